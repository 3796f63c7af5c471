/* All terms of a vertex's energy beyond the pose and the ridge, as one quadratic about the weights
 * before. The words are row.h's.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 * With z = before - w, sigma = sum z and d_0 the base of each further pose or guard pose,
 *
 *     f(before) - f(w) = 2 sum_i z_i g_i - sum_ij z_i z_j E_ij                   (i, j >= 1)
 *                      + 2 sigma g_0 - 2 sigma sum_i z_i X_i - sigma^2 X_0
 *     E_ij = 1/2 (P_0i + P_0j - P_ij)    P_ij = sum omega |e_i - e_j|^2 + lambda S_ij
 *     g_i  = sum omega e_i.r + half the guard's slope     g_0 = sum omega d_0.r
 *     X_i  = sum omega e_i.d_0                            X_0 = sum omega |d_0|^2
 *
 * r being what the weights before leave. Every number comes from differences, and gains are formed
 * from differences again, so that rows that differ little are told apart. sigma is 0 or a last bit
 * of float32; the guard looks at differences of bones only and so does not see it.
 *
 * row_poses.h and row_guard.h add to these numbers; row_energy.h's F and L get their part from
 * them, and row_choice.h's gains.
 */
#ifndef SKD_SOLVER_ROW_EXTRA_H
#define SKD_SOLVER_ROW_EXTRA_H

#include "solver/row.h"

struct skd_extra {
    double pairs[SKD_PAIR_COUNT_MAX];  /* P */
    double slopes[SKD_SLOT_COUNT_MAX]; /* g */
    double cross[SKD_SLOT_COUNT_MAX];  /* X */
    double square;                     /* sum omega |r|^2 */
    double size; /* what the rounding errors of d and t are proportional to, over all poses */
    double flat; /* and those of the guard's slopes */
};

SKD_ROW void extra_clear(int n, struct skd_extra *extra)
{
    SKD_ROW_UNROLL
    for (int p = 0; p < n * (n - 1) / 2; p++)
        extra->pairs[p] = 0.0;
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++)
        extra->slopes[i] = extra->cross[i] = 0.0;
    extra->square = extra->size = extra->flat = 0.0;
}

/* Ex for i >= 1 (0 for i = 0), E being what `pairs` say. */
SKD_ROW void extra_times(int n, const double *pairs, const double *x, double *out)
{
    double sum = 0.0, along = 0.0;
    SKD_ROW_UNROLL
    for (int j = 1; j < n; j++) {
        sum += x[j];
        along += x[j] * pairs[j - 1];
    }
    out[0] = 0.0;
    SKD_ROW_UNROLL
    for (int i = 1; i < n; i++) {
        double across = 0.0;
        SKD_ROW_UNROLL
        for (int j = 1; j < n; j++)
            across += j == i ? 0.0 : x[j] * pairs[j < i ? row_pair(n, j, i) : row_pair(n, i, j)];
        out[i] = 0.5 * (pairs[i - 1] * sum + along - across);
    }
}

/* Adds the terms' part to the corner and pair numbers of the open slots. */
SKD_ROW void extra_assemble(int n, const struct skd_extra *extra, double plane, double mass,
                            const double *open, const double *before, double *corners,
                            double *pairs)
{
    double moving[SKD_SLOT_COUNT_MAX], pulled[SKD_SLOT_COUNT_MAX];
    const double off = row_sum(n, before) - plane;
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++)
        moving[i] = open[i] > 0.0 ? before[i] : 0.0;
    extra_times(n, extra->pairs, moving, pulled);
    SKD_ROW_UNROLL
    for (int i = 1; i < n; i++)
        corners[i] += mass * extra->pairs[i - 1] +
                      2.0 * (extra->slopes[i] - off * extra->cross[i] - pulled[i]);
    SKD_ROW_UNROLL
    for (int p = 0; p < n * (n - 1) / 2; p++)
        pairs[p] += extra->pairs[p];
}

/* What the terms gain by a step z, and what rounding may have added to that. */
SKD_ROW double extra_gain(int n, const struct skd_extra *extra, const double *z, double *noise)
{
    double sum = 0.0, others = 0.0, moved = 0.0;
    double slope = 0.0, along = 0.0, apart = 0.0, cross = 0.0, spread = 0.0;
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++) {
        sum += z[i];
        moved += fabs(z[i]);
    }
    SKD_ROW_UNROLL
    for (int i = 1; i < n; i++) {
        others += z[i];
        slope += z[i] * extra->slopes[i];
        cross += z[i] * extra->cross[i];
        along += z[i] * extra->pairs[i - 1];
        spread += extra->pairs[i - 1];
        SKD_ROW_UNROLL
        for (int j = i + 1; j < n; j++)
            apart += z[i] * z[j] * extra->pairs[row_pair(n, i, j)];
    }
    slope += sum * extra->slopes[0];
    const double bent = others * along - apart + sum * (2.0 * cross + sum * extra->cross[0]);
    const double length = sqrt(bent > 0.0 ? bent : 0.0);
    *noise = extra->size * (moved * (2.0 * sqrt(extra->square) + length) + length) +
             (extra->flat + moved * spread) * moved;
    return 2.0 * slope - bent;
}

#endif
