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
 */
#ifndef SKD_SOLVER_ROW_H
#define SKD_SOLVER_ROW_H

#include "solver/solve.h"

#include <math.h>
#include <stdbool.h>

#define SKD_ROW static inline __attribute__((always_inline))

/* What every vertex of a call has in common. */
struct skd_plan {
    double ridge; /* rho = L^2 max(kappa^2, 1e-12) */
    bool affine;
};

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
    int open_count;
    bool locked; /* the whole vertex */
};

/* Reads `item` of the batch. An empty slot weighs 0 wherever it stands; it stands where another
 * slot does, so that it never makes the vertex look larger than it is. */
SKD_ROW void row_gather(int n, const struct skd_solve_batch *batch, size_t item,
                        struct skd_row *row)
{
    static const double identity[SKD_MATRIX_SIZE] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const size_t vertex = batch->vertices[item];
    const size_t first = (size_t)n * vertex;
    const double *stand_in = identity;
    for (int i = n - 1; i >= 0; i--) {
        const uint16_t joint = batch->joints[first + (size_t)i];
        if (joint != SKD_SLOT_EMPTY)
            stand_in = batch->matrices + (size_t)SKD_MATRIX_SIZE * joint;
    }
    for (int axis = 0; axis < 3; axis++) {
        row->rest[axis] = (double)batch->rest[3 * vertex + (size_t)axis];
        row->target[axis] = (double)batch->targets[3 * item + (size_t)axis];
    }
    row->open_count = 0;
    for (int i = 0; i < n; i++) {
        const uint16_t joint = batch->joints[first + (size_t)i];
        const bool empty = joint == SKD_SLOT_EMPTY;
        const bool open = !empty && !(batch->bone_locked && batch->bone_locked[joint]);
        row_carry(empty ? stand_in : batch->matrices + (size_t)SKD_MATRIX_SIZE * joint, row->rest,
                  row->carried[i]);
        row->before[i] = empty ? 0.0 : (double)batch->weights[first + (size_t)i];
        row->anchor[i] = empty ? 0.0 : (double)batch->anchor[first + (size_t)i];
        row->open[i] = open ? 1.0 : 0.0;
        row->open_count += open;
    }
    row->locked = batch->vertex_locked && batch->vertex_locked[vertex];
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
