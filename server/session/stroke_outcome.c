/* See stroke_outcome.h. */
#include "session/stroke_outcome.h"

#include "solver/rest.h"
#include "solver/shape.h"

#include <math.h>
#include <string.h>

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

/* Where items rest after the stroke, as far as that is known: by item. */
static void gather_rest(const struct skd_stroke *stroke, size_t first, size_t count, float *rest)
{
    const struct skd_step *step = stroke->step;
    const float *moved = step->rest_after;
    for (size_t i = 0; i < count; i++)
        memcpy(rest + 3 * i,
               moved != NULL ? moved + 3 * (first + i)
                             : stroke->session->rest + 3 * (size_t)step->vertices[first + i],
               3 * sizeof(float));
}

void skd_stroke_move_rest(struct skd_stroke *stroke, const struct skd_solve_batch *piece,
                          size_t first)
{
    struct skd_step *step = stroke->step;
    size_t slots = (size_t)piece->slot_count;
    uint16_t rows[SKD_PIECE_VERTICES * SKD_SLOT_COUNT_MAX];
    const uint16_t *joints = joints_of(stroke, first, piece->count, rows);
    float *rest = step->rest_after + 3 * first;
    for (size_t i = 0; i < piece->count; i++)
        memcpy(rest + 3 * i, piece->rest + 3 * (size_t)piece->vertices[i], 3 * sizeof(float));
    skd_rest_solve(piece, &stroke->input.options, joints, step->after + slots * first, rest,
                   stroke->doubtful + first);
}

/* Whether a vertex's shape follows: it is not locked, and has one or is to get one. */
static bool is_shaped(const struct skd_stroke *stroke, size_t item)
{
    const struct skd_step *step = stroke->step;
    const float *before = step->shape->before + SKD_SHAPE_NUMBERS * item;
    bool shaped = stroke->input.residual == SKD_RESIDUAL_SHAPE;
    if (stroke->vertex_locked != NULL && stroke->vertex_locked[step->vertices[item]])
        return false;
    for (size_t k = 0; k < SKD_SHAPE_NUMBERS; k++)
        shaped = shaped || before[k] < 0.0f || before[k] > 0.0f;
    return shaped;
}

/* The shape of a piece's vertices in the stroke's pose: into the step. */
static void correct(struct skd_stroke *stroke, const struct skd_solve_batch *piece, size_t first,
                    const float *rest, const uint16_t *joints)
{
    const struct skd_step *step = stroke->step;
    const struct skd_sheet_change *shape = step->shape;
    skd_shape_solve(piece->count, piece->slot_count, rest, joints,
                    step->after + (size_t)piece->slot_count * first, stroke->pose->matrices,
                    piece->poses[0].targets, shape->after + SKD_SHAPE_NUMBERS * first);
    for (size_t i = first; i < first + piece->count; i++) {
        if (!is_shaped(stroke, i))
            memcpy(shape->after + SKD_SHAPE_NUMBERS * i, shape->before + SKD_SHAPE_NUMBERS * i,
                   SKD_SHAPE_NUMBERS * sizeof(float));
    }
}

/* Shape and residuals in the stroke's own pose. */
static void settle_in_pose(struct skd_stroke *stroke, const struct skd_solve_batch *piece,
                           size_t first)
{
    const struct skd_step *step = stroke->step;
    const double *matrices = stroke->pose->matrices;
    size_t count = piece->count;
    uint16_t rows[SKD_PIECE_VERTICES * SKD_SLOT_COUNT_MAX];
    float rest[SKD_PIECE_VERTICES * 3], shown[SKD_PIECE_VERTICES * 3];
    const uint16_t *joints = joints_of(stroke, first, count, rows);
    const float *weights = step->after + (size_t)piece->slot_count * first;
    const float *asked = stroke->asked != NULL ? stroke->asked : stroke->poses[0].targets;
    skd_session_show(stroke->session, stroke->pose, count, piece->vertices, shown);
    measure(shown, asked + 3 * first, count, stroke->residual_before + first);
    gather_rest(stroke, first, count, rest);
    if (step->shape != NULL) {
        const float *offsets = step->shape->after + SKD_SHAPE_NUMBERS * first;
        correct(stroke, piece, first, rest, joints);
        for (size_t k = 0; k < 3 * count; k++)
            rest[k] += offsets[k];
    }
    skd_skin(count, NULL, piece->slot_count, rest, joints, weights, matrices, shown);
    measure(shown, asked + 3 * first, count, stroke->residual_after + first);
}

/* Root of the mean square over a refit's poses of how far vertices are from their targets. */
static void measure_poses(const struct skd_solve_batch *batch, const uint32_t *vertices,
                          const float *rest, const uint16_t *joints, const float *weights,
                          float *distances)
{
    float shown[SKD_PIECE_VERTICES * 3], apart[SKD_PIECE_VERTICES];
    double squares[SKD_PIECE_VERTICES] = {0};
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

/* Residuals of a refit: over all its poses. */
static void settle_in_poses(struct skd_stroke *stroke, const struct skd_solve_batch *piece,
                            size_t first)
{
    const struct skd_session *session = stroke->session;
    uint16_t rows[SKD_PIECE_VERTICES * SKD_SLOT_COUNT_MAX];
    float rest[SKD_PIECE_VERTICES * 3];
    const uint16_t *joints = joints_of(stroke, first, piece->count, rows);
    measure_poses(piece, piece->vertices, session->rest, session->joints, session->weights,
                  stroke->residual_before + first);
    gather_rest(stroke, first, piece->count, rest);
    measure_poses(piece, NULL, rest, joints,
                  stroke->step->after + (size_t)piece->slot_count * first,
                  stroke->residual_after + first);
}

bool skd_stroke_has_outcome(const struct skd_stroke *stroke)
{
    const struct skd_step *step = stroke->step;
    bool moves = stroke->shown_before != NULL;
    return stroke->pose == NULL || moves || step->rest_after != NULL || step->shape != NULL ||
           stroke->pass > 0;
}

void skd_stroke_settle(struct skd_stroke *stroke, const struct skd_solve_batch *piece, size_t first)
{
    if (stroke->pose != NULL)
        settle_in_pose(stroke, piece, first);
    else
        settle_in_poses(stroke, piece, first);
}
