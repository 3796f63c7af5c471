/* What weights cannot reach in several poses: the rest position moves too.
 *
 * Stage: [pure solve], after the weights were solved. Thread: any. Pure, a vertex at a time, so any
 * split of a batch gives the same bits.
 *
 * With v the rest position, v_0 where it was, w the weights and B_p = sum_i w_i R_i(p):
 *
 *     E(w, v) = f(w) of solve.h with d_i = M_i [v; 1]  +  eta^2 sum_p omega_p |v - v_0|^2
 *
 * with eta = 1e-3. Alternating: the offset that is best for the weights (three
 * equations), then the weights that are best for the offset, 40 rounds (ten are too few), each
 * followed by a look further along the same way.
 *
 * One pose cannot tell an offset from weights: vertices with less than two targets stay as they
 * are. The guard looks at weights only: it is measured with the vertex's new rest position.
 */
#ifndef SKD_SOLVER_REST_H
#define SKD_SOLVER_REST_H

#include "solver/solve.h"

/* joints [count][N], by item, are what weights [count][N] (in and out) are laid out by: slots may
 * have changed since batch->joints. rest_out [count][3], in and out: where each vertex rests.
 * doubtful_out [count]: 1 where the targets hardly tell an offset from weights (two of them only,
 * or poses too alike), so that poses that were not sculpted may suffer; 0 otherwise.
 *
 * A vertex's E is never higher than with the weights given and v_0; else, for locked vertices and
 * those with less than two targets, weights and rest come back bit for bit. Locked bones keep their
 * weight, and rows what they sum to. Of the batch, weights, joints, anchor, pulls and the outputs
 * are not used. */
void skd_rest_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options,
                    const uint16_t *joints, float *weights, float *rest_out, uint8_t *doubtful_out);

#endif
