/* See topology.h.
 *
 * Twins: one pass over the vertices with an open table of 8-byte entries {tag, last of its ring}.
 * A vertex that the table knows joins the ring behind its last one, so rings rise.
 *
 * Neighbours: each triangle gives each of its corners a pair (next, previous). A vertex's pairs are
 * gathered by counting, then made a sorted set. On a clean mesh each neighbour stands once as next
 * and once as previous, so the set is nearly always the `next`s alone.
 */
#include "rig/topology.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

enum {
    BLOCK = 32,     /* vertices hashed ahead of their look-up, so that memory has time to come */
    SMALL_SET = 16, /* corners up to which insertion beats qsort */
};

/* More neighbours in all than any mesh of real surfaces has. */
#define NEIGHBOURS_MAX ((size_t)UINT32_MAX / 8)

size_t skd_topology_drop_degenerate(struct skd_mesh *mesh)
{
    size_t kept = 0;
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *from = mesh->triangles + t * 3;
        if (from[0] == from[1] || from[1] == from[2] || from[2] == from[0])
            continue;
        if (kept != t)
            memcpy(mesh->triangles + kept * 3, from, 3 * sizeof *from);
        kept++;
    }
    const size_t dropped = mesh->triangle_count - kept;
    mesh->triangle_count = kept;
    return dropped;
}

enum { KEY_HEAD = 3 * sizeof(float) + 2 * sizeof(uint16_t), KEY_PAIR = 2 * sizeof(uint32_t) };

/* The key is put together number by number, as rows are too short for memcpy to pay. */
static uint64_t hash_vertex(const struct skd_mesh *mesh, const struct skd_influences *influences,
                            size_t v)
{
    unsigned char key[KEY_HEAD + SKD_INFLUENCES_MAX * KEY_PAIR];
    const size_t first = influences->offsets[v], count = influences->offsets[v + 1] - first;
    const uint32_t skin = mesh->skins[v];
    memcpy(key, mesh->rest + v * 3, 3 * sizeof(float));
    memcpy(key + 3 * sizeof(float), &skin, sizeof skin);
    for (size_t i = 0; i < count; i++) {
        const uint32_t joint = influences->joints[first + i];
        memcpy(key + KEY_HEAD + i * KEY_PAIR, &joint, sizeof joint);
        memcpy(key + KEY_HEAD + i * KEY_PAIR + sizeof joint, &influences->weights[first + i],
               sizeof(float));
    }
    return XXH3_64bits(key, KEY_HEAD + count * KEY_PAIR);
}

static bool is_twin(const struct skd_mesh *mesh, const struct skd_influences *influences, size_t a,
                    size_t b)
{
    const size_t first_a = influences->offsets[a], first_b = influences->offsets[b];
    const size_t count = influences->offsets[a + 1] - first_a;
    return memcmp(mesh->rest + a * 3, mesh->rest + b * 3, 3 * sizeof(float)) == 0 &&
           mesh->skins[a] == mesh->skins[b] && influences->offsets[b + 1] - first_b == count &&
           memcmp(influences->joints + first_a, influences->joints + first_b,
                  count * sizeof(uint16_t)) == 0 &&
           memcmp(influences->weights + first_a, influences->weights + first_b,
                  count * sizeof(float)) == 0;
}

enum skd_status skd_topology_find_twins(struct skd_mesh *mesh,
                                        const struct skd_influences *influences,
                                        struct skd_scratch *scratch, struct skd_error *error)
{
    const size_t count = mesh->vertex_count;
    size_t capacity = 64;
    while (capacity < count + count / 2)
        capacity *= 2;
    const size_t mask = capacity - 1;
    uint64_t *table = skd_scratch_take(scratch, capacity * sizeof *table);
    uint32_t *twins = malloc(count * sizeof *twins);
    size_t found = 0;
    if (table == NULL || twins == NULL) {
        free(twins);
        return skd_fail_memory(error, "the search for seams");
    }
    memset(table, 0, capacity * sizeof *table);
    for (size_t start = 0; start < count; start += BLOCK) {
        const size_t stop = start + BLOCK < count ? start + BLOCK : count;
        uint64_t hashes[BLOCK];
        for (size_t v = start; v < stop; v++) {
            hashes[v - start] = hash_vertex(mesh, influences, v);
            __builtin_prefetch(&table[hashes[v - start] & mask], 1);
        }
        for (size_t v = start; v < stop; v++) {
            const uint64_t hash = hashes[v - start], tag = hash & ~(uint64_t)UINT32_MAX;
            size_t at = hash & mask;
            twins[v] = (uint32_t)v;
            for (; table[at] != 0; at = (at + 1) & mask) {
                const uint32_t last = (uint32_t)table[at] - 1;
                if ((table[at] & ~(uint64_t)UINT32_MAX) != tag ||
                    !is_twin(mesh, influences, last, v))
                    continue;
                twins[v] = twins[last];
                twins[last] = (uint32_t)v;
                found++;
                break;
            }
            table[at] = tag | (uint32_t)(v + 1);
        }
    }
    if (found == 0) {
        free(twins);
        twins = NULL;
    }
    mesh->twins = twins;
    return SKD_OK;
}

/* firsts[v] = the first vertex of v's ring. */
static void find_ring_firsts(const struct skd_mesh *mesh, uint32_t *firsts)
{
    for (size_t v = 0; v < mesh->vertex_count; v++)
        firsts[v] = UINT32_MAX;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        if (firsts[v] != UINT32_MAX)
            continue;
        uint32_t at = (uint32_t)v;
        do {
            firsts[at] = (uint32_t)v;
            at = mesh->twins[at];
        } while (at != v);
    }
}

static uint32_t first_of(const uint32_t *firsts, uint32_t v)
{
    return firsts != NULL ? firsts[v] : v;
}

struct corner {
    uint32_t next;
    uint32_t previous;
};

/* Gathers the corners of each first vertex: those of v are [offsets[v], offsets[v+1]). */
static void gather_corners(const struct skd_mesh *mesh, const uint32_t *firsts, uint32_t *offsets,
                           struct corner *corners)
{
    const size_t index_count = mesh->triangle_count * 3;
    memset(offsets, 0, (mesh->vertex_count + 2) * sizeof *offsets);
    for (size_t i = 0; i < index_count; i++)
        offsets[first_of(firsts, mesh->triangles[i]) + 2]++;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        offsets[v + 2] += offsets[v + 1];
    /* offsets[v + 1] walks from the start of v's corners to their end. */
    for (size_t i = 0; i < index_count; i += 3) {
        const uint32_t a = first_of(firsts, mesh->triangles[i]);
        const uint32_t b = first_of(firsts, mesh->triangles[i + 1]);
        const uint32_t c = first_of(firsts, mesh->triangles[i + 2]);
        corners[offsets[a + 1]++] = (struct corner){b, c};
        corners[offsets[b + 1]++] = (struct corner){c, a};
        corners[offsets[c + 1]++] = (struct corner){a, b};
    }
}

static int compare_indexes(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

/* Drops equal ones and `self` from a sorted list. */
static size_t make_unique(uint32_t *list, size_t count, uint32_t self)
{
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (list[i] != self && (kept == 0 || list[kept - 1] != list[i]))
            list[kept++] = list[i];
    return kept;
}

/* Puts a value into a sorted set where it is missing. */
static size_t insert(uint32_t *set, size_t count, uint32_t value)
{
    size_t at = count;
    for (; at > 0 && set[at - 1] > value; at--)
        set[at] = set[at - 1];
    if (at == 0 || set[at - 1] != value) {
        set[at] = value;
        return count + 1;
    }
    for (; at < count; at++) /* it was there: close the gap */
        set[at] = set[at + 1];
    return count;
}

static size_t find_small_set(const struct corner *corners, size_t count, uint32_t self,
                             uint32_t *set)
{
    size_t listed = 0;
    for (size_t i = 0; i < count; i++)
        if (corners[i].next != self)
            listed = insert(set, listed, corners[i].next);
    for (size_t i = 0; i < count; i++) {
        uint32_t is_listed = corners[i].previous == self;
        for (size_t k = 0; k < listed; k++) /* nearly always there: looked up without a branch */
            is_listed |= set[k] == corners[i].previous;
        if (!is_listed)
            listed = insert(set, listed, corners[i].previous);
    }
    return listed;
}

/* The sorted set of a vertex's neighbours. `out` has room for two a corner and may be the corners'
 * own memory or lie before it: a corner is read before anything is written there. */
static size_t find_set(const struct corner *corners, size_t count, uint32_t self, uint32_t *out)
{
    if (count <= SMALL_SET) {
        uint32_t set[SMALL_SET * 2];
        const size_t listed = find_small_set(corners, count, self, set);
        for (size_t i = 0; i < listed; i++)
            out[i] = set[i];
        return listed;
    }
    size_t listed = 0;
    for (size_t i = 0; i < count; i++) {
        const struct corner corner = corners[i];
        out[listed++] = corner.next;
        out[listed++] = corner.previous;
    }
    qsort(out, listed, sizeof *out, compare_indexes);
    return make_unique(out, listed, self);
}

/* Gives each vertex of a ring the list of the ring's first. */
static enum skd_status spread_over_rings(struct skd_mesh *mesh, const uint32_t *firsts,
                                         struct skd_error *error)
{
    const size_t count = mesh->vertex_count;
    const uint32_t *lists = mesh->neighbour_offsets;
    size_t total = 0;
    for (size_t v = 0; v < count; v++)
        total += lists[firsts[v] + 1] - lists[firsts[v]];
    if (total > NEIGHBOURS_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "the vertices of the mesh have %zu neighbours in all, more than %zu: too "
                        "many of them share one place; merge vertices by distance",
                        total, NEIGHBOURS_MAX);
    uint32_t *offsets = malloc((count + 1) * sizeof *offsets);
    uint32_t *neighbours = malloc((total + 1) * sizeof *neighbours);
    if (offsets == NULL || neighbours == NULL) {
        free(offsets);
        free(neighbours);
        return skd_fail_memory(error, "the mesh neighbours");
    }
    offsets[0] = 0;
    for (size_t v = 0; v < count; v++) {
        const uint32_t from = lists[firsts[v]], length = lists[firsts[v] + 1] - from;
        memcpy(neighbours + offsets[v], mesh->neighbours + from, length * sizeof *neighbours);
        offsets[v + 1] = offsets[v] + length;
    }
    free(mesh->neighbour_offsets);
    free(mesh->neighbours);
    mesh->neighbour_offsets = offsets;
    mesh->neighbours = neighbours;
    return SKD_OK;
}

/* Makes the lists of all first vertices over their own corners, where they always fit, and copies
 * them out. */
static enum skd_status list_neighbours(struct skd_mesh *mesh, const uint32_t *offsets,
                                       struct corner *corners, struct skd_error *error)
{
    const size_t count = mesh->vertex_count;
    uint32_t *lists = (uint32_t *)(void *)corners;
    size_t total = 0;
    mesh->neighbour_offsets = malloc((count + 1) * sizeof *mesh->neighbour_offsets);
    if (mesh->neighbour_offsets == NULL)
        return skd_fail_memory(error, "the mesh neighbours");
    for (size_t v = 0; v < count; v++) {
        mesh->neighbour_offsets[v] = (uint32_t)total;
        total +=
            find_set(corners + offsets[v], offsets[v + 1] - offsets[v], (uint32_t)v, lists + total);
    }
    mesh->neighbour_offsets[count] = (uint32_t)total;
    mesh->neighbours = malloc((total + 1) * sizeof *mesh->neighbours);
    if (mesh->neighbours == NULL)
        return skd_fail_memory(error, "the mesh neighbours");
    memcpy(mesh->neighbours, lists, total * sizeof *lists);
    return SKD_OK;
}

enum skd_status skd_topology_find_neighbours(struct skd_mesh *mesh, struct skd_scratch *scratch,
                                             struct skd_error *error)
{
    /* In scratch: corners, their offsets, and the first of each vertex's ring when there are any.
     */
    const size_t corner_count = mesh->triangle_count * 3, offset_count = mesh->vertex_count + 2;
    const size_t first_count = mesh->twins != NULL ? mesh->vertex_count : 0;
    struct corner *corners = skd_scratch_take(
        scratch, corner_count * sizeof *corners + (offset_count + first_count) * sizeof(uint32_t));
    if (corners == NULL)
        return skd_fail_memory(error, "the mesh neighbours");
    uint32_t *offsets = (uint32_t *)(void *)(corners + corner_count);
    uint32_t *firsts = first_count > 0 ? offsets + offset_count : NULL;
    if (firsts != NULL)
        find_ring_firsts(mesh, firsts);
    gather_corners(mesh, firsts, offsets, corners);
    const enum skd_status status = list_neighbours(mesh, offsets, corners, error);
    return status == SKD_OK && firsts != NULL ? spread_over_rings(mesh, firsts, error) : status;
}
