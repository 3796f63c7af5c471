/* The targets in further poses, eight poses at a time. The words are row.h's and row_extra.h's.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing: the cache is the caller's.
 * Lanes are poses, see pose_cache.h. Lanes without a pose have strength 0; a block of poses in none
 * of which the vertex has a target is left out.
 */
#ifndef SKD_SOLVER_ROW_POSES_H
#define SKD_SOLVER_ROW_POSES_H

#include "solver/pose_cache.h"
#include "solver/row_extra.h"

enum {
    WISH_AHEAD = 32, /* vertices */
    POSE_NUMBERS_MAX = SKD_PAIR_COUNT_MAX + 2 * SKD_SLOT_COUNT_MAX + 1
};

/* What one vertex is asked in eight poses. */
struct skd_pose_wish {
    _Alignas(64) double strengths[POSE_LANES];
    _Alignas(64) double targets[3][POSE_LANES];
};

/* Returns the sum of the strengths. Many poses are more streams than a processor follows, so what
 * is needed some vertices later is asked for here. */
SKD_ROW double pose_wish(const struct skd_solve_batch *batch, size_t item, int first,
                         struct skd_pose_wish *wish)
{
    float read[4][POSE_LANES] = {{0.0F}};
    const struct skd_solve_pose *poses = batch->poses + first;
    const int left = batch->pose_count - first;
    const int used = left < POSE_LANES ? left : POSE_LANES;
    const size_t ahead = item + WISH_AHEAD < batch->count ? item + WISH_AHEAD : item;
    for (int lane = 0; lane < used; lane++) {
        const float *strengths = poses[lane].strengths;
        const float *target = poses[lane].targets + 3 * item;
        __builtin_prefetch(poses[lane].targets + 3 * ahead);
        if (strengths)
            __builtin_prefetch(strengths + ahead);
        read[0][lane] = strengths ? strengths[item] : 1.0F;
        read[1][lane] = target[0];
        read[2][lane] = target[1];
        read[3][lane] = target[2];
    }
    double sum = 0.0;
    for (int lane = 0; lane < POSE_LANES; lane++) {
        wish->strengths[lane] = (double)read[0][lane];
        for (int axis = 0; axis < 3; axis++)
            wish->targets[axis][lane] = (double)read[1 + axis][lane];
    }
    for (int lane = 0; lane < POSE_LANES; lane++)
        sum += wish->strengths[lane];
    return sum;
}

/* d_0 and the edges e_1.. in the pose of one lane. */
SKD_ROW void pose_edges(int n, const struct skd_pose_cache *cache, const int *places,
                        const double v[3], int lane, double base[3], double e[][3])
{
    SKD_ROW_UNROLL
    for (int i = 0; i < n; i++) {
        for (int axis = 0; axis < 3; axis++) {
            const double(*m)[POSE_LANES] = cache->matrices[places[i]] + 4 * axis;
            const double d =
                m[0][lane] * v[0] + m[1][lane] * v[1] + (m[2][lane] * v[2] + m[3][lane]);
            if (i == 0)
                base[axis] = d;
            else
                e[i][axis] = d - base[axis];
        }
    }
}

SKD_ROW double pose_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Adds eight poses' numbers, lane by lane: pairs, slopes, cross, square. */
SKD_ROW void pose_add_block(int n, const struct skd_row *row, const struct skd_pose_cache *cache,
                            const int *places, const struct skd_pose_wish *wish,
                            double numbers[][POSE_LANES])
{
    const double sum = row_sum(n, row->before);
    const int slopes = n * (n - 1) / 2, cross = slopes + n, square = cross + n;
    for (int l = 0; l < POSE_LANES; l++) {
        double e[SKD_SLOT_COUNT_MAX][3], base[3], r[3];
        const double strength = wish->strengths[l];
        pose_edges(n, cache, places, row->rest, l, base, e);
        for (int axis = 0; axis < 3; axis++) {
            r[axis] = sum * base[axis] - wish->targets[axis][l];
            SKD_ROW_UNROLL
            for (int i = 1; i < n; i++)
                r[axis] += row->before[i] * e[i][axis];
        }
        SKD_ROW_UNROLL
        for (int i = 1; i < n; i++) {
            numbers[row_pair(n, 0, i)][l] += strength * pose_dot(e[i], e[i]);
            numbers[slopes + i][l] += strength * pose_dot(e[i], r);
            numbers[cross + i][l] += strength * pose_dot(e[i], base);
            SKD_ROW_UNROLL
            for (int j = i + 1; j < n; j++) {
                const double apart[3] = {e[i][0] - e[j][0], e[i][1] - e[j][1], e[i][2] - e[j][2]};
                numbers[row_pair(n, i, j)][l] += strength * pose_dot(apart, apart);
            }
        }
        numbers[slopes][l] += strength * pose_dot(base, r);
        numbers[cross][l] += strength * pose_dot(base, base);
        numbers[square][l] += strength * pose_dot(r, r);
    }
}

/* The lanes' sum, in one order. */
SKD_ROW double pose_sum(const double *lanes)
{
    double four[4], two[2];
    for (int l = 0; l < 4; l++)
        four[l] = lanes[l] + lanes[l + 4];
    for (int l = 0; l < 2; l++)
        two[l] = four[l] + four[l + 2];
    return two[0] + two[1];
}

/* Adds the terms of all poses but the first. */
SKD_ROW void poses_add(int n, const struct skd_solve_batch *batch, size_t item,
                       const struct skd_row *row, struct skd_pose_cache *cache,
                       struct skd_extra *extra)
{
    _Alignas(64) double numbers[POSE_NUMBERS_MAX][POSE_LANES];
    const int pair_count = n * (n - 1) / 2;
    double strength = 0.0, apart = 0.0;
    if (row_is_bare(row))
        return;
    for (int k = 0; k < pair_count + 2 * n + 1; k++) {
        for (int l = 0; l < POSE_LANES; l++)
            numbers[k][l] = 0.0;
    }
    for (int block = 0; 1 + POSE_LANES * block < batch->pose_count; block++) {
        int places[SKD_SLOT_COUNT_MAX];
        struct skd_pose_wish wish;
        const double here = pose_wish(batch, item, 1 + POSE_LANES * block, &wish);
        if (!(here > 0.0))
            continue;
        strength += here;
        cache->round++;
        for (int i = 0; i < n; i++)
            places[i] = pose_cache_find(cache, batch, row->bones[i], block);
        pose_add_block(n, row, cache, places, &wish, numbers);
    }
    for (int i = 0; i < n; i++) {
        extra->slopes[i] += pose_sum(numbers[pair_count + i]);
        extra->cross[i] += pose_sum(numbers[pair_count + n + i]);
    }
    for (int p = 0; p < pair_count; p++) {
        const double pair = pose_sum(numbers[p]);
        extra->pairs[p] += pair;
        apart += p < n - 1 ? pair : 0.0;
    }
    extra->square += pose_sum(numbers[pair_count + 2 * n]);
    /* Targets are no larger than what is carried and what it leaves. */
    const double rest =
        row->rest[0] * row->rest[0] + row->rest[1] * row->rest[1] + row->rest[2] * row->rest[2];
    extra->size += 4.0 * sqrt(strength * rest + extra->cross[0] + apart + extra->square);
}

#endif
