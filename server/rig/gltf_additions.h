/* Accessors that an export adds to a file: their elements, and their JSON.
 *
 *      buffer 0  [what was there][padding to 4][added][padding][added] ...
 *                                ^ tail: one block in memory
 *
 * Stage: export. Thread: a worker. Owns the tail. Numbers of views and accessors go on where the
 * file's end; nothing of the file moves.
 */
#ifndef SKD_RIG_GLTF_ADDITIONS_H
#define SKD_RIG_GLTF_ADDITIONS_H

#include "rig/gltf_container.h"
#include "rig/json_edit.h"

#include <stdio.h>

struct skd_gltf_additions {
    const struct skd_gltf_container *container;
    size_t view_count; /* added, and so below */
    size_t accessor_count;
    /* The JSON of both, elements with commas between them. */
    FILE *views;
    FILE *accessors;
    char *view_text;
    char *accessor_text;
    size_t view_bytes;
    size_t accessor_bytes;
    uint8_t *tail; /* begins with its alignment */
    size_t tail_bytes;
    size_t tail_capacity;
};

/* What is to be added. */
struct skd_gltf_addition {
    int component;
    int width; /* 1, 3 or 4 */
    bool is_normalized;
    bool is_vertex_data;
    size_t count;
    /* [2][3] smallest and largest of each column, which a POSITION must have; NULL: none */
    const float *bounds;
};

/* bounds [2][3] of at least one element. */
void skd_gltf_find_bounds(const float *elements, size_t count, float *bounds);

/* Errors: SKD_NO_MEMORY; finish it then too. The container is borrowed. */
SKD_MUST_CHECK enum skd_status skd_gltf_additions_init(struct skd_gltf_additions *additions,
                                                       const struct skd_gltf_container *container,
                                                       struct skd_error *error);

/* Adds an accessor with room for its elements, zeroed, at tail + *offset. The tail moves when
 * something else is added. Errors of this and the next: SKD_UNSUPPORTED (no buffer to put them
 * in), SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_add_elements(struct skd_gltf_additions *additions,
                                                     const struct skd_gltf_addition *addition,
                                                     int32_t *accessor, size_t *offset,
                                                     struct skd_error *error);

/* Adds float32 [3] elements of which all are zero but values[i] at indices[i], rising. Costs 16
 * bytes a value. */
SKD_MUST_CHECK enum skd_status skd_gltf_add_sparse(struct skd_gltf_additions *additions,
                                                   const struct skd_gltf_addition *addition,
                                                   size_t value_count, const uint32_t *indices,
                                                   const float *values, int32_t *accessor,
                                                   struct skd_error *error);

/* Adds elements that are all zero and have no bytes; returns the accessor's number. */
int32_t skd_gltf_add_zeros(struct skd_gltf_additions *additions,
                           const struct skd_gltf_addition *addition);

/* Puts the JSON of all into the file's lists, and the new byteLength. Nothing is added after it.
 * Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_additions_json(struct skd_gltf_additions *additions,
                                                       struct skd_json_edits *edits,
                                                       struct skd_error *error);

void skd_gltf_additions_finish(struct skd_gltf_additions *additions);

/* The member of a buffer in the JSON. */
bool skd_gltf_buffer_member(const struct skd_gltf_container *container, size_t index,
                            const char *name, struct skd_json *value);

#endif
