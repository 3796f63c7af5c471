/* The changes that an export makes to a file apart from the elements' own bytes: the JSON that
 * names other accessors, bounds that moved, and putting the main file together again.
 *
 * Stage: export. Thread: a worker. When all elements fit where the old ones were, nothing changes
 * here and the file comes out with its own bytes around what changed.
 */
#ifndef SKD_RIG_GLTF_PATCH_H
#define SKD_RIG_GLTF_PATCH_H

#include "rig/gltf_additions.h"
#include "rig/gltf_plan.h"
#include "rig/gltf_write.h"
#include "rig/json_edit.h"

struct skd_gltf_patch {
    struct skd_json_edits edits;
    struct skd_gltf_additions additions;
    bool *is_dirty; /* [buffers] written into, or longer */
};

/* Errors: SKD_NO_MEMORY; finish it then too. The container is borrowed. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_init(struct skd_gltf_patch *patch,
                                                   const struct skd_gltf_container *container,
                                                   struct skd_error *error);

/* Gives the new targets of the plans their bytes, until something else is added.
 * Errors: SKD_UNSUPPORTED (no buffer to put them in), SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_make_room(struct skd_gltf_patch *patch,
                                                        const struct skd_gltf_container *container,
                                                        const struct skd_mesh *mesh,
                                                        struct skd_part_plan *plans,
                                                        struct skd_error *error);

/* After the rows were written: the primitives that use new accessors, and bounds (min and max) of
 * those that were written over. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_json(struct skd_gltf_patch *patch,
                                                   const struct skd_gltf_container *container,
                                                   const struct skd_mesh *mesh,
                                                   const struct skd_part_plan *plans,
                                                   struct skd_error *error);

/* When nothing is added any more: the lists of views and accessors, buffer 0's length.
 * Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_patch_close(struct skd_gltf_patch *patch,
                                                    struct skd_error *error);

/* Marks the buffer of a target that lies in the file. */
void skd_gltf_patch_touch(struct skd_gltf_patch *patch, const struct skd_gltf_document *document,
                          const struct skd_gltf_target *target);

/* min and max of an accessor that was written over; as long as they hold, their text stays.
 * width is at most 4. */
void skd_gltf_patch_bounds(struct skd_gltf_patch *patch, struct skd_json accessor,
                           const struct skd_gltf_target *target, size_t width, size_t count);

/* A primitive among the elements of "meshes". */
bool skd_gltf_primitive_json(const struct skd_json *meshes, size_t mesh, size_t primitive,
                             struct skd_json *value);

/* An attribute names another accessor; it is added where it is missing. */
void skd_gltf_patch_attribute(struct skd_gltf_patch *patch, struct skd_json attributes,
                              const char *name, int32_t accessor);

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
