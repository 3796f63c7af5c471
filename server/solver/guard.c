/* The guard's pair factors, by Householder reflections.
 *
 * Stage: before a solve, inside solver/. Thread: any. Owns its stack only.
 */
#include "solver/guard.h"

#include "base/error.h"
#include "solver/solve.h"

#include <math.h>

enum { COLUMNS = 4, ROWS_MAX = 3 * SKD_GUARD_POSES_MAX };

size_t skd_guard_bytes(int bone_count)
{
    const size_t bones = (size_t)bone_count;
    SKD_ASSERT(bone_count >= 0 && bone_count <= SKD_GUARD_BONES_MAX);
    const size_t pairs = bones > 0 ? bones * (bones - 1) / 2 : 0;
    return sizeof(struct skd_guard) + pairs * SKD_GUARD_FACTOR_SIZE * sizeof(double);
}

static double column_dot(double a[][COLUMNS], int first, int rows, int one, int other)
{
    double sum = 0.0;
    for (int r = first; r < rows; r++)
        sum += a[r][one] * a[r][other];
    return sum;
}

/* A column shorter than this is none: its square would lose its digits. */
static const double length_least = 1e-140;

/* Turns `a` into its triangular factor, in its first four rows. */
static void triangulate(double a[][COLUMNS], int rows)
{
    const int steps = rows - 1 < COLUMNS ? rows - 1 : COLUMNS;
    for (int k = 0; k < steps; k++) {
        const double length = sqrt(column_dot(a, k, rows, k, k));
        if (!(length > length_least))
            continue;
        /* Reflector v = x + sign(x_k) |x| e_k: no cancellation. */
        const double diagonal = a[k][k] > 0.0 ? -length : length;
        a[k][k] -= diagonal;
        const double half_square = -diagonal * a[k][k];
        for (int c = k + 1; c < COLUMNS; c++) {
            const double along = column_dot(a, k, rows, k, c) / half_square;
            for (int r = k; r < rows; r++)
                a[r][c] -= along * a[r][k];
        }
        a[k][k] = diagonal;
    }
}

static void build_pair(int pose_count, const double *const *matrices, size_t one, size_t other,
                       double *factor)
{
    double a[ROWS_MAX][COLUMNS];
    const double scale = 1.0 / sqrt((double)pose_count);
    for (int q = 0; q < pose_count; q++) {
        const double *from = matrices[q] + SKD_MATRIX_SIZE * one;
        const double *to = matrices[q] + SKD_MATRIX_SIZE * other;
        for (int entry = 0; entry < SKD_MATRIX_SIZE; entry++)
            a[3 * q + entry / COLUMNS][entry % COLUMNS] = scale * (from[entry] - to[entry]);
    }
    const int rows = 3 * pose_count;
    triangulate(a, rows);
    for (int r = 0; r < COLUMNS; r++) {
        for (int c = r; c < COLUMNS; c++)
            *factor++ = r < rows ? a[r][c] : 0.0;
    }
}

void skd_guard_build(int bone_count, int pose_count, const double *const *matrices,
                     struct skd_guard *guard)
{
    SKD_ASSERT(bone_count >= 0 && bone_count <= SKD_GUARD_BONES_MAX);
    SKD_ASSERT(pose_count >= 1 && pose_count <= SKD_GUARD_POSES_MAX);
    guard->bone_count = bone_count;
    guard->pose_count = pose_count;
    double *factor = guard->factors;
    for (size_t i = 0; i < (size_t)bone_count; i++) {
        for (size_t j = i + 1; j < (size_t)bone_count; j++, factor += SKD_GUARD_FACTOR_SIZE)
            build_pair(pose_count, matrices, i, j, factor);
    }
}
