/* One vertex as the solver sees it, written once for N slots: reading it from a batch.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 * What is done to a row goes on in row_energy.h (before the minimum is looked for) and row_choice.h
 * (after it was found). All three are straight-line code without branches on data: with a constant
 * n (four_slots.c) every inner loop unrolls and the compiler runs one vertex per SIMD lane;
 * active_set.c calls it with any n.
 *
 * The words used:
 *
 *     carried  d_i: the vertex moved rigidly by slot i's bone
 *     edges    e_i = d_i - d_0. Differences are formed before anything is squared.
 *     open     1 for a slot that may change, 0 for a locked or empty one
 *     plane    what the row sums to: its own sum before the stroke, so 1 but for rounding. Solving
 *              in that plane keeps the rounding out of the comparison with the weights before.
 *     mass     what the open slots share: plane - sum of the closed ones
 *     goal     t - plane d_0 - sum of closed w_i e_i: what the open slots should reach
 *     centre   where the ridge draws to: the anchor, or a point between it and the pull. Two terms
 *              rho |w - o|^2 + nu |w - u|^2 are one of rho + nu about (rho o + nu u) / (rho + nu).
 *
 * "The pose" of a row is the batch's first; other poses and the guard are in row_extra.h.
 */
#ifndef SKD_SOLVER_ROW_H
#define SKD_SOLVER_ROW_H

#include "solver/solve.h"

#include <math.h>
#include <stdbool.h>

#define SKD_ROW static inline __attribute__((always_inline))

/* Put before the nested loops, which need help to unroll; a file with a constant n defines it. */
#ifndef SKD_ROW_UNROLL
#define SKD_ROW_UNROLL
#endif

enum { SKD_PAIR_COUNT_MAX = SKD_SLOT_COUNT_MAX * (SKD_SLOT_COUNT_MAX - 1) / 2 };

/* Pair i < j of n slots counted as (0,1), (0,2), ... (1,2), ... */
SKD_ROW int row_pair(int n, int i, int j)
{
    return i * (2 * n - i - 1) / 2 + (j - i - 1);
}

/* What every vertex of a call has in common. */
struct skd_plan {
    double ridge; /* rho = L^2 (max(kappa^2, 1e-12) + mu^2), mu counting where there are pulls */
    double pull;  /* mu^2's share of it */
    double guard; /* lambda; 0 without a guard */
    bool affine;
    bool is_simple; /* one pose of strength 1, no guard, no pulls, the start's slots: no row has
                       further terms or a centre of its own */
};

/* kappa^2, but no less than what makes every problem well posed in float64. */
SKD_ROW double row_kappa_square(double kappa)
{
    const double least = 1e-12, square = kappa * kappa;
    return square > least ? square : least;
}

/* d = M [v; 1] */
SKD_ROW void row_carry(const double *matrix, const double v[3], double d[3])
{
    for (int axis = 0; axis < 3; axis++) {
        const double *row = matrix + 4 * axis;
        d[axis] = row[0] * v[0] + row[1] * v[1] + (row[2] * v[2] + row[3]);
    }
}

/* One vertex as it stands before the solve. */
struct skd_row {
    double rest[3];
    double target[3];
    double carried[SKD_SLOT_COUNT_MAX][3];
    double before[SKD_SLOT_COUNT_MAX];
    double anchor[SKD_SLOT_COUNT_MAX];
    double open[SKD_SLOT_COUNT_MAX];
    uint16_t bones[SKD_SLOT_COUNT_MAX]; /* an empty slot's is where it stands; see row_gather() */
    int open_count;
    bool locked; /* the whole vertex */
    /* These come from row_gather_terms(), unless the plan is simple. */
    bool is_cut; /* a bone of the start lost its slot: the anchor is no whole row */
    double strength;
    double centre[SKD_SLOT_COUNT_MAX];
};

/* What bone i of a vertex weighed at the start, if no slot of the vertex has it now: else 0. */
SKD_ROW double row_dropped(int n, const struct skd_solve_batch *batch, size_t vertex, int i)
{
    const size_t first = (size_t)n * vertex;
    const uint16_t bone = batch->start_joints[first + (size_t)i];
    bool has = bone == SKD_SLOT_EMPTY;
    for (int j = 0; j < n; j++)
        has = has || batch->joints[first + (size_t)j] == bone;
    return has ? 0.0 : (double)batch->start_weights[first + (size_t)i];
}

/* Reads `item` of the batch. An empty slot weighs 0 wherever it stands; it stands where another
 * slot does, so that it never makes the vertex look larger than it is. */
SKD_ROW void row_gather(int n, const struct skd_solve_batch *batch, size_t item,
                        struct skd_row *row)
{
    static const double identity[SKD_MATRIX_SIZE] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const struct skd_solve_pose *pose = batch->poses;
    const size_t vertex = batch->vertices[item];
    const size_t first = (size_t)n * vertex;
    uint16_t stand_in = SKD_SLOT_EMPTY;
    const double *stand_in_at = identity;
    for (int i = n - 1; i >= 0; i--) {
        const uint16_t joint = batch->joints[first + (size_t)i];
        if (joint != SKD_SLOT_EMPTY) {
            stand_in = joint;
            stand_in_at = pose->matrices + (size_t)SKD_MATRIX_SIZE * joint;
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        row->rest[axis] = (double)batch->rest[3 * vertex + (size_t)axis];
        row->target[axis] = (double)pose->targets[3 * item + (size_t)axis];
    }
    row->open_count = 0;
    for (int i = 0; i < n; i++) {
        const uint16_t joint = batch->joints[first + (size_t)i];
        const bool empty = joint == SKD_SLOT_EMPTY;
        const bool open = !empty && !(batch->bone_locked && batch->bone_locked[joint]);
        row->bones[i] = empty ? stand_in : joint;
        row_carry(empty ? stand_in_at : pose->matrices + (size_t)SKD_MATRIX_SIZE * joint, row->rest,
                  row->carried[i]);
        row->before[i] = empty ? 0.0 : (double)batch->weights[first + (size_t)i];
        row->anchor[i] = empty ? 0.0 : (double)batch->anchor[first + (size_t)i];
        row->open[i] = open ? 1.0 : 0.0;
        row->open_count += open;
    }
    row->locked = batch->vertex_locked && batch->vertex_locked[vertex];
}

/* Reads the rest of a row whose plan is not simple. */
SKD_ROW void row_gather_terms(int n, const struct skd_solve_batch *batch,
                              const struct skd_plan *plan, size_t item, struct skd_row *row)
{
    const float *strengths = batch->poses[0].strengths;
    row->strength = strengths ? (double)strengths[item] : 1.0;
    for (int i = 0; i < n; i++) {
        const double pull =
            batch->pulls ? (double)batch->pulls[(size_t)n * item + (size_t)i] : row->anchor[i];
        row->centre[i] = row->anchor[i] + plan->pull * (pull - row->anchor[i]);
    }
    row->is_cut = false;
    for (int i = 0; batch->start_joints && i < n; i++)
        row->is_cut = row->is_cut || row_dropped(n, batch, batch->vertices[item], i) > 0.0;
}

/* No slot has a bone: there is nothing to solve, and `bones` mean nothing. */
SKD_ROW bool row_is_bare(const struct skd_row *row)
{
    return row->bones[0] == SKD_SLOT_EMPTY;
}

SKD_ROW double row_length(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Fills e and returns the size of the rest position. */
SKD_ROW double row_edges(int n, const struct skd_row *row, double e[][3])
{
    for (int i = 0; i < n; i++) {
        for (int axis = 0; axis < 3; axis++)
            e[i][axis] = row->carried[i][axis] - row->carried[0][axis];
    }
    return fabs(row->rest[0]) + fabs(row->rest[1]) + fabs(row->rest[2]);
}

SKD_ROW double row_sum(int n, const double *w)
{
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        sum += w[i];
    return sum;
}

SKD_ROW double row_plane(int n, const double *before)
{
    const double sum = row_sum(n, before);
    const double low = sum > 1.0 - 6e-8 ? sum : 1.0 - 6e-8;
    return low < 1.0 + 6e-8 ? low : 1.0 + 6e-8;
}

/* Puts what closed slots weigh in place of what the solve left there. */
SKD_ROW void row_close(int n, const double *open, const double *before, double *w)
{
    for (int i = 0; i < n; i++)
        w[i] = open[i] > 0.0 ? w[i] : before[i];
}

#endif
