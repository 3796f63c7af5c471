/* See reduce.h.
 *
 * Stage: before the first stroke, or an edit, inside solver/. Thread: any. Owns its stack only.
 * With S_ij the mean squared distance between bones i and j as carriers of the vertex, the posed
 * error of weights w against o, both summing to one, is
 *
 *     sum_ij w_i o_j S_ij - sum_{i<j} w_i w_j S_ij - sum_{i<j} o_i o_j S_ij
 *
 * so F_i = sum_j o_j S_ij and L_ij = S_ij.
 */
#include "solver/reduce.h"

#include "base/error.h"
#include "solver/problem.h"

#include <string.h>

/* The ridge against the largest S: below what float32 weights can show. */
static const double ridge_share = 1e-9;

/* The largest influences in their own order, and the rank of each (0: the largest). Returns how
 * many. */
static int choose_largest(int count, const float *weights, int *places, int *ranks)
{
    int used = 0;
    for (int i = 0; i < count; i++) {
        int larger = 0;
        for (int j = 0; j < count; j++)
            larger += weights[j] > weights[i] || (weights[j] == weights[i] && j < i);
        if (larger < SKD_SLOT_COUNT_MAX) {
            ranks[used] = larger;
            places[used++] = i;
        }
    }
    return used;
}

static double pair_of(const struct skd_guard *guard, const uint16_t *joints, int i, int j,
                      const double v[3])
{
    return skd_guard_pair(guard, joints[i], joints[j], v);
}

/* The largest weights, scaled to sum to one: what the poses must be better than. */
static void keep_largest(int count, const int *ranks, const double *weights, int keep, double *w)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++) {
        w[i] = ranks[i] < keep ? weights[i] : 0.0;
        sum += w[i];
    }
    for (int i = 0; i < count; i++)
        w[i] /= sum;
}

void skd_reduce(const struct skd_guard *guard, const float *rest, int count, const uint16_t *joints,
                const float *weights, int keep, float *weights_out)
{
    const double v[3] = {(double)rest[0], (double)rest[1], (double)rest[2]};
    double w[SKD_SLOT_COUNT_MAX] = {0.0}, simple[SKD_SLOT_COUNT_MAX] = {0.0},
           anchor[SKD_SLOT_COUNT_MAX] = {0.0};
    double largest = 0.0;
    int places[SKD_SLOT_COUNT_MAX], ranks[SKD_SLOT_COUNT_MAX];
    struct skd_problem problem;
    SKD_ASSERT(keep >= 1);
    for (int i = 0; i < count; i++)
        weights_out[i] = count <= keep ? weights[i] : 0.0F;
    if (count <= keep)
        return;
    const int used = choose_largest(count, weights, places, ranks);
    for (int r = 0; r < used; r++) {
        anchor[r] = w[r] = (double)weights[places[r]];
        for (int j = 0; j < count; j++) {
            const double pair = pair_of(guard, joints, places[r], j, v);
            largest = pair > largest ? pair : largest;
        }
    }
    const double ridge = largest > 0.0 ? ridge_share * largest : 1.0;
    skd_problem_begin(&problem, used, 1.0, ridge, anchor);
    for (int r = 0; r < used; r++) {
        for (int j = 0; j < count; j++)
            problem.corners[r] += (double)weights[j] * pair_of(guard, joints, places[r], j, v);
        for (int s = 0; s < used; s++)
            problem.pairs[r][s] += pair_of(guard, joints, places[r], places[s], v);
    }
    keep_largest(used, ranks, anchor, keep, simple);
    skd_problem_minimise(&problem, false, w);
    skd_problem_eliminate(&problem, keep, w);
    if (skd_problem_energy(&problem, simple) < skd_problem_energy(&problem, w))
        memcpy(w, simple, sizeof w);
    for (int r = 0; r < used; r++)
        weights_out[places[r]] = (float)w[r];
}
