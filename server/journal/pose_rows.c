/* See pose_rows.h. */
#include "journal/pose_rows.h"

#include "journal/checksum.h"

#include <math.h>
#include <stdlib.h>

void skd_pose_rows_finish(struct skd_pose_rows *poses)
{
    for (size_t i = 0; i < poses->count; i++)
        skd_pose_release(poses->items[i].pose);
    free(poses->items);
    free(poses->named);
    *poses = (struct skd_pose_rows){0};
}

static size_t matrix_bytes(const struct skd_pose_rows *poses)
{
    return poses->bone_count * SKD_MATRIX_SIZE * sizeof(double);
}

static void digest(const struct skd_pose_rows *poses, const char *name, const double *matrices,
                   uint64_t out[2])
{
    XXH128_hash_t hash =
        XXH3_128bits_withSeed(matrices, matrix_bytes(poses), skd_sum_text(0, name));
    out[0] = hash.low64;
    out[1] = hash.high64;
}

static uint64_t named_sum(const struct skd_pose_rows *poses, const struct skd_named_row *named)
{
    const struct skd_pose_row *row = &poses->items[named->row];
    return skd_sum_bytes(skd_sum_number(named->place, row->id), row->digest, sizeof row->digest);
}

/* Room for one more of either kind. */
static enum skd_status make_room(struct skd_pose_rows *poses, struct skd_error *error)
{
    if (poses->count == poses->capacity) {
        size_t capacity = 2 * poses->capacity + 16;
        void *items = realloc(poses->items, capacity * sizeof *poses->items);
        if (items == NULL)
            return skd_fail_memory(error, "the list of poses");
        poses->items = items;
        poses->capacity = capacity;
    }
    if (poses->named_count == poses->named_capacity) {
        size_t capacity = 2 * poses->named_capacity + 16;
        void *named = realloc(poses->named, capacity * sizeof *poses->named);
        if (named == NULL)
            return skd_fail_memory(error, "the list of poses");
        poses->named = named;
        poses->named_capacity = capacity;
    }
    return SKD_OK;
}

static enum skd_status write_pose(struct skd_store *store, const struct skd_pose_rows *poses,
                                  const struct skd_pose *pose, const struct skd_pose_row *row,
                                  struct skd_error *error)
{
    sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_POSE_WRITE);
    int bound = skd_bind_number(statement, 1, row->id);
    bound |= skd_bind_text(statement, 2, pose->name);
    bound |= skd_bind_array(statement, 3, pose->matrices, matrix_bytes(poses));
    bound |= skd_bind_number(statement, 4, row->digest[0]);
    return skd_store_run(store, statement, bound, error);
}

/* The place of the pose's row in the table, written where it is new. */
static enum skd_status need(struct skd_store *store, struct skd_pose_rows *poses,
                            const struct skd_pose *pose, size_t *at, struct skd_error *error)
{
    struct skd_pose_row row = {.id = poses->next_id};
    digest(poses, pose->name, pose->matrices, row.digest);
    for (*at = 0; *at < poses->count; ++*at) {
        if (memcmp(poses->items[*at].digest, row.digest, sizeof row.digest) == 0)
            return SKD_OK;
    }
    enum skd_status status = make_room(poses, error);
    if (status == SKD_OK)
        status = write_pose(store, poses, pose, &row, error);
    if (status == SKD_OK) {
        poses->items[poses->count++] = row;
        poses->next_id++;
    }
    return status;
}

enum skd_status skd_pose_rows_need(struct skd_store *store, struct skd_pose_rows *poses,
                                   const struct skd_pose *pose, bool for_sheet, uint64_t *id,
                                   uint64_t *sum, struct skd_error *error)
{
    size_t at;
    enum skd_status status = need(store, poses, pose, &at, error);
    if (status != SKD_OK)
        return status;
    poses->items[at].is_in_sheets |= for_sheet;
    *id = poses->items[at].id;
    *sum = poses->items[at].digest[0];
    return SKD_OK;
}

static enum skd_status delete_row(struct skd_store *store, enum skd_sql sql, uint64_t id,
                                  struct skd_error *error)
{
    sqlite3_stmt *statement = skd_store_statement(store, sql);
    return skd_store_run(store, statement, skd_bind_number(statement, 1, id), error);
}

static bool is_named(const struct skd_pose_rows *poses, size_t row)
{
    for (size_t i = 0; i < poses->named_count; i++) {
        if (poses->named[i].row == row)
            return true;
    }
    return false;
}

/* A pose that has no name and no sheet any more. */
static enum skd_status forget(struct skd_store *store, struct skd_pose_rows *poses, size_t row,
                              struct skd_error *error)
{
    if (poses->items[row].is_in_sheets || is_named(poses, row))
        return SKD_OK;
    enum skd_status status = delete_row(store, SKD_SQL_POSE_DELETE, poses->items[row].id, error);
    poses->count--;
    memmove(poses->items + row, poses->items + row + 1,
            (poses->count - row) * sizeof *poses->items);
    for (size_t i = 0; i < poses->named_count; i++)
        poses->named[i].row -= poses->named[i].row > row;
    return status;
}

enum skd_status skd_pose_rows_put(struct skd_store *store, struct skd_pose_rows *poses,
                                  const struct skd_pose *pose, struct skd_error *error)
{
    struct skd_named_row named = {.place = poses->next_place++};
    size_t before = SIZE_MAX;
    enum skd_status status = need(store, poses, pose, &named.row, error);
    if (status == SKD_OK)
        status = make_room(poses, error);
    if (status != SKD_OK)
        return status;
    memcpy(named.name, pose->name, sizeof named.name);
    for (size_t i = 0; i < poses->named_count && before == SIZE_MAX; i++) {
        if (strcmp(poses->named[i].name, pose->name) != 0)
            continue;
        before = poses->named[i].row;
        status = delete_row(store, SKD_SQL_NAMED_DELETE, poses->named[i].place, error);
        poses->named_count--;
        memmove(poses->named + i, poses->named + i + 1,
                (poses->named_count - i) * sizeof *poses->named);
    }
    poses->named[poses->named_count++] = named;
    if (status == SKD_OK) {
        sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_NAMED_WRITE);
        int bound = skd_bind_number(statement, 1, named.place);
        bound |= skd_bind_number(statement, 2, poses->items[named.row].id);
        bound |= skd_bind_number(statement, 3, named_sum(poses, &named));
        status = skd_store_run(store, statement, bound, error);
    }
    if (status == SKD_OK && before != SIZE_MAX)
        status = forget(store, poses, before, error);
    return status;
}

static bool are_finite(const double *numbers, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(numbers[i]))
            return false;
    }
    return true;
}

/* One row, appended; SKD_DAMAGED where it is not whole. */
static enum skd_status read_pose(struct skd_store *store, struct skd_pose_rows *poses,
                                 sqlite3_stmt *row, bool make, struct skd_error *error)
{
    struct skd_pose_row made = {0};
    const char *name;
    const void *matrices;
    uint64_t sum;
    if (!skd_column_number(row, 0, INT64_MAX - 1, &made.id) ||
        !skd_column_text(row, 1, SKD_POSE_NAME_BYTES_MAX, &name) ||
        !skd_column_blob(row, 2, matrix_bytes(poses), &matrices) || !skd_column_sum(row, 3, &sum))
        return skd_store_damaged(store, "a pose", error);
    if (make && (made.pose = skd_pose_create(name, (int)poses->bone_count)) == NULL)
        return skd_fail_memory(error, "a pose");
    if (make) {
        memcpy(made.pose->matrices, matrices, matrix_bytes(poses));
        matrices = made.pose->matrices;
    }
    digest(poses, name, matrices, made.digest);
    enum skd_status status = SKD_OK;
    if (made.digest[0] != sum ||
        (make && !are_finite(made.pose->matrices, poses->bone_count * SKD_MATRIX_SIZE)))
        status = skd_fail(error, SKD_DAMAGED, "a pose cannot be read");
    if (status == SKD_OK)
        status = make_room(poses, error);
    if (status != SKD_OK) {
        skd_pose_release(made.pose);
        return status;
    }
    poses->items[poses->count++] = made;
    poses->next_id = made.id + 1;
    return SKD_OK;
}

static size_t find(const struct skd_pose_rows *poses, uint64_t id)
{
    size_t first = 0, count = poses->count;
    while (count > 0) {
        size_t half = count / 2;
        bool is_behind = poses->items[first + half].id < id;
        first = is_behind ? first + half + 1 : first;
        count = is_behind ? count - half - 1 : half;
    }
    return first < poses->count && poses->items[first].id == id ? first : SIZE_MAX;
}

struct skd_pose *skd_pose_rows_find(const struct skd_pose_rows *poses, uint64_t id, uint64_t *sum)
{
    size_t row = find(poses, id);
    if (row == SIZE_MAX)
        return NULL;
    *sum = poses->items[row].digest[0];
    return poses->items[row].pose;
}

static enum skd_status read_named(struct skd_store *store, struct skd_pose_rows *poses,
                                  sqlite3_stmt *row, struct skd_error *error)
{
    struct skd_named_row named = {0};
    const char *name;
    uint64_t id, sum;
    enum skd_status status = make_room(poses, error);
    if (status != SKD_OK)
        return status;
    if (!skd_column_number(row, 0, INT64_MAX - 1, &named.place) ||
        !skd_column_number(row, 1, INT64_MAX, &id) || !skd_column_sum(row, 2, &sum) ||
        !skd_column_text(row, 3, SKD_POSE_NAME_BYTES_MAX, &name) ||
        (named.row = find(poses, id)) == SIZE_MAX || named_sum(poses, &named) != sum)
        return skd_store_damaged(store, "a pose's name", error);
    memcpy(named.name, name, strlen(name) + 1);
    poses->named[poses->named_count++] = named;
    poses->next_place = named.place + 1;
    return SKD_OK;
}

/* Goes through the rows of a table; those that are not whole are counted. */
static enum skd_status read_rows(struct skd_store *store, struct skd_pose_rows *poses,
                                 enum skd_sql sql, bool make, size_t *damaged,
                                 struct skd_error *error)
{
    sqlite3_stmt *row = skd_store_statement(store, sql);
    bool has_row;
    enum skd_status status;
    while ((status = skd_store_next(store, row, &has_row, error)) == SKD_OK && has_row) {
        status = sql == SKD_SQL_POSES_READ ? read_pose(store, poses, row, make, error)
                                           : read_named(store, poses, row, error);
        if (status != SKD_OK && status != SKD_DAMAGED) {
            (void)sqlite3_reset(row);
            return status;
        }
        *damaged += status == SKD_DAMAGED;
    }
    if (status == SKD_DAMAGED) {
        ++*damaged; /* what comes after cannot be reached */
        return SKD_OK;
    }
    return status;
}

static enum skd_status mark_sheets(struct skd_store *store, struct skd_pose_rows *poses,
                                   enum skd_sql sql, struct skd_error *error)
{
    sqlite3_stmt *row = skd_store_statement(store, sql);
    bool has_row;
    enum skd_status status;
    while ((status = skd_store_next(store, row, &has_row, error)) == SKD_OK && has_row) {
        size_t at = find(poses, (uint64_t)sqlite3_column_int64(row, 0));
        if (at != SIZE_MAX)
            poses->items[at].is_in_sheets = true;
    }
    return status;
}

enum skd_status skd_pose_rows_read(struct skd_store *store, struct skd_pose_rows *poses, bool make,
                                   size_t *damaged, struct skd_error *error)
{
    *damaged = 0;
    enum skd_status status = read_rows(store, poses, SKD_SQL_POSES_READ, make, damaged, error);
    if (status == SKD_OK)
        status = read_rows(store, poses, SKD_SQL_NAMED_READ, make, damaged, error);
    if (status != SKD_OK || make)
        return status;
    status = mark_sheets(store, poses, SKD_SQL_BASE_SHEETS_READ, error);
    return status == SKD_OK ? mark_sheets(store, poses, SKD_SQL_STEP_SHEET_POSES_READ, error)
                            : status;
}
