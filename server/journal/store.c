/* See store.h. */
#include "journal/store.h"

#include "base/utf8.h"
#include "journal/inspect.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One row: a step of the most vertices with all that it can change. */
static const int ROW_BYTES_MAX = 640 * 1000 * 1000;

static enum skd_status status_of(int code)
{
    if (code == SQLITE_IOERR_SHORT_READ || code == SQLITE_IOERR_CORRUPTFS)
        return SKD_DAMAGED;
    switch (code & 0xff) {
    case SQLITE_NOMEM:
        return SKD_NO_MEMORY;
    case SQLITE_IOERR:
    case SQLITE_FULL:
    case SQLITE_CANTOPEN:
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_AUTH:
    case SQLITE_PROTOCOL:
    case SQLITE_NOLFS:
        return SKD_FILE_IO;
    default:
        return SKD_DAMAGED;
    }
}

enum skd_status skd_store_fail(struct skd_store *store, struct skd_error *error)
{
    if (store->db == NULL)
        return skd_fail_memory(error, "a session's file");
    const char *path = sqlite3_db_filename(store->db, "main");
    enum skd_status status = status_of(sqlite3_extended_errcode(store->db));
    if (status == SKD_NO_MEMORY)
        return skd_fail_memory(error, "a session's file");
    return skd_fail(error, status, "\"%s\": %s", path != NULL ? path : "",
                    sqlite3_errmsg(store->db));
}

enum skd_status skd_store_damaged(struct skd_store *store, const char *what,
                                  struct skd_error *error)
{
    if (sqlite3_errcode(store->db) == SQLITE_NOMEM)
        return skd_fail_memory(error, "a session's file");
    return skd_fail(error, SKD_DAMAGED, "%s cannot be read", what);
}

enum skd_status skd_store_command(struct skd_store *store, const char *sql, struct skd_error *error)
{
    return sqlite3_exec(store->db, sql, NULL, NULL, NULL) == SQLITE_OK
               ? SKD_OK
               : skd_store_fail(store, error);
}

/* Nothing that a file brings along is run, and no file makes us ask for more than a row may need.
 */
static enum skd_status restrict_to(struct skd_store *store, struct skd_error *error)
{
    sqlite3 *db = store->db;
    (void)sqlite3_extended_result_codes(db, 1);
    (void)sqlite3_limit(db, SQLITE_LIMIT_LENGTH, ROW_BYTES_MAX);
    (void)sqlite3_limit(db, SQLITE_LIMIT_ATTACHED, 0);
    (void)sqlite3_limit(db, SQLITE_LIMIT_TRIGGER_DEPTH, 0);
    (void)sqlite3_limit(db, SQLITE_LIMIT_WORKER_THREADS, 0);
    static const struct {
        int option, value;
    } settings[] = {
        {SQLITE_DBCONFIG_DEFENSIVE, 1},
        {SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0},
        {SQLITE_DBCONFIG_ENABLE_TRIGGER, 0},
        {SQLITE_DBCONFIG_ENABLE_VIEW, 0},
        {SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION, 0},
        {SQLITE_DBCONFIG_WRITABLE_SCHEMA, 0},
        {SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1},
    };
    for (size_t i = 0; i < sizeof settings / sizeof *settings; i++) {
        if (sqlite3_db_config(db, settings[i].option, settings[i].value, NULL) != SQLITE_OK)
            return skd_store_fail(store, error);
    }
    return skd_store_command(store,
                             "PRAGMA locking_mode=EXCLUSIVE; " /* before anything is read */
                             "PRAGMA cell_size_check=ON; PRAGMA mmap_size=0;"
                             "PRAGMA temp_store=MEMORY; PRAGMA secure_delete=OFF;"
                             "PRAGMA wal_autocheckpoint=0; PRAGMA cache_size=-4096",
                             error);
}

/* The path as a URI that says "nobody writes to it, and nor do we". */
static char *immutable_uri(const char *path)
{
    char *uri = malloc(3 * strlen(path) + sizeof "file:?immutable=1"), *out = uri;
    if (uri == NULL)
        return NULL;
    out += sprintf(out, "file:");
    for (; *path != '\0'; path++)
        out += strchr("%?#", *path) != NULL ? sprintf(out, "%%%02X", (unsigned)(unsigned char)*path)
                                            : sprintf(out, "%c", *path);
    (void)sprintf(out, "?immutable=1");
    return uri;
}

static int open_file(struct skd_store *store, const char *path, bool immutable)
{
    int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_NOFOLLOW;
    if (!immutable)
        return sqlite3_open_v2(path, &store->db, flags | SQLITE_OPEN_READWRITE, NULL);
    char *uri = immutable_uri(path);
    int result = uri == NULL
                     ? SQLITE_NOMEM
                     : sqlite3_open_v2(uri, &store->db,
                                       flags | SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, NULL);
    free(uri);
    return result;
}

/* Brings what an older skind wrote up to date in memory; the file stays what it is. */
static enum skd_status upgrade_copy(struct skd_store *store, int version, struct skd_error *error)
{
    struct skd_store copy = {0};
    enum skd_status status = SKD_OK;
    if (sqlite3_open_v2(":memory:", &copy.db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, NULL) !=
        SQLITE_OK)
        status = skd_store_fail(&copy, error);
    if (status == SKD_OK)
        status = restrict_to(&copy, error);
    if (status == SKD_OK) {
        sqlite3_backup *backup = sqlite3_backup_init(copy.db, "main", store->db, "main");
        (void)sqlite3_backup_step(backup, -1);
        if (backup == NULL || sqlite3_backup_finish(backup) != SQLITE_OK ||
            skd_schema_upgrade(copy.db, version) != SQLITE_OK)
            status = skd_store_fail(&copy, error);
    }
    if (status == SKD_OK) {
        copy.bytes = store->bytes;
        skd_store_close(store);
        *store = copy;
    } else {
        skd_store_close(&copy);
    }
    return status;
}

static enum skd_status read_version(struct skd_store *store, int *version, struct skd_error *error)
{
    sqlite3_stmt *row = NULL;
    if (sqlite3_prepare_v2(store->db, "PRAGMA user_version", -1, &row, NULL) != SQLITE_OK ||
        sqlite3_step(row) != SQLITE_ROW) {
        sqlite3_finalize(row);
        return skd_store_fail(store, error);
    }
    *version = sqlite3_column_int(row, 0);
    sqlite3_finalize(row);
    return SKD_OK;
}

static enum skd_status check(struct skd_store *store, const char *path, bool *is_old,
                             struct skd_error *error)
{
    int version = 0;
    bool is_ours;
    enum skd_status status = read_version(store, &version, error);
    if (status != SKD_OK)
        return status;
    if (version > SKD_JOURNAL_VERSION)
        return skd_inspect_newer(path, version, error);
    if (version < 0)
        return skd_fail(error, SKD_DAMAGED, "\"%s\" says that it is of version %d", path, version);
    *is_old = version < SKD_JOURNAL_VERSION;
    if (*is_old && (status = upgrade_copy(store, version, error)) != SKD_OK)
        return status;
    if (skd_schema_check(store->db, &is_ours) != SQLITE_OK)
        return skd_store_fail(store, error);
    return is_ours ? SKD_OK
                   : skd_fail(error, SKD_DAMAGED,
                              "\"%s\" has other tables than a session's file has", path);
}

enum skd_status skd_store_open(struct skd_store *store, const char *path, enum skd_store_mode mode,
                               bool *is_old, struct skd_error *error)
{
    struct skd_inspection file;
    char resolved[SKD_PATH_BYTES_MAX];
    *store = (struct skd_store){0};
    enum skd_status status = skd_inspect_resolve(path, resolved, error);
    if (status == SKD_OK && mode != SKD_STORE_NEW)
        status = skd_inspect(resolved, &file, error);
    if (status != SKD_OK)
        return status;
    store->bytes = mode != SKD_STORE_NEW ? file.bytes + file.log_bytes : 0;
    bool immutable = mode == SKD_STORE_READ && file.log_bytes == 0;
    if (open_file(store, resolved, immutable) != SQLITE_OK)
        return skd_store_fail(store, error);
    if ((status = restrict_to(store, error)) != SKD_OK)
        return status;
    if (mode == SKD_STORE_NEW) {
        status = skd_store_command(store,
                                   "PRAGMA page_size=4096; PRAGMA journal_mode=MEMORY;"
                                   "PRAGMA synchronous=OFF; BEGIN",
                                   error);
        if (status == SKD_OK && skd_schema_upgrade(store->db, 0) != SQLITE_OK)
            status = skd_store_fail(store, error);
        return status;
    }
    bool old = false;
    status = check(store, resolved, &old, error);
    if (is_old != NULL)
        *is_old = old;
    if (status == SKD_OK && mode == SKD_STORE_APPEND)
        status = old ? skd_fail(error, SKD_FILE_IO, "\"%s\" was written by an older skind", path)
                     : skd_store_command(store, "PRAGMA journal_mode=WAL", error);
    return status;
}

void skd_store_drop_log(struct skd_store *store)
{
    if (store->db != NULL)
        (void)sqlite3_db_config(store->db, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 0, NULL);
}

void skd_store_close(struct skd_store *store)
{
    for (int i = 0; i < SKD_SQL_COUNT; i++)
        sqlite3_finalize(store->statements[i]);
    (void)sqlite3_close(store->db);
    *store = (struct skd_store){0};
}

sqlite3_stmt *skd_store_statement(struct skd_store *store, enum skd_sql sql)
{
    static const char *const texts[] = {
#define SKD_SQL_TEXT(name, text) text,
        SKD_SQL(SKD_SQL_TEXT)
#undef SKD_SQL_TEXT
    };
    sqlite3_stmt **statement = &store->statements[sql];
    if (*statement == NULL)
        (void)sqlite3_prepare_v3(store->db, texts[sql], -1, SQLITE_PREPARE_PERSISTENT, statement,
                                 NULL);
    else
        (void)sqlite3_reset(*statement);
    return *statement;
}

enum skd_status skd_store_next(struct skd_store *store, sqlite3_stmt *statement, bool *has_row,
                               struct skd_error *error)
{
    int result = statement != NULL ? sqlite3_step(statement) : SQLITE_ERROR;
    *has_row = result == SQLITE_ROW;
    if (result == SQLITE_ROW)
        return SKD_OK;
    enum skd_status status = result == SQLITE_DONE ? SKD_OK : skd_store_fail(store, error);
    (void)sqlite3_reset(statement);
    return status;
}

enum skd_status skd_store_run(struct skd_store *store, sqlite3_stmt *statement, int bound,
                              struct skd_error *error)
{
    bool has_row;
    if (statement == NULL || bound != SQLITE_OK) {
        enum skd_status status = skd_store_fail(store, error);
        /* A parameter that was not bound would be written as NULL. */
        return status != SKD_DAMAGED ? status : skd_fail_memory(error, "a session's file");
    }
    return skd_store_next(store, statement, &has_row, error);
}

bool skd_column_number(sqlite3_stmt *row, int column, uint64_t most, uint64_t *number)
{
    sqlite3_int64 value = sqlite3_column_int64(row, column);
    *number = (uint64_t)value;
    return sqlite3_column_type(row, column) == SQLITE_INTEGER && value >= 0 &&
           (uint64_t)value <= most;
}

bool skd_column_sum(sqlite3_stmt *row, int column, uint64_t *sum)
{
    *sum = (uint64_t)sqlite3_column_int64(row, column);
    return sqlite3_column_type(row, column) == SQLITE_INTEGER;
}

bool skd_column_real(sqlite3_stmt *row, int column, double *number)
{
    *number = sqlite3_column_double(row, column);
    return sqlite3_column_type(row, column) == SQLITE_FLOAT && isfinite(*number);
}

bool skd_column_text(sqlite3_stmt *row, int column, size_t most, const char **text)
{
    if (sqlite3_column_type(row, column) != SQLITE_TEXT)
        return false;
    *text = (const char *)sqlite3_column_text(row, column);
    size_t bytes = (size_t)sqlite3_column_bytes(row, column);
    return *text != NULL && bytes <= most && strlen(*text) == bytes &&
           skd_utf8_valid_bytes(*text, bytes) == bytes;
}

bool skd_column_blob(sqlite3_stmt *row, int column, size_t bytes, const void **blob)
{
    if (sqlite3_column_type(row, column) != SQLITE_BLOB)
        return false;
    *blob = sqlite3_column_blob(row, column);
    return (size_t)sqlite3_column_bytes(row, column) == bytes && (*blob != NULL || bytes == 0);
}

int skd_bind_array(sqlite3_stmt *statement, int place, const void *array, size_t bytes)
{
    return sqlite3_bind_blob64(statement, place, bytes > 0 ? array : "", bytes, SQLITE_STATIC);
}

int skd_bind_text(sqlite3_stmt *statement, int place, const char *text)
{
    return sqlite3_bind_text(statement, place, text, -1, SQLITE_STATIC);
}

int skd_bind_number(sqlite3_stmt *statement, int place, uint64_t number)
{
    return sqlite3_bind_int64(statement, place, (sqlite3_int64)number);
}
