/* The JOINTS_n and WEIGHTS_n of one primitive, as rows of influences.
 *
 * Stage: rig session and export. Thread: a worker.
 */
#ifndef SKD_RIG_GLTF_SETS_H
#define SKD_RIG_GLTF_SETS_H

#include "rig/elements.h"
#include "rig/gltf_source.h"
#include "rig/influences.h"

enum { SKD_ROWS_AHEAD = 64 }; /* rows that are read at once */

struct skd_gltf_sets {
    size_t vertex_count;
    int count;
    struct skd_elements joints[SKD_SETS_MAX];
    struct skd_elements weights[SKD_SETS_MAX];
    /* The skin's joints. */
    size_t joint_count;
    const uint16_t *bones; /* [joint_count] */
    uint16_t root;         /* bone of vertices without weight */
    /* Rows [read_first, read_end) as the file has them. */
    size_t read_first;
    size_t read_end;
    uint32_t read_joints[SKD_SETS_MAX][SKD_ROWS_AHEAD][4];
    float read_weights[SKD_SETS_MAX][SKD_ROWS_AHEAD][4];
};

/* Opens the sets of the primitive that `part` came from. Errors: SKD_BAD_RIG, SKD_TOO_LARGE,
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_gltf_sets_open(const struct skd_gltf_container *container, const struct skd_gltf_source *source,
                   const struct skd_rig *rig, const struct skd_part *part,
                   struct skd_gltf_sets *sets, struct skd_error *error);
void skd_gltf_sets_close(struct skd_gltf_sets *sets);

/* Reads and mends one vertex's row, which has room for SKD_INFLUENCES_MAX; returns its length or
 * -1 when it names a joint that the skin does not have (a joint of weight 0 may be anything).
 * Fast when vertices come in order. */
int skd_gltf_sets_row(struct skd_gltf_sets *sets, size_t vertex, struct skd_influence *row,
                      size_t *notes);

/* The same row as it stands in the file: four joints and weights a set. */
void skd_gltf_sets_raw_row(struct skd_gltf_sets *sets, size_t vertex, uint32_t *joints,
                           float *weights);

#endif
