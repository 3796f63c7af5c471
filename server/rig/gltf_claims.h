/* Which bytes of a file are whose: where new elements may go over old ones, and where not.
 *
 * Stage: export. Thread: a worker.
 */
#ifndef SKD_RIG_GLTF_CLAIMS_H
#define SKD_RIG_GLTF_CLAIMS_H

#include "rig/gltf_container.h"
#include "rig/rig.h"

/* Bytes of a buffer that something in the file stands on. */
struct skd_gltf_claim {
    int32_t accessor; /* -1: not an accessor's own elements */
    int32_t buffer;
    size_t start;
    size_t end;
    size_t stride; /* 0: every byte from start to end */
    size_t element_bytes;
};

struct skd_gltf_claims {
    size_t count;
    size_t capacity;
    struct skd_gltf_claim *items;
    bool has_failed;
};

/* Finds all of them. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_claims_find(const struct skd_gltf_container *container,
                                                    struct skd_gltf_claims *claims,
                                                    struct skd_error *error);
void skd_gltf_claims_finish(struct skd_gltf_claims *claims);

/* True when the accessor's elements may be written over for `part` and the parts that have its
 * leader (leaders[part_count]): no other thing stands on a byte of them, and nobody else uses the
 * accessor, nor one of the parts in a second role. */
bool skd_gltf_is_own(const struct skd_gltf_claims *claims, const struct skd_rig *rig,
                     const struct skd_gltf_document *document, const size_t *leaders, size_t part,
                     int32_t accessor);

/* One attribute of one primitive that is written: over what is there, or as a new accessor. */
struct skd_gltf_target {
    bool is_new;
    int32_t accessor; /* in the file; -1 for a set that is added */
    int component;
    uint8_t *bytes; /* element i at bytes + i * stride */
    size_t stride;
    size_t offset; /* new: of its bytes among those that are added */
};

/* In place where that may be and the file's accessor can hold the type, else new; `accessor` is -1
 * for an attribute that is added. */
struct skd_gltf_target skd_gltf_choose_target(const struct skd_gltf_container *container,
                                              int32_t accessor, int width, int component,
                                              bool may_overwrite);

/* The part that a primitive became, or part_count. */
size_t skd_gltf_find_part(const struct skd_mesh *mesh, size_t mesh_index, size_t primitive);

#endif
