/* Corrective shapes, as morph targets behind those that a file has.
 *
 * Stage: export. Thread: a worker.
 * glTF wants the same targets on all primitives of a mesh, so a shape that has one vertex of a
 * mesh is a target of each of its primitives; on those without a vertex of it, one of zeros that
 * costs no bytes. The file's own targets keep their numbers, names and weights. Their weights get
 * a 0 behind them wherever the file lists weights: in meshes, nodes and animations.
 */
#ifndef SKD_RIG_GLTF_SHAPES_H
#define SKD_RIG_GLTF_SHAPES_H

#include "rig/gltf.h"
#include "rig/gltf_patch.h"

/* Morph targets of one mesh. */
struct skd_gltf_growth {
    size_t old_count;
    size_t added;
};

/* What the parts of this job share. */
struct skd_gltf_shaping {
    const struct skd_rig *rig;
    const struct skd_gltf_container *container;
    const struct skd_gltf_content *content;
    struct skd_gltf_patch *patch;
    struct skd_json *meshes; /* the JSON of each */
    size_t mesh_count;
    struct skd_gltf_growth *growths; /* [meshes] */
    bool *is_used;                   /* [shapes][meshes] the shape has a vertex of the mesh */
};

/* Writes content->shapes, when there are any; adds to report->targets.
 * Errors: SKD_BAD_INDEX and SKD_NOT_FINITE (of a shape), SKD_UNSUPPORTED (primitives of a mesh
 * with different numbers of targets or without POSITION, animation of weights that does not fit),
 * SKD_BAD_RIG (animation that cannot be read), SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_gltf_shapes_write(const struct skd_rig *rig, const struct skd_gltf_container *container,
                      const struct skd_gltf_content *content, struct skd_gltf_patch *patch,
                      struct skd_gltf_export_report *report, struct skd_error *error);

/* gltf_shape_names.c: `weights` of meshes and nodes, and extras.targetNames, where programs look
 * for names. A name that the mesh has already gets a number; targets without a name get that of
 * their accessor, or one of their number. Where extras is no object there are no names. */
SKD_MUST_CHECK enum skd_status skd_gltf_shape_names_write(const struct skd_gltf_shaping *shaping,
                                                          struct skd_error *error);

/* gltf_shape_clips.c: channels that move the weights of a mesh get a 0 for each target added, in
 * each of their keys; a sampler that also moves a mesh that stays is doubled. */
SKD_MUST_CHECK enum skd_status skd_gltf_shape_clips_write(const struct skd_gltf_shaping *shaping,
                                                          struct skd_error *error);

#endif
