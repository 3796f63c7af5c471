/* See row_edit.h. */
#include "session/row_edit.h"

#include "solver/slots.h"

#include <stdbool.h>

int skd_row_largest(int slot_count, const uint16_t *joints, const float *weights)
{
    int largest = 0;
    for (int i = 1; i < slot_count; i++) {
        if (weights[i] > weights[largest] ||
            (weights[i] >= weights[largest] && joints[i] < joints[largest]))
            largest = i;
    }
    return largest;
}

void skd_row_scale(int slot_count, const uint16_t *joints, float *weights)
{
    uint16_t used[SKD_SLOT_COUNT_MAX]; /* rounding must not wake a slot that weighs nothing */
    for (int i = 0; i < slot_count; i++)
        used[i] = weights[i] > 0 ? joints[i] : SKD_SLOT_EMPTY;
    skd_slots_normalise(slot_count, used, weights);
}

static int find(int count, const uint16_t *bones, uint16_t bone)
{
    for (int i = 0; i < count; i++) {
        if (bones[i] == bone)
            return i;
    }
    return -1;
}

void skd_row_put(int slot_count, uint16_t *joints, float *weights, int count, const uint16_t *bones,
                 const float *values)
{
    int last = slot_count - 1;
    for (int k = 0; k < count; k++) {
        if (find(slot_count, joints, bones[k]) >= 0)
            continue;
        while (find(count, bones, joints[last]) >= 0)
            last--;
        joints[last] = bones[k];
    }
    for (int i = 0; i < slot_count; i++) {
        int k = find(count, bones, joints[i]);
        weights[i] = k >= 0 ? values[k] : 0;
    }
}
