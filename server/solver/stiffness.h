/* The anchor's strength from what a stroke's targets say about themselves.
 *
 * Stage: between a solve of a sample and that of all, inside solver/. Thread: any. Pure: scratch is
 * the caller's.
 */
#ifndef SKD_SOLVER_STIFFNESS_H
#define SKD_SOLVER_STIFFNESS_H

#include "solver/solve.h"

/* The stiffness that a sample is solved with, to see what is left. */
#define SKD_STIFFNESS_PROBE 1e-4

/* Returns kappa for a stroke that `solved` is a sample of (some hundred vertices do):
 *
 *     clip(2 x median leftover / L, floor, 0.03)
 *
 * over the vertices that have a target and are not locked. `leftovers` [count] are how far the
 * vertices stayed from their targets when they were solved with SKD_STIFFNESS_PROBE (leftover_out,
 * where weights are all that moves); they are shuffled. `length` is L > 0. Targets that can be
 * reached ask for little stiffness, noise and bumps out of reach for more. The floor is 1e-4 where
 * at least half of these vertices have targets in two poses or more, else 5e-4: one pose says less.
 */
double skd_stiffness_choose(const struct skd_solve_batch *solved, double length, float *leftovers);

#endif
