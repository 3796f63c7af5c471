/* A PC2 point cache: where a mesh's points are, frame by frame, as Blender, Maya and Houdini write.
 *
 * Thread: one. Everything that the file says is checked here once.
 *
 *     0               12        16        20      24      28        32
 *     +---------------+---------+---------+-------+-------+---------+------------------+
 *     | "POINTCACHE2" | i32 = 1 | i32     | f32   | f32   | i32     | frames x points  |
 *     | and a NUL     | version | points  | start | rate  | samples | x f32 x, y, z    |
 *     +---------------+---------+---------+-------+-------+---------+------------------+
 *     little-endian; start and rate are counted in frames
 */
#ifndef SKD_CLI_PC2_H
#define SKD_CLI_PC2_H

#include "base/error.h"

#include <stddef.h>
#include <stdint.h>

struct skd_pc2 {
    size_t points;
    size_t samples;   /* in the file */
    double rate;      /* frames from one sample to the next, above 0 */
    size_t step;      /* every step-th sample was read, from the first on */
    size_t count;     /* samples that were read */
    float *positions; /* [count][points][3], owned, finite */
};

/* What a cache must be like. */
struct skd_pc2_wanted {
    size_t points;
    size_t step;       /* 1 or more */
    size_t count_most; /* samples that may be read */
};

/* Reads a cache ("-": stdin). Finish *cache in any case. Errors, each naming the file: SKD_NO_FILE,
 * SKD_FILE_IO, SKD_BAD_PARAMS (no point cache, cut short, or longer than it says),
 * SKD_COUNT_MISMATCH (other points than wanted), SKD_TOO_LARGE, SKD_NOT_FINITE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_pc2_read(const char *path, const struct skd_pc2_wanted *wanted,
                                            struct skd_pc2 *cache, struct skd_error *error);
void skd_pc2_finish(struct skd_pc2 *cache);

#endif
