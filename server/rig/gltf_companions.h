/* The files beside a glTF file: which an export writes anew, under which name, and which go along.
 *
 * Stage: export. Thread: a worker.
 */
#ifndef SKD_RIG_GLTF_COMPANIONS_H
#define SKD_RIG_GLTF_COMPANIONS_H

#include "rig/gltf_container.h"
#include "rig/gltf_source.h"
#include "rig/gltf_write.h"

struct skd_companions {
    const struct skd_gltf_source *source;
    struct skd_outputs *outputs;
    const char *name;    /* of the target, in its folder */
    bool is_same_folder; /* as the source's */
    bool is_source;      /* the target replaces the source */
};

/* Compares the target's place with the source's. */
void skd_companions_init(struct skd_companions *companions, const struct skd_gltf_source *source,
                         struct skd_outputs *outputs, const char *name);

/* The path for a buffer's file that is written anew: its own when the source is replaced, else one
 * made from the target's name that is no other file of the source's nor one written before. The
 * caller's to free; NULL: no memory. */
char *skd_companions_name(const struct skd_companions *companions, size_t buffer);

/* Copies what the file refers to and is not written anew into the target's folder: buffers for
 * which is_written[] is false, and images. Images that are not there either stay away.
 * Errors: SKD_UNSUPPORTED (a path out of the folder), SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_companions_copy(const struct skd_companions *companions,
                                                   const struct skd_gltf_container *container,
                                                   const bool *is_written, struct skd_error *error);

#endif
