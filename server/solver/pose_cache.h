/* Bones' matrices in eight poses at a time, kept for the vertices that share them.
 *
 * Stage: [pure solve], inside solver/. Thread: any; a cache belongs to one call's stack.
 * Lanes are poses here, not vertices. A bone's matrices in a block of eight poses are turned once
 * into
 *
 *     [12 entries][8 poses]
 *
 * and serve every vertex of the bone that comes while they are here, so that a vertex reads whole
 * vectors: reading a matrix for each vertex, slot and pose into vertex lanes takes several times as
 * long as the arithmetic. Block b holds the poses 1 + 8 b and on (the first pose is not among
 * them); a pose's lane depends on its place only, so no result depends on what the cache held.
 */
#ifndef SKD_SOLVER_POSE_CACHE_H
#define SKD_SOLVER_POSE_CACHE_H

#include "solver/row.h"

enum {
    POSE_LANES = 8,
    POSE_CACHE_SIZE = 256 /* 200 KB on the stack; 60 bones in 32 poses */
};

/* Matrices in eight poses each; `keys` say whose. An entry that the vertex at hand reads is not
 * thrown out for another of its bones: `stamps` say for which round it was last found. */
struct skd_pose_cache {
    uint64_t round;
    uint64_t stamps[POSE_CACHE_SIZE];
    uint32_t keys[POSE_CACHE_SIZE];
    _Alignas(64) double matrices[POSE_CACHE_SIZE][SKD_MATRIX_SIZE][POSE_LANES];
};

SKD_ROW void pose_cache_clear(struct skd_pose_cache *cache)
{
    cache->round = 0;
    for (int i = 0; i < POSE_CACHE_SIZE; i++) {
        cache->stamps[i] = 0;
        cache->keys[i] = UINT32_MAX;
    }
}

/* Fills an entry with a bone's matrices in the poses of a block, as far as there are so many. */
static void pose_cache_fill(const struct skd_solve_batch *batch, uint16_t bone, int first,
                            double entry[][POSE_LANES])
{
    for (int lane = 0; lane < POSE_LANES; lane++) {
        const int p = first + lane;
        const double *from = p < batch->pose_count
                                 ? batch->poses[p].matrices + SKD_MATRIX_SIZE * (size_t)bone
                                 : NULL;
        for (int k = 0; k < SKD_MATRIX_SIZE; k++)
            entry[k][lane] = from ? from[k] : 0.0;
    }
}

/* Finds a bone's entry for a block of poses, or makes it. */
SKD_ROW int pose_cache_find(struct skd_pose_cache *cache, const struct skd_solve_batch *batch,
                            uint16_t bone, int block)
{
    const uint32_t key = (uint32_t)block << 16 | bone;
    int place = (int)((4 * (uint32_t)bone + (uint32_t)block) % POSE_CACHE_SIZE);
    while (cache->keys[place] != key && cache->stamps[place] == cache->round)
        place = (place + 1) % POSE_CACHE_SIZE;
    if (cache->keys[place] != key) {
        cache->keys[place] = key;
        pose_cache_fill(batch, bone, 1 + POSE_LANES * block, cache->matrices[place]);
    }
    cache->stamps[place] = cache->round;
    return place;
}

#endif
