/* See seams.h. Each ring is walked once, however many of its vertices were named: a hostile file
 * may hold one ring of all its vertices. */
#include "session/seams.h"

#include "session/bits.h"

#include <stdlib.h>
#include <string.h>

/* A named vertex that has twins, and where it stands in the stroke. */
struct named {
    uint32_t vertex;
    uint32_t index;
};

static int compare_named(const void *left, const void *right)
{
    const struct named *a = left, *b = right;
    return a->vertex < b->vertex ? -1 : a->vertex > b->vertex;
}

static size_t ring_size(const uint32_t *twins, uint32_t first, uint8_t *walked)
{
    size_t size = 0;
    for (uint32_t vertex = first; !skd_bits_take(walked, vertex); vertex = twins[vertex])
        size++;
    return size;
}

/* Writes the ring of `first`, every vertex with the mean of the positions named for the ring. */
static size_t emit_ring(const uint32_t *twins, uint32_t first, const struct named *named,
                        size_t named_count, const float *positions, uint32_t *vertices_out,
                        float *positions_out)
{
    double sum[3] = {0, 0, 0};
    size_t emitted = 0, found_count = 0;
    uint32_t vertex = first;
    do {
        const struct named key = {vertex, 0};
        const struct named *found = bsearch(&key, named, named_count, sizeof *named, compare_named);
        for (size_t axis = 0; found != NULL && axis < 3; axis++)
            sum[axis] += (double)positions[3 * (size_t)found->index + axis];
        found_count += found != NULL;
        vertices_out[emitted++] = vertex;
        vertex = twins[vertex];
    } while (vertex != first);
    for (size_t i = 0; i < 3 * emitted; i++)
        positions_out[i] = (float)(sum[i % 3] / (double)found_count);
    return emitted;
}

/* Fills `seams` (whose arrays are there): loose vertices in their order, then the rings. */
static size_t emit_all(const uint32_t *twins, const uint32_t *vertices, const float *positions,
                       size_t count, const struct named *named, size_t named_count, uint8_t *walked,
                       struct skd_seams *seams)
{
    size_t out = 0;
    for (size_t i = 0; i < count; i++) {
        if (twins[vertices[i]] != vertices[i])
            continue;
        seams->vertices[out] = vertices[i];
        memcpy(seams->positions + 3 * out++, positions + 3 * i, 3 * sizeof(float));
    }
    for (size_t i = 0; i < named_count; i++) {
        if (ring_size(twins, named[i].vertex, walked) > 0)
            out += emit_ring(twins, named[i].vertex, named, named_count, positions,
                             seams->vertices + out, seams->positions + 3 * out);
    }
    return out;
}

enum skd_status skd_seams_join(const struct skd_mesh *mesh, const uint32_t *vertices,
                               const float *positions, size_t count, struct skd_seams *seams,
                               struct skd_error *error)
{
    *seams = (struct skd_seams){.count = count};
    const uint32_t *twins = mesh->twins;
    if (twins == NULL || count == 0)
        return SKD_OK;
    size_t bitmap_bytes = skd_bits_bytes(mesh->vertex_count);
    size_t named_count = 0, joined_count = 0;
    uint8_t *walked = calloc(bitmap_bytes, 1);
    struct named *named = malloc(count * sizeof *named);
    if (walked == NULL || named == NULL)
        goto fail;
    for (size_t i = 0; i < count; i++) {
        bool alone = twins[vertices[i]] == vertices[i];
        joined_count += alone ? 1 : ring_size(twins, vertices[i], walked);
        if (!alone)
            named[named_count++] = (struct named){vertices[i], (uint32_t)i};
    }
    if (named_count > 0) {
        seams->vertices = malloc(joined_count * sizeof(uint32_t));
        seams->positions = malloc(joined_count * 3 * sizeof(float));
        if (seams->vertices == NULL || seams->positions == NULL)
            goto fail;
        qsort(named, named_count, sizeof *named, compare_named);
        memset(walked, 0, bitmap_bytes);
        seams->count =
            emit_all(twins, vertices, positions, count, named, named_count, walked, seams);
        SKD_ASSERT(seams->count == joined_count);
    }
    free(named);
    free(walked);
    return SKD_OK;
fail:
    free(seams->vertices);
    free(seams->positions);
    free(named);
    free(walked);
    *seams = (struct skd_seams){0};
    return skd_fail_memory(error, "the vertices at seams");
}
