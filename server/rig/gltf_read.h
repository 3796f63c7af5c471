/* The steps of reading a glTF rig, in this order: nodes, skins, clips, meshes.
 *
 * Stage: rig session. Thread: a worker. Each fills its part of a rig that starts zeroed and is
 * destroyed by the caller when a step fails.
 */
#ifndef SKD_RIG_GLTF_READ_H
#define SKD_RIG_GLTF_READ_H

#include "rig/gltf_container.h"
#include "rig/gltf_source.h"
#include "rig/rig.h"

/* Quaternions that are off unit length by more are told about: the Khronos validator's line. */
#define SKD_ROTATION_VALID 0.00769

/* rig->nodes but for the clips. Errors: SKD_BAD_RIG (a cycle, two parents), SKD_TOO_LARGE. */
SKD_MUST_CHECK enum skd_status skd_gltf_read_nodes(const struct skd_gltf_container *container,
                                                   struct skd_rig *rig, struct skd_error *error);
/* rig->skeleton but for the heads, and the joint tables of the source. */
SKD_MUST_CHECK enum skd_status skd_gltf_read_skins(const struct skd_gltf_container *container,
                                                   struct skd_gltf_source *source,
                                                   struct skd_rig *rig, struct skd_error *error);
/* rig->nodes.clips. */
SKD_MUST_CHECK enum skd_status skd_gltf_read_clips(const struct skd_gltf_container *container,
                                                   struct skd_rig *rig, struct skd_error *error);
/* rig->mesh but for twins and neighbours, and the influences. */
SKD_MUST_CHECK enum skd_status skd_gltf_read_meshes(const struct skd_gltf_container *container,
                                                    const struct skd_gltf_source *source,
                                                    struct skd_rig *rig,
                                                    struct skd_influences *influences,
                                                    struct skd_error *error);

#endif
