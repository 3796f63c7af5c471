/* See schema.h. */
#include "journal/schema.h"

#include <stdio.h>
#include <string.h>

/* X(table, its columns in version 1, those that came later, in the words of ALTER TABLE) */
#define SKD_TABLES(X)                                                                              \
    X(session,                                                                                     \
      "id INTEGER PRIMARY KEY, name TEXT, source TEXT, slots INTEGER, vertices INTEGER, "          \
      "bones INTEGER, rig_bytes INTEGER, parts INTEGER, sheets INTEGER, revision INTEGER, "        \
      "reduced INTEGER, filled INTEGER, empty INTEGER, cut REAL, measured INTEGER, mean REAL, "    \
      "most REAL, sum INTEGER",                                                                    \
      "")                                                                                          \
    X(state,                                                                                       \
      "id INTEGER PRIMARY KEY, instance TEXT, revision INTEGER, first INTEGER, position INTEGER, " \
      "count INTEGER, exported INTEGER, durability INTEGER, history_bytes INTEGER, "               \
      "chain INTEGER, sum INTEGER",                                                                \
      "")                                                                                          \
    X(chunks, "id INTEGER PRIMARY KEY, sum INTEGER, body BLOB", "")                                \
    X(poses, "id INTEGER PRIMARY KEY, name TEXT, matrices BLOB, sum INTEGER", "")                  \
    X(named, "place INTEGER PRIMARY KEY, pose INTEGER, sum INTEGER", "")                           \
    X(base_sheets,                                                                                 \
      "id INTEGER PRIMARY KEY, kind INTEGER, pose INTEGER, count INTEGER, sum INTEGER", "")        \
    X(steps,                                                                                       \
      "id INTEGER PRIMARY KEY, cause INTEGER, client TEXT, client_id TEXT, count INTEGER, "        \
      "sheets INTEGER, vertices BLOB, weights BLOB, joints BLOB, rest BLOB, sum INTEGER",          \
      ", user TEXT")                                                                               \
    X(step_sheets,                                                                                 \
      "id INTEGER PRIMARY KEY, kind INTEGER, pose INTEGER, count INTEGER, vertices BLOB, "         \
      "rows BLOB",                                                                                 \
      "")                                                                                          \
    X(history, "place INTEGER PRIMARY KEY, step INTEGER, revision INTEGER, chain INTEGER", "")     \
    X(guard, "id INTEGER PRIMARY KEY, candidates INTEGER, count INTEGER, body BLOB, sum INTEGER",  \
      "")                                                                                          \
    X(remembered,                                                                                  \
      "id INTEGER PRIMARY KEY, client TEXT, sequence INTEGER, revision INTEGER, answer TEXT, "     \
      "sum INTEGER",                                                                               \
      "")                                                                                          \
    X(sources, "number INTEGER PRIMARY KEY, bytes INTEGER, sum INTEGER", "")

static const struct {
    const char *name;
    const char *sql;
} tables[] = {
#define SKD_TABLE_ENTRY(name, first, later) {#name, "CREATE TABLE " #name "(" first later ")"},
    SKD_TABLES(SKD_TABLE_ENTRY)
#undef SKD_TABLE_ENTRY
};

enum { TABLE_COUNT = sizeof tables / sizeof *tables };

/* What makes tables of version n + 1 out of those of version n. */
static const char *const upgrades[SKD_JOURNAL_VERSION] = {
#define SKD_TABLE_SQL(name, first, later) "CREATE TABLE " #name "(" first ");"
    SKD_TABLES(SKD_TABLE_SQL),
#undef SKD_TABLE_SQL
    "ALTER TABLE steps ADD COLUMN user TEXT", /* the person who made a step */
};

int skd_schema_upgrade(sqlite3 *db, int version)
{
    char stamp[80];
    int result = SQLITE_OK;
    for (; version < SKD_JOURNAL_VERSION && result == SQLITE_OK; version++)
        result = sqlite3_exec(db, upgrades[version], NULL, NULL, NULL);
    if (result != SQLITE_OK)
        return result;
    (void)snprintf(stamp, sizeof stamp, "PRAGMA application_id=%d; PRAGMA user_version=%d",
                   SKD_JOURNAL_APPLICATION, SKD_JOURNAL_VERSION);
    return sqlite3_exec(db, stamp, NULL, NULL, NULL);
}

static bool is_text(sqlite3_stmt *row, int column, const char *wanted)
{
    const char *text = (const char *)sqlite3_column_text(row, column);
    return text != NULL && strcmp(text, wanted) == 0;
}

static bool is_table_of_ours(sqlite3_stmt *row)
{
    for (int i = 0; i < TABLE_COUNT; i++) {
        if (is_text(row, 1, tables[i].name))
            return is_text(row, 0, "table") && is_text(row, 2, tables[i].name) &&
                   is_text(row, 3, tables[i].sql);
    }
    return false;
}

int skd_schema_check(sqlite3 *db, bool *is_ours)
{
    sqlite3_stmt *rows = NULL;
    int found = 0;
    *is_ours = true;
    int result = sqlite3_prepare_v2(db, "SELECT type, name, tbl_name, sql FROM sqlite_schema", -1,
                                    &rows, NULL);
    if (result != SQLITE_OK)
        return result;
    /* Names are unique, so as many tables of ours as there are is all of them. */
    for (; (result = sqlite3_step(rows)) == SQLITE_ROW && *is_ours; found++)
        *is_ours = is_table_of_ours(rows);
    *is_ours = *is_ours && found == TABLE_COUNT;
    sqlite3_finalize(rows);
    return result == SQLITE_DONE || result == SQLITE_ROW ? SQLITE_OK : result;
}
