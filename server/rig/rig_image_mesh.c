/* See rig_image_reader.h: parts, mesh and influences. The loops over all vertices and corners only
 * gather whether something is wrong, so that they run as fast as memory does. */
#include "rig/rig_image_reader.h"

#include "rig/influences.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Parts follow each other over all vertices; a vertex has its part's skin. */
static enum skd_status fill_parts(const struct skd_image_reader *reader,
                                  const struct skd_image_part *images, const struct skd_rig *rig,
                                  struct skd_mesh *mesh)
{
    const bool has_source = (reader->head->flags & SKD_IMAGE_HAS_SOURCE) != 0;
    size_t vertices = 0;
    for (size_t p = 0; p < mesh->part_count; p++) {
        const struct skd_image_part *image = &images[p];
        struct skd_part *part = &mesh->parts[p];
        if (image->vertex_count > mesh->vertex_count - vertices)
            return skd_image_wrong(reader, "its parts have more vertices than there are");
        if (image->skin >= (uint32_t)rig->skin_count || (image->mesh >= 0) != has_source ||
            (image->primitive >= 0) != has_source)
            return skd_image_wrong(reader, "a part has a skin or a mesh that is not there");
        part->first_vertex = vertices;
        part->vertex_count = image->vertex_count;
        part->skin = (uint16_t)image->skin;
        part->mesh = has_source ? image->mesh : -1;
        part->primitive = has_source ? image->primitive : -1;
        for (size_t v = 0; v < part->vertex_count; v++)
            mesh->skins[vertices + v] = part->skin;
        vertices += part->vertex_count;
    }
    return vertices == mesh->vertex_count ? SKD_OK
                                          : skd_image_wrong(reader, "a vertex is of no part");
}

static enum skd_status read_parts(struct skd_image_reader *reader, const struct skd_rig *rig,
                                  struct skd_mesh *mesh)
{
    /* Every part has bytes of its own in the image: a count that lies asks for no memory. */
    const size_t count = reader->head->part_count;
    if (count > reader->left / sizeof(struct skd_image_part))
        return skd_image_wrong(reader, "it is too short");
    mesh->parts = calloc(count + 1, sizeof *mesh->parts);
    mesh->skins = malloc(mesh->vertex_count * sizeof *mesh->skins);
    if (mesh->parts == NULL || mesh->skins == NULL)
        return skd_fail_memory(reader->error, "the meshes");
    mesh->part_count = count;
    const enum skd_status status =
        skd_image_strings(reader, count, 0, &mesh->parts->name, sizeof *mesh->parts);
    if (status != SKD_OK)
        return status;
    const struct skd_image_part *images = skd_image_take(reader, count, sizeof *images);
    return images != NULL ? fill_parts(reader, images, rig, mesh) : SKD_BAD_RIG;
}

static bool are_finite(const float *numbers, size_t count)
{
    uint32_t is_wrong = 0;
    for (size_t i = 0; i < count; i++)
        is_wrong |= (uint32_t) !(fabsf(numbers[i]) <= FLT_MAX);
    return !is_wrong;
}

/* Corners are vertices, and none stands twice in a triangle. */
static bool are_triangles_good(const uint32_t *triangles, size_t count, uint32_t vertices)
{
    for (size_t t = 0; t < count; t++, triangles += 3) {
        const uint32_t a = triangles[0], b = triangles[1], c = triangles[2];
        if (a >= vertices || b >= vertices || c >= vertices || a == b || b == c || c == a)
            return false;
    }
    return true;
}

/* Each ring rises until it closes: a vertex names a later one that nobody else names, or the first
 * of its own ring. firsts[] is scratch. At least one vertex has a twin, or there would be no rings.
 */
static bool are_rings_good(const struct skd_mesh *mesh, uint32_t *firsts)
{
    const uint32_t *twins = mesh->twins;
    bool is_split = false;
    memset(firsts, 0xFF, mesh->vertex_count * sizeof *firsts);
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        const uint32_t next = twins[v];
        const uint32_t first = firsts[v] == UINT32_MAX ? v : firsts[v];
        if (next <= v) {
            if (next != first)
                return false;
            continue;
        }
        if (next >= mesh->vertex_count || firsts[next] != UINT32_MAX ||
            mesh->skins[v] != mesh->skins[next] ||
            memcmp(mesh->rest + (size_t)v * 3, mesh->rest + (size_t)next * 3,
                   3 * sizeof *mesh->rest) != 0)
            return false;
        firsts[next] = first;
        is_split = true;
    }
    return is_split;
}

static enum skd_status check_twins(const struct skd_image_reader *reader,
                                   const struct skd_mesh *mesh)
{
    uint32_t *firsts = malloc(mesh->vertex_count * sizeof *firsts);
    if (firsts == NULL)
        return skd_fail_memory(reader->error, "the seams");
    const bool is_good = are_rings_good(mesh, firsts);
    free(firsts);
    return is_good ? SKD_OK : skd_image_wrong(reader, "its seams do not close");
}

enum skd_status skd_image_read_mesh(struct skd_image_reader *reader, struct skd_rig *rig)
{
    struct skd_mesh *mesh = &rig->mesh;
    const size_t vertices = reader->head->vertex_count, triangles = reader->head->triangle_count;
    const bool has_twins = (reader->head->flags & SKD_IMAGE_HAS_TWINS) != 0;
    if (vertices > reader->left / (3 * sizeof *mesh->rest))
        return skd_image_wrong(reader, "it is too short");
    mesh->vertex_count = vertices;
    const enum skd_status status = read_parts(reader, rig, mesh);
    if (status != SKD_OK)
        return status;
    if ((mesh->rest = skd_image_copy(reader, vertices, 3 * sizeof *mesh->rest)) == NULL ||
        (mesh->triangles = skd_image_copy(reader, triangles, 3 * sizeof *mesh->triangles)) ==
            NULL ||
        (has_twins &&
         (mesh->twins = skd_image_copy(reader, vertices, sizeof *mesh->twins)) == NULL))
        return reader->error->status;
    mesh->triangle_count = triangles;
    if (!are_finite(mesh->rest, vertices * 3))
        return skd_image_wrong(reader, "a rest position is not finite");
    if (!are_triangles_good(mesh->triangles, triangles, (uint32_t)vertices))
        return skd_image_wrong(reader, "a triangle has a corner that cannot be");
    return has_twins ? check_twins(reader, mesh) : SKD_OK;
}

/* Rows follow each other and none is empty or too long; *most gets the longest. */
static bool are_offsets_good(const uint32_t *offsets, size_t vertices, size_t influences, int *most)
{
    uint32_t longest = 0, is_wrong = offsets[0] != 0 || offsets[vertices] != influences;
    for (size_t v = 0; v < vertices; v++) {
        const uint32_t count = offsets[v + 1] - offsets[v]; /* huge where they fall */
        is_wrong |= count - 1 >= SKD_INFLUENCES_MAX;
        longest = count > longest ? count : longest;
    }
    *most = (int)longest;
    return !is_wrong;
}

/* A row as skd_influences_mend leaves it, of bones of the vertex's skin. */
static bool is_row_good(const uint16_t *joints, const float *weights, uint32_t count,
                        const struct skd_skeleton *skeleton, uint16_t skin)
{
    double sum = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (joints[i] >= skeleton->bone_count || skeleton->skins[joints[i]] != skin ||
            !(weights[i] > 0))
            return false;
        if (i > 0 && !(weights[i - 1] > weights[i] ||
                       (weights[i - 1] == weights[i] && joints[i - 1] < joints[i])))
            return false;
        for (uint32_t k = 0; k < i; k++)
            if (joints[k] == joints[i])
                return false;
        sum += (double)weights[i];
    }
    return fabs(sum - 1) <= SKD_ROW_SUM_EXACT;
}

static bool are_rows_good(const struct skd_rig *rig, const struct skd_influences *influences)
{
    const uint32_t *offsets = influences->offsets;
    for (size_t v = 0; v < rig->mesh.vertex_count; v++)
        if (!is_row_good(influences->joints + offsets[v], influences->weights + offsets[v],
                         offsets[v + 1] - offsets[v], &rig->skeleton, rig->mesh.skins[v]))
            return false;
    return true;
}

/* Twins have one row: each ring's is compared along the ring. */
static bool are_twins_rows_equal(const struct skd_mesh *mesh,
                                 const struct skd_influences *influences)
{
    const uint32_t *offsets = influences->offsets;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        const size_t twin = mesh->twins[v], count = offsets[v + 1] - offsets[v];
        if (twin <= v)
            continue;
        if (offsets[twin + 1] - offsets[twin] != count ||
            memcmp(influences->joints + offsets[v], influences->joints + offsets[twin],
                   count * sizeof *influences->joints) != 0 ||
            memcmp(influences->weights + offsets[v], influences->weights + offsets[twin],
                   count * sizeof *influences->weights) != 0)
            return false;
    }
    return true;
}

enum skd_status skd_image_read_influences(struct skd_image_reader *reader,
                                          const struct skd_rig *rig,
                                          struct skd_influences *influences)
{
    const size_t vertices = rig->mesh.vertex_count, count = reader->head->influence_count;
    /* Where they are in the image: they are looked through once and given up again. Nothing writes
     * to borrowed influences, so the const that is cast away here stays true. */
    influences->is_borrowed = true;
    influences->offsets =
        (uint32_t *)skd_image_take(reader, vertices + 1, sizeof *influences->offsets);
    if (influences->offsets == NULL)
        return SKD_BAD_RIG;
    if (!are_offsets_good(influences->offsets, vertices, count, &influences->most))
        return skd_image_wrong(reader, "its rows of weights do not follow each other");
    influences->joints = (uint16_t *)skd_image_take(reader, count, sizeof *influences->joints);
    if (influences->joints == NULL)
        return SKD_BAD_RIG;
    influences->weights = (float *)skd_image_take(reader, count, sizeof *influences->weights);
    if (influences->weights == NULL)
        return SKD_BAD_RIG;
    if (!are_rows_good(rig, influences))
        return skd_image_wrong(reader, "a row of weights is none");
    if (rig->mesh.twins != NULL && !are_twins_rows_equal(&rig->mesh, influences))
        return skd_image_wrong(reader, "vertices of one place differ in their weights");
    return SKD_OK;
}
