/* The project's own character: a humanoid of any size, written as one .glb file.
 *
 * Stage: before the line; skinctl runs it, the daemon never does. Thread: the caller's.
 * Owns nothing between calls. Reads no clock, no locale and no random numbers: the same options
 * give the same bytes.
 *
 *   anatomy ─► skeleton ─► weights ─┐
 *       └────► body (cage) ─► surface ─► tessellation ─► mesh ─► write_glb ─► file
 *              skeleton ─► clips ───────────────────────────────────┘
 *
 * The figure is 1.75 m tall, stands on y = 0 in an A-pose, faces +Z, has Y up and metres as unit.
 * Its left is +X; names of bones end in .L and .R.
 */
#ifndef SKD_GENERATE_H
#define SKD_GENERATE_H

#include <stdint.h>

#include "base/error.h"

enum {
    SKD_GENERATE_MIN_VERTICES = 1000,
    SKD_GENERATE_MAX_VERTICES = 5000000,
    SKD_GENERATE_MIN_BONES = 20,
    SKD_GENERATE_MAX_BONES = 250,
    SKD_GENERATE_DEFAULT_BONES = 53
};

/* progress may be NULL; else it is called now and then with fraction in 0..1 and with user. */
struct skd_generate_options {
    uint32_t vertex_count;
    uint16_t bone_count;
    void (*progress)(double fraction, void *user);
    void *user;
};

/* Writes a humanoid with exactly options->vertex_count vertices and options->bone_count joints to
 * path, first into a file beside it that takes its name when it is complete: a failed call leaves
 * what was at path as it was.
 *
 * The skin is one closed surface (every edge has two triangles, wound outwards) without seams;
 * each vertex has at most 4 float32 weights that sum to one. Clips: walk, bend, reach,
 * range_of_motion. Needs about 50 bytes a vertex.
 *
 * Errors: SKD_BAD_PARAMS for a count out of range, SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_generate_humanoid(const struct skd_generate_options *options,
                                                     const char *path, struct skd_error *error);

#endif
