/* N of a vertex's K influences, chosen by how little the vertex moves in a set of poses instead of
 * by their size.
 *
 * Stage: before the first stroke, or an edit. Thread: any. Pure, a vertex a call.
 */
#ifndef SKD_SOLVER_REDUCE_H
#define SKD_SOLVER_REDUCE_H

#include "solver/guard.h"

#include <stdint.h>

/* Minimises mean_q |sum_i w_i d_i(q) - sum_j o_j d_j(q)|^2 over the guard's poses, with no more
 * than `keep` (>= 1) weights above 0: solved for the 16 largest, then backward elimination. A tiny
 * ridge towards the old weights decides where the poses say nothing. Never worse in these poses
 * than the largest weights scaled to sum to one.
 *
 * rest [3] bind space; joints and weights are the vertex's `count` influences, weights > 0 summing
 * to one, no bone twice. Writes weights_out [count], 0 for those that went, summing to one up to
 * float32's rounding. With count <= keep the weights come back as they are. */
void skd_reduce(const struct skd_guard *guard, const float *rest, int count, const uint16_t *joints,
                const float *weights, int keep, float *weights_out);

#endif
