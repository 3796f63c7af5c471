/* A quadratic over weights as its value at the corners and along the edges of the simplex, and the
 * minimum of one.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 *
 *     f(w) = sum_i w_i F_i - sum_{i<j} w_i w_j L_ij     w >= 0, sum w = mass
 *
 * up to a constant. However many poses, terms and slots went in, these numbers decide a vertex.
 * Energies of one problem may be compared with each other, also where weights are left at 0.
 */
#ifndef SKD_SOLVER_PROBLEM_H
#define SKD_SOLVER_PROBLEM_H

#include "solver/solve.h"

#include <stdbool.h>

struct skd_problem {
    int count; /* weights that may change, 1..SKD_SLOT_COUNT_MAX */
    double mass;
    double ridge;                                         /* no pivot is smaller */
    double corners[SKD_SLOT_COUNT_MAX];                   /* F */
    double pairs[SKD_SLOT_COUNT_MAX][SKD_SLOT_COUNT_MAX]; /* L: symmetric, 0 on the diagonal */
};

/* F = -2 ridge o, L = 2 ridge: the anchor's term alone. */
void skd_problem_begin(struct skd_problem *problem, int count, double mass, double ridge,
                       const double *anchor);

/* Adds omega |sum_i w_i d_i - t|^2, for d of the problem's weights and t less what is held. */
void skd_problem_add_pose(struct skd_problem *problem, double omega, double carried[][3],
                          const double goal[3]);

/* Takes the lowest corner off all: energies near the minimum lose no digits to a far target. */
void skd_problem_level(struct skd_problem *problem);

double skd_problem_energy(const struct skd_problem *problem, const double *w);

/* Starts at the given weights, which need not be feasible, and ends at the minimum; `affine`:
 * without w >= 0. */
void skd_problem_minimise(const struct skd_problem *problem, bool affine, double *w);

/* From the minimum w over all to few weights above 0: drops the weight without which the minimum
 * rises least, solves again, until no more than `keep` (>= 1) are left. A weight that is 0 may come
 * back when another goes; one that was dropped does not. */
void skd_problem_eliminate(const struct skd_problem *problem, int keep, double *w);

#endif
