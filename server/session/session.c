/* See session.h. */
#include "session/session.h"

#include "session/bits.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

static size_t weight_count(const struct skd_session *session)
{
    return session->rig->mesh.vertex_count * (size_t)session->slot_count;
}

void skd_session_destroy(struct skd_session *session)
{
    if (session == NULL)
        return;
    skd_remembered_finish(&session->remembered);
    skd_history_finish(&session->history);
    skd_sheets_finish(&session->pins);
    skd_sheets_finish(&session->shapes);
    skd_poses_finish(&session->poses);
    if (session->rest != session->rig->mesh.rest)
        free(session->rest);
    free(session->start_joints);
    free(session->start_weights);
    free(session->hops);
    skd_guards_finish(&session->guards);
    free(session->joints);
    free(session->weights);
    free(session->anchor);
    free(session->source);
    skd_rig_destroy(session->rig);
    free(session);
}

void skd_session_new_instance(char instance[SKD_INSTANCE_BYTES + 1])
{
    uint64_t number;
    /* Eight bytes come whole or not at all (getrandom(2)), and only a kernel without it fails. */
    ssize_t got = getrandom(&number, sizeof number, 0);
    SKD_ASSERT(got == (ssize_t)sizeof number);
    (void)snprintf(instance, SKD_INSTANCE_BYTES + 1, "%016llx", (unsigned long long)number);
}

enum skd_status skd_session_keep_start(struct skd_session *session, struct skd_error *error)
{
    size_t count = weight_count(session);
    if (session->start_joints != NULL)
        return SKD_OK;
    uint16_t *joints = malloc(count * sizeof *joints);
    float *weights = malloc(count * sizeof *weights);
    if (joints == NULL || weights == NULL) {
        free(joints);
        free(weights);
        return skd_fail_memory(error, "the bones at the session's start");
    }
    memcpy(joints, session->joints, count * sizeof *joints);
    memcpy(weights, session->anchor, count * sizeof *weights);
    session->start_joints = joints;
    session->start_weights = weights;
    return SKD_OK;
}

enum skd_status skd_session_own_rest(struct skd_session *session, struct skd_error *error)
{
    const struct skd_mesh *mesh = &session->rig->mesh;
    if (session->rest != mesh->rest)
        return SKD_OK;
    float *rest = malloc(mesh->vertex_count * 3 * sizeof *rest);
    if (rest == NULL)
        return skd_fail_memory(error, "the rest positions");
    memcpy(rest, mesh->rest, mesh->vertex_count * 3 * sizeof *rest);
    session->rest = rest;
    return SKD_OK;
}

enum skd_status skd_session_need_sheet(struct skd_session *session, struct skd_sheets *sheets,
                                       struct skd_pose *pose, struct skd_sheet **sheet,
                                       struct skd_error *error)
{
    if (sheets->count == sheets->capacity) {
        skd_history_keep_sheets(&session->history, sheets);
        skd_sheets_drop_idle(sheets);
    }
    return skd_sheets_need(sheets, pose, sheet, error);
}

const uint16_t *skd_session_start_joints(const struct skd_session *session)
{
    return session->start_joints != NULL ? session->start_joints : session->joints;
}

const float *skd_session_start_weights(const struct skd_session *session)
{
    return session->start_weights != NULL ? session->start_weights : session->anchor;
}

void skd_session_anchor_row(const struct skd_session *session, size_t vertex,
                            const uint16_t *joints, float *anchor)
{
    size_t slots = (size_t)session->slot_count;
    const uint16_t *start_joints = skd_session_start_joints(session) + vertex * slots;
    const float *start = skd_session_start_weights(session) + vertex * slots;
    for (size_t i = 0; i < slots; i++) {
        anchor[i] = 0;
        for (size_t k = 0; k < slots && joints[i] != SKD_SLOT_EMPTY; k++) {
            if (start_joints[k] == joints[i])
                anchor[i] = start[k];
        }
    }
}

size_t skd_session_count_moved(const struct skd_session *session)
{
    const struct skd_mesh *mesh = &session->rig->mesh;
    size_t moved = 0;
    for (size_t v = 0; v < mesh->vertex_count && session->rest != mesh->rest; v++)
        moved += memcmp(session->rest + 3 * v, mesh->rest + 3 * v, 3 * sizeof(float)) != 0;
    return moved;
}

void skd_session_show(const struct skd_session *session, const struct skd_pose *pose, size_t count,
                      const uint32_t *vertices, float *out)
{
    size_t slots = (size_t)session->slot_count;
    const struct skd_sheet *shape = skd_sheets_find(&session->shapes, pose);
    skd_skin(count, vertices, session->slot_count, session->rest, session->joints, session->weights,
             pose->matrices, out);
    for (size_t i = 0; i < count && shape != NULL; i++) {
        uint32_t vertex = vertices != NULL ? vertices[i] : (uint32_t)i;
        const float *offset = skd_sheet_row(&session->shapes, shape, vertex);
        if (offset == NULL)
            continue;
        float rest[3];
        for (int axis = 0; axis < 3; axis++)
            rest[axis] = session->rest[3 * (size_t)vertex + (size_t)axis] + offset[axis];
        skd_skin(1, NULL, session->slot_count, rest, session->joints + vertex * slots,
                 session->weights + vertex * slots, pose->matrices, out + 3 * i);
    }
}

static void write_joints(struct skd_session *session, const struct skd_step *step,
                         const uint16_t *joints)
{
    size_t slots = (size_t)step->slot_count;
    for (size_t i = 0; i < step->count; i++) {
        size_t at = step->vertices[i] * slots;
        skd_session_anchor_row(session, step->vertices[i], joints + i * slots,
                               session->anchor + at);
        memcpy(session->joints + at, joints + i * slots, slots * sizeof(uint16_t));
    }
}

void skd_session_write(struct skd_session *session, const struct skd_step *step, bool undo)
{
    const float *weights = undo ? step->before : step->after;
    const uint16_t *joints = undo ? step->joints_before : step->joints_after;
    const float *rest = undo ? step->rest_before : step->rest_after;
    size_t slots = (size_t)step->slot_count;
    if (joints != NULL)
        write_joints(session, step, joints);
    for (size_t i = 0; i < step->count; i++)
        memcpy(session->weights + step->vertices[i] * slots, weights + i * slots,
               slots * sizeof(float));
    for (size_t i = 0; i < step->count && rest != NULL; i++)
        memcpy(session->rest + 3 * (size_t)step->vertices[i], rest + 3 * i, 3 * sizeof(float));
    for (struct skd_sheet_change *change = step->pins; change != NULL; change = change->next)
        skd_sheet_change_write(change, undo);
    if (step->shape != NULL)
        skd_sheet_change_write(step->shape, undo);
}

void skd_session_account(struct skd_session *session)
{
    size_t bytes = skd_sheets_bytes(&session->pins) + skd_sheets_bytes(&session->shapes) +
                   skd_guards_bytes(&session->guards) + session->remembered.bytes;
    if (session->start_joints != NULL)
        bytes += weight_count(session) * (sizeof(uint16_t) + sizeof(float));
    if (session->rest != session->rig->mesh.rest)
        bytes += session->rig->mesh.vertex_count * 3 * sizeof(float);
    if (session->hops != NULL)
        bytes +=
            (size_t)session->rig->skeleton.bone_count * (size_t)session->rig->skeleton.bone_count;
    session->grown_bytes = bytes;
}

void skd_session_advance(struct skd_session *session)
{
    skd_session_account(session);
    session->revision++;
}

size_t skd_session_bytes(const struct skd_session *session)
{
    size_t pose_bytes =
        (size_t)session->rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof(double);
    return sizeof *session + skd_rig_bytes(session->rig) +
           weight_count(session) * (sizeof(uint16_t) + 2 * sizeof(float)) +
           HASH_COUNT(session->poses.by_name) * (sizeof(struct skd_pose) + pose_bytes) +
           session->history.bytes + session->grown_bytes;
}

struct skd_pose *skd_session_find_pose(const struct skd_session *session, const char *name,
                                       struct skd_error *error)
{
    struct skd_pose *pose = skd_poses_find(&session->poses, name);
    if (pose == NULL)
        (void)skd_fail(error, SKD_NO_POSE, "session \"%s\" has no pose \"%s\"", session->name,
                       name);
    return pose;
}

enum skd_status skd_session_check_vertices(const struct skd_session *session,
                                           const uint32_t *vertices, size_t count,
                                           struct skd_error *error)
{
    size_t vertex_count = session->rig->mesh.vertex_count;
    if (count > SKD_VERTICES_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "%zu vertices are named, and %zu is the limit; name each once", count,
                        SKD_VERTICES_MAX);
    for (size_t i = 0; i < count; i++) {
        if (vertices[i] >= vertex_count)
            return skd_fail(error, SKD_BAD_INDEX,
                            "vertices[%zu] is %u, but the session \"%s\" has %zu vertices; name "
                            "them from 0 to %zu",
                            i, (unsigned)vertices[i], session->name, vertex_count,
                            vertex_count - 1);
    }
    return SKD_OK;
}

enum skd_status skd_session_check_distinct(const struct skd_session *session,
                                           const uint32_t *vertices, size_t count,
                                           struct skd_error *error)
{
    enum skd_status status = skd_session_check_vertices(session, vertices, count, error);
    if (status != SKD_OK)
        return status;
    uint8_t *named = calloc(skd_bits_bytes(session->rig->mesh.vertex_count), 1);
    if (named == NULL)
        return skd_fail_memory(error, "checking the vertices");
    for (size_t i = 0; i < count && status == SKD_OK; i++) {
        if (skd_bits_take(named, vertices[i]))
            status = skd_fail(error, SKD_BAD_INDEX,
                              "vertices[%zu] names vertex %u a second time; name each vertex once",
                              i, (unsigned)vertices[i]);
    }
    free(named);
    return status;
}
