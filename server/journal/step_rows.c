/* See step_rows.h. */
#include "journal/step_rows.h"

#include "journal/checksum.h"
#include "session/restore.h"

#include <stdlib.h>

/* Of a step's sheet. */
enum sheet_kind { KIND_PINS = 0, KIND_SHAPE = 1 };

static uint64_t sheet_id(uint64_t step, size_t place)
{
    return step << 10 | place;
}

/* ---- checksums --------------------------------------------------------------------------------
 */

static uint64_t step_sum(const struct skd_step *step, size_t sheet_count)
{
    size_t slots = (size_t)step->slot_count;
    const struct skd_author *author = &step->author;
    uint64_t sum = skd_sum_text(skd_sum_text(step->cause, author->client), author->id);
    if (author->user[0] != '\0') /* version 1 knew none */
        sum = skd_sum_text(sum, author->user);
    sum = skd_sum_number(skd_sum_number(sum, step->count), sheet_count);
    sum = skd_sum_number(sum, (step->joints_after != NULL ? 1u : 0u) +
                                  (step->rest_after != NULL ? 2u : 0u));
    sum = skd_sum_bytes(sum, step->vertices, step->count * sizeof *step->vertices);
    sum = skd_sum_bytes(sum, step->after, step->count * slots * sizeof *step->after);
    if (step->joints_after != NULL)
        sum = skd_sum_bytes(sum, step->joints_after, step->count * slots * sizeof(uint16_t));
    if (step->rest_after != NULL)
        sum = skd_sum_bytes(sum, step->rest_after, step->count * 3 * sizeof(float));
    return sum;
}

static uint64_t sheet_sum(uint64_t sum, enum sheet_kind kind, uint64_t pose_sum,
                          const struct skd_sheet_change *change, int width)
{
    sum = skd_sum_number(skd_sum_number(skd_sum_number(sum, kind), pose_sum), change->count);
    sum = skd_sum_bytes(sum, change->vertices, change->count * sizeof *change->vertices);
    return skd_sum_bytes(sum, change->after, change->count * (size_t)width * sizeof(float));
}

static int width_of(enum sheet_kind kind)
{
    return kind == KIND_SHAPE ? SKD_SHAPE_NUMBERS : SKD_PIN_NUMBERS;
}

/* ---- writing ----------------------------------------------------------------------------------
 */

static int bind_optional(sqlite3_stmt *row, int place, const void *array, size_t bytes)
{
    return array != NULL ? skd_bind_array(row, place, array, bytes) : sqlite3_bind_null(row, place);
}

/* A pin sheet mostly has the step's own vertices; then they stand there once. */
static bool has_vertices_of(const struct skd_step *step, const struct skd_sheet_change *change)
{
    return change->count == step->count &&
           memcmp(change->vertices, step->vertices, step->count * sizeof *step->vertices) == 0;
}

static enum skd_status write_sheet(struct skd_store *store, uint64_t id, uint64_t pose,
                                   enum sheet_kind kind, const struct skd_step *step,
                                   const struct skd_sheet_change *change, struct skd_error *error)
{
    size_t row_bytes = (size_t)width_of(kind) * sizeof(float);
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_STEP_SHEET_WRITE);
    int bound = skd_bind_number(row, 1, id);
    bound |= skd_bind_number(row, 2, kind);
    bound |= skd_bind_number(row, 3, pose);
    bound |= skd_bind_number(row, 4, change->count);
    bound |= bind_optional(row, 5, has_vertices_of(step, change) ? NULL : change->vertices,
                           change->count * sizeof *change->vertices);
    bound |= skd_bind_array(row, 6, change->after, change->count * row_bytes);
    return skd_store_run(store, row, bound, error);
}

static enum skd_status write_step(struct skd_store *store, uint64_t id, const struct skd_step *step,
                                  size_t sheet_count, uint64_t sum, struct skd_error *error)
{
    size_t row_bytes = (size_t)step->slot_count * sizeof(float);
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_STEP_WRITE);
    int bound = skd_bind_number(row, 1, id);
    bound |= skd_bind_number(row, 2, step->cause);
    bound |= skd_bind_text(row, 3, step->author.client);
    bound |= skd_bind_text(row, 4, step->author.id);
    bound |= skd_bind_number(row, 5, step->count);
    bound |= skd_bind_number(row, 6, sheet_count);
    bound |= skd_bind_array(row, 7, step->vertices, step->count * sizeof *step->vertices);
    bound |= skd_bind_array(row, 8, step->after, step->count * row_bytes);
    bound |= bind_optional(row, 9, step->joints_after,
                           step->count * (size_t)step->slot_count * sizeof(uint16_t));
    bound |= bind_optional(row, 10, step->rest_after, step->count * 3 * sizeof(float));
    bound |= skd_bind_number(row, 11, sum);
    bound |= skd_bind_text(row, 12, step->author.user);
    return skd_store_run(store, row, bound, error);
}

static size_t count_changes(const struct skd_sheet_change *change)
{
    size_t count = 0;
    for (; change != NULL; change = change->next)
        count++;
    return count;
}

enum skd_status skd_step_row_write(struct skd_store *store, struct skd_pose_rows *rows, uint64_t id,
                                   const struct skd_step *step, struct skd_pose *const *poses,
                                   uint64_t *sum, struct skd_error *error)
{
    size_t pins = count_changes(step->pins), sheets = pins + (step->shape != NULL ? 1 : 0);
    const struct skd_sheet_change *change = step->pins;
    enum skd_status status = SKD_OK;
    SKD_ASSERT(sheets <= SKD_STEP_SHEETS_MAX);
    *sum = step_sum(step, sheets);
    for (size_t i = 0; i < sheets && status == SKD_OK; i++) {
        enum sheet_kind kind = i < pins ? KIND_PINS : KIND_SHAPE;
        uint64_t pose = 0, pose_sum = 0;
        if (kind == KIND_SHAPE)
            change = step->shape;
        status = skd_pose_rows_need(store, rows, poses[i], true, &pose, &pose_sum, error);
        *sum = sheet_sum(*sum, kind, pose_sum, change, width_of(kind));
        if (status == SKD_OK)
            status = write_sheet(store, sheet_id(id, i), pose, kind, step, change, error);
        change = change->next;
    }
    return status == SKD_OK ? write_step(store, id, step, sheets, *sum, error) : status;
}

enum skd_status skd_step_row_delete(struct skd_store *store, uint64_t id, struct skd_error *error)
{
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_STEP_DELETE);
    enum skd_status status = skd_store_run(store, row, skd_bind_number(row, 1, id), error);
    if (status != SKD_OK)
        return status;
    row = skd_store_statement(store, SKD_SQL_STEP_SHEETS_DELETE);
    int bound = skd_bind_number(row, 1, sheet_id(id, 0));
    bound |= skd_bind_number(row, 2, sheet_id(id, SKD_STEP_SHEETS_MAX));
    return skd_store_run(store, row, bound, error);
}

/* ---- reading ----------------------------------------------------------------------------------
 */

static const char damaged[] = "a step of the history";

/* The arrays of a step's row, borrowed of the statement. */
struct arrays {
    const void *vertices, *weights, *joints, *rest;
    size_t sheets;
};

static bool has(sqlite3_stmt *row, int column)
{
    return sqlite3_column_type(row, column) != SQLITE_NULL;
}

/* Sizes are held against the count, and that against the rig, before memory is asked for. */
static bool look_at(sqlite3_stmt *row, const struct skd_session *session, size_t *count,
                    struct arrays *arrays)
{
    size_t slots = (size_t)session->slot_count;
    uint64_t vertices, sheets;
    if (!skd_column_number(row, 4, session->rig->mesh.vertex_count, &vertices) ||
        !skd_column_number(row, 5, SKD_STEP_SHEETS_MAX, &sheets))
        return false;
    *count = (size_t)vertices;
    arrays->sheets = (size_t)sheets;
    return skd_column_blob(row, 6, *count * sizeof(uint32_t), &arrays->vertices) &&
           skd_column_blob(row, 7, *count * slots * sizeof(float), &arrays->weights) &&
           (!has(row, 8) ||
            skd_column_blob(row, 8, *count * slots * sizeof(uint16_t), &arrays->joints)) &&
           (!has(row, 9) || skd_column_blob(row, 9, *count * 3 * sizeof(float), &arrays->rest));
}

static enum skd_status copy_arrays(const struct arrays *arrays, sqlite3_stmt *row,
                                   struct skd_step *step, struct skd_error *error)
{
    size_t count = step->count, slots = (size_t)step->slot_count;
    enum skd_status status;
    if (has(row, 8) && (status = skd_step_add_joints(step, error)) != SKD_OK)
        return status;
    if (has(row, 9) && (status = skd_step_add_rest(step, error)) != SKD_OK)
        return status;
    if (count == 0)
        return SKD_OK;
    memcpy(step->vertices, arrays->vertices, count * sizeof *step->vertices);
    memcpy(step->after, arrays->weights, count * slots * sizeof *step->after);
    if (step->joints_after != NULL)
        memcpy(step->joints_after, arrays->joints, count * slots * sizeof(uint16_t));
    if (step->rest_after != NULL)
        memcpy(step->rest_after, arrays->rest, count * 3 * sizeof(float));
    return SKD_OK;
}

static enum skd_status read_step(struct skd_store *store, sqlite3_stmt *row,
                                 struct skd_session *session, struct skd_step **result,
                                 size_t *sheets, uint64_t *sum, struct skd_error *error)
{
    const char *client, *user, *id;
    uint64_t cause;
    size_t count;
    struct arrays arrays = {0};
    if (!skd_column_number(row, 0, SKD_CAUSE_COUNT - 1, &cause) ||
        !skd_column_text(row, 1, SKD_CLIENT_NAME_BYTES_MAX, &client) ||
        !skd_column_text(row, 2, SKD_USER_BYTES_MAX, &user) ||
        !skd_column_text(row, 3, SKD_CLIENT_ID_BYTES_MAX, &id) ||
        !look_at(row, session, &count, &arrays) || !skd_column_sum(row, 10, sum))
        return skd_store_damaged(store, damaged, error);
    struct skd_step *step = *result = skd_step_create(count, session->slot_count);
    if (step == NULL)
        return skd_fail_memory(error, damaged);
    step->cause = (enum skd_cause)cause;
    memcpy(step->author.client, client, strlen(client) + 1);
    memcpy(step->author.user, user, strlen(user) + 1);
    memcpy(step->author.id, id, strlen(id) + 1);
    *sheets = arrays.sheets;
    return copy_arrays(&arrays, row, step, error);
}

static enum skd_status read_sheet(struct skd_store *store, const struct skd_pose_rows *rows,
                                  sqlite3_stmt *row, struct skd_session *session,
                                  struct skd_step *step, uint64_t *sum, struct skd_error *error)
{
    uint64_t kind, pose_id, count, pose_sum;
    const void *vertices = step->vertices, *after;
    struct skd_sheet_change *change;
    if (!skd_column_number(row, 0, KIND_SHAPE, &kind) ||
        !skd_column_number(row, 1, INT64_MAX, &pose_id) ||
        !skd_column_number(row, 2, session->rig->mesh.vertex_count, &count) ||
        (has(row, 3) ? !skd_column_blob(row, 3, (size_t)count * sizeof(uint32_t), &vertices)
                     : count != step->count) ||
        !skd_column_blob(row, 4,
                         (size_t)count * (size_t)width_of((enum sheet_kind)kind) * sizeof(float),
                         &after))
        return skd_store_damaged(store, damaged, error);
    struct skd_pose *pose = skd_pose_rows_find(rows, pose_id, &pose_sum);
    if (pose == NULL)
        return skd_fail(error, SKD_DAMAGED, "a step's pose cannot be read");
    enum skd_status status = skd_session_restore_change(
        session, step, kind == KIND_SHAPE ? &session->shapes : &session->pins, pose,
        count > 0 ? vertices : step->vertices, (size_t)count, &change, error);
    if (status != SKD_OK)
        return status;
    if (count > 0)
        memcpy(change->after, after, (size_t)count * (size_t)change->sheets->width * sizeof(float));
    *sum = sheet_sum(*sum, (enum sheet_kind)kind, pose_sum, change, change->sheets->width);
    return SKD_OK;
}

/* The row of that statement and id, or SKD_DAMAGED. */
static enum skd_status find_row(struct skd_store *store, enum skd_sql sql, uint64_t id,
                                sqlite3_stmt **row, struct skd_error *error)
{
    bool has_row;
    *row = skd_store_statement(store, sql);
    if (*row == NULL || skd_bind_number(*row, 1, id) != SQLITE_OK)
        return skd_store_fail(store, error);
    enum skd_status status = skd_store_next(store, *row, &has_row, error);
    return status == SKD_OK && !has_row ? skd_store_damaged(store, damaged, error) : status;
}

enum skd_status skd_step_row_read(struct skd_store *store, const struct skd_pose_rows *rows,
                                  uint64_t id, struct skd_session *session, struct skd_step **step,
                                  uint64_t *sum, struct skd_error *error)
{
    sqlite3_stmt *row, *sheet_row = NULL;
    struct skd_step *made = NULL;
    size_t sheets = 0;
    uint64_t found = 0;
    enum skd_status status = find_row(store, SKD_SQL_STEP_READ, id, &row, error);
    if (status == SKD_OK)
        status = read_step(store, row, session, &made, &sheets, sum, error);
    if (status == SKD_OK)
        found = step_sum(made, sheets);
    for (size_t i = 0; i < sheets && status == SKD_OK; i++) {
        status = find_row(store, SKD_SQL_STEP_SHEET_READ, sheet_id(id, i), &sheet_row, error);
        if (status == SKD_OK)
            status = read_sheet(store, rows, sheet_row, session, made, &found, error);
    }
    (void)sqlite3_reset(row);
    (void)sqlite3_reset(sheet_row);
    if (status == SKD_OK && found != *sum)
        status = skd_fail(error, SKD_DAMAGED, "%s has another checksum than it had", damaged);
    if (status == SKD_OK)
        *step = made;
    else
        skd_step_release(made);
    return status;
}
