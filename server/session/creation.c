/* See creation.h. */
#include "session/creation.h"

#include "session/reduction.h"

#include <stdlib.h>
#include <string.h>

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

/* Slots chosen a second time, from influences that were cut by what they do in poses. */
static enum skd_status cut_by_poses(struct skd_session *session,
                                    const struct skd_influences *influences, enum skd_fill fill,
                                    struct skd_error *error)
{
    struct skd_influences cut = {0};
    size_t reduced_count = session->slots.reduced_count;
    float largest_cut;
    enum skd_status status = skd_reduction_cut(session, influences, &cut, &largest_cut, error);
    if (status == SKD_OK)
        status = choose_slots(session, &cut, fill, error);
    session->slots.reduced_count = reduced_count;
    session->slots.largest_cut = largest_cut;
    skd_influences_finish(&cut);
    return status;
}

enum skd_status skd_session_add_rest_pose(struct skd_session *session, struct skd_error *error)
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
    if (influences->most > options->slot_count && options->cut == SKD_CUT_REFUSE) {
        status = refuse_cut(influences, rig->mesh.vertex_count, options->slot_count, error);
        goto fail;
    }
    size_t count = rig->mesh.vertex_count * (size_t)session->slot_count;
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
        (status = skd_session_add_rest_pose(session, error)) != SKD_OK)
        goto fail;
    if (session->slots.reduced_count > 0 && options->cut == SKD_CUT_POSED &&
        (status = cut_by_poses(session, influences, options->fill, error)) != SKD_OK)
        goto fail;
    if (session->slots.reduced_count > 0 &&
        (status = skd_reduction_measure(session, influences, &session->reduction, error)) != SKD_OK)
        goto fail;
    memcpy(session->anchor, session->weights, count * sizeof *session->anchor);
    session->rest = rig->mesh.rest;
    session->history.bytes_max = SKD_HISTORY_BYTES_DEFAULT;
    skd_session_new_instance(session->instance);
    size_t bones = (size_t)rig->skeleton.bone_count;
    skd_sheets_init(&session->pins, SKD_PIN_NUMBERS, -1, rig->mesh.vertex_count, bones);
    skd_sheets_init(&session->shapes, SKD_SHAPE_NUMBERS, 0, rig->mesh.vertex_count, bones);
    *result = session;
    return SKD_OK;
fail:
    skd_session_destroy(session);
    return status;
}
