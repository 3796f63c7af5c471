/* See weight_rows.h. */
#include "rig/weight_rows.h"

#include <math.h>
#include <stdbool.h>

static int find_slot(const struct skd_file_row *row, const bool *is_taken, int32_t bone,
                     bool has_weight)
{
    for (int i = 0; i < row->count; i++)
        if (!is_taken[i] && row->bones[i] == bone && (row->weights[i] != 0) == has_weight)
            return i;
    return -1;
}

void skd_row_place(struct skd_file_row *row, const struct skd_influence *wanted, int wanted_count,
                   const uint16_t *joint_of_bone)
{
    bool is_taken[SKD_INFLUENCES_MAX] = {false};
    int slots[SKD_INFLUENCES_MAX];
    for (int k = 0; k < wanted_count; k++) {
        slots[k] = find_slot(row, is_taken, wanted[k].bone, true);
        if (slots[k] < 0)
            slots[k] = find_slot(row, is_taken, wanted[k].bone, false);
        if (slots[k] >= 0)
            is_taken[slots[k]] = true;
    }
    int next = 0;
    for (int k = 0; k < wanted_count; k++) {
        if (slots[k] >= 0)
            continue;
        while (is_taken[next])
            next++;
        slots[k] = next;
        is_taken[next] = true;
        row->joints[next] = joint_of_bone[wanted[k].bone];
        row->bones[next] = wanted[k].bone;
    }
    for (int i = 0; i < row->count; i++) {
        if (!is_taken[i] && row->weights[i] != 0)
            row->joints[i] = 0;
        row->weights[i] = 0;
    }
    for (int k = 0; k < wanted_count; k++)
        row->weights[slots[k]] = wanted[k].weight;
}

double skd_row_quantise(struct skd_file_row *row, uint32_t steps, uint32_t *numerators)
{
    double rests[SKD_INFLUENCES_MAX], sum = 0, largest = 0;
    for (int i = 0; i < row->count; i++)
        sum += (double)row->weights[i];
    uint32_t given = 0;
    for (int i = 0; i < row->count; i++) {
        const double share = (double)row->weights[i] / sum * steps;
        numerators[i] = (uint32_t)share;
        rests[i] = row->weights[i] > 0 ? share - numerators[i] : -1;
        given += numerators[i];
    }
    for (; given < steps; given++) {
        int best = 0;
        for (int i = 1; i < row->count; i++)
            if (rests[i] > rests[best] ||
                (rests[i] == rests[best] && row->bones[i] < row->bones[best]))
                best = i;
        numerators[best]++;
        rests[best] = -1;
    }
    for (int i = 0; i < row->count; i++) {
        const double change = fabs((double)numerators[i] / steps - (double)row->weights[i]);
        largest = change > largest ? change : largest;
        if (numerators[i] == 0 && row->weights[i] > 0)
            row->joints[i] = 0;
        row->weights[i] = (float)((double)numerators[i] / steps);
    }
    return largest;
}
