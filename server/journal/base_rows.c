/* See base_rows.h. */
#include "journal/base_rows.h"

#include "journal/checksum.h"
#include "journal/chunks.h"
#include "rig/rig_image.h"
#include "session/restore.h"

#include <stdlib.h>

/* ---- the rig ----------------------------------------------------------------------------------
 */

/* An image on its way into chunks. */
struct image {
    struct skd_store *store;
    char *buffer; /* [SKD_CHUNK_BYTES] */
    size_t used;
    size_t place;
    enum skd_status status;
    struct skd_error *error;
};

static void put_chunk(struct image *image)
{
    image->status = skd_chunk_write(image->store, (struct skd_chunk_name){.kind = SKD_CHUNK_RIG},
                                    image->place++, image->buffer, image->used, image->error);
    image->used = 0;
}

static bool take_run(void *user, const void *bytes, size_t count)
{
    struct image *image = user;
    const char *run = bytes;
    while (count > 0 && image->status == SKD_OK) {
        size_t room = SKD_CHUNK_BYTES - image->used, taken = count < room ? count : room;
        memcpy(image->buffer + image->used, run, taken);
        image->used += taken;
        run += taken;
        count -= taken;
        if (image->used == SKD_CHUNK_BYTES)
            put_chunk(image);
    }
    return image->status == SKD_OK;
}

static enum skd_status write_rig(struct skd_store *store, const struct skd_rig *rig,
                                 struct skd_error *error)
{
    struct image image = {.store = store, .buffer = malloc(SKD_CHUNK_BYTES), .error = error};
    const struct skd_image_sink sink = {.write = take_run, .user = &image};
    if (image.buffer == NULL)
        return skd_fail_memory(error, "a session's file");
    bool is_whole = skd_rig_image_write(rig, NULL, &sink);
    if (is_whole && image.used > 0)
        put_chunk(&image);
    free(image.buffer);
    return image.status;
}

static enum skd_status read_rig(struct skd_store *store, const struct skd_session_row *row,
                                struct skd_rig **rig, struct skd_error *error)
{
    void *bytes;
    enum skd_status status = skd_chunks_read(store, (struct skd_chunk_name){.kind = SKD_CHUNK_RIG},
                                             (size_t)row->rig_bytes, &bytes, error);
    if (status != SKD_OK)
        return status;
    status = skd_rig_image_read(bytes, (size_t)row->rig_bytes, rig, NULL, error);
    free(bytes);
    if (status == SKD_NO_MEMORY || status == SKD_OK)
        return status;
    return skd_fail(error, SKD_DAMAGED, "the rig makes no sense");
}

/* ---- sheets -----------------------------------------------------------------------------------
 */

enum { KIND_PINS = 0, KIND_SHAPES = 1 };

static uint64_t sheet_sum(uint64_t id, uint64_t kind, uint64_t pose_sum, uint64_t count)
{
    return skd_sum_number(skd_sum_number(skd_sum_number(id, kind), pose_sum), count);
}

static enum skd_status write_rows(struct skd_store *store, size_t id,
                                  const struct skd_sheets *sheets, const struct skd_sheet *sheet,
                                  struct skd_error *error)
{
    size_t width = (size_t)sheets->width;
    uint32_t *vertices = malloc(sheet->used * sizeof *vertices + 1);
    float *rows = malloc(sheet->used * width * sizeof *rows + 1);
    enum skd_status status = SKD_OK;
    if (vertices == NULL || rows == NULL) {
        status = skd_fail_memory(error, "the pins and shapes");
    } else {
        skd_sheet_list(sheets, sheet, vertices);
        for (size_t i = 0; i < sheet->used; i++)
            memcpy(rows + i * width, skd_sheet_row(sheets, sheet, vertices[i]),
                   width * sizeof *rows);
        status = skd_chunks_write(store, (struct skd_chunk_name){SKD_CHUNK_SHEET_VERTICES, id},
                                  vertices, sheet->used * sizeof *vertices, error);
    }
    if (status == SKD_OK)
        status = skd_chunks_write(store, (struct skd_chunk_name){SKD_CHUNK_SHEET_ROWS, id}, rows,
                                  sheet->used * width * sizeof *rows, error);
    free(vertices);
    free(rows);
    return status;
}

static enum skd_status write_sheets(struct skd_store *store, struct skd_pose_rows *poses,
                                    const struct skd_sheets *sheets, uint64_t kind, uint64_t *next,
                                    struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t i = 0; i < sheets->count && status == SKD_OK; i++) {
        const struct skd_sheet *sheet = sheets->items[i];
        uint64_t id = *next, pose, pose_sum;
        if (sheet->used == 0)
            continue;
        status = skd_pose_rows_need(store, poses, sheet->pose, true, &pose, &pose_sum, error);
        if (status != SKD_OK)
            return status;
        sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_BASE_SHEET_WRITE);
        int bound = skd_bind_number(row, 1, id);
        bound |= skd_bind_number(row, 2, kind);
        bound |= skd_bind_number(row, 3, pose);
        bound |= skd_bind_number(row, 4, sheet->used);
        bound |= skd_bind_number(row, 5, sheet_sum(id, kind, pose_sum, sheet->used));
        status = skd_store_run(store, row, bound, error);
        if (status == SKD_OK)
            status = write_rows(store, (size_t)id, sheets, sheet, error);
        ++*next;
    }
    return status;
}

static enum skd_status read_rows(struct skd_store *store, size_t id, struct skd_session *session,
                                 struct skd_sheets *sheets, struct skd_pose *pose, size_t count,
                                 struct skd_error *error)
{
    void *vertices, *rows = NULL;
    enum skd_status status =
        skd_chunks_read(store, (struct skd_chunk_name){SKD_CHUNK_SHEET_VERTICES, id},
                        count * sizeof(uint32_t), &vertices, error);
    if (status == SKD_OK)
        status = skd_chunks_read(store, (struct skd_chunk_name){SKD_CHUNK_SHEET_ROWS, id},
                                 count * (size_t)sheets->width * sizeof(float), &rows, error);
    if (status == SKD_OK)
        status = skd_session_restore_rows(session, sheets, pose, vertices, rows, count, error);
    free(vertices);
    free(rows);
    return status;
}

static enum skd_status read_sheet(struct skd_store *store, const struct skd_pose_rows *poses,
                                  uint64_t id, struct skd_session *session, struct skd_error *error)
{
    uint64_t kind, pose_id, count, sum, pose_sum;
    struct skd_pose *pose = NULL;
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_BASE_SHEET_READ);
    if (row == NULL || skd_bind_number(row, 1, id) != SQLITE_OK)
        return skd_store_fail(store, error);
    enum skd_status status = skd_store_next(store, row, &has_row, error);
    if (status != SKD_OK)
        return status;
    if (!has_row || !skd_column_number(row, 0, KIND_SHAPES, &kind) ||
        !skd_column_number(row, 1, INT64_MAX, &pose_id) ||
        !skd_column_number(row, 2, session->rig->mesh.vertex_count, &count) ||
        !skd_column_sum(row, 3, &sum) ||
        (pose = skd_pose_rows_find(poses, pose_id, &pose_sum)) == NULL ||
        sheet_sum(id, kind, pose_sum, count) != sum)
        status = skd_store_damaged(store, "the pins and shapes", error);
    (void)sqlite3_reset(row);
    if (status != SKD_OK)
        return status;
    return read_rows(store, (size_t)id, session,
                     kind == KIND_SHAPES ? &session->shapes : &session->pins, pose, (size_t)count,
                     error);
}

/* ---- all of it --------------------------------------------------------------------------------
 */

static enum skd_status write_array(struct skd_store *store, enum skd_chunk_kind kind,
                                   const void *array, size_t bytes, struct skd_error *error)
{
    return skd_chunks_write(store, (struct skd_chunk_name){.kind = kind}, array, bytes, error);
}

static enum skd_status write_arrays(struct skd_store *store, const struct skd_session *session,
                                    uint64_t *parts, struct skd_error *error)
{
    size_t vertices = session->rig->mesh.vertex_count;
    size_t rows = vertices * (size_t)session->slot_count;
    enum skd_status status;
    *parts = 0;
    if ((status = write_array(store, SKD_CHUNK_JOINTS, session->joints, rows * sizeof(uint16_t),
                              error)) != SKD_OK ||
        (status = write_array(store, SKD_CHUNK_WEIGHTS, session->weights, rows * sizeof(float),
                              error)) != SKD_OK ||
        (status = write_array(store, SKD_CHUNK_START_WEIGHTS, skd_session_start_weights(session),
                              rows * sizeof(float), error)) != SKD_OK)
        return status;
    if (session->start_joints != NULL) {
        *parts |= SKD_PART_START_JOINTS;
        status = write_array(store, SKD_CHUNK_START_JOINTS, session->start_joints,
                             rows * sizeof(uint16_t), error);
    }
    if (status == SKD_OK && session->rest != session->rig->mesh.rest) {
        *parts |= SKD_PART_REST;
        status =
            write_array(store, SKD_CHUNK_REST, session->rest, vertices * 3 * sizeof(float), error);
    }
    return status;
}

enum skd_status skd_base_write(struct skd_store *store, struct skd_pose_rows *poses,
                               const struct skd_session *session, struct skd_session_row *row,
                               struct skd_error *error)
{
    enum skd_status status;
    SKD_ASSERT(strlen(session->source) < sizeof row->source);
    memcpy(row->source, session->source, strlen(session->source) + 1);
    row->slots = (uint64_t)session->slot_count;
    row->vertices = session->rig->mesh.vertex_count;
    row->bones = poses->bone_count = (size_t)session->rig->skeleton.bone_count;
    row->rig_bytes = skd_rig_image_bytes(session->rig, NULL);
    row->sheets = 0;
    row->revision = session->history.base_revision;
    row->report = session->slots;
    row->reduction = session->reduction;
    if ((status = write_rig(store, session->rig, error)) != SKD_OK ||
        (status = write_arrays(store, session, &row->parts, error)) != SKD_OK ||
        (status = write_sheets(store, poses, &session->pins, KIND_PINS, &row->sheets, error)) !=
            SKD_OK ||
        (status = write_sheets(store, poses, &session->shapes, KIND_SHAPES, &row->sheets, error)) !=
            SKD_OK)
        return status;
    return skd_session_row_write(store, row, error);
}

/* The caller's to free; NULL where *status was or is a failure. */
static void *read_array(struct skd_store *store, enum skd_chunk_kind kind, size_t bytes,
                        enum skd_status *status, struct skd_error *error)
{
    void *array = NULL;
    if (*status == SKD_OK)
        *status =
            skd_chunks_read(store, (struct skd_chunk_name){.kind = kind}, bytes, &array, error);
    return array;
}

static enum skd_status read_parts(struct skd_store *store, const struct skd_session_row *row,
                                  struct skd_session **session, struct skd_error *error)
{
    struct skd_session_parts parts = {.slot_count = (int)row->slots};
    size_t vertices = (size_t)row->vertices, rows = vertices * (size_t)row->slots;
    enum skd_status status = read_rig(store, row, &parts.rig, error);
    if (status == SKD_OK && (parts.rig->mesh.vertex_count != vertices ||
                             (uint64_t)parts.rig->skeleton.bone_count != row->bones))
        status = skd_fail(error, SKD_DAMAGED, "the rig has other sizes than the session");
    parts.joints = read_array(store, SKD_CHUNK_JOINTS, rows * sizeof(uint16_t), &status, error);
    parts.weights = read_array(store, SKD_CHUNK_WEIGHTS, rows * sizeof(float), &status, error);
    parts.start_weights =
        read_array(store, SKD_CHUNK_START_WEIGHTS, rows * sizeof(float), &status, error);
    if ((row->parts & SKD_PART_START_JOINTS) != 0)
        parts.start_joints =
            read_array(store, SKD_CHUNK_START_JOINTS, rows * sizeof(uint16_t), &status, error);
    if ((row->parts & SKD_PART_REST) != 0)
        parts.rest =
            read_array(store, SKD_CHUNK_REST, vertices * 3 * sizeof(float), &status, error);
    if (status == SKD_OK && (parts.source = strdup(row->source)) == NULL)
        status = skd_fail_memory(error, "a path");
    if (status == SKD_OK)
        return skd_session_restore(&parts, session, error);
    skd_rig_destroy(parts.rig);
    free(parts.joints);
    free(parts.weights);
    free(parts.start_weights);
    free(parts.start_joints);
    free(parts.rest);
    return status;
}

enum skd_status skd_base_read(struct skd_store *store, struct skd_pose_rows *poses,
                              struct skd_session_row *row, struct skd_session **result,
                              size_t *damaged, struct skd_error *error)
{
    struct skd_session *session = NULL;
    enum skd_status status = skd_session_row_read(store, row, error);
    if (status == SKD_OK)
        status = read_parts(store, row, &session, error);
    if (status != SKD_OK)
        return status;
    poses->bone_count = (size_t)row->bones;
    memcpy(session->name, row->name, sizeof session->name);
    session->slots = row->report;
    session->reduction = row->reduction;
    session->history.base_revision = row->revision;
    status = skd_pose_rows_read(store, poses, true, damaged, error);
    for (uint64_t id = 0; id < row->sheets && status == SKD_OK; id++)
        status = read_sheet(store, poses, id, session, error);
    if (status == SKD_OK)
        *result = session;
    else
        skd_session_destroy(session);
    return status;
}
