/* See matrix.h. */
#include "rig/matrix.h"

#include <float.h>
#include <math.h>
#include <string.h>

void skd_matrix_identity(double *m)
{
    static const double identity[SKD_MATRIX_SIZE] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    memcpy(m, identity, sizeof identity);
}

void skd_matrix_from_trs(const double t[3], const double q[4], const double s[3], double *m)
{
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    m[0] = (1 - 2 * (y * y + z * z)) * s[0];
    m[1] = 2 * (x * y - z * w) * s[1];
    m[2] = 2 * (x * z + y * w) * s[2];
    m[3] = t[0];
    m[4] = 2 * (x * y + z * w) * s[0];
    m[5] = (1 - 2 * (x * x + z * z)) * s[1];
    m[6] = 2 * (y * z - x * w) * s[2];
    m[7] = t[1];
    m[8] = 2 * (x * z - y * w) * s[0];
    m[9] = 2 * (y * z + x * w) * s[1];
    m[10] = (1 - 2 * (x * x + y * y)) * s[2];
    m[11] = t[2];
}

static double determinant(const double *m)
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

static double column_length(const double *m, int column)
{
    return sqrt(m[column] * m[column] + m[4 + column] * m[4 + column] +
                m[8 + column] * m[8 + column]);
}

/* The quaternion of a rotation matrix, from its largest component so that nothing cancels. */
static void rotation_to_quaternion(double r[3][3], double q[4])
{
    const double trace = r[0][0] + r[1][1] + r[2][2];
    if (trace > 0) {
        const double s = 2 * sqrt(trace + 1);
        q[0] = (r[2][1] - r[1][2]) / s;
        q[1] = (r[0][2] - r[2][0]) / s;
        q[2] = (r[1][0] - r[0][1]) / s;
        q[3] = s / 4;
    } else {
        int i = r[1][1] > r[0][0] ? 1 : 0;
        if (r[2][2] > r[i][i])
            i = 2;
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double s = 2 * sqrt(1 + r[i][i] - r[j][j] - r[k][k]);
        q[i] = s / 4;
        q[j] = (r[j][i] + r[i][j]) / s;
        q[k] = (r[k][i] + r[i][k]) / s;
        q[3] = (r[k][j] - r[j][k]) / s;
    }
    skd_quaternion_normalise(q);
}

void skd_matrix_to_trs(const double *m, double t[3], double q[4], double s[3])
{
    double rotation[3][3];
    const double mirror = determinant(m) < 0 ? -1 : 1;
    for (int column = 0; column < 3; column++) {
        s[column] = column_length(m, column) * (column == 0 ? mirror : 1);
        for (int row = 0; row < 3; row++)
            rotation[row][column] =
                s[column] != 0 ? m[row * 4 + column] / s[column] : row == column;
        t[column] = m[column * 4 + 3];
    }
    rotation_to_quaternion(rotation, q);
}

bool skd_matrix_invert(const double *m, double *out)
{
    const double det = determinant(m);
    const double size = column_length(m, 0) * column_length(m, 1) * column_length(m, 2);
    if (!isfinite(det) || !(fabs(det) > 1e-12 * size) || fabs(det) < DBL_MIN)
        return false;
    double inverse[SKD_MATRIX_SIZE];
    for (int row = 0; row < 3; row++) {
        const int a = (row + 1) % 3, b = (row + 2) % 3;
        double *to = inverse + row * 4;
        for (int column = 0; column < 3; column++) {
            const double *p = m + ((column + 1) % 3) * 4, *q = m + ((column + 2) % 3) * 4;
            to[column] = (p[a] * q[b] - p[b] * q[a]) / det;
        }
        to[3] = -(to[0] * m[3] + to[1] * m[7] + to[2] * m[11]);
    }
    if (!skd_matrix_is_finite(inverse))
        return false;
    memcpy(out, inverse, sizeof inverse);
    return true;
}

bool skd_matrix_is_finite(const double *m)
{
    for (int i = 0; i < SKD_MATRIX_SIZE; i++)
        if (!isfinite(m[i]))
            return false;
    return true;
}

double skd_quaternion_normalise(double q[4])
{
    const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!isfinite(length) || length < 1e-30) {
        q[0] = q[1] = q[2] = 0;
        q[3] = 1;
        return 0;
    }
    for (int i = 0; i < 4; i++)
        q[i] /= length;
    return length;
}
