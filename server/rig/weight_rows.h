/* One vertex's weights as a file stores them: which slot takes which joint, and rounding.
 *
 * Stage: export. Thread: a worker. Pure.
 */
#ifndef SKD_RIG_WEIGHT_ROWS_H
#define SKD_RIG_WEIGHT_ROWS_H

#include "rig/influences.h"

#include <stdint.h>

/* A row of JOINTS_n and WEIGHTS_n, set after set. */
struct skd_file_row {
    int count;                           /* slots: 4 a set */
    uint32_t joints[SKD_INFLUENCES_MAX]; /* as in the file */
    int32_t bones[SKD_INFLUENCES_MAX];   /* what they mean, or -1: no bone of the skin */
    float weights[SKD_INFLUENCES_MAX];
};

/* Puts the wanted influences into the row, which holds what the file had: a bone that stands there
 * stays in its slot, the others take free slots from the front, slots that lose their weight get
 * joint 0 and slots that had none stay as they are. joint_of_bone[bone] is a joint number of the
 * skin. wanted_count is at most row->count. */
void skd_row_place(struct skd_file_row *row, const struct skd_influence *wanted, int wanted_count,
                   const uint16_t *joint_of_bone);

/* Rounds the row's weights to multiples of 1/steps that sum to exactly one, by largest remainder
 * (of equal ones, the lower bone: twins round alike wherever their slots are). numerators[] gets
 * the multiples. Slots that come to 0 get joint 0 unless they were 0. Returns the largest change
 * of one weight. */
double skd_row_quantise(struct skd_file_row *row, uint32_t steps, uint32_t *numerators);

#endif
