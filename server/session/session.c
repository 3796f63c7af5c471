/* See session.h. */
#include "session/session.h"

#include "session/bits.h"
#include "session/reduction.h"

#include <stdlib.h>
#include <string.h>

static size_t weight_count(const struct skd_session *session)
{
    return session->rig->mesh.vertex_count * (size_t)session->slot_count;
}

static enum skd_status refuse_cut(const struct skd_influences *influences, size_t vertex_count,
                                  int slot_count, struct skd_error *error)
{
    size_t over = 0;
    for (size_t v = 0; v < vertex_count; v++)
        over += influences->offsets[v + 1] - influences->offsets[v] > (uint32_t)slot_count;
    return skd_fail(error, SKD_TOO_MANY_INFLUENCES,
                    "%zu of %zu vertices have more than %d influences (up to %d), and none is cut "
                    "without being told to",
                    over, vertex_count, slot_count, influences->most);
}

/* Slots, weights and anchor; the hop table and the fill's scratch are gone when it returns. */
static enum skd_status choose_slots(struct skd_session *session,
                                    const struct skd_influences *influences, enum skd_fill fill,
                                    struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    const struct skd_skeleton *skeleton = &rig->skeleton;
    size_t bones = (size_t)skeleton->bone_count;
    uint8_t *hops = malloc(bones * bones);
    struct skd_slots_input input = {
        .vertex_count = rig->mesh.vertex_count,
        .slot_count = session->slot_count,
        .fill = fill,
        .bone_count = skeleton->bone_count,
        .hops = hops,
        .bone_heads = skeleton->heads,
        .bone_skin = skeleton->skins,
        .vertex_skin = rig->mesh.skins,
        .rest = rig->mesh.rest,
        .influence_offsets = influences->offsets,
        .influence_joints = influences->joints,
        .influence_weights = influences->weights,
        .neighbour_offsets = rig->mesh.neighbour_offsets,
        .neighbours = rig->mesh.neighbours,
    };
    void *scratch = malloc(skd_slots_scratch_bytes(&input) + 1);
    enum skd_status status = SKD_OK;
    if (hops == NULL || scratch == NULL) {
        status = skd_fail_memory(error, "choosing bones for each vertex");
    } else {
        skd_hops_build(skeleton->bone_count, skeleton->parents, hops);
        skd_slots_fill(&input, scratch, session->joints, session->weights, &session->slots);
    }
    free(scratch);
    free(hops);
    return status;
}

static enum skd_status add_rest_pose(struct skd_session *session, struct skd_error *error)
{
    int bones = session->rig->skeleton.bone_count;
    struct skd_pose *pose = skd_pose_create("rest", bones);
    if (pose == NULL)
        return skd_fail_memory(error, "the rest pose");
    memcpy(pose->matrices, session->rig->rest_pose,
           (size_t)bones * SKD_MATRIX_SIZE * sizeof(double));
    return skd_poses_put(&session->poses, pose, error);
}

enum skd_status skd_session_create(struct skd_rig *rig, const struct skd_influences *influences,
                                   const char *source, const struct skd_session_options *options,
                                   struct skd_session **result, struct skd_error *error)
{
    enum skd_status status;
    struct skd_session *session = calloc(1, sizeof *session);
    if (session == NULL) {
        skd_rig_destroy(rig);
        return skd_fail_memory(error, "a session");
    }
    session->rig = rig;
    session->slot_count = options->slot_count;
    if (influences->most > options->slot_count && !options->may_reduce) {
        status = refuse_cut(influences, rig->mesh.vertex_count, options->slot_count, error);
        goto fail;
    }
    size_t count = weight_count(session);
    session->source = strdup(source);
    session->joints = malloc(count * sizeof *session->joints);
    session->weights = malloc(count * sizeof *session->weights);
    session->anchor = malloc(count * sizeof *session->anchor);
    if (session->source == NULL || session->joints == NULL || session->weights == NULL ||
        session->anchor == NULL) {
        status = skd_fail_memory(error, "the session's weights");
        goto fail;
    }
    if ((status = choose_slots(session, influences, options->fill, error)) != SKD_OK ||
        (status = add_rest_pose(session, error)) != SKD_OK)
        goto fail;
    if (session->slots.reduced_count > 0 &&
        (status = skd_reduction_measure(session, influences, &session->reduction, error)) != SKD_OK)
        goto fail;
    memcpy(session->anchor, session->weights, count * sizeof *session->anchor);
    *result = session;
    return SKD_OK;
fail:
    skd_session_destroy(session);
    return status;
}

void skd_session_destroy(struct skd_session *session)
{
    if (session == NULL)
        return;
    skd_history_finish(&session->history);
    skd_poses_finish(&session->poses);
    free(session->joints);
    free(session->weights);
    free(session->anchor);
    free(session->source);
    skd_rig_destroy(session->rig);
    free(session);
}

void skd_session_write(struct skd_session *session, const struct skd_step *step, bool undo)
{
    const float *source = undo ? step->before : step->after;
    size_t slots = (size_t)step->slot_count;
    for (size_t i = 0; i < step->count; i++)
        memcpy(session->weights + step->vertices[i] * slots, source + i * slots,
               slots * sizeof(float));
}

size_t skd_session_bytes(const struct skd_session *session)
{
    size_t pose_bytes =
        (size_t)session->rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof(double);
    return sizeof *session + skd_rig_bytes(session->rig) +
           weight_count(session) * (sizeof(uint16_t) + 2 * sizeof(float)) +
           HASH_COUNT(session->poses.by_name) * (sizeof(struct skd_pose) + pose_bytes) +
           session->history.bytes;
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
