/* See influences.h. */
#include "rig/influences.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

/* Takes out what is no weight. */
static int drop_invalid(struct skd_influence *row, int count, size_t *notes)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        if (row[i].weight > 0 && isfinite(row[i].weight))
            row[kept++] = row[i];
        else if (!(row[i].weight == 0))
            notes[SKD_NOTE_WEIGHTS_INVALID]++;
    }
    return kept;
}

static int merge_bones(struct skd_influence *row, int count, size_t *notes)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        int same = 0;
        while (same < kept && row[same].bone != row[i].bone)
            same++;
        if (same == kept) {
            row[kept++] = row[i];
        } else {
            const float sum = row[same].weight + row[i].weight;
            row[same].weight = isfinite(sum) ? sum : FLT_MAX;
            notes[SKD_NOTE_JOINTS_MERGED]++;
        }
    }
    return kept;
}

/* Scaling in float64 and rounding once leaves at most 2^-24 of the sum, 6e-8. */
static int scale_to_one(struct skd_influence *row, int count, size_t *notes)
{
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += (double)row[i].weight;
    const double off = fabs(sum - 1);
    if (off <= SKD_ROW_SUM_EXACT)
        return count;
    if (off > SKD_ROW_SUM_VALID * count)
        notes[SKD_NOTE_WEIGHTS_NORMALISED]++;
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const float weight = (float)((double)row[i].weight / sum);
        if (weight > 0)
            row[kept++] = (struct skd_influence){row[i].bone, weight};
    }
    return kept;
}

/* Rows are short and mostly in order as they come. */
static void sort_largest_first(struct skd_influence *row, int count)
{
    for (int i = 1; i < count; i++) {
        const struct skd_influence one = row[i];
        int at = i;
        for (; at > 0; at--) {
            const struct skd_influence *before = &row[at - 1];
            if (before->weight > one.weight ||
                (before->weight == one.weight && before->bone < one.bone))
                break;
            row[at] = *before;
        }
        row[at] = one;
    }
}

/* The usual row: nothing to mend, and in order already. */
static bool is_mended(const struct skd_influence *row, int count)
{
    double sum = 0;
    for (int i = 0; i < count; i++) {
        if (!(row[i].weight > 0))
            return false;
        sum += (double)row[i].weight;
        if (i > 0 && (row[i - 1].weight < row[i].weight ||
                      (row[i - 1].weight == row[i].weight && row[i - 1].bone > row[i].bone)))
            return false;
        for (int k = 0; k < i; k++)
            if (row[k].bone == row[i].bone)
                return false;
    }
    return fabs(sum - 1) <= SKD_ROW_SUM_EXACT; /* also tells infinite ones */
}

int skd_influences_mend(struct skd_influence *row, int count, uint16_t root, size_t *notes)
{
    if (is_mended(row, count))
        return count;
    count = drop_invalid(row, count, notes);
    count = merge_bones(row, count, notes);
    if (count == 0) {
        row[0] = (struct skd_influence){root, 1};
        notes[SKD_NOTE_WEIGHTS_MISSING]++;
        return 1;
    }
    count = scale_to_one(row, count, notes);
    sort_largest_first(row, count);
    return count;
}

enum skd_status skd_influences_reserve(struct skd_influences *influences, size_t vertex_count,
                                       size_t most, struct skd_error *error)
{
    influences->offsets = malloc((vertex_count + 1) * sizeof *influences->offsets);
    influences->joints = malloc(most * sizeof *influences->joints);
    influences->weights = malloc(most * sizeof *influences->weights);
    if (influences->offsets == NULL || influences->joints == NULL || influences->weights == NULL)
        return skd_fail_memory(error, "the influences");
    influences->offsets[0] = 0;
    influences->most = 0;
    return SKD_OK;
}

void skd_influences_append(struct skd_influences *influences, size_t vertex,
                           const struct skd_influence *row, int count)
{
    const uint32_t first = influences->offsets[vertex];
    for (int i = 0; i < count; i++) {
        influences->joints[first + (uint32_t)i] = row[i].bone;
        influences->weights[first + (uint32_t)i] = row[i].weight;
    }
    influences->offsets[vertex + 1] = first + (uint32_t)count;
    if (count > influences->most)
        influences->most = count;
}

void skd_influences_trim(struct skd_influences *influences, size_t vertex_count)
{
    const size_t used = influences->offsets[vertex_count];
    uint16_t *joints = realloc(influences->joints, used * sizeof *joints);
    if (joints != NULL)
        influences->joints = joints;
    float *weights = realloc(influences->weights, used * sizeof *weights);
    if (weights != NULL)
        influences->weights = weights;
}
