/* The nearest of many points: a balanced k-d tree.
 *
 * Stage: job. Thread: a worker; searches share nothing but what they read.
 *
 *     [ nearer along the axis | middle | farther ]   and each side the same, down to a few points
 */
#ifndef SKD_SESSION_NEAREST_H
#define SKD_SESSION_NEAREST_H

#include <stddef.h>
#include <stdint.h>

struct skd_point {
    float at[3];
    uint32_t vertex;
};

/* Sorts the points in place into a tree; axes [count] is the tree's too. Linear memory, n log n. */
void skd_nearest_build(size_t count, struct skd_point *points, uint8_t *axes);

/* The point nearest to `at` and closer than *square (a squared distance), which becomes its own;
 * NULL where there is none. The same points in the same order give the same answer. */
const struct skd_point *skd_nearest_find(size_t count, const struct skd_point *points,
                                         const uint8_t *axes, const double at[3], double *square);

#endif
