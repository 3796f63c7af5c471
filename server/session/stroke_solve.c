/* See stroke_solve.h; and skd_stroke_solve of stroke.h. */
#include "session/stroke_solve.h"

#include "session/smoothing.h"
#include "solver/candidates.h"
#include "solver/evidence.h"
#include "solver/rest.h"
#include "solver/shape.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct skd_solve_batch skd_stroke_batch(const struct skd_stroke *stroke)
{
    const struct skd_session *session = stroke->session;
    return (struct skd_solve_batch){
        .slot_count = session->slot_count,
        .pose_count = stroke->pose_count,
        .rest = session->rest,
        .joints = session->joints,
        .weights = session->weights,
        .anchor = session->anchor,
        .start_joints = session->start_joints,
        .start_weights = session->start_weights,
        .guard = session->guards.factors,
        .vertex_locked = stroke->vertex_locked,
        .bone_locked = stroke->bone_locked,
    };
}

void skd_stroke_solve_evidence(const struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                               const uint16_t *candidates, uint16_t *joints)
{
    const struct skd_rig *rig = stroke->session->rig;
    const struct skd_evidence_bones bones = {
        .bone_count = rig->skeleton.bone_count,
        .bone_skin = rig->skeleton.skins,
        .vertex_skin = rig->mesh.skins,
        .lists = candidates,
    };
    skd_evidence_solve(batch, &stroke->input.options, &bones, joints);
}

/* The poses' targets from item `first` on; `poses` has room for stroke->pose_count. */
static void point_poses(const struct skd_stroke *stroke, size_t first, struct skd_solve_pose *poses)
{
    for (int p = 0; p < stroke->pose_count; p++) {
        const struct skd_stroke_pose *from = &stroke->poses[p];
        poses[p] = (struct skd_solve_pose){
            .matrices = from->matrices,
            .targets = from->targets + 3 * first,
            .strengths = from->strengths != NULL ? from->strengths + first : NULL,
        };
    }
}

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
        .start_joints = session->start_joints,
        .start_weights = session->start_weights,
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

/* The rows as they are before the stroke: what undo goes back to. */
static void copy_before(const struct skd_stroke *stroke, size_t first, size_t count)
{
    const struct skd_session *session = stroke->session;
    struct skd_step *step = stroke->step;
    size_t slots = (size_t)step->slot_count;
    for (size_t i = first; i < first + count; i++) {
        size_t vertex = step->vertices[i];
        memcpy(step->before + i * slots, session->weights + vertex * slots, slots * sizeof(float));
        if (step->joints_before != NULL)
            memcpy(step->joints_before + i * slots, session->joints + vertex * slots,
                   slots * sizeof(uint16_t));
        if (step->rest_before != NULL)
            memcpy(step->rest_before + 3 * i, session->rest + 3 * vertex, 3 * sizeof(float));
    }
}

static void solve_weights(struct skd_stroke *stroke, struct skd_solve_batch *batch, size_t first)
{
    if (stroke->smoothing != NULL && stroke->pass > 0)
        skd_smoothing_solve(stroke, batch, first);
    else if (stroke->candidates != NULL)
        skd_stroke_solve_evidence(stroke, batch, stroke->candidates + SKD_CANDIDATES_MAX * first,
                                  stroke->step->joints_after + (size_t)batch->slot_count * first);
    else
        skd_solve(batch, &stroke->input.options);
}

/* The joints of items [first, first + count) as solved: borrowed, or gathered into `rows`. */
static const uint16_t *joints_of(const struct skd_stroke *stroke, size_t first, size_t count,
                                 uint16_t *rows)
{
    const struct skd_step *step = stroke->step;
    size_t slots = (size_t)step->slot_count;
    if (step->joints_after != NULL)
        return step->joints_after + slots * first;
    for (size_t i = 0; i < count; i++)
        memcpy(rows + i * slots, stroke->session->joints + step->vertices[first + i] * slots,
               slots * sizeof *rows);
    return rows;
}

static void measure(const float *shown, const float *wanted, size_t count, float *distances)
{
    for (size_t i = 0; i < count; i++) {
        double square = 0.0;
        for (size_t k = 3 * i; k < 3 * i + 3; k++) {
            double apart = (double)shown[k] - (double)wanted[k];
            square += apart * apart;
        }
        distances[i] = (float)sqrt(square);
    }
}

enum { PIECE = 256 }; /* vertices whose rows fit on the stack */

/* Rest positions, corrective shape and residuals of one piece, whose weights are solved. */
static void finish_piece(struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                         size_t first)
{
    const struct skd_session *session = stroke->session;
    struct skd_step *step = stroke->step;
    size_t slots = (size_t)batch->slot_count, count = batch->count;
    uint16_t rows[PIECE * SKD_SLOT_COUNT_MAX];
    float rest[PIECE * 3], shown[PIECE * 3];
    const uint16_t *joints = joints_of(stroke, first, count, rows);
    float *weights = step->after + slots * first;
    const float *asked = (stroke->asked != NULL ? stroke->asked : stroke->poses[0].targets);
    asked += 3 * first;
    skd_session_show(session, stroke->pose, count, batch->vertices, shown);
    measure(shown, asked, count, stroke->residual_before + first);
    for (size_t i = 0; i < count; i++)
        memcpy(rest + 3 * i, session->rest + 3 * (size_t)batch->vertices[i], 3 * sizeof(float));
    if (step->rest_after != NULL) {
        skd_rest_solve(batch, &stroke->input.options, joints, weights, rest,
                       stroke->doubtful + first);
        memcpy(step->rest_after + 3 * first, rest, count * 3 * sizeof(float));
    }
    if (step->shape != NULL) {
        float *offsets = step->shape->after + SKD_SHAPE_NUMBERS * first;
        skd_shape_solve(count, batch->slot_count, rest, joints, weights, stroke->pose->matrices,
                        batch->poses[0].targets, offsets);
        for (size_t k = 0; k < 3 * count; k++)
            rest[k] += offsets[k];
    }
    skd_skin(count, NULL, batch->slot_count, rest, joints, weights, stroke->pose->matrices, shown);
    measure(shown, asked, count, stroke->residual_after + first);
}

/* Root of the mean square over a refit's poses of how far vertices are from their targets. */
static void measure_poses(const struct skd_solve_batch *batch, const uint32_t *vertices,
                          const float *rest, const uint16_t *joints, const float *weights,
                          float *distances)
{
    float shown[PIECE * 3], apart[PIECE];
    double squares[PIECE] = {0};
    for (int p = 0; p < batch->pose_count; p++) {
        skd_skin(batch->count, vertices, batch->slot_count, rest, joints, weights,
                 batch->poses[p].matrices, shown);
        measure(shown, batch->poses[p].targets, batch->count, apart);
        for (size_t i = 0; i < batch->count; i++)
            squares[i] += (double)apart[i] * (double)apart[i];
    }
    for (size_t i = 0; i < batch->count; i++)
        distances[i] = (float)sqrt(squares[i] / batch->pose_count);
}

/* Residuals of one piece of a refit: over all its poses. */
static void finish_refit_piece(struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                               size_t first)
{
    const struct skd_session *session = stroke->session;
    uint16_t rows[PIECE * SKD_SLOT_COUNT_MAX];
    float rest[PIECE * 3];
    const uint16_t *joints = joints_of(stroke, first, batch->count, rows);
    measure_poses(batch, batch->vertices, session->rest, session->joints, session->weights,
                  stroke->residual_before + first);
    for (size_t i = 0; i < batch->count; i++)
        memcpy(rest + 3 * i, session->rest + 3 * (size_t)batch->vertices[i], 3 * sizeof(float));
    measure_poses(batch, NULL, rest, joints,
                  stroke->step->after + (size_t)batch->slot_count * first,
                  stroke->residual_after + first);
}

/* Whether the solver's own residuals do not tell what is seen: the target was another one, or
 * something else than weights moved. */
static bool needs_finishing(const struct skd_stroke *stroke)
{
    const struct skd_step *step = stroke->step;
    bool moves = stroke->shown_before != NULL;
    return stroke->pose == NULL || moves || step->rest_after != NULL || step->shape != NULL ||
           stroke->pass > 0;
}

void skd_stroke_solve(struct skd_stroke *stroke, size_t first, size_t count)
{
    struct skd_step *step = stroke->step;
    struct skd_solve_pose poses[SKD_SHEETS_MAX + 1];
    struct skd_solve_batch batch = skd_stroke_batch(stroke);
    if (stroke->pass == 0)
        copy_before(stroke, first, count);
    point_poses(stroke, first, poses);
    batch.count = count;
    batch.vertices = step->vertices + first;
    batch.poses = poses;
    batch.weights_out = step->after + first * (size_t)step->slot_count;
    batch.residual_before = stroke->residual_before + first;
    batch.residual_after = stroke->residual_after + first;
    solve_weights(stroke, &batch, first);
    if (stroke->pass + 1 < stroke->pass_count || !needs_finishing(stroke))
        return;
    for (size_t at = 0; at < count; at += PIECE) {
        struct skd_solve_batch piece = batch;
        piece.count = count - at < PIECE ? count - at : PIECE;
        piece.vertices += at;
        point_poses(stroke, first + at, poses);
        if (stroke->pose == NULL)
            finish_refit_piece(stroke, &piece, first + at);
        else
            finish_piece(stroke, &piece, first + at);
    }
}

enum skd_status skd_stroke_next_pass(struct skd_stroke *stroke, struct skd_error *error)
{
    stroke->pass++;
    if (stroke->smoothing != NULL) {
        skd_smoothing_next(stroke);
        return SKD_OK;
    }
    return skd_stroke_find_candidates(stroke, error);
}
