/* A rig as one run of bytes: what a process that parsed a file hands over, and what a journal
 * keeps.
 *
 * Stage: rig session. Thread: any; no state.
 * Little-endian. Numbers stand as rig.h has them in memory, so that both ways are a few large
 * copies; each array begins at a multiple of 8 bytes. What follows from the rest is not in it and
 * is made by the reader: heads, skins of vertices, durations, neighbours.
 *
 *     head | bones | nodes | clips | parts | rest, triangles, twins | influences | source
 *
 * The writer trusts its rig, the reader trusts nothing: the process that wrote the bytes may have
 * been taken over by the file that it parsed, a journal may be damaged.
 */
#ifndef SKD_RIG_RIG_IMAGE_H
#define SKD_RIG_RIG_IMAGE_H

#include "rig/rig.h"

/* Where an image goes, run after run. write returns false to stop it. */
struct skd_image_sink {
    bool (*write)(void *user, const void *bytes, size_t count);
    void *user;
};

/* Bytes of the image of a rig; influences may be NULL: without. */
size_t skd_rig_image_bytes(const struct skd_rig *rig, const struct skd_influences *influences);

/* Writes skd_rig_image_bytes bytes into the sink; false when the sink stopped it. */
SKD_MUST_CHECK bool skd_rig_image_write(const struct skd_rig *rig,
                                        const struct skd_influences *influences,
                                        const struct skd_image_sink *sink);

/* Makes the rig that an image holds, with heads and neighbours. `bytes` (at an address that is a
 * multiple of 8) are borrowed and not changed; *rig and *influences are the caller's as from
 * skd_gltf_import, but that the influences point into the image, which has to outlive them.
 * influences NULL: the image must be one without, else one with.
 *
 * Everything is held against the limits of rig.h and against the rest of the image: counts,
 * indexes, the order of nodes, cycles of parents, rings of twins, names, that numbers are finite,
 * that rows of weights are mended. What the files of the source are is the caller's to see: the
 * source comes with paths, sizes and digests, and with no file open (skd_gltf_source_reopen,
 * skd_gltf_source_restore).
 * Errors: SKD_BAD_RIG (says what is wrong with the image), SKD_TOO_LARGE, SKD_NO_MEMORY; then *rig
 * is NULL and *influences is empty. */
SKD_MUST_CHECK enum skd_status skd_rig_image_read(const void *bytes, size_t count,
                                                  struct skd_rig **rig,
                                                  struct skd_influences *influences,
                                                  struct skd_error *error);

#endif
