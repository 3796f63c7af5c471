/* Poses that should stay as they are, as one small factor for each pair of bones.
 *
 * Stage: before a solve, inside solver/. Thread: any. Pure: the struct's memory is the caller's.
 * What a change z of the weights (sum z = 0) does to a vertex v in the guard poses q = 1..Q is
 *
 *     mean_q |sum_i z_i d_i(q)|^2 = - sum_{i<j} z_i z_j S_ij
 *     S_ij = mean_q |d_i(q) - d_j(q)|^2 = |U_ij [v; 1]|^2
 *
 * with U_ij the triangular factor (QR, float64) of the stacked differences M_i(q) - M_j(q) over
 * sqrt(Q). It is built once for a set of poses; after that no cost depends on their number.
 */
#ifndef SKD_SOLVER_GUARD_H
#define SKD_SOLVER_GUARD_H

#include <stddef.h>

enum {
    SKD_GUARD_BONES_MAX = 2048,
    SKD_GUARD_POSES_MAX = 64,
    SKD_GUARD_FACTOR_SIZE = 10 /* doubles of a factor */
};

struct skd_guard {
    int bone_count;
    int pose_count;
    /* [B(B-1)/2][10], pairs i < j counted as (0,1), (0,2), ... (1,2), ...; each factor row by row:
     *     0 1 2 3
     *       4 5 6
     *         7 8
     *           9     */
    double factors[];
};

/* Size of a guard for so many bones (0..SKD_GUARD_BONES_MAX). */
size_t skd_guard_bytes(int bone_count);

/* Builds the factors from Q = pose_count (1..SKD_GUARD_POSES_MAX) poses, matrices[q] being
 * [bones][12] finite transforms, posed bone x inverse bind. */
void skd_guard_build(int bone_count, int pose_count, const double *const *matrices,
                     struct skd_guard *guard);

/* |U [v; 1]|^2 */
static inline double skd_guard_square(const double *u, const double v[3])
{
    const double a = u[0] * v[0] + u[1] * v[1] + (u[2] * v[2] + u[3]);
    const double b = u[4] * v[1] + (u[5] * v[2] + u[6]);
    const double c = u[7] * v[2] + u[8];
    return a * a + b * b + (c * c + u[9] * u[9]);
}

/* The factor of two different bones. */
static inline const double *skd_guard_factor(const struct skd_guard *guard, int i, int j)
{
    const size_t low = (size_t)(i < j ? i : j), high = (size_t)(i < j ? j : i);
    const size_t pair = low * (2 * (size_t)guard->bone_count - low - 1) / 2 + (high - low - 1);
    return guard->factors + SKD_GUARD_FACTOR_SIZE * pair;
}

/* S_ij for bones i and j of a vertex at v in bind space, scene units squared; 0 for i == j. */
static inline double skd_guard_pair(const struct skd_guard *guard, int i, int j, const double v[3])
{
    return i == j ? 0.0 : skd_guard_square(skd_guard_factor(guard, i, j), v);
}

#endif
