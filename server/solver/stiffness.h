/* The anchor's strength from what a stroke's targets say about themselves.
 *
 * Stage: before a solve, inside solver/. Thread: any. Pure: scratch is the caller's.
 */
#ifndef SKD_SOLVER_STIFFNESS_H
#define SKD_SOLVER_STIFFNESS_H

#include "solver/solve.h"

/* Returns kappa for a stroke that `sample` is typical of (some hundred vertices do):
 *
 *     clip(2 x median leftover / L, floor, 0.03)    of a solve at kappa = 1e-4
 *
 * over the vertices that have a target and are not locked. Targets that weights can reach ask for
 * little stiffness, noise and bumps out of reach for more. The floor is 1e-4 where at least half
 * of these vertices have targets in two poses or more, else 5e-4: one pose says less.
 *
 * Everything but stiffness is taken from the options (length > 0). The sample's outputs are
 * written to (leftover_out may be NULL) and mean nothing afterwards; scratch holds sample->count
 * floats. */
double skd_stiffness_choose(const struct skd_solve_batch *sample,
                            const struct skd_solve_options *options, float *scratch);

/* The second half of it, for a sample that was solved in another way (slots by evidence) with
 * stiffness SKD_STIFFNESS_PROBE: leftovers [count] are its leftover_out, and are shuffled. */
#define SKD_STIFFNESS_PROBE 1e-4
double skd_stiffness_from_leftovers(const struct skd_solve_batch *solved, double length,
                                    float *leftovers);

#endif
