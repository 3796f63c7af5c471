/* Rubino's solver of 2020, for comparison.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#ifndef SKD_SOLVER_THESIS_H
#define SKD_SOLVER_THESIS_H

#include "solver/row.h"

/* Solves one vertex of a batch of four slots, in its first pose, and writes its outputs. */
void skd_thesis_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options,
                      size_t item);

#endif
