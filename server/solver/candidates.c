/* Three rankings of bones, interleaved; see candidates.h.
 *
 * Stage: before a solve that may change slots, inside solver/. Thread: any. Pure.
 * Scratch: what diffusion holds for the vertices within 8 rings of those asked for ("the region"),
 * found by a breadth-first walk, and one distance a bone.
 */
#include "solver/candidates.h"

#include "base/error.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum {
    ROUNDS = 8,
    HELD = 16, /* bones that a vertex remembers in diffusion, the heaviest */
    GATHERED_MAX = 64,
};

static const uint32_t outside = UINT32_MAX;

/* A vertex's bones and weights while they spread; SKD_SLOT_EMPTY ends the row. */
struct spread_row {
    float weights[HELD];
    uint16_t bones[HELD];
};

struct work {
    struct spread_row *rows[2]; /* [region] before and after a round */
    double *distances;          /* [B] squared, of one vertex */
    double nearness[SKD_HOPS_APART + 1];
    uint32_t *members;  /* [region] vertices; those asked for first, then ring after ring */
    uint32_t *place;    /* [V] a vertex's number among the members, or `outside` */
    uint8_t *is_parent; /* [B] the bone has a child */
    size_t ring_end[ROUNDS + 1]; /* members within so many rings */
};

static void *take(char **at, size_t count, size_t size)
{
    char *taken = *at;
    *at += count * size;
    return taken;
}

/* Larger elements first, so that all are aligned. */
static size_t lay_work(const struct skd_candidates_input *input, char *at, struct work *work)
{
    const char *begin = at;
    const size_t bones = (size_t)input->bone_count;
    work->distances = take(&at, bones, sizeof(double));
    work->rows[0] = take(&at, input->vertex_count, sizeof(struct spread_row));
    work->rows[1] = take(&at, input->vertex_count, sizeof(struct spread_row));
    work->members = take(&at, input->vertex_count, sizeof(uint32_t));
    work->place = take(&at, input->vertex_count, sizeof(uint32_t));
    work->is_parent = take(&at, bones, sizeof(uint8_t));
    return (size_t)(at - begin);
}

size_t skd_candidates_scratch_bytes(const struct skd_candidates_input *input)
{
    static char origin[1];
    struct work work;
    return lay_work(input, origin, &work);
}

/* ---- diffusion ---- */

static void find_region(const struct skd_candidates_input *input, struct work *work)
{
    size_t first = 0, end = input->count;
    memset(work->place, 0xff, input->vertex_count * sizeof *work->place);
    for (size_t item = 0; item < input->count; item++) {
        work->members[item] = input->vertices[item];
        work->place[input->vertices[item]] = (uint32_t)item;
    }
    work->ring_end[0] = end;
    for (int ring = 1; ring <= ROUNDS; ring++) {
        const size_t before = end;
        for (; first < before; first++) {
            const uint32_t from = work->members[first];
            for (uint32_t edge = input->neighbour_offsets[from];
                 edge < input->neighbour_offsets[from + 1]; edge++) {
                const uint32_t to = input->neighbours[edge];
                if (work->place[to] == outside) {
                    work->place[to] = (uint32_t)end;
                    work->members[end++] = to;
                }
            }
        }
        work->ring_end[ring] = end;
    }
}

/* What gathers at a vertex in a round. */
struct gathered {
    int count;
    uint16_t bones[GATHERED_MAX];
    double weights[GATHERED_MAX];
};

static void add_row(struct gathered *gathered, const struct spread_row *row)
{
    for (int k = 0; k < HELD && row->bones[k] != SKD_SLOT_EMPTY; k++) {
        int at = 0;
        while (at < gathered->count && gathered->bones[at] != row->bones[k])
            at++;
        if (at == GATHERED_MAX)
            continue;
        if (at == gathered->count) {
            gathered->bones[at] = row->bones[k];
            gathered->weights[at] = 0.0;
            gathered->count++;
        }
        gathered->weights[at] += (double)row->weights[k];
    }
}

/* Takes the heaviest bone that is left, the lower number of equal ones. -1: none is left. */
static int take_heaviest(struct gathered *gathered, uint16_t *bone, double *weight)
{
    int best = -1;
    for (int i = 0; i < gathered->count; i++) {
        if (best < 0 || gathered->weights[i] > gathered->weights[best] ||
            (gathered->weights[i] == gathered->weights[best] &&
             gathered->bones[i] < gathered->bones[best]))
            best = i;
    }
    if (best < 0)
        return -1;
    *bone = gathered->bones[best];
    *weight = gathered->weights[best];
    gathered->count--;
    gathered->bones[best] = gathered->bones[gathered->count];
    gathered->weights[best] = gathered->weights[gathered->count];
    return 0;
}

static void keep_heaviest(struct gathered *gathered, double scale, struct spread_row *row)
{
    for (int k = 0; k < HELD; k++) {
        uint16_t bone;
        double weight;
        const bool taken = take_heaviest(gathered, &bone, &weight) == 0;
        row->bones[k] = taken ? bone : SKD_SLOT_EMPTY;
        row->weights[k] = taken ? (float)(scale * weight) : 0.0F;
    }
}

static void read_start(const struct skd_candidates_input *input, size_t vertex,
                       struct gathered *gathered)
{
    const size_t n = (size_t)input->slot_count;
    gathered->count = 0;
    for (size_t slot = n * vertex; slot < n * (vertex + 1); slot++) {
        if (input->start_joints[slot] == SKD_SLOT_EMPTY || !(input->start_weights[slot] > 0.0F))
            continue;
        gathered->bones[gathered->count] = input->start_joints[slot];
        gathered->weights[gathered->count++] = (double)input->start_weights[slot];
    }
}

/* After round r the rows of members within ROUNDS - r rings are right; the others are not needed
 * any more. Leaves the result in rows[0]. */
static void diffuse(const struct skd_candidates_input *input, struct work *work)
{
    struct gathered gathered;
    for (size_t member = 0; member < work->ring_end[ROUNDS]; member++) {
        read_start(input, work->members[member], &gathered);
        keep_heaviest(&gathered, 1.0, &work->rows[0][member]);
    }
    for (int round = 1; round <= ROUNDS; round++) {
        for (size_t member = 0; member < work->ring_end[ROUNDS - round]; member++) {
            const uint32_t vertex = work->members[member];
            const uint32_t first = input->neighbour_offsets[vertex];
            const uint32_t end = input->neighbour_offsets[vertex + 1];
            gathered.count = 0;
            add_row(&gathered, &work->rows[0][member]);
            for (uint32_t edge = first; edge < end; edge++)
                add_row(&gathered, &work->rows[0][work->place[input->neighbours[edge]]]);
            keep_heaviest(&gathered, 1.0 / (double)(1 + end - first), &work->rows[1][member]);
        }
        struct spread_row *done = work->rows[0];
        work->rows[0] = work->rows[1];
        work->rows[1] = done;
    }
}

/* ---- distance and hops ---- */

static double segment_distance(const float *point, const float *from, const float *to)
{
    double length = 0.0, along = 0.0, square = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double side = (double)to[axis] - (double)from[axis];
        length += side * side;
        along += side * ((double)point[axis] - (double)from[axis]);
    }
    const double share = length > 0.0 ? fmin(fmax(along / length, 0.0), 1.0) : 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double side = (double)to[axis] - (double)from[axis];
        const double apart = (double)point[axis] - (double)from[axis] - share * side;
        square += apart * apart;
    }
    return square;
}

/* Fills work->distances. A segment belongs to the parent; it ends at the child's head. */
static void measure_bones(const struct skd_candidates_input *input, const struct work *work,
                          size_t vertex)
{
    const float *point = input->rest + 3 * vertex;
    for (int bone = 0; bone < input->bone_count; bone++) {
        const float *head = input->bone_heads + 3 * (size_t)bone;
        work->distances[bone] =
            work->is_parent[bone] ? INFINITY : segment_distance(point, head, head);
    }
    for (int bone = 0; bone < input->bone_count; bone++) {
        const int32_t parent = input->bone_parents[bone];
        if (parent < 0)
            continue;
        const double distance = segment_distance(point, input->bone_heads + 3 * (size_t)parent,
                                                 input->bone_heads + 3 * (size_t)bone);
        if (distance < work->distances[parent])
            work->distances[parent] = distance;
    }
}

/* The best bones by falling score, the lower number of equal ones first. */
struct ranking {
    int count;
    uint16_t bones[SKD_CANDIDATES_MAX];
    double scores[SKD_CANDIDATES_MAX];
};

static void rank_bone(struct ranking *ranking, uint16_t bone, double score)
{
    int at = ranking->count;
    while (at > 0 && score > ranking->scores[at - 1])
        at--;
    if (at == SKD_CANDIDATES_MAX)
        return;
    ranking->count += ranking->count < SKD_CANDIDATES_MAX;
    for (int i = ranking->count - 1; i > at; i--) {
        ranking->bones[i] = ranking->bones[i - 1];
        ranking->scores[i] = ranking->scores[i - 1];
    }
    ranking->bones[at] = bone;
    ranking->scores[at] = score;
}

static void rank_all(const struct skd_candidates_input *input, const struct work *work, size_t item,
                     struct ranking rankings[3])
{
    const size_t vertex = input->vertices[item];
    const size_t first = (size_t)input->slot_count * vertex;
    const struct spread_row *row = &work->rows[0][item];
    for (int i = 0; i < 3; i++)
        rankings[i].count = 0;
    for (int k = 0; k < HELD && row->bones[k] != SKD_SLOT_EMPTY; k++)
        rank_bone(&rankings[0], row->bones[k], (double)row->weights[k]);
    measure_bones(input, work, vertex);
    for (int bone = 0; bone < input->bone_count; bone++) {
        if (input->bone_skin[bone] != input->vertex_skin[vertex])
            continue;
        double score = 0.0;
        for (size_t slot = first; slot < first + (size_t)input->slot_count; slot++) {
            const uint16_t own = input->start_joints[slot];
            if (own != SKD_SLOT_EMPTY && input->start_weights[slot] > 0.0F)
                score += (double)input->start_weights[slot] *
                         work->nearness[input->hops[(size_t)own * (size_t)input->bone_count +
                                                    (size_t)bone]];
        }
        rank_bone(&rankings[1], (uint16_t)bone, -work->distances[bone]);
        if (score > 0.0)
            rank_bone(&rankings[2], (uint16_t)bone, score);
    }
}

/* ---- the list ---- */

static bool has_bone(const uint16_t *list, int count, uint16_t bone)
{
    for (int i = 0; i < count; i++) {
        if (list[i] == bone)
            return true;
    }
    return false;
}

static int list_own(const struct skd_candidates_input *input, size_t vertex, uint16_t *list)
{
    struct gathered own;
    double weight;
    int used = 0;
    read_start(input, vertex, &own);
    while (used < SKD_CANDIDATES_MAX && take_heaviest(&own, &list[used], &weight) == 0)
        used++;
    return used;
}

static void interleave(const struct ranking rankings[3], uint16_t skin, const uint16_t *bone_skin,
                       uint16_t *list, int used)
{
    int next[3] = {0, 0, 0};
    bool more = true;
    while (more && used < SKD_CANDIDATES_MAX) {
        more = false;
        for (int i = 0; i < 3 && used < SKD_CANDIDATES_MAX; i++) {
            const struct ranking *ranking = &rankings[i];
            while (next[i] < ranking->count && (has_bone(list, used, ranking->bones[next[i]]) ||
                                                bone_skin[ranking->bones[next[i]]] != skin))
                next[i]++;
            if (next[i] < ranking->count) {
                list[used++] = ranking->bones[next[i]++];
                more = true;
            }
        }
    }
    while (used < SKD_CANDIDATES_MAX)
        list[used++] = SKD_SLOT_EMPTY;
}

void skd_candidates_fill(const struct skd_candidates_input *input, void *scratch, uint16_t *lists)
{
    struct work work;
    SKD_ASSERT(input->slot_count >= 1 && input->slot_count <= SKD_SLOT_COUNT_MAX);
    lay_work(input, scratch, &work);
    memset(work.is_parent, 0, (size_t)input->bone_count);
    for (int bone = 0; bone < input->bone_count; bone++) {
        if (input->bone_parents[bone] >= 0)
            work.is_parent[input->bone_parents[bone]] = 1;
    }
    for (int hops = 0; hops < SKD_HOPS_APART; hops++)
        work.nearness[hops] = ldexp(1.0, -hops);
    work.nearness[SKD_HOPS_APART] = 0.0;
    find_region(input, &work);
    diffuse(input, &work);
    for (size_t item = 0; item < input->count; item++) {
        const size_t vertex = input->vertices[item];
        uint16_t *list = lists + SKD_CANDIDATES_MAX * item;
        struct ranking rankings[3];
        rank_all(input, &work, item, rankings);
        const int used = list_own(input, vertex, list);
        interleave(rankings, input->vertex_skin[vertex], input->bone_skin, list, used);
    }
}
