/* The guard's part of a vertex's energy: lambda mean_q |sum_i w_i d_i(q) - sum_j o_j d_j(q)|^2, o
 * over the bones of the start. The words are row.h's.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 * A bone of the start that has no slot any more is a slot of weight 0 here that cannot change.
 */
#ifndef SKD_SOLVER_ROW_GUARD_H
#define SKD_SOLVER_ROW_GUARD_H

#include "solver/guard.h"
#include "solver/row_extra.h"

/* Half the slope that a dropped bone of weight `held` adds: -held E_ik. */
SKD_ROW void guard_add_dropped(int n, const struct skd_guard *guard, double lambda,
                               const struct skd_row *row, uint16_t bone, double held,
                               double *slopes)
{
    const double to_base = skd_guard_pair(guard, row->bones[0], bone, row->rest);
    for (int i = 1; i < n; i++) {
        const double across = skd_guard_pair(guard, row->bones[i], bone, row->rest);
        const double from_base = skd_guard_pair(guard, row->bones[0], row->bones[i], row->rest);
        slopes[i] -= 0.5 * lambda * held * (from_base + to_base - across);
    }
}

SKD_ROW void guard_add(int n, const struct skd_solve_batch *batch, double lambda, size_t item,
                       const struct skd_row *row, struct skd_extra *extra)
{
    double pairs[SKD_PAIR_COUNT_MAX], moved[SKD_SLOT_COUNT_MAX], slopes[SKD_SLOT_COUNT_MAX];
    double all = 0.0, away = 0.0;
    if (row_is_bare(row))
        return;
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++) {
        moved[i] = row->before[i] - row->anchor[i];
        away += fabs(moved[i]);
        SKD_ROW_UNROLL
        for (int j = i + 1; j < n; j++) {
            const double pair =
                lambda * skd_guard_pair(batch->guard, row->bones[i], row->bones[j], row->rest);
            pairs[row_pair(n, i, j)] = pair;
            extra->pairs[row_pair(n, i, j)] += pair;
            all += pair;
        }
    }
    extra_times(n, pairs, moved, slopes);
    const size_t vertex = batch->vertices[item];
    for (int k = 0; row->is_cut && k < n; k++) {
        const double held = row_dropped(n, batch, vertex, k);
        if (!(held > 0.0))
            continue;
        away += held;
        guard_add_dropped(n, batch->guard, lambda, row,
                          batch->start_joints[(size_t)n * vertex + (size_t)k], held, slopes);
    }
    for (int i = 1; i < n; i++)
        extra->slopes[i] += slopes[i];
    extra->flat += all * away;
}

#endif
