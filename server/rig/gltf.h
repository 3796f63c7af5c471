/* glTF 2.0 in and out, .glb and .gltf.
 *
 * Stage: rig session (in), reply (out). Thread: a worker; both calls block on files.
 * In goes through tinygltf (gltf_import.cpp, the only C++ file; no exception leaves it). Out does
 * not: it takes the source's own bytes and replaces what changed alone.
 */
#ifndef SKD_RIG_GLTF_H
#define SKD_RIG_GLTF_H

#include "rig/rig.h"

/* Reads a file, checks it against the limits of rig.h, mends what the notes name.
 * On success *rig (free with skd_rig_destroy) and *influences (skd_influences_finish) are the
 * caller's. Errors: SKD_NO_FILE, SKD_FILE_IO, SKD_NOT_GLTF, SKD_UNSUPPORTED (Draco, meshopt, no
 * skin), SKD_BAD_RIG, SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_import(const char *path, struct skd_rig **rig,
                                               struct skd_influences *influences,
                                               struct skd_error *error);

/* The part of skd_gltf_import that needs the file: all but heads and neighbours. Such a rig is good
 * for skd_rig_image_write alone, whose reader adds them. Ownership and errors as there. */
SKD_MUST_CHECK enum skd_status skd_gltf_parse(const char *path, struct skd_rig **rig,
                                              struct skd_influences *influences,
                                              struct skd_error *error);

/* A corrective shape: what is added to rest positions while it is on. */
struct skd_export_shape {
    const char *name; /* UTF-8; the morph target gets it */
    size_t count;
    const uint32_t *vertices; /* [count] of the rig, each once */
    const float *offsets;     /* [count][3] rest space: that of the mesh's POSITION */
};

/* What a file is to say. */
struct skd_gltf_content {
    int slot_count;
    const uint16_t *joints; /* [V][N] SKD_SLOT_EMPTY weighs nothing */
    const float *weights;   /* [V][N] rows that sum to one */
    const float *rest;      /* [V][3], or NULL: the file's own */
    size_t shape_count;
    const struct skd_export_shape *shapes;
};

struct skd_gltf_export_report {
    uint64_t bytes;          /* written, the main file and those beside it */
    size_t accessors;        /* JOINTS_n and WEIGHTS_n of primitives in which a row changed */
    size_t positions;        /* POSITION of primitives in which a rest position moved */
    size_t targets;          /* morph targets added, one for each shape and mesh */
    double largest_rounding; /* largest change of one weight by quantising, 0 for float32 */
};

/* Writes the rig's source to `path` with the weights, rest positions and shapes of `content`.
 *
 * A row that means what the file's row means leaves that row's bytes alone, so that a file written
 * unchanged is its source, byte for byte. In a row that changes, bones keep their slots; integer
 * weights are rounded by largest remainder and sum to one exactly. Sets are written in place, in
 * their own types; where that cannot be (sparse, bytes shared with something else, a joint number
 * too large, sets missing) the primitive gets accessors at the end of buffer 0 and the JSON is
 * edited at these places alone.
 *
 * Rest positions go the same way (gltf_rest.h); a POSITION that is not float32 becomes so when it
 * moves. Each shape becomes a morph target of every mesh that has a vertex of it (gltf_shapes.h).
 * Normals and tangents stay the file's: they belong to the surface that the artist drew, and a
 * program that wants new ones computes them.
 *
 * A .bin that changes is written beside the target under the target's name (the source's own when
 * the source is replaced); other files that the source needs are copied into the target's folder.
 * Everything is written under temporary names and renamed at the end, so that a full disk leaves
 * the old files. Writing over the source is allowed, and exporting again after it.
 *
 * Errors: SKD_UNSUPPORTED (the rig came as arrays, `path` does not end like its source, a negative
 * weight, a position or offset that is not finite, an image outside the source's folder, morph
 * targets or their animation that do not fit together in the source), SKD_BAD_RIG (animation that
 * cannot be read), SKD_SOURCE_CHANGED, SKD_FILE_IO, SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_gltf_export(const struct skd_rig *rig, const struct skd_gltf_content *content, const char *path,
                struct skd_gltf_export_report *report, struct skd_error *error);

#endif
