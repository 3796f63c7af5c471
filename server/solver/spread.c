/* Infection along edges (thesis 7.5.2) and bones of the neighbours, ring after ring.
 *
 * Stage: before the first stroke, inside solver/. Thread: any. Pure: scratch is the caller's.
 *
 * How 7.5.2 is read. Its text: a vertex gives its bones to the other end of each edge; the weight
 * there is minus the distance from that vertex to the bone; a nearer bone replaces a farther one;
 * until nothing changes; then negative weights become 0 and the four largest stay. Its pseudo-code
 * has slips that the text does not: the distance is rounded to whole scene units, it is measured
 * from an unnamed vertex, a bone that is there already is compared with the giver's weights, and a
 * found one is stored with the wrong sign. Here every vertex keeps its own bones, and in its other
 * slots the nearest bones (vertex to bone head) that its neighbours have ever held while it
 * looked.
 *
 * All vertices look at once, round by round, at what their neighbours held after the last round,
 * so no order of vertices, edges or triangles matters. A vertex's list only ever gets nearer, so
 * it ends. Only vertices with a neighbour that changed look again.
 */
#include "solver/spread.h"

#include <string.h>

/* How far NEIGHBOURS looks; farther than this is left to hops. */
enum { RINGS_MOST = 8 };

struct infection {
    uint32_t *reader_offsets; /* [V+1] who has a vertex as a neighbour, CSR */
    uint32_t *readers;
    uint32_t *looking; /* [V] vertices of this round */
    uint32_t *next;    /* [V] vertices of the next one */
    uint16_t *found;   /* [V][N] lists of this round, until all have looked */
    uint8_t *is_next;  /* [V] */
};

struct rings {
    uint64_t *totals;  /* [B] weight of a bone in the ring, in steps of 2^-32 */
    uint32_t *visited; /* [V] the vertex whose search came here last, plus one */
    uint32_t *queue;   /* [V] */
    uint16_t *touched; /* [B] bones with a total */
};

/* Takes `count` elements of `size` bytes; larger elements must be taken first. */
static void *take(char **at, size_t count, size_t size)
{
    char *taken = *at;
    *at += count * size;
    return taken;
}

static char *lay_infection(const struct skd_slots_input *input, char *at, struct infection *lists)
{
    const size_t vertices = input->vertex_count;
    lists->reader_offsets = take(&at, vertices + 1, sizeof(uint32_t));
    lists->readers = take(&at, input->neighbour_offsets[vertices], sizeof(uint32_t));
    lists->looking = take(&at, vertices, sizeof(uint32_t));
    lists->next = take(&at, vertices, sizeof(uint32_t));
    lists->found = take(&at, vertices * (size_t)input->slot_count, sizeof(uint16_t));
    lists->is_next = take(&at, vertices, sizeof(uint8_t));
    return at;
}

static char *lay_rings(const struct skd_slots_input *input, char *at, struct rings *rings)
{
    rings->totals = take(&at, (size_t)input->bone_count, sizeof(uint64_t));
    rings->visited = take(&at, input->vertex_count, sizeof(uint32_t));
    rings->queue = take(&at, input->vertex_count, sizeof(uint32_t));
    rings->touched = take(&at, (size_t)input->bone_count, sizeof(uint16_t));
    return at;
}

size_t skd_spread_scratch_bytes(const struct skd_slots_input *input)
{
    static char origin[1];
    struct infection lists;
    struct rings rings;
    if (input->fill == SKD_FILL_INFECT)
        return (size_t)(lay_infection(input, origin, &lists) - origin);
    if (input->fill == SKD_FILL_NEIGHBOURS)
        return (size_t)(lay_rings(input, origin, &rings) - origin);
    return 0;
}

/* ---- infection ---- */

static void find_readers(const struct skd_slots_input *input, struct infection *lists)
{
    const size_t vertices = input->vertex_count;
    const uint32_t edges = input->neighbour_offsets[vertices];
    uint32_t *offsets = lists->reader_offsets;
    memset(offsets, 0, (vertices + 1) * sizeof *offsets);
    for (uint32_t edge = 0; edge < edges; edge++)
        offsets[input->neighbours[edge]]++;
    for (size_t vertex = 1; vertex <= vertices; vertex++)
        offsets[vertex] += offsets[vertex - 1];
    /* offsets[v] is the end of v's readers now; filling them backwards makes it their begin. */
    for (size_t vertex = vertices; vertex-- > 0;) {
        for (uint32_t edge = input->neighbour_offsets[vertex];
             edge < input->neighbour_offsets[vertex + 1]; edge++)
            lists->readers[--offsets[input->neighbours[edge]]] = (uint32_t)vertex;
    }
}

static double head_distance(const struct skd_slots_input *input, size_t vertex, uint16_t bone)
{
    const float *v = input->rest + 3 * vertex;
    const float *head = input->bone_heads + 3 * (size_t)bone;
    double square = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double apart = (double)v[axis] - (double)head[axis];
        square += apart * apart;
    }
    return square;
}

/* A vertex's list while it looks: own bones, then borrowed ones, nearest first. */
struct list {
    int own;
    int used;
    int most;
    uint16_t bones[SKD_SLOT_COUNT_MAX];
    double distances[SKD_SLOT_COUNT_MAX];
};

static void offer(const struct skd_slots_input *input, size_t vertex, uint16_t bone,
                  struct list *list)
{
    if (skd_row_has(list->bones, list->used, bone) ||
        input->bone_skin[bone] != input->vertex_skin[vertex])
        return;
    const double distance = head_distance(input, vertex, bone);
    int at = list->used;
    while (at > list->own && (distance < list->distances[at - 1] ||
                              (distance == list->distances[at - 1] && bone < list->bones[at - 1])))
        at--;
    if (at == list->most)
        return;
    list->used += list->used < list->most;
    for (int i = list->used - 1; i > at; i--) {
        list->bones[i] = list->bones[i - 1];
        list->distances[i] = list->distances[i - 1];
    }
    list->bones[at] = bone;
    list->distances[at] = distance;
}

/* Looks at the neighbours. True if the list of `found` is a nearer one than that of `joints`. */
static bool look(const struct skd_slots_input *input, const uint16_t *joints, size_t vertex,
                 uint16_t *found)
{
    const int n = input->slot_count;
    const uint16_t *row = joints + (size_t)n * vertex;
    struct list list = {.own = skd_own_count(input, vertex), .most = n};
    while (list.used < n && row[list.used] != SKD_SLOT_EMPTY) {
        list.bones[list.used] = row[list.used];
        list.distances[list.used] = head_distance(input, vertex, row[list.used]);
        list.used++;
    }
    for (uint32_t edge = input->neighbour_offsets[vertex];
         edge < input->neighbour_offsets[vertex + 1]; edge++) {
        const uint16_t *theirs = joints + (size_t)n * input->neighbours[edge];
        for (int i = 0; i < n && theirs[i] != SKD_SLOT_EMPTY; i++)
            offer(input, vertex, theirs[i], &list);
    }
    bool changed = false;
    for (int i = 0; i < n; i++) {
        found[i] = i < list.used ? list.bones[i] : SKD_SLOT_EMPTY;
        changed = changed || found[i] != row[i];
    }
    return changed;
}

void skd_spread_infect(const struct skd_slots_input *input, void *scratch, uint16_t *joints)
{
    const size_t n = (size_t)input->slot_count;
    struct infection lists;
    size_t looking = 0;
    lay_infection(input, scratch, &lists);
    find_readers(input, &lists);
    memset(lists.is_next, 0, input->vertex_count);
    for (size_t vertex = 0; vertex < input->vertex_count; vertex++) {
        if (skd_own_count(input, vertex) < input->slot_count)
            lists.looking[looking++] = (uint32_t)vertex;
    }
    while (looking > 0) {
        size_t changed = 0, next = 0;
        for (size_t i = 0; i < looking; i++) {
            const uint32_t vertex = lists.looking[i];
            if (look(input, joints, vertex, lists.found + n * vertex))
                lists.looking[changed++] = vertex;
        }
        for (size_t i = 0; i < changed; i++) {
            const uint32_t vertex = lists.looking[i];
            memcpy(joints + n * vertex, lists.found + n * vertex, n * sizeof *joints);
            for (uint32_t at = lists.reader_offsets[vertex]; at < lists.reader_offsets[vertex + 1];
                 at++) {
                const uint32_t reader = lists.readers[at];
                if (!lists.is_next[reader] && skd_own_count(input, reader) < input->slot_count) {
                    lists.is_next[reader] = 1;
                    lists.next[next++] = reader;
                }
            }
        }
        for (size_t i = 0; i < next; i++)
            lists.is_next[lists.next[i]] = 0;
        uint32_t *done = lists.looking;
        lists.looking = lists.next;
        lists.next = done;
        looking = next;
    }
}

/* ---- neighbours ---- */

/* Adds up the weights of a ring's bones; returns how many bones have a total. */
static int weigh_ring(const struct skd_slots_input *input, size_t vertex, const uint16_t *row,
                      int used, struct rings *rings, size_t first, size_t end)
{
    int touched = 0;
    for (size_t at = first; at < end; at++) {
        const uint32_t other = rings->queue[at];
        for (uint32_t k = input->influence_offsets[other]; k < input->influence_offsets[other + 1];
             k++) {
            const uint16_t bone = input->influence_joints[k];
            if (input->bone_skin[bone] != input->vertex_skin[vertex] ||
                skd_row_has(row, used, bone))
                continue;
            if (rings->totals[bone] == 0)
                rings->touched[touched++] = bone;
            /* Whole numbers add up to the same in any order. */
            rings->totals[bone] += 1 + (uint64_t)((double)input->influence_weights[k] * 0x1p32);
        }
    }
    return touched;
}

/* Takes the heaviest bones into the row, then forgets the totals. Returns the slots used. */
static int take_heaviest(struct rings *rings, int touched, uint16_t *row, int used, int n)
{
    int left = touched;
    while (used < n && left > 0) {
        int best = 0;
        for (int i = 1; i < left; i++) {
            const uint16_t bone = rings->touched[i], lead = rings->touched[best];
            if (rings->totals[bone] > rings->totals[lead] ||
                (rings->totals[bone] == rings->totals[lead] && bone < lead))
                best = i;
        }
        const uint16_t taken = rings->touched[best];
        row[used++] = taken;
        rings->totals[taken] = 0;
        rings->touched[best] = rings->touched[--left];
    }
    for (int i = 0; i < left; i++)
        rings->totals[rings->touched[i]] = 0;
    return used;
}

static void search_rings(const struct skd_slots_input *input, size_t vertex, struct rings *rings,
                         uint16_t *row)
{
    const uint32_t mark = (uint32_t)vertex + 1;
    int used = skd_own_count(input, vertex);
    size_t first = 0, end = 1;
    rings->visited[vertex] = mark;
    rings->queue[0] = (uint32_t)vertex;
    for (int ring = 1; ring <= RINGS_MOST && used < input->slot_count && first < end; ring++) {
        size_t outer = end;
        for (; first < end; first++) {
            const uint32_t from = rings->queue[first];
            for (uint32_t edge = input->neighbour_offsets[from];
                 edge < input->neighbour_offsets[from + 1]; edge++) {
                const uint32_t to = input->neighbours[edge];
                if (rings->visited[to] != mark) {
                    rings->visited[to] = mark;
                    rings->queue[outer++] = to;
                }
            }
        }
        end = outer;
        const int touched = weigh_ring(input, vertex, row, used, rings, first, end);
        used = take_heaviest(rings, touched, row, used, input->slot_count);
    }
}

void skd_spread_neighbours(const struct skd_slots_input *input, void *scratch, uint16_t *joints)
{
    struct rings rings;
    lay_rings(input, scratch, &rings);
    memset(rings.totals, 0, (size_t)input->bone_count * sizeof *rings.totals);
    memset(rings.visited, 0, input->vertex_count * sizeof *rings.visited);
    for (size_t vertex = 0; vertex < input->vertex_count; vertex++) {
        if (skd_own_count(input, vertex) < input->slot_count)
            search_rings(input, vertex, &rings, joints + (size_t)input->slot_count * vertex);
    }
}
