/* The exact solve for any number of slots: an active set, a vertex at a time.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#ifndef SKD_SOLVER_ACTIVE_SET_H
#define SKD_SOLVER_ACTIVE_SET_H

#include "solver/row.h"

/* Solves the batch and writes all its outputs; with `closed_only` only the vertices that have a
 * locked or empty slot, leaving the others' outputs alone. */
void skd_active_set_solve(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                          bool closed_only);

#endif
