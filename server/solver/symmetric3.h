/* Three equations, symmetric and positive definite.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#ifndef SKD_SOLVER_SYMMETRIC3_H
#define SKD_SOLVER_SYMMETRIC3_H

/* Solves a x = b by LDL^T; only the lower triangle of a is read. */
static inline void skd_symmetric3_solve(double a[3][3], const double b[3], double x[3])
{
    const double l10 = a[1][0] / a[0][0], l20 = a[2][0] / a[0][0];
    const double d1 = a[1][1] - l10 * a[1][0];
    const double across = a[2][1] - l20 * a[1][0];
    const double l21 = across / d1;
    const double d2 = a[2][2] - l20 * a[2][0] - l21 * across;
    const double y1 = b[1] - l10 * b[0];
    const double y2 = b[2] - l20 * b[0] - l21 * y1;
    x[2] = y2 / d2;
    x[1] = y1 / d1 - l21 * x[2];
    x[0] = b[0] / a[0][0] - l10 * x[1] - l20 * x[2];
}

#endif
