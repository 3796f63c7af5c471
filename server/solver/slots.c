/* Rows of N slots: own bones, then the chosen fill, then hops.
 *
 * Stage: before the first stroke. Thread: any. Pure: scratch and results are the caller's.
 */
#include "solver/slots.h"

#include "base/error.h"
#include "solver/row_choice.h"
#include "solver/spread.h"

/* The bones that a skin's vertices may take lie in [first, end). */
struct skin_bones {
    uint16_t skin;
    int first;
    int end;
};

static struct skin_bones find_skin_bones(const struct skd_slots_input *input, uint16_t skin)
{
    struct skin_bones bones = {skin, input->bone_count, 0};
    for (int bone = 0; bone < input->bone_count; bone++) {
        if (input->bone_skin[bone] == skin) {
            bones.first = bone < bones.first ? bone : bones.first;
            bones.end = bone + 1;
        }
    }
    return bones;
}

/* Puts one more bone into a row that is sorted by falling score, then by bone; the last one falls
 * out of a full row. Returns the slots used. */
static int insert_sorted(uint16_t *bones, double *scores, int used, int most, uint16_t bone,
                         double score)
{
    int at = used;
    while (at > 0 && (score > scores[at - 1] || (score == scores[at - 1] && bone < bones[at - 1])))
        at--;
    if (at == most)
        return used;
    used += used < most;
    for (int i = used - 1; i > at; i--) {
        bones[i] = bones[i - 1];
        scores[i] = scores[i - 1];
    }
    bones[at] = bone;
    scores[at] = score;
    return used;
}

/* Scales weights to sum to one, rounded as the solver rounds. open: 1 for a slot with a bone. */
static void scale_to_one(int n, const double *open, double *weights)
{
    static const double none[SKD_SLOT_COUNT_MAX];
    const double sum = row_sum(n, weights);
    for (int i = 0; i < n; i++)
        weights[i] /= sum;
    row_store(n, 1.0, open, none, weights);
}

void skd_slots_normalise(int slot_count, const uint16_t *joints, float *weights)
{
    double open[SKD_SLOT_COUNT_MAX] = {0}, scaled[SKD_SLOT_COUNT_MAX] = {0};
    for (int i = 0; i < slot_count; i++) {
        open[i] = joints[i] == SKD_SLOT_EMPTY ? 0.0 : 1.0;
        scaled[i] = (double)weights[i];
    }
    if (row_is_valid(slot_count, scaled, 0.0) > 0.0)
        return;
    scale_to_one(slot_count, open, scaled);
    for (int i = 0; i < slot_count; i++)
        weights[i] = (float)scaled[i];
}

/* Writes the own bones of a vertex; the other slots stay empty. */
static void write_own(const struct skd_slots_input *input, size_t vertex, uint16_t *joints,
                      float *weights, struct skd_slots_report *report)
{
    const int n = input->slot_count;
    uint16_t bones[SKD_SLOT_COUNT_MAX];
    double scores[SKD_SLOT_COUNT_MAX];
    double total = 0.0;
    int used = 0;
    const uint32_t first = input->influence_offsets[vertex];
    const uint32_t end = input->influence_offsets[vertex + 1];
    for (uint32_t k = first; k < end; k++) {
        const double weight = (double)input->influence_weights[k];
        total += weight;
        used = insert_sorted(bones, scores, used, n, input->influence_joints[k], weight);
    }
    if (end - first > (uint32_t)n) {
        static const double every[SKD_SLOT_COUNT_MAX] = {1, 1, 1, 1, 1, 1, 1, 1,
                                                         1, 1, 1, 1, 1, 1, 1, 1};
        const float cut = (float)(1.0 - row_sum(n, scores) / total);
        scale_to_one(n, every, scores);
        report->reduced_count++;
        report->largest_cut = cut > report->largest_cut ? cut : report->largest_cut;
    }
    for (int i = 0; i < n; i++) {
        joints[i] = i < used ? bones[i] : SKD_SLOT_EMPTY;
        weights[i] = i < used ? (float)scores[i] : 0.0F;
    }
}

/* Fills empty slots with the bones of largest sum_i w_i 2^-hops(i, j). */
static void fill_by_hops(const struct skd_slots_input *input, const struct skin_bones *skin,
                         const double *nearness, uint16_t *joints, const float *weights)
{
    const int n = input->slot_count;
    uint16_t bones[SKD_SLOT_COUNT_MAX];
    double scores[SKD_SLOT_COUNT_MAX];
    int own = 0, held = 0, used = 0;
    while (own < n && weights[own] > 0.0F)
        own++;
    while (held < n && joints[held] != SKD_SLOT_EMPTY)
        held++;
    for (int bone = skin->first; held < n && bone < skin->end; bone++) {
        if (input->bone_skin[bone] != skin->skin || skd_row_has(joints, held, (uint16_t)bone))
            continue;
        double score = 0.0;
        for (int i = 0; i < own; i++) {
            const size_t from = (size_t)joints[i] * (size_t)input->bone_count;
            score += (double)weights[i] * nearness[input->hops[from + (size_t)bone]];
        }
        if (score > 0.0)
            used = insert_sorted(bones, scores, used, n - held, (uint16_t)bone, score);
    }
    for (int i = 0; i < used; i++)
        joints[held + i] = bones[i];
}

size_t skd_slots_scratch_bytes(const struct skd_slots_input *input)
{
    return skd_spread_scratch_bytes(input);
}

static void fill_all_by_hops(const struct skd_slots_input *input, uint16_t *joints,
                             const float *weights)
{
    const size_t n = (size_t)input->slot_count;
    double nearness[SKD_HOPS_APART + 1];
    for (int hops = 0; hops < SKD_HOPS_APART; hops++)
        nearness[hops] = ldexp(1.0, -hops);
    nearness[SKD_HOPS_APART] = 0.0;
    struct skin_bones skin = {0};
    for (size_t vertex = 0; vertex < input->vertex_count; vertex++) {
        if (vertex == 0 || input->vertex_skin[vertex] != skin.skin)
            skin = find_skin_bones(input, input->vertex_skin[vertex]);
        fill_by_hops(input, &skin, nearness, joints + n * vertex, weights + n * vertex);
    }
}

void skd_slots_fill(const struct skd_slots_input *input, void *scratch, uint16_t *joints_out,
                    float *weights_out, struct skd_slots_report *report)
{
    const size_t n = (size_t)input->slot_count;
    SKD_ASSERT(input->slot_count >= 1 && input->slot_count <= SKD_SLOT_COUNT_MAX);
    *report = (struct skd_slots_report){0};
    for (size_t vertex = 0; vertex < input->vertex_count; vertex++)
        write_own(input, vertex, joints_out + n * vertex, weights_out + n * vertex, report);
    if (input->fill == SKD_FILL_INFECT)
        skd_spread_infect(input, scratch, joints_out);
    if (input->fill == SKD_FILL_NEIGHBOURS)
        skd_spread_neighbours(input, scratch, joints_out);
    if (input->fill != SKD_FILL_NONE)
        fill_all_by_hops(input, joints_out, weights_out);
    for (size_t vertex = 0; vertex < input->vertex_count; vertex++) {
        const int own = skd_own_count(input, vertex);
        for (size_t i = (size_t)own; i < n; i++) {
            const bool empty = joints_out[n * vertex + i] == SKD_SLOT_EMPTY;
            report->empty_count += empty;
            report->filled_count += !empty;
        }
    }
}
