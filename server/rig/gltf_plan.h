/* Where new weights go in a file: over the old ones, or into new accessors.
 *
 * Stage: export. Thread: a worker.
 * An accessor is written in place when its bytes are its own: it has a buffer view, is not sparse,
 * shares no byte with anything else, and its type can hold what is to be written. Primitives that
 * share their sets and want the same weights are one case; those that want different ones get
 * accessors of their own.
 */
#ifndef SKD_RIG_GLTF_PLAN_H
#define SKD_RIG_GLTF_PLAN_H

#include "rig/gltf.h"
#include "rig/gltf_claims.h"
#include "rig/gltf_sets.h"

struct skd_part_plan {
    bool is_changed;  /* some row differs */
    size_t leader;    /* the first part with the same sets and the same new rows, or itself */
    int most;         /* influences of a row to write */
    uint32_t highest; /* joint to write */
    int set_count;    /* when changed: sets to write */
    struct skd_gltf_target joints[SKD_SETS_MAX];
    struct skd_gltf_target weights[SKD_SETS_MAX];
};

/* The wanted influences of one vertex: those that weigh something. Returns how many, or -1 for a
 * negative weight. */
int skd_wanted_row(const struct skd_gltf_content *wanted, size_t vertex, struct skd_influence *row);

/* True when the file's row means exactly what is wanted and is valid as it stands. */
bool skd_row_is_kept(struct skd_gltf_sets *sets, size_t vertex, const struct skd_influence *wanted,
                     int wanted_count);

/* Plans all parts; plans[part_count] is zeroed by the caller. New targets have no bytes yet.
 * Errors: SKD_UNSUPPORTED (negative weights), SKD_NO_MEMORY, those of reading. */
SKD_MUST_CHECK enum skd_status skd_gltf_plan(const struct skd_rig *rig,
                                             const struct skd_gltf_container *container,
                                             const struct skd_gltf_claims *claims,
                                             const struct skd_gltf_content *wanted,
                                             struct skd_part_plan *plans, struct skd_error *error);

#endif
