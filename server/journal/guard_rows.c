/* See guard_rows.h. */
#include "journal/guard_rows.h"

#include "journal/checksum.h"

#include <math.h>
#include <stdlib.h>

struct packed_sample {
    int32_t source;
    int32_t index;
    double time;
    char name[264];
};

_Static_assert(sizeof(struct packed_sample) == 280, "no padding in what is written");
_Static_assert(sizeof((struct packed_sample *)0)->name > SKD_NAME_BYTES_MAX, "every name fits");

static size_t pose_bytes(size_t bones)
{
    return bones * SKD_MATRIX_SIZE * sizeof(double);
}

enum skd_status skd_guard_row_pack(const struct skd_guards *guards, struct skd_guard_row *row,
                                   struct skd_error *error)
{
    const struct skd_samples *poses = &guards->poses;
    *row = (struct skd_guard_row){0};
    if (guards->factors == NULL)
        return SKD_OK;
    size_t matrices = poses->count * pose_bytes((size_t)poses->bone_count);
    size_t bytes = poses->count * sizeof(struct packed_sample) + matrices;
    struct packed_sample *body = calloc(1, bytes);
    if (body == NULL)
        return skd_fail_memory(error, "the guard's poses");
    for (size_t i = 0; i < poses->count; i++) {
        const struct skd_sample *sample = &poses->items[i];
        body[i].source = (int32_t)sample->source;
        body[i].index = sample->index;
        body[i].time = sample->time;
        memcpy(body[i].name, sample->name, sizeof sample->name);
    }
    memcpy(body + poses->count, poses->matrices, matrices);
    *row = (struct skd_guard_row){
        .candidates = guards->candidate_count, .count = poses->count, .bytes = bytes, .body = body};
    return SKD_OK;
}

void skd_guard_row_finish(struct skd_guard_row *row)
{
    free(row->body);
    *row = (struct skd_guard_row){0};
}

static uint64_t sum_of(uint64_t candidates, uint64_t count, const void *body, size_t bytes)
{
    return skd_sum_bytes(skd_sum_number(candidates, count), body, bytes);
}

enum skd_status skd_guard_row_write(struct skd_store *store, const struct skd_guard_row *row,
                                    struct skd_error *error)
{
    sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_GUARD_DELETE);
    enum skd_status status = skd_store_run(store, statement, SQLITE_OK, error);
    if (status != SKD_OK || row->count == 0)
        return status;
    statement = skd_store_statement(store, SKD_SQL_GUARD_WRITE);
    int bound = skd_bind_number(statement, 1, row->candidates);
    bound |= skd_bind_number(statement, 2, row->count);
    bound |= skd_bind_array(statement, 3, row->body, row->bytes);
    bound |=
        skd_bind_number(statement, 4, sum_of(row->candidates, row->count, row->body, row->bytes));
    return skd_store_run(store, statement, bound, error);
}

static bool is_sound(const struct packed_sample *sample, const double *matrices, size_t bones)
{
    if (sample->source < SKD_SAMPLE_CLIP || sample->source > SKD_SAMPLE_BEND ||
        !isfinite(sample->time) || strnlen(sample->name, sizeof sample->name) > SKD_NAME_BYTES_MAX)
        return false;
    for (size_t i = 0; i < bones * SKD_MATRIX_SIZE; i++) {
        if (!isfinite(matrices[i]))
            return false;
    }
    return true;
}

static enum skd_status unpack(struct skd_session *session, const void *body, size_t count,
                              struct skd_guards *guards, struct skd_error *error)
{
    struct skd_samples *poses = &guards->poses;
    size_t bones = (size_t)session->rig->skeleton.bone_count;
    enum skd_status status = skd_samples_init(poses, count, session->rig, error);
    if (status != SKD_OK)
        return status;
    const char *matrices = (const char *)body + count * sizeof(struct packed_sample);
    memcpy(poses->matrices, matrices, count * pose_bytes(bones));
    for (size_t i = 0; i < count; i++) {
        struct packed_sample sample;
        memcpy(&sample, (const char *)body + i * sizeof sample, sizeof sample);
        if (!is_sound(&sample, skd_samples_matrices(poses, i), bones))
            return skd_fail(error, SKD_DAMAGED, "a pose of the guard makes no sense");
        poses->items[i].source = (enum skd_sample_source)sample.source;
        poses->items[i].index = sample.index;
        poses->items[i].time = sample.time;
        memcpy(poses->items[i].name, sample.name, sizeof poses->items[i].name);
        poses->count++;
    }
    status = skd_guards_factor(poses, &guards->factors, error);
    return status == SKD_UNSUPPORTED ? skd_fail(error, SKD_DAMAGED, "the guard fits another rig")
                                     : status;
}

enum skd_status skd_guard_row_read(struct skd_store *store, struct skd_session *session,
                                   struct skd_error *error)
{
    uint64_t candidates, count, sum;
    const void *body;
    size_t bones = (size_t)session->rig->skeleton.bone_count;
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_GUARD_READ);
    enum skd_status status = skd_store_next(store, row, &has_row, error);
    if (status != SKD_OK || !has_row)
        return status;
    struct skd_guards guards = {0};
    size_t each = sizeof(struct packed_sample) + pose_bytes(bones);
    if (!skd_column_number(row, 0, INT32_MAX, &candidates) ||
        !skd_column_number(row, 1, SKD_GUARD_COUNT_MAX, &count) || count == 0 ||
        !skd_column_blob(row, 2, (size_t)count * each, &body) || !skd_column_sum(row, 3, &sum) ||
        sum_of(candidates, count, body, (size_t)count * each) != sum)
        status = skd_store_damaged(store, "the guard", error);
    else
        status = unpack(session, body, (size_t)count, &guards, error);
    (void)sqlite3_reset(row);
    if (status != SKD_OK) {
        skd_guards_finish(&guards);
        return status;
    }
    guards.candidate_count = (size_t)candidates;
    session->guards = guards;
    return SKD_OK;
}
