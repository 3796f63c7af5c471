/* glTF 2.0 in and out, .glb and .gltf.
 *
 * Stage: rig session (in), reply (out). Thread: a worker; both calls block on files.
 * In goes through tinygltf (gltf_import.cpp, the only C++ file; no exception leaves it). Out does
 * not: it takes the source's own bytes and replaces those of JOINTS_n and WEIGHTS_n alone.
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

struct skd_gltf_export_report {
    uint64_t bytes;          /* written, the main file and a .bin beside it */
    size_t accessors;        /* JOINTS_n and WEIGHTS_n accessors written */
    double largest_rounding; /* largest change of one weight by quantising, 0 for float32 */
};

/* Writes the rig's source with new weights to `path`: joints [V][N] (SKD_SLOT_EMPTY is written as
 * joint 0, weight 0) and weights [V][N]. Sets that the source has are rewritten in place, in
 * their own component types (quantised by largest remainder); sets beyond N are zeroed; missing
 * sets are added as new accessors. The file is written beside the target and renamed, so that a
 * full disk leaves the old one. Writing over the source is allowed.
 * Errors: SKD_UNSUPPORTED (the rig came as arrays, or `path` ends in neither .glb nor .gltf like
 * its source), SKD_SOURCE_CHANGED, SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_export(const struct skd_rig *rig, int slot_count,
                                               const uint16_t *joints, const float *weights,
                                               const char *path,
                                               struct skd_gltf_export_report *report,
                                               struct skd_error *error);

#endif
