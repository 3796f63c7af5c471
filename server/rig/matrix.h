/* Affine maths on 3x4 matrices, row by row, float64, and unit quaternions (x, y, z, w).
 *
 * Stage: rig. Thread: any. Pure. A matrix takes columns: p' = M [p; 1]; the last row 0 0 0 1 is
 * not stored.
 */
#ifndef SKD_RIG_MATRIX_H
#define SKD_RIG_MATRIX_H

#include "solver/solve.h"

#include <stdbool.h>

/* out = a b; out may be neither. */
static inline void skd_matrix_multiply(const double *a, const double *b, double *out)
{
    for (int row = 0; row < 3; row++) {
        const double *r = a + row * 4;
        for (int column = 0; column < 4; column++)
            out[row * 4 + column] = r[0] * b[column] + r[1] * b[4 + column] + r[2] * b[8 + column];
        out[row * 4 + 3] += r[3];
    }
}

/* Adds weight * (M [p; 1]) to out. */
static inline void skd_matrix_add_transformed(const double *m, const float *p, double weight,
                                              double out[3])
{
    for (int row = 0; row < 3; row++, m += 4)
        out[row] +=
            weight * (m[0] * (double)p[0] + m[1] * (double)p[1] + m[2] * (double)p[2] + m[3]);
}

void skd_matrix_identity(double *m);

/* T R S, as glTF composes a node. rotation must be unit. */
void skd_matrix_from_trs(const double translation[3], const double rotation[4],
                         const double scale[3], double *m);

/* The reverse, for a matrix without shear; with shear the nearest by columns. A mirrored matrix
 * gets its minus sign in x. */
void skd_matrix_to_trs(const double *m, double translation[3], double rotation[4], double scale[3]);

/* False when m has no inverse that float64 could tell; out is left alone then. */
bool skd_matrix_invert(const double *m, double *out);

bool skd_matrix_is_finite(const double *m);

/* Scales to length one; no length or not finite gives the identity. Returns the length. */
double skd_quaternion_normalise(double q[4]);

#endif
