/* See read.h. */
#include "journal/read.h"

#include "journal/base_rows.h"
#include "journal/chunks.h"
#include "journal/compare.h"
#include "journal/damage.h"
#include "journal/guard_rows.h"
#include "journal/inspect.h"
#include "journal/remembered_rows.h"
#include "journal/source_rows.h"
#include "journal/step_rows.h"
#include "session/creation.h"
#include "session/restore.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

/* A file on its way to a session. */
struct reading {
    char path[SKD_PATH_BYTES_MAX];
    struct skd_store store;
    struct skd_pose_rows poses;
    struct skd_session_row row;
    struct skd_state_row state;
    bool has_state;
    size_t row_count; /* steps that the history lists */
    struct skd_history_row *rows;
    size_t done; /* steps that were replayed */
    bool is_old;
    bool is_sound; /* as SQLite sees it */
    struct skd_session *session;
    struct skd_journal_report *report;
};

/* Something is lost: one more part of the report's sentence. */
__attribute__((format(printf, 2, 3))) static void lose(struct reading *reading, const char *format,
                                                       ...)
{
    struct skd_journal_report *report = reading->report;
    size_t used = strlen(report->text);
    va_list arguments;
    va_start(arguments, format);
    if (used > 0)
        used += (size_t)snprintf(report->text + used, sizeof report->text - used, "; ");
    if (used < sizeof report->text)
        (void)vsnprintf(report->text + used, sizeof report->text - used, format, arguments);
    va_end(arguments);
    report->cut = true;
}

/* ---- history ----------------------------------------------------------------------------------
 */

/* The list of steps, as far as it goes on without a gap. */
static enum skd_status read_rows(struct reading *reading, struct skd_error *error)
{
    size_t capacity = 0;
    uint64_t place;
    bool has_row;
    enum skd_status status;
    sqlite3_stmt *row = skd_store_statement(&reading->store, SKD_SQL_HISTORY_READ);
    while ((status = skd_store_next(&reading->store, row, &has_row, error)) == SKD_OK && has_row) {
        if (reading->row_count == capacity) {
            capacity = 2 * capacity + 64;
            void *rows = realloc(reading->rows, capacity * sizeof *reading->rows);
            if (rows == NULL) {
                status = skd_fail_memory(error, "the list of steps");
                break;
            }
            reading->rows = rows;
        }
        struct skd_history_row *item = &reading->rows[reading->row_count];
        if (!skd_column_number(row, 0, INT32_MAX, &place) || place != reading->row_count ||
            !skd_column_number(row, 1, INT64_MAX >> 11, &item->step) ||
            !skd_column_number(row, 2, INT64_MAX, &item->revision) ||
            !skd_column_sum(row, 3, &item->chain))
            break;
        reading->row_count++;
    }
    (void)sqlite3_reset(row);
    return status == SKD_DAMAGED ? SKD_OK : status; /* what was read so far */
}

/* How far the session has come, if the row that says so fits the list of steps. */
static enum skd_status read_state(struct reading *reading, struct skd_error *error)
{
    struct skd_state_row *state = &reading->state;
    enum skd_status status = skd_state_row_read(&reading->store, reading->row.sum, state, error);
    reading->has_state = status == SKD_OK;
    if (status != SKD_OK && status != SKD_DAMAGED)
        return status;
    if (reading->has_state && state->count <= reading->row_count) {
        uint64_t chain =
            state->count > 0 ? reading->rows[state->count - 1].chain : reading->row.sum;
        reading->has_state = chain == state->chain;
    }
    return SKD_OK;
}

static enum skd_status replay_step(struct reading *reading, size_t place, uint64_t *chain,
                                   struct skd_error *error)
{
    struct skd_history_row *row = &reading->rows[place];
    struct skd_step *step;
    enum skd_status status = skd_step_row_read(&reading->store, &reading->poses, row->step,
                                               reading->session, &step, &row->sum, error);
    if (status != SKD_OK)
        return status;
    *chain = skd_history_chain(*chain, place, row);
    step->revision = row->revision;
    if (reading->has_state && place < reading->state.first)
        reading->report->spent += skd_step_bytes(step) / 2; /* one side of it is in the file */
    status = *chain == row->chain ? skd_session_replay(reading->session, step, error)
                                  : skd_fail(error, SKD_DAMAGED, "a step is out of order");
    skd_step_release(step);
    return status;
}

/* Does the steps until one of them is not whole. */
static enum skd_status replay(struct reading *reading, struct skd_error *error)
{
    uint64_t chain = reading->row.sum;
    size_t count = reading->row_count;
    if (reading->has_state && reading->state.count < count)
        count = (size_t)reading->state.count;
    while (reading->done < count) {
        enum skd_status status = replay_step(reading, reading->done, &chain, error);
        if (status == SKD_DAMAGED)
            return SKD_OK;
        if (status != SKD_OK)
            return status;
        reading->done++;
    }
    return SKD_OK;
}

/* The state where the file says it is, or without some steps that could be redone. */
static void settle_whole(struct reading *reading)
{
    struct skd_state_row *state = &reading->state;
    struct skd_session *session = reading->session;
    if (reading->done < state->count)
        lose(reading, "%llu undone steps cannot be redone any more",
             (unsigned long long)state->count - reading->done);
    skd_session_settle(session, (size_t)state->first, (size_t)state->position, reading->done);
    session->revision = state->revision;
    session->exported = state->exported;
}

/* The last state that was ever told and is whole. */
static enum skd_status settle_cut(struct reading *reading, struct skd_error *error)
{
    struct skd_session *session = reading->session;
    size_t kept = reading->done, first = 0;
    while (kept > 0 && reading->rows[kept - 1].revision == 0)
        kept--;
    uint64_t revision = kept > 0 ? reading->rows[kept - 1].revision : reading->row.revision;
    if (revision == SKD_REVISION_NONE)
        return skd_fail(error, SKD_DAMAGED, "no step of the history is whole");
    if (reading->has_state && reading->state.first < kept)
        first = (size_t)reading->state.first;
    skd_session_settle(session, first, kept, kept);
    session->revision = revision;
    session->exported =
        reading->has_state && reading->state.exported <= revision ? reading->state.exported : 0;
    if (!reading->has_state)
        lose(reading,
             "how far it had come is not known; it is at revision %llu, its last whole step",
             (unsigned long long)revision);
    else
        lose(reading, "%llu of %llu steps are not whole; it is at revision %llu instead of %llu",
             (unsigned long long)reading->state.count - kept,
             (unsigned long long)reading->state.count, (unsigned long long)revision,
             (unsigned long long)reading->state.revision);
    return SKD_OK;
}

static enum skd_status read_history(struct reading *reading, struct skd_error *error)
{
    struct skd_session *session = reading->session;
    const struct skd_state_row *state = &reading->state;
    enum skd_status status = read_rows(reading, error);
    if (status == SKD_OK)
        status = read_state(reading, error);
    if (status == SKD_OK)
        status = replay(reading, error);
    if (status != SKD_OK)
        return status;
    reading->report->steps = reading->done;
    if (reading->has_state && reading->done >= state->position)
        settle_whole(reading);
    else if ((status = settle_cut(reading, error)) != SKD_OK)
        return status;
    if (!reading->has_state)
        return SKD_OK; /* and its settings are the defaults */
    memcpy(reading->report->instance, state->instance, sizeof state->instance);
    session->durability = (enum skd_durability)state->durability;
    session->history.bytes_max = (size_t)state->history_bytes;
    /* What was told and not written is lost with the process that told it. */
    if (session->durability == SKD_DURABILITY_FULL)
        memcpy(session->instance, state->instance, sizeof session->instance);
    return SKD_OK;
}

/* ---- the rest ---------------------------------------------------------------------------------
 */

static enum skd_status name_poses(struct reading *reading, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t i = 0; i < reading->poses.named_count && status == SKD_OK; i++) {
        const struct skd_named_row *named = &reading->poses.named[i];
        struct skd_pose *pose = reading->poses.items[named->row].pose;
        status = skd_poses_put(&reading->session->poses, skd_pose_hold(pose), error);
    }
    if (status == SKD_OK && skd_poses_find(&reading->session->poses, "rest") == NULL)
        status = skd_session_add_rest_pose(reading->session, error); /* it always exists */
    return status == SKD_TOO_LARGE ? skd_fail(error, SKD_DAMAGED, "there are too many poses")
                                   : status;
}

static enum skd_status read_guard(struct reading *reading, struct skd_error *error)
{
    enum skd_status status = skd_guard_row_read(&reading->store, reading->session, error);
    if (status != SKD_DAMAGED)
        return status;
    lose(reading, "its guard is lost");
    return SKD_OK;
}

static enum skd_status read_remembered(struct reading *reading, struct skd_error *error)
{
    size_t damaged;
    enum skd_status status =
        skd_remembered_rows_read(&reading->store, reading->session, &damaged, error);
    if (status == SKD_OK && damaged > 0)
        lose(reading, "what answers it gave last is lost");
    return status;
}

static enum skd_status read_sources(struct reading *reading, struct skd_error *error)
{
    char folder[SKD_PATH_BYTES_MAX];
    size_t damaged;
    (void)snprintf(folder, sizeof folder, "%.*s",
                   (int)(strrchr(reading->path, '/') - reading->path) + 1, reading->path);
    enum skd_status status =
        skd_source_rows_read(&reading->store, reading->session->rig, folder, &damaged, error);
    if (status == SKD_OK && damaged > 0)
        lose(reading,
             "%zu of its glTF's files changed, and their copies are lost: it cannot be "
             "exported as glTF",
             damaged);
    return status;
}

/* Whether SQLite finds the file sound: only asked where a process ended without closing it, since
 * it takes time. What is in the rows has checksums of its own. */
static enum skd_status look_within(struct reading *reading, struct skd_error *error)
{
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(&reading->store, SKD_SQL_CHECK);
    enum skd_status status = skd_store_next(&reading->store, row, &has_row, error);
    const char *answer =
        status == SKD_OK && has_row ? (const char *)sqlite3_column_text(row, 0) : NULL;
    reading->is_sound = answer != NULL && strcmp(answer, "ok") == 0;
    (void)sqlite3_reset(row);
    return status == SKD_DAMAGED ? SKD_OK : status;
}

static enum skd_status read_all(struct reading *reading, struct skd_error *error)
{
    struct skd_inspection file;
    size_t poses_lost;
    bool is_torn;
    enum skd_status status;
    if ((status = skd_inspect(reading->path, &file, error)) != SKD_OK)
        return status;
    reading->report->bytes = file.bytes + file.log_bytes;
    if ((status = skd_inspect_log(reading->path, &is_torn, error)) != SKD_OK ||
        (status = skd_store_open(&reading->store, reading->path, SKD_STORE_READ, &reading->is_old,
                                 error)) != SKD_OK)
        return status;
    reading->is_sound = true;
    if (file.log_bytes > 0 && (status = look_within(reading, error)) != SKD_OK)
        return status;
    if (is_torn)
        lose(reading, "the end of its log is not whole");
    if ((status = skd_base_read(&reading->store, &reading->poses, &reading->row, &reading->session,
                                &poses_lost, error)) != SKD_OK)
        return status;
    if (poses_lost > 0)
        lose(reading, "%zu poses are lost", poses_lost);
    if ((status = read_history(reading, error)) != SKD_OK ||
        (status = name_poses(reading, error)) != SKD_OK ||
        (status = read_guard(reading, error)) != SKD_OK ||
        (status = read_remembered(reading, error)) != SKD_OK)
        return status;
    return read_sources(reading, error);
}

static void finish(struct reading *reading)
{
    skd_store_close(&reading->store);
    skd_pose_rows_finish(&reading->poses);
    free(reading->rows);
    free(reading);
}

static enum skd_status begin(const char *path, struct skd_journal_report *report,
                             struct reading **result, struct skd_error *error)
{
    struct reading *reading = calloc(1, sizeof *reading);
    if (reading == NULL)
        return skd_fail_memory(error, "a session's file");
    *report = (struct skd_journal_report){0};
    reading->report = report;
    enum skd_status status = skd_inspect_resolve(path, reading->path, error);
    if (status != SKD_OK) {
        finish(reading);
        return status;
    }
    *result = reading;
    return SKD_OK;
}

/* What the session and the report say of what was read. */
static void conclude(struct reading *reading)
{
    struct skd_journal_report *report = reading->report;
    struct skd_session *session = reading->session;
    report->revision = session->revision;
    report->rewrite = report->cut || reading->is_old || !reading->is_sound;
    if (report->cut) {
        skd_session_new_instance(session->instance);
        (void)snprintf(session->damage, sizeof session->damage, "%s", report->text);
    }
    skd_session_account(session);
}

enum skd_status skd_journal_read(const char *path, const char *aside, struct skd_session **session,
                                 struct skd_journal_report *report, struct skd_error *error)
{
    struct reading *reading = NULL;
    struct skd_error failure;
    enum skd_status status = begin(path, report, &reading, error);
    if (status != SKD_OK)
        return status;
    status = read_all(reading, &failure);
    skd_store_close(&reading->store);
    if (status == SKD_OK)
        conclude(reading);
    bool is_damaged = status == SKD_DAMAGED || (status == SKD_OK && report->cut);
    if (is_damaged && aside != NULL) {
        struct skd_error second;
        if (skd_set_aside(reading->path, aside, status == SKD_DAMAGED, &second) != SKD_OK &&
            status == SKD_OK)
            status = skd_fail(&failure, second.status, "%s", second.text);
    }
    if (status == SKD_OK) {
        *session = reading->session;
    } else {
        skd_session_destroy(reading->session);
        bool is_named = status != SKD_DAMAGED || failure.text[0] == '"'; /* with its path */
        (void)skd_fail(error, status, is_named ? "%.0s%s" : "\"%s\" cannot be read: %s", path,
                       failure.text);
    }
    finish(reading);
    return status;
}

enum skd_status skd_journal_verify(const char *path, const struct skd_session *live,
                                   struct skd_journal_report *report, struct skd_error *error)
{
    struct reading *reading = NULL;
    enum skd_status status = begin(path, report, &reading, error);
    if (status != SKD_OK)
        return status;
    status = read_all(reading, error);
    if (status == SKD_OK)
        status = look_within(reading, error);
    if (status == SKD_OK) {
        conclude(reading);
        if (!reading->is_sound)
            lose(reading, "SQLite finds the file not sound");
        status = skd_chunks_check(&reading->store, error);
    }
    if (status == SKD_OK && live != NULL)
        status = skd_compare_sessions(live, reading->session, error);
    skd_session_destroy(reading->session);
    finish(reading);
    return status;
}
