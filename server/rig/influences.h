/* Mending influences: whatever a file or a peer says becomes weights that a solver can trust.
 *
 * Stage: rig session (in) and export (to see what a file means). Thread: a worker.
 * The policies are the SKD_NOTES of rig.h.
 */
#ifndef SKD_RIG_INFLUENCES_H
#define SKD_RIG_INFLUENCES_H

#include "rig/rig.h"

/* A row of weights that is off by more than this is scaled ... */
#define SKD_ROW_SUM_EXACT 1e-7
/* ... and one that is off by more than this for each of its weights is told about, and written anew
 * on export: what the Khronos validator lets pass, measured. */
#define SKD_ROW_SUM_VALID 2e-7

struct skd_influence {
    uint16_t bone;
    float weight;
};

/* Mends the `count` influences of one vertex in place and counts what it did in
 * notes[SKD_NOTE_COUNT]. `root` takes a vertex without weight, so there must be room for one.
 * Returns how many are left, at least 1. Mending twice is mending once. */
int skd_influences_mend(struct skd_influence *row, int count, uint16_t root, size_t *notes);

/* Room for the influences of vertex_count vertices, `most` in all; fill with
 * skd_influences_append, end with skd_influences_trim. */
SKD_MUST_CHECK enum skd_status skd_influences_reserve(struct skd_influences *influences,
                                                      size_t vertex_count, size_t most,
                                                      struct skd_error *error);
/* The next vertex's row; vertices come in order. */
void skd_influences_append(struct skd_influences *influences, size_t vertex,
                           const struct skd_influence *row, int count);
/* Gives back what was reserved and not used. */
void skd_influences_trim(struct skd_influences *influences, size_t vertex_count);

#endif
