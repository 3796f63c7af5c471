/* The elements of an accessor, checked once and then read without a check.
 *
 * Stage: rig session and export. Thread: a worker.
 * Everything that a file says about where its numbers lie is held against the bytes that are there
 * when an accessor is opened. Sparse accessors and those without a buffer view are made whole in
 * memory of their own.
 */
#ifndef SKD_RIG_ELEMENTS_H
#define SKD_RIG_ELEMENTS_H

#include "rig/gltf_container.h"

struct skd_elements {
    const uint8_t *bytes; /* element i at bytes + i * stride */
    size_t stride;
    size_t count;
    int width;     /* numbers in one element */
    int component; /* SKD_GLTF_... */
    bool is_normalized;
    uint8_t *owned; /* the whole accessor when it had to be put together, else NULL */
};

/* Opens accessor `index`, which must have `width` numbers an element; `what` names it in errors
 * ("POSITION of mesh 3"). Errors: SKD_BAD_RIG, SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_elements_open(const struct skd_gltf_container *container,
                                                 int32_t index, int width, const char *what,
                                                 struct skd_elements *elements,
                                                 struct skd_error *error);
void skd_elements_close(struct skd_elements *elements);

/* Bytes of one component, 0 for a type that glTF does not have. */
size_t skd_component_bytes(int component);

/* Elements [first, first + count) as float32, one after the other; normalised integers as the
 * specification maps them. */
void skd_elements_floats(const struct skd_elements *elements, size_t first, size_t count,
                         float *out);
/* The same as integers; only for unsigned integer components. */
void skd_elements_integers(const struct skd_elements *elements, size_t first, size_t count,
                           uint32_t *out);

#endif
