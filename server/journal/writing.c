/* See writing.h. */
#include "journal/writing.h"

#include "journal/inspect.h"
#include "journal/step_rows.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* ---- opening ----------------------------------------------------------------------------------
 */

/* The row of a place that is not forgotten. */
static struct skd_history_row *row_at(const struct skd_writing *writing, uint64_t place)
{
    SKD_ASSERT(place >= writing->forgotten);
    return &writing->history[place - writing->forgotten];
}

/* What the row of a place is chained to. */
static uint64_t chain_before(const struct skd_writing *writing, uint64_t place)
{
    if (place > writing->forgotten)
        return row_at(writing, place - 1)->chain;
    return place > 0 ? writing->forgotten_chain : writing->session.sum;
}

/* Lets go of rows that no undo comes back to, once they are the greater part. */
static void forget_rows(struct skd_writing *writing)
{
    const struct skd_state_row *state = &writing->state;
    const size_t kept = (size_t)(state->count - state->first), capacity = 2 * kept + 16;
    if (state->first - writing->forgotten < capacity)
        return;
    const uint64_t chain = chain_before(writing, state->first);
    memmove(writing->history, row_at(writing, state->first), kept * sizeof *writing->history);
    writing->forgotten = state->first;
    writing->forgotten_chain = chain;
    void *history = realloc(writing->history, capacity * sizeof *writing->history);
    if (history == NULL)
        return; /* it stays as large as it was */
    writing->history = history;
    writing->history_capacity = capacity;
}

static enum skd_status make_room(struct skd_writing *writing, struct skd_error *error)
{
    const size_t count = (size_t)(writing->state.count - writing->forgotten);
    if (count < writing->history_capacity)
        return SKD_OK;
    size_t capacity = 2 * count + 16;
    void *history = realloc(writing->history, capacity * sizeof *writing->history);
    if (history == NULL)
        return skd_fail_memory(error, "the list of steps");
    writing->history = history;
    writing->history_capacity = capacity;
    return SKD_OK;
}

/* The checksums of the steps, which the history's rows are chained over. */
static enum skd_status read_sums(struct skd_writing *writing, struct skd_error *error)
{
    struct skd_store *store = &writing->store;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_STEP_SUMS_READ);
    bool has_row;
    enum skd_status status;
    uint64_t id, sum, last = 0;
    size_t found = 0;
    /* Ids stand in the order of the history but for steps that were undone out of order, so each
     * step is looked for near where the last was found. */
    size_t count = (size_t)writing->state.count, at = 0;
    while ((status = skd_store_next(store, row, &has_row, error)) == SKD_OK && has_row) {
        if (!skd_column_number(row, 0, INT64_MAX >> 11, &id) || !skd_column_sum(row, 1, &sum))
            break;
        for (size_t tried = 0; tried < count && writing->history[at].step != id; tried++)
            at = at + 1 < count ? at + 1 : 0;
        if (count == 0 || writing->history[at].step != id)
            break;
        writing->history[at].sum = sum;
        last = id;
        found++;
    }
    (void)sqlite3_reset(row);
    writing->next_step = last + 1;
    return status == SKD_OK && (found != count || has_row)
               ? skd_store_damaged(store, "the history", error)
               : status;
}

static enum skd_status read_history(struct skd_writing *writing, struct skd_error *error)
{
    struct skd_store *store = &writing->store;
    uint64_t count = writing->state.count, place, chain = writing->session.sum;
    bool has_row;
    enum skd_status status;
    writing->state.count = 0;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_HISTORY_READ);
    while ((status = skd_store_next(store, row, &has_row, error)) == SKD_OK && has_row) {
        if ((status = make_room(writing, error)) != SKD_OK)
            break;
        struct skd_history_row *item = &writing->history[writing->state.count];
        if (!skd_column_number(row, 0, INT32_MAX, &place) || place != writing->state.count ||
            !skd_column_number(row, 1, INT64_MAX, &item->step) ||
            !skd_column_number(row, 2, INT64_MAX, &item->revision) ||
            !skd_column_sum(row, 3, &item->chain))
            break;
        writing->state.count++;
    }
    (void)sqlite3_reset(row);
    if (status == SKD_OK && (has_row || writing->state.count != count))
        return skd_store_damaged(store, "the history", error);
    if (status == SKD_OK)
        status = read_sums(writing, error);
    for (uint64_t i = 0; i < count && status == SKD_OK; i++) {
        chain = skd_history_chain(chain, i, &writing->history[i]);
        if (chain != writing->history[i].chain)
            status = skd_fail(error, SKD_DAMAGED, "the history is not what it was");
    }
    if (status == SKD_OK)
        forget_rows(writing);
    return status;
}

static int note_log_pages(void *user, sqlite3 *db, const char *name, int pages)
{
    struct skd_writing *writing = user;
    (void)db;
    (void)name;
    writing->log_bytes = (uint64_t)pages * 4096;
    return SQLITE_OK;
}

enum skd_status skd_writing_open(struct skd_writing *writing, const char *path,
                                 struct skd_error *error)
{
    size_t damaged;
    *writing = (struct skd_writing){0};
    struct skd_store *store = &writing->store;
    enum skd_status status = skd_store_open(store, path, SKD_STORE_APPEND, NULL, error);
    if (status == SKD_OK)
        status = skd_session_row_read(store, &writing->session, error);
    if (status == SKD_OK)
        status = skd_state_row_read(store, writing->session.sum, &writing->state, error);
    if (status == SKD_OK)
        status = read_history(writing, error);
    if (status != SKD_OK)
        return status;
    writing->poses.bone_count = (size_t)writing->session.bones;
    status = skd_pose_rows_read(store, &writing->poses, false, &damaged, error);
    if (status == SKD_OK && damaged > 0)
        status = skd_fail(error, SKD_DAMAGED, "%zu poses cannot be read", damaged);
    if (status == SKD_OK)
        status = skd_remembered_rows_open(store, &writing->remembered, error);
    if (status == SKD_OK)
        (void)sqlite3_wal_hook(store->db, note_log_pages, writing);
    return status;
}

void skd_writing_close(struct skd_writing *writing)
{
    skd_store_close(&writing->store);
    skd_pose_rows_finish(&writing->poses);
    skd_remembered_rows_finish(&writing->remembered);
    free(writing->history);
    *writing = (struct skd_writing){0};
}

/* ---- records ----------------------------------------------------------------------------------
 */

/* Writes the places from `first` on with their chain. */
static enum skd_status chain_from(struct skd_writing *writing, uint64_t first,
                                  struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (uint64_t i = first; i < writing->state.count && status == SKD_OK; i++) {
        struct skd_history_row *row = row_at(writing, i);
        row->chain = skd_history_chain(chain_before(writing, i), i, row);
        status = skd_history_row_write(&writing->store, i, row, error);
    }
    return status;
}

static enum skd_status forget_undone(struct skd_writing *writing, struct skd_error *error)
{
    struct skd_state_row *state = &writing->state;
    if (state->count == state->position)
        return SKD_OK;
    sqlite3_stmt *row = skd_store_statement(&writing->store, SKD_SQL_HISTORY_DELETE);
    enum skd_status status =
        skd_store_run(&writing->store, row, skd_bind_number(row, 1, state->position), error);
    for (; state->count > state->position && status == SKD_OK; state->count--)
        status =
            skd_step_row_delete(&writing->store, row_at(writing, state->count - 1)->step, error);
    return status;
}

static enum skd_status disagree(struct skd_error *error)
{
    return skd_fail(error, SKD_INTERNAL, "the file's history is not the session's");
}

static enum skd_status drop(struct skd_writing *writing, size_t dropped, struct skd_error *error)
{
    if (dropped > writing->state.position - writing->state.first)
        return disagree(error);
    writing->state.first += dropped;
    forget_rows(writing);
    return SKD_OK;
}

static enum skd_status put_step(struct skd_writing *writing, const struct skd_record *record,
                                struct skd_error *error)
{
    struct skd_state_row *state = &writing->state;
    struct skd_history_row item = {.step = writing->next_step++, .revision = record->revision};
    enum skd_status status = forget_undone(writing, error);
    if (status == SKD_OK)
        status = make_room(writing, error);
    if (status == SKD_OK)
        status = skd_step_row_write(&writing->store, &writing->poses, item.step, record->step,
                                    record->poses, &item.sum, error);
    if (status != SKD_OK)
        return status;
    *row_at(writing, state->count++) = item;
    state->position = state->count;
    state->revision = record->revision;
    status = chain_from(writing, state->count - 1, error);
    return status == SKD_OK ? drop(writing, record->dropped, error) : status;
}

/* Takes the step at `from` to `to`, those in between one place towards where it was. No state in
 * which they stand like that, but for the last one, was ever told. */
static void rotate(struct skd_history_row *history, uint64_t from, uint64_t to)
{
    struct skd_history_row moved = history[from];
    for (; from < to; from++)
        history[from] = history[from + 1];
    for (; from > to; from--)
        history[from] = history[from - 1];
    history[to] = moved;
}

static enum skd_status put_move(struct skd_writing *writing, const struct skd_record *record,
                                struct skd_error *error)
{
    struct skd_state_row *state = &writing->state;
    bool undo = record->direction < 0;
    uint64_t place = state->first + record->index;
    uint64_t boundary = undo ? state->position - 1 : state->position;
    if (undo ? place >= state->position : place < state->position || place >= state->count)
        return disagree(error);
    enum skd_status status = SKD_OK;
    if (place != boundary) {
        uint64_t low = place < boundary ? place : boundary, high = place + boundary - low;
        rotate(writing->history, place - writing->forgotten, boundary - writing->forgotten);
        for (uint64_t i = low; i <= high; i++)
            row_at(writing, i)->revision = 0;
        uint64_t top = undo ? boundary : boundary + 1; /* steps that are done now */
        if (top > low)
            row_at(writing, top - 1)->revision = record->revision;
        status = chain_from(writing, low, error);
    }
    state->position = undo ? boundary : boundary + 1;
    state->revision = record->revision;
    return status;
}

static enum skd_status put(struct skd_writing *writing, const struct skd_record *record,
                           struct skd_error *error)
{
    switch (record->kind) {
    case SKD_RECORD_STEP:
        return put_step(writing, record, error);
    case SKD_RECORD_MOVE:
        return put_move(writing, record, error);
    case SKD_RECORD_POSE:
        return skd_pose_rows_put(&writing->store, &writing->poses, record->poses[0], error);
    case SKD_RECORD_GUARD:
        return skd_guard_row_write(&writing->store, &record->guard, error);
    case SKD_RECORD_EXPORTED:
        writing->state.exported = record->revision;
        return SKD_OK;
    case SKD_RECORD_SETTINGS:
        writing->state.durability = record->durability;
        writing->state.history_bytes = record->history_bytes;
        return drop(writing, record->dropped, error);
    case SKD_RECORD_ANSWER:
        return SKD_OK;
    case SKD_RECORD_SUSPENDED:
    case SKD_RECORD_END:
        break;
    }
    SKD_ASSERT(false); /* a record of the journal's own is never put */
    return SKD_INTERNAL;
}

enum skd_status skd_writing_put(struct skd_writing *writing, const struct skd_record *record,
                                struct skd_error *error)
{
    enum skd_status status = put(writing, record, error);
    if (status == SKD_OK && record->answer != NULL)
        status = skd_remembered_rows_add(&writing->store, &writing->remembered, record->client_id,
                                         record->sequence, writing->state.revision, record->answer,
                                         error);
    return status;
}

/* ---- transactions -----------------------------------------------------------------------------
 */

enum skd_status skd_writing_begin(struct skd_writing *writing, enum skd_durability durability,
                                  struct skd_error *error)
{
    bool full = durability == SKD_DURABILITY_FULL;
    if (full && writing->is_ahead) {
        enum skd_status status = skd_writing_sync(writing, error);
        if (status != SKD_OK)
            return status;
    }
    enum skd_status status = skd_store_command(
        &writing->store, full ? "PRAGMA synchronous=FULL" : "PRAGMA synchronous=NORMAL", error);
    writing->is_full = full;
    if (status != SKD_OK)
        return status;
    sqlite3_stmt *row = skd_store_statement(&writing->store, SKD_SQL_BEGIN);
    return skd_store_run(&writing->store, row, SQLITE_OK, error);
}

/* Looks at the files by name: opening one here would drop SQLite's lock on it. */
static void note_bytes(struct skd_writing *writing)
{
    const char *names[] = {sqlite3_db_filename(writing->store.db, "main"), NULL};
    names[1] = sqlite3_filename_wal(names[0]);
    writing->file_bytes = 0;
    for (size_t i = 0; i < 2; i++) {
        struct stat status;
        if (stat(names[i], &status) == 0)
            writing->file_bytes += (uint64_t)status.st_size;
    }
}

enum skd_status skd_writing_commit(struct skd_writing *writing, struct skd_error *error)
{
    struct skd_state_row *state = &writing->state;
    state->chain = chain_before(writing, state->count);
    enum skd_status status =
        skd_state_row_write(&writing->store, writing->session.sum, state, error);
    if (status != SKD_OK)
        return status;
    sqlite3_stmt *row = skd_store_statement(&writing->store, SKD_SQL_COMMIT);
    status = skd_store_run(&writing->store, row, SQLITE_OK, error);
    if (status != SKD_OK)
        return status;
    writing->is_ahead |= !writing->is_full;
    note_bytes(writing);
    return SKD_OK;
}

enum skd_status skd_writing_sync(struct skd_writing *writing, struct skd_error *error)
{
    sqlite3_file *log = NULL;
    if (sqlite3_file_control(writing->store.db, "main", SQLITE_FCNTL_JOURNAL_POINTER, &log) !=
            SQLITE_OK ||
        log == NULL || log->pMethods == NULL ||
        log->pMethods->xSync(log, SQLITE_SYNC_NORMAL) != SQLITE_OK)
        return skd_fail(error, SKD_FILE_IO,
                        "the log of session \"%s\" cannot be brought to the disk",
                        writing->session.name);
    writing->is_ahead = false;
    return SKD_OK;
}

enum skd_status skd_writing_checkpoint(struct skd_writing *writing, bool truncate,
                                       struct skd_error *error)
{
    int mode = truncate ? SQLITE_CHECKPOINT_TRUNCATE : SQLITE_CHECKPOINT_PASSIVE;
    if (sqlite3_wal_checkpoint_v2(writing->store.db, "main", mode, NULL, NULL) != SQLITE_OK)
        return skd_store_fail(&writing->store, error);
    if (truncate)
        skd_store_drop_log(&writing->store);
    writing->log_bytes = 0;
    writing->is_ahead = false;
    note_bytes(writing);
    return SKD_OK;
}
