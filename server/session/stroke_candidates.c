/* Which bones a stroke's vertices may choose from; see stroke_candidates.h.
 *
 * Stage: job, before the solve. Thread: a worker.
 */
#include "session/stroke_candidates.h"

#include "solver/candidates.h"

#include <stdlib.h>
#include <string.h>

/* The hops between all bones, made once for a session. */
static enum skd_status need_hops(struct skd_session *session, struct skd_error *error)
{
    const struct skd_skeleton *skeleton = &session->rig->skeleton;
    size_t bones = (size_t)skeleton->bone_count;
    if (session->hops == NULL) {
        session->hops = malloc(bones * bones);
        if (session->hops == NULL)
            return skd_fail_memory(error, "choosing bones for each vertex");
        skd_hops_build(skeleton->bone_count, skeleton->parents, session->hops);
    }
    return SKD_OK;
}

/* The rows that the pass before found, laid out by vertex: two blocks of the caller's. */
static void scatter_result(const struct skd_stroke *stroke, uint16_t *joints, float *weights)
{
    const struct skd_session *session = stroke->session;
    const struct skd_step *step = stroke->step;
    size_t slots = (size_t)step->slot_count, rows = session->rig->mesh.vertex_count * slots;
    memcpy(joints, session->joints, rows * sizeof *joints);
    memcpy(weights, session->weights, rows * sizeof *weights);
    for (size_t i = 0; i < step->count; i++) {
        size_t at = step->vertices[i] * slots;
        memcpy(joints + at, step->joints_after + i * slots, slots * sizeof *joints);
        memcpy(weights + at, step->after + i * slots, slots * sizeof *weights);
    }
}

enum skd_status skd_stroke_find_candidates(struct skd_stroke *stroke, struct skd_error *error)
{
    struct skd_session *session = stroke->session;
    const struct skd_rig *rig = session->rig;
    size_t rows = rig->mesh.vertex_count * (size_t)session->slot_count;
    size_t list_bytes = stroke->step->count * SKD_CANDIDATES_MAX * sizeof(uint16_t);
    uint16_t *joints = NULL;
    float *weights = NULL;
    void *scratch = NULL;
    enum skd_status status = need_hops(session, error);
    if (status != SKD_OK)
        return status;
    struct skd_candidates_input input = {
        .vertex_count = rig->mesh.vertex_count,
        .slot_count = session->slot_count,
        .bone_count = rig->skeleton.bone_count,
        .hops = session->hops,
        .bone_heads = rig->skeleton.heads,
        .bone_parents = rig->skeleton.parents,
        .bone_skin = rig->skeleton.skins,
        .vertex_skin = rig->mesh.skins,
        .rest = rig->mesh.rest,
        .start_joints = skd_session_start_joints(session),
        .start_weights = skd_session_start_weights(session),
        .neighbour_offsets = rig->mesh.neighbour_offsets,
        .neighbours = rig->mesh.neighbours,
        .count = stroke->step->count,
        .vertices = stroke->step->vertices,
    };
    if (stroke->pass > 0) {
        joints = malloc(rows * sizeof *joints);
        weights = malloc(rows * sizeof *weights);
        if (joints == NULL || weights == NULL)
            goto no_memory;
        scatter_result(stroke, joints, weights);
        input.start_joints = joints;
        input.start_weights = weights;
    }
    if (stroke->candidates == NULL)
        stroke->candidates = malloc(list_bytes + 1);
    scratch = malloc(skd_candidates_scratch_bytes(&input) + 1);
    if (stroke->candidates == NULL || scratch == NULL)
        goto no_memory;
    skd_candidates_fill(&input, scratch, stroke->candidates);
    goto done;
no_memory:
    status = skd_fail_memory(error, "choosing bones for each vertex");
done:
    free(joints);
    free(weights);
    free(scratch);
    return status;
}
