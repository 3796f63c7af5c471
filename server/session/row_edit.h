/* One row of slots: what the edits of whole rows have in common.
 *
 * Stage: job. Thread: any. Pure.
 */
#ifndef SKD_SESSION_ROW_EDIT_H
#define SKD_SESSION_ROW_EDIT_H

#include <stdint.h>

/* The slot of the largest weight; of equal ones, the lower bone's. */
int skd_row_largest(int slot_count, const uint16_t *joints, const float *weights);

/* Scales a row of weights, none negative and not all 0, to sum to one within 1e-7 as stored.
 * Weights that are 0 stay so. */
void skd_row_scale(int slot_count, const uint16_t *joints, float *weights);

/* Puts `count` bones, each once and no more than there are slots, with their weights into a row: a
 * bone that has a slot keeps it, others take the last slots whose bones are not wanted. */
void skd_row_put(int slot_count, uint16_t *joints, float *weights, int count, const uint16_t *bones,
                 const float *values);

#endif
