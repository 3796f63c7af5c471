/* The figure's vertices: positions, normals, joints and weights in the file's own types.
 *
 * Thread: the caller's. Owns four arrays of the vertex count (44 bytes a vertex); borrows the
 * tessellation.
 */
#ifndef SKD_GENERATE_MESH_H
#define SKD_GENERATE_MESH_H

#include "base/error.h"
#include "tessellation.h"
#include "weights.h"

struct mesh {
    const struct tessellation *tessellation;
    float *position, *normal; /* 3 a vertex */
    uint8_t *joint;           /* INFLUENCE_COUNT a vertex */
    float *weight;            /* INFLUENCE_COUNT a vertex */
    float lowest[3], highest[3];
    uint32_t (*triangle)[3]; /* room for the triangles of one face */
};

/* Errors: SKD_NO_MEMORY; the mesh must be finished all the same. */
SKD_MUST_CHECK enum skd_status skd_mesh_init(struct mesh *mesh,
                                             const struct tessellation *tessellation,
                                             const struct weight_model *weights,
                                             struct skd_error *error);

void skd_mesh_finish(struct mesh *mesh);

#endif
