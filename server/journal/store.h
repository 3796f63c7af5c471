/* A session's file as SQLite has it: opened with all that can be switched off switched off, and its
 * statements prepared when they are first needed.
 *
 * Stage: journal. Thread: one at a time: the worker that reads or writes a whole file, or the
 * writer.
 */
#ifndef SKD_JOURNAL_STORE_H
#define SKD_JOURNAL_STORE_H

#include "base/error.h"
#include "journal/schema.h"
#include "protocol/limits.h"

#include <stddef.h>
#include <stdint.h>

#define SKD_SQL(X)                                                                                 \
    X(BEGIN, "BEGIN IMMEDIATE")                                                                    \
    X(COMMIT, "COMMIT")                                                                            \
    X(SESSION_WRITE, "INSERT INTO session VALUES(1,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)")            \
    X(SESSION_READ, "SELECT name, source, slots, vertices, bones, rig_bytes, parts, "              \
                    "sheets, revision, reduced, filled, empty, cut, measured, mean, most, sum "    \
                    "FROM session WHERE id=1")                                                     \
    X(STATE_WRITE, "INSERT OR REPLACE INTO state VALUES(1,?,?,?,?,?,?,?,?,?,?)")                   \
    X(STATE_READ, "SELECT instance, revision, first, position, count, exported, durability, "      \
                  "history_bytes, chain, sum FROM state WHERE id=1")                               \
    X(CHUNK_WRITE, "INSERT INTO chunks VALUES(?,?,?)")                                             \
    X(CHUNKS_READ, "SELECT id, sum, body FROM chunks")                                             \
    X(CHUNK_READ, "SELECT sum, body FROM chunks WHERE id=?")                                       \
    X(POSE_WRITE, "INSERT INTO poses VALUES(?,?,?,?)")                                             \
    X(POSE_DELETE, "DELETE FROM poses WHERE id=?")                                                 \
    X(POSES_READ, "SELECT id, name, matrices, sum FROM poses ORDER BY id")                         \
    X(NAMED_WRITE, "INSERT INTO named VALUES(?,?,?)")                                              \
    X(NAMED_DELETE, "DELETE FROM named WHERE place=?")                                             \
    X(NAMED_READ, "SELECT place, pose, named.sum, name FROM named LEFT JOIN poses "                \
                  "ON poses.id=pose ORDER BY place")                                               \
    X(BASE_SHEET_WRITE, "INSERT INTO base_sheets VALUES(?,?,?,?,?)")                               \
    X(BASE_SHEET_READ, "SELECT kind, pose, count, sum FROM base_sheets WHERE id=?")                \
    X(BASE_SHEETS_READ, "SELECT pose FROM base_sheets")                                            \
    X(STEP_WRITE, "INSERT INTO steps VALUES(?,?,?,?,?,?,?,?,?,?,?,?)")                             \
    X(STEP_READ,                                                                                   \
      "SELECT cause, client, coalesce(user, ''), client_id, count, sheets, vertices, weights, "    \
      "joints, rest, sum FROM steps WHERE id=?")                                                   \
    X(STEP_SUMS_READ, "SELECT id, sum FROM steps ORDER BY id")                                     \
    X(STEP_DELETE, "DELETE FROM steps WHERE id=?")                                                 \
    X(STEP_SHEET_WRITE, "INSERT INTO step_sheets VALUES(?,?,?,?,?,?)")                             \
    X(STEP_SHEET_READ, "SELECT kind, pose, count, vertices, rows FROM step_sheets WHERE id=?")     \
    X(STEP_SHEETS_DELETE, "DELETE FROM step_sheets WHERE id BETWEEN ? AND ?")                      \
    X(STEP_SHEET_POSES_READ, "SELECT pose FROM step_sheets")                                       \
    X(HISTORY_WRITE, "INSERT OR REPLACE INTO history VALUES(?,?,?,?)")                             \
    X(HISTORY_DELETE, "DELETE FROM history WHERE place>=?")                                        \
    X(HISTORY_READ, "SELECT place, step, revision, chain FROM history ORDER BY place")             \
    X(GUARD_WRITE, "INSERT INTO guard VALUES(1,?,?,?,?)")                                          \
    X(GUARD_DELETE, "DELETE FROM guard")                                                           \
    X(GUARD_READ, "SELECT candidates, count, body, sum FROM guard WHERE id=1")                     \
    X(REMEMBERED_WRITE, "INSERT INTO remembered VALUES(?,?,?,?,?,?)")                              \
    X(REMEMBERED_DELETE, "DELETE FROM remembered WHERE id=?")                                      \
    X(REMEMBERED_READ, "SELECT id, client, sequence, revision, answer, sum FROM remembered "       \
                       "ORDER BY id")                                                              \
    X(SOURCE_WRITE, "INSERT INTO sources VALUES(?,?,?)")                                           \
    X(SOURCE_READ, "SELECT bytes, sum FROM sources WHERE number=?")                                \
    X(CHECK, "PRAGMA quick_check(1)")

enum skd_sql {
#define SKD_SQL_ENUM(name, text) SKD_SQL_##name,
    SKD_SQL(SKD_SQL_ENUM)
#undef SKD_SQL_ENUM
        SKD_SQL_COUNT
};

struct skd_store {
    sqlite3 *db;    /* NULL: not open */
    uint64_t bytes; /* of the file and its log as they were opened: nothing in it is larger */
    sqlite3_stmt *statements[SKD_SQL_COUNT];
};

enum skd_store_mode {
    SKD_STORE_NEW,    /* an empty file is there; gets our tables */
    SKD_STORE_READ,   /* nothing of the file or its log is changed */
    SKD_STORE_APPEND, /* with a log (WAL) that only a checkpoint folds into the file */
};

/* Opens a file; READ refuses what has other tables than ours, makes a copy of an older version in
 * memory and brings that up to date (*is_old). Close in any case. Errors: SKD_NO_FILE,
 * SKD_FILE_IO, SKD_DAMAGED, SKD_NEWER, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_store_open(struct skd_store *store, const char *path,
                                              enum skd_store_mode mode, bool *is_old,
                                              struct skd_error *error);
/* From now on closing removes the log, which a checkpoint has emptied. */
void skd_store_drop_log(struct skd_store *store);
/* Leaves the log as it is. */
void skd_store_close(struct skd_store *store);

/* A statement, ready to be bound anew; NULL where it cannot be prepared (skd_store_fail tells). */
sqlite3_stmt *skd_store_statement(struct skd_store *store, enum skd_sql sql);

/* Runs a bound statement that returns no row. `bound` is what binding returned, ored together. */
SKD_MUST_CHECK enum skd_status skd_store_run(struct skd_store *store, sqlite3_stmt *statement,
                                             int bound, struct skd_error *error);

/* Takes the next row of a statement into *has_row; the last one's statement is reset. */
SKD_MUST_CHECK enum skd_status skd_store_next(struct skd_store *store, sqlite3_stmt *statement,
                                              bool *has_row, struct skd_error *error);

/* The connection's last failure as an error: SKD_DAMAGED where the file makes no sense,
 * SKD_NO_MEMORY, else SKD_FILE_IO. */
enum skd_status skd_store_fail(struct skd_store *store, struct skd_error *error);

/* A row that is missing or is not what it should be: SKD_DAMAGED, or SKD_NO_MEMORY where that was
 * why its columns could not be had. `what` begins the sentence. */
enum skd_status skd_store_damaged(struct skd_store *store, const char *what,
                                  struct skd_error *error);

/* Runs commands that take nothing and return nothing. */
SKD_MUST_CHECK enum skd_status skd_store_command(struct skd_store *store, const char *sql,
                                                 struct skd_error *error);

/* Columns, held against what they should be: false where they are something else. A text is valid
 * UTF-8 without a 0 in it, of at most `most` bytes; it and a blob live until the statement goes on.
 * A blob of 0 bytes may be NULL. */
SKD_MUST_CHECK bool skd_column_number(sqlite3_stmt *row, int column, uint64_t most,
                                      uint64_t *number);
SKD_MUST_CHECK bool skd_column_sum(sqlite3_stmt *row, int column, uint64_t *sum);
SKD_MUST_CHECK bool skd_column_real(sqlite3_stmt *row, int column, double *number);
SKD_MUST_CHECK bool skd_column_text(sqlite3_stmt *row, int column, size_t most, const char **text);
SKD_MUST_CHECK bool skd_column_blob(sqlite3_stmt *row, int column, size_t bytes, const void **blob);

/* Binds an array where it is; `bytes` may be 0. */
int skd_bind_array(sqlite3_stmt *statement, int place, const void *array, size_t bytes);
int skd_bind_text(sqlite3_stmt *statement, int place, const char *text);
int skd_bind_number(sqlite3_stmt *statement, int place, uint64_t number);

#endif
