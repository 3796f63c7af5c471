/* The changes that new weights make to a file apart from the weights' own bytes: accessors that
 * are added, bounds that moved, and putting the main file together again.
 *
 * Stage: export. Thread: a worker. When all rows fit where the old ones were, nothing changes here
 * and the file comes out with its own bytes around the weights.
 */
#ifndef SKD_RIG_GLTF_PATCH_H
#define SKD_RIG_GLTF_PATCH_H

#include "rig/gltf_container.h"
#include "rig/gltf_plan.h"
#include "rig/gltf_write.h"
#include "rig/json_edit.h"

/* An accessor that is added. */
struct skd_gltf_addition {
    struct skd_gltf_target *target;
    size_t vertex_count;
    bool is_weights;
};

struct skd_gltf_patch {
    size_t addition_count;
    struct skd_gltf_addition *additions;
    struct skd_json_edits edits;
    /* New elements, one block behind buffer 0; the block begins with its alignment. */
    uint8_t *tail;
    size_t tail_bytes;
    bool *is_dirty; /* [buffers] */
};

/* Allocates the new targets of the plans. Errors: SKD_UNSUPPORTED (no buffer to put them in),
 * SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_make_room(struct skd_gltf_patch *patch,
                                                        const struct skd_gltf_container *container,
                                                        const struct skd_mesh *mesh,
                                                        struct skd_part_plan *plans,
                                                        struct skd_error *error);

/* After the rows were written: new views and accessors, the primitives that use them, and bounds
 * (min and max) of accessors that were written over. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_json(struct skd_gltf_patch *patch,
                                                   const struct skd_gltf_container *container,
                                                   const struct skd_mesh *mesh,
                                                   const struct skd_part_plan *plans,
                                                   struct skd_error *error);

/* What is written behind buffer `index`. */
struct skd_slice skd_gltf_patch_tail(const struct skd_gltf_patch *patch, size_t index);

/* The buffer's uri becomes a data URI of its new bytes, or the name of another file. */
void skd_gltf_patch_data_uri(struct skd_gltf_patch *patch,
                             const struct skd_gltf_container *container, size_t index);
void skd_gltf_patch_uri(struct skd_gltf_patch *patch, const struct skd_gltf_container *container,
                        size_t index, const char *path);

/* The main file, from its old bytes and the edits. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_write(struct skd_gltf_patch *patch,
                                                    const struct skd_gltf_container *container,
                                                    struct skd_outputs *outputs, const char *name,
                                                    struct skd_error *error);

void skd_gltf_patch_finish(struct skd_gltf_patch *patch);

#endif
