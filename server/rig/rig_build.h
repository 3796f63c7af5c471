/* A rig from arrays: what a DCC holds, or what the glTF importer found.
 *
 * Stage: rig session. Thread: a worker. The arrays are borrowed and copied; sizes were chosen by a
 * peer and are checked here, once, against the limits of rig.h.
 */
#ifndef SKD_RIG_RIG_BUILD_H
#define SKD_RIG_RIG_BUILD_H

#include "rig/rig.h"

struct skd_rig_arrays {
    size_t vertex_count;
    const float *positions; /* [V][3] rest, in the mesh's space */
    size_t triangle_count;
    const uint32_t *triangles; /* [T][3] */
    int bone_count;
    const char *const *bone_names;     /* [B] or NULL: "bone0", "bone1", ... */
    const int32_t *parents;            /* [B] -1 for a root */
    const double *bind_matrices;       /* [B][16] bone to mesh space at rest, row by row */
    const uint32_t *influence_offsets; /* [V+1] CSR */
    const uint16_t *influence_joints;
    const float *influence_weights;
};

/* Checks, mends (see SKD_NOTES) and copies. Errors: SKD_BAD_INDEX, SKD_NOT_FINITE,
 * SKD_COUNT_MISMATCH, SKD_BAD_RIG (a cycle of parents, a bind matrix without inverse),
 * SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_rig_from_arrays(const struct skd_rig_arrays *arrays,
                                                   struct skd_rig **rig,
                                                   struct skd_influences *influences,
                                                   struct skd_error *error);

#endif
