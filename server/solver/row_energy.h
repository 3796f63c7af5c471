/* From a row to the numbers that a minimum is found by. The words are row.h's.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#ifndef SKD_SOLVER_ROW_ENERGY_H
#define SKD_SOLVER_ROW_ENERGY_H

#include "solver/row.h"

/* What the open slots share of the plane, and what they should reach. */
SKD_ROW double row_goal(int n, double e[][3], const double base[3], const double target[3],
                        double plane, const double *open, const double *before, double goal[3])
{
    double held = 0.0;
    double at[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < n; i++) {
        const double closed = open[i] > 0.0 ? 0.0 : before[i];
        held += closed;
        for (int axis = 0; axis < 3; axis++)
            at[axis] += closed * e[i][axis];
    }
    for (int axis = 0; axis < 3; axis++)
        goal[axis] = (target[axis] - plane * base[axis]) - at[axis];
    const double left = plane - held;
    return left > 0.0 ? left : 0.0;
}

/* The energy of the pose (omega: its strength) and of the ridge, up to a constant, as corner and
 * pair numbers:
 *
 *     f(w) = sum_i w_i F_i - sum_{i<j} w_i w_j L_ij     for sum of open w = mass
 *     F_i  = omega (mass |e_i|^2 - 2 goal.e_i) - 2 rho o_i     (o: the centre)
 *     L_ij = omega |e_i - e_j|^2 + 2 rho
 *
 * (ten numbers for four slots). Any other quadratic is one more term in each: row_extra.h. */
SKD_ROW void row_assemble(int n, double e[][3], const double goal[3], double mass, double strength,
                          double ridge, const double *centre, double *corners, double *pairs)
{
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++) {
        const double square = e[i][0] * e[i][0] + e[i][1] * e[i][1] + e[i][2] * e[i][2];
        const double along = goal[0] * e[i][0] + goal[1] * e[i][1] + goal[2] * e[i][2];
        corners[i] = strength * (mass * square) - 2.0 * (strength * along + ridge * centre[i]);
    }
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++) {
        SKD_ROW_UNROLL
        for (int j = i + 1; j < n; j++) {
            const double x = e[i][0] - e[j][0];
            const double y = e[i][1] - e[j][1];
            const double z = e[i][2] - e[j][2];
            pairs[row_pair(n, i, j)] = strength * (x * x + y * y + z * z) + 2.0 * ridge;
        }
    }
}

#endif
