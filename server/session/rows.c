/* See rows.h. */
#include "session/rows.h"

#include "session/bits.h"

#include <stdlib.h>
#include <string.h>

enum { ITEMS_BETWEEN_LOOKS = 4096 };

enum skd_status skd_scope_check(const struct skd_edit_scope *scope, size_t item,
                                struct skd_error *error)
{
    if (item % ITEMS_BETWEEN_LOOKS != 0 || scope->cancelled == NULL ||
        !atomic_load(scope->cancelled))
        return SKD_OK;
    return skd_fail(error, SKD_CANCELLED, "it was cancelled; nothing was changed");
}

/* Writes every vertex of the scope and its ring, each once; returns how many. */
static size_t list_rings(const struct skd_mesh *mesh, const struct skd_edit_scope *scope,
                         uint8_t *listed, uint32_t *out)
{
    size_t count = 0;
    for (size_t i = 0; i < scope->count; i++) {
        uint32_t vertex = scope->vertices[i];
        while (!skd_bits_take(listed, vertex)) {
            out[count++] = vertex;
            vertex = mesh->twins != NULL ? mesh->twins[vertex] : vertex;
        }
    }
    return count;
}

enum skd_status skd_rows_list(const struct skd_session *session, const struct skd_edit_scope *scope,
                              uint32_t **vertices, size_t *count, struct skd_error *error)
{
    const struct skd_mesh *mesh = &session->rig->mesh;
    size_t most = scope->all || mesh->twins != NULL ? mesh->vertex_count : scope->count;
    *vertices = NULL;
    *count = 0;
    if (!scope->all) {
        enum skd_status status =
            skd_session_check_distinct(session, scope->vertices, scope->count, error);
        if (status != SKD_OK)
            return status;
    }
    uint8_t *listed = calloc(skd_bits_bytes(mesh->vertex_count), 1);
    *vertices = malloc(most * sizeof **vertices + 1);
    if (listed == NULL || *vertices == NULL) {
        free(listed);
        free(*vertices);
        *vertices = NULL;
        return skd_fail_memory(error, "the vertices to edit");
    }
    for (size_t v = 0; scope->all && v < mesh->vertex_count; v++)
        (*vertices)[v] = (uint32_t)v;
    *count = scope->all ? mesh->vertex_count : list_rings(mesh, scope, listed, *vertices);
    free(listed);
    return SKD_OK;
}

enum skd_status skd_rows_take(const struct skd_session *session, uint32_t *vertices, size_t count,
                              struct skd_rows *rows, struct skd_error *error)
{
    size_t slots = (size_t)session->slot_count;
    *rows = (struct skd_rows){
        .slot_count = session->slot_count,
        .count = count,
        .vertices = vertices,
        .joints = malloc(count * slots * sizeof *rows->joints + 1),
        .weights = malloc(count * slots * sizeof *rows->weights + 1),
    };
    if (rows->joints == NULL || rows->weights == NULL) {
        skd_rows_finish(rows);
        return skd_fail_memory(error, "the weights to edit");
    }
    for (size_t i = 0; i < count; i++) {
        memcpy(rows->joints + i * slots, session->joints + vertices[i] * slots,
               slots * sizeof *rows->joints);
        memcpy(rows->weights + i * slots, session->weights + vertices[i] * slots,
               slots * sizeof *rows->weights);
    }
    return SKD_OK;
}

void skd_rows_finish(struct skd_rows *rows)
{
    free(rows->vertices);
    free(rows->joints);
    free(rows->weights);
    *rows = (struct skd_rows){0};
}

static bool joints_differ(const struct skd_session *session, const struct skd_rows *rows, size_t i)
{
    size_t slots = (size_t)rows->slot_count;
    return memcmp(rows->joints + i * slots, session->joints + rows->vertices[i] * slots,
                  slots * sizeof *rows->joints) != 0;
}

static bool weights_differ(const struct skd_session *session, const struct skd_rows *rows, size_t i)
{
    size_t slots = (size_t)rows->slot_count;
    return memcmp(rows->weights + i * slots, session->weights + rows->vertices[i] * slots,
                  slots * sizeof *rows->weights) != 0;
}

static void fill_step(const struct skd_session *session, const struct skd_rows *rows,
                      struct skd_step *step)
{
    size_t slots = (size_t)rows->slot_count, out = 0;
    size_t weight_bytes = slots * sizeof(float), joint_bytes = slots * sizeof(uint16_t);
    for (size_t i = 0; i < rows->count; i++) {
        if (!weights_differ(session, rows, i) && !joints_differ(session, rows, i))
            continue;
        size_t at = rows->vertices[i] * slots, to = out * slots;
        step->vertices[out++] = rows->vertices[i];
        memcpy(step->before + to, session->weights + at, weight_bytes);
        memcpy(step->after + to, rows->weights + i * slots, weight_bytes);
        if (step->joints_after == NULL)
            continue;
        memcpy(step->joints_before + to, session->joints + at, joint_bytes);
        memcpy(step->joints_after + to, rows->joints + i * slots, joint_bytes);
    }
}

enum skd_status skd_rows_step(struct skd_session *session, const struct skd_rows *rows,
                              struct skd_step **result, struct skd_error *error)
{
    size_t changed = 0, slots_changed = 0;
    enum skd_status status = SKD_OK;
    for (size_t i = 0; i < rows->count; i++) {
        bool joints = joints_differ(session, rows, i);
        slots_changed += joints;
        changed += joints || weights_differ(session, rows, i);
    }
    struct skd_step *step = skd_step_create(changed, rows->slot_count);
    if (step == NULL)
        return skd_fail_memory(error, "a step of the history");
    if (slots_changed > 0 && ((status = skd_step_add_joints(step, error)) != SKD_OK ||
                              (status = skd_session_keep_start(session, error)) != SKD_OK)) {
        skd_step_release(step);
        return status;
    }
    fill_step(session, rows, step);
    *result = step;
    return SKD_OK;
}
