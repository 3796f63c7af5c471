/* See stroke_pass.h. */
#include "session/stroke_pass.h"

#include "session/smoothing.h"
#include "session/stroke_batch.h"
#include "session/stroke_candidates.h"
#include "session/stroke_outcome.h"
#include "solver/candidates.h"

#include <stdlib.h>
#include <string.h>

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
        if (stroke->pass == SKD_PASS_REST_FIRST)
            memcpy(step->joints_after + i * slots, step->joints_before + i * slots,
                   slots * sizeof(uint16_t));
    }
}

static void solve_weights(struct skd_stroke *stroke, struct skd_solve_batch *batch, size_t first)
{
    if (stroke->pass == SKD_PASS_REST_FIRST)
        skd_solve(batch, &stroke->input.options);
    else if (stroke->smoothing != NULL && stroke->pass > 0)
        skd_smoothing_solve(stroke, batch, first);
    else if (stroke->candidates != NULL)
        skd_stroke_solve_evidence(stroke, batch, stroke->candidates + SKD_CANDIDATES_MAX * first,
                                  stroke->step->joints_after + (size_t)batch->slot_count * first);
    else
        skd_solve(batch, &stroke->input.options);
}

/* Calls one of the stages that work on pieces, for all pieces of a chunk. */
static void for_pieces(struct skd_stroke *stroke, const struct skd_solve_batch *batch, size_t first,
                       struct skd_solve_pose *poses,
                       void (*stage)(struct skd_stroke *stroke, const struct skd_solve_batch *piece,
                                     size_t first))
{
    for (size_t at = 0; at < batch->count; at += SKD_PIECE_VERTICES) {
        struct skd_solve_batch piece = *batch;
        size_t left = batch->count - at;
        piece.count = left < SKD_PIECE_VERTICES ? left : SKD_PIECE_VERTICES;
        piece.vertices += at;
        skd_stroke_point_poses(stroke, first + at, poses);
        stage(stroke, &piece, first + at);
    }
}

void skd_stroke_solve(struct skd_stroke *stroke, size_t first, size_t count)
{
    struct skd_step *step = stroke->step;
    struct skd_solve_pose poses[SKD_TARGET_POSES_MAX + 1];
    struct skd_solve_batch batch = skd_stroke_batch(stroke);
    bool is_last = stroke->pass + 1 >= stroke->pass_count;
    if (stroke->pass == stroke->first_pass)
        copy_before(stroke, first, count);
    skd_stroke_point_poses(stroke, first, poses);
    batch.count = count;
    batch.vertices = step->vertices + first;
    batch.poses = poses;
    batch.weights_out = step->after + first * (size_t)step->slot_count;
    batch.residual_before = stroke->residual_before + first;
    batch.residual_after = stroke->residual_after + first;
    solve_weights(stroke, &batch, first);
    if (step->rest_after != NULL && (is_last || stroke->pass == SKD_PASS_REST_FIRST))
        for_pieces(stroke, &batch, first, poses, skd_stroke_move_rest);
    if (is_last && skd_stroke_has_outcome(stroke))
        for_pieces(stroke, &batch, first, poses, skd_stroke_settle);
}

/* The session's rest positions with those that the pass before moved. */
static enum skd_status take_moved_rest(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_step *step = stroke->step;
    size_t bytes = stroke->session->rig->mesh.vertex_count * 3 * sizeof(float);
    stroke->rest = malloc(bytes);
    if (stroke->rest == NULL)
        return skd_fail_memory(error, "the rest positions");
    memcpy(stroke->rest, stroke->session->rest, bytes);
    for (size_t i = 0; i < step->count; i++)
        memcpy(stroke->rest + 3 * (size_t)step->vertices[i], step->rest_after + 3 * i,
               3 * sizeof(float));
    return SKD_OK;
}

enum skd_status skd_stroke_next_pass(struct skd_stroke *stroke, struct skd_error *error)
{
    if (stroke->pass++ == SKD_PASS_REST_FIRST)
        return take_moved_rest(stroke, error);
    if (stroke->smoothing != NULL) {
        skd_smoothing_next(stroke);
        return SKD_OK;
    }
    return skd_stroke_find_candidates(stroke, error);
}
