/* What moves one vertex moves its twins, so that no crack opens at a seam.
 *
 * Stage: job. Thread: a worker.
 */
#ifndef SKD_SESSION_SEAMS_H
#define SKD_SESSION_SEAMS_H

#include "rig/rig.h"

/* A stroke's vertices with all their twins. vertices and positions are the caller's to free; both
 * are NULL, and count the one given, where no named vertex has a twin: use the given arrays. */
struct skd_seams {
    size_t count;
    uint32_t *vertices; /* [count] each once */
    float *positions;   /* [count][3] */
};

/* Vertices without twins keep their order and come first; then each ring of twins, by its lowest
 * vertex, all with the mean of the positions that were named for the ring.
 * vertices: [count], each once, in range. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_seams_join(const struct skd_mesh *mesh, const uint32_t *vertices,
                                              const float *positions, size_t count,
                                              struct skd_seams *seams, struct skd_error *error);

#endif
