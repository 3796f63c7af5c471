/* See gltf_read.h: meshes.
 *
 * Two passes: the first lists the parts (skinned primitives) and adds up their sizes against the
 * limits, the second reads them into arrays of the right size.
 */
#include "rig/gltf_read.h"

#include "rig/elements.h"
#include "rig/gltf_sets.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct totals {
    size_t vertices;
    size_t triangles;
    size_t influences;
    size_t parts;
};

static bool is_skinned(const struct skd_gltf_primitive *primitive)
{
    return primitive->set_count > 0 && primitive->position >= 0;
}

/* Elements of an accessor that is not open yet; 0 for one that is not there. */
static size_t accessor_count(const struct skd_gltf_document *document, int32_t accessor)
{
    return accessor >= 0 && (size_t)accessor < document->accessor_count
               ? document->accessors[accessor].count
               : 0;
}

/* Triangles that `corners` corners make. */
static size_t triangle_count(int mode, size_t corners)
{
    if (mode == SKD_GLTF_TRIANGLES)
        return corners / 3;
    if (mode == SKD_GLTF_TRIANGLE_STRIP || mode == SKD_GLTF_TRIANGLE_FAN)
        return corners > 2 ? corners - 2 : 0;
    return 0; /* points and lines have vertices only */
}

static enum skd_status add_part(const struct skd_gltf_document *document, int32_t node,
                                int32_t primitive_index, struct skd_mesh *mesh,
                                struct totals *totals, struct skd_error *error)
{
    const int32_t mesh_index = document->nodes[node].mesh;
    const struct skd_gltf_primitive *primitive =
        &document->meshes[mesh_index].primitives[primitive_index];
    const size_t vertices = accessor_count(document, primitive->position);
    const size_t corners =
        primitive->indices >= 0 ? accessor_count(document, primitive->indices) : vertices;
    const size_t triangles = triangle_count(primitive->mode, corners);
    if (primitive->set_count > SKD_SETS_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "mesh %d has more than %d influences a vertex; limit them before export",
                        mesh_index, (int)SKD_INFLUENCES_MAX);
    if (vertices > SKD_VERTICES_MAX - totals->vertices)
        return skd_fail(error, SKD_TOO_LARGE, "the file has more than %zu skinned vertices",
                        SKD_VERTICES_MAX);
    if (triangles > SKD_TRIANGLES_MAX - totals->triangles)
        return skd_fail(error, SKD_TOO_LARGE, "the file has more than %zu skinned triangles",
                        SKD_TRIANGLES_MAX);
    struct skd_part *part = &mesh->parts[totals->parts];
    *part = (struct skd_part){.first_vertex = totals->vertices,
                              .vertex_count = vertices,
                              .skin = (uint16_t)document->nodes[node].skin,
                              .mesh = mesh_index,
                              .primitive = primitive_index,
                              .name = strdup(document->nodes[node].name)};
    if (part->name == NULL)
        return skd_fail_memory(error, "the meshes");
    mesh->part_count = ++totals->parts;
    totals->vertices += vertices;
    totals->triangles += triangles;
    totals->influences += vertices * (size_t)primitive->set_count * 4;
    return SKD_OK;
}

/* skin_of_mesh[m]: skin of the first skinned node that uses mesh m, or -1. */
static enum skd_status use_mesh(const struct skd_gltf_document *document, int32_t node,
                                int32_t *skin_of_mesh, struct skd_rig *rig, struct totals *totals,
                                struct skd_error *error)
{
    const struct skd_gltf_node *user = &document->nodes[node];
    if (user->mesh < 0 || user->skin < 0)
        return SKD_OK;
    if ((size_t)user->mesh >= document->mesh_count || (size_t)user->skin >= document->skin_count)
        return skd_fail(error, SKD_BAD_RIG, "node %d uses mesh %d and skin %d; one is not there",
                        node, user->mesh, user->skin);
    if (skin_of_mesh[user->mesh] >= 0) {
        rig->notes[SKD_NOTE_MESHES_SHARED] += skin_of_mesh[user->mesh] != user->skin;
        return SKD_OK;
    }
    skin_of_mesh[user->mesh] = user->skin;
    const struct skd_gltf_mesh *mesh = &document->meshes[user->mesh];
    if (mesh->primitive_count > 0)
        rig->notes[SKD_NOTE_MORPH_TARGETS] += mesh->primitives[0].target_count;
    for (size_t p = 0; p < mesh->primitive_count; p++) {
        if (!is_skinned(&mesh->primitives[p]))
            continue;
        const enum skd_status status =
            add_part(document, node, (int32_t)p, &rig->mesh, totals, error);
        if (status != SKD_OK)
            return status;
    }
    return SKD_OK;
}

static enum skd_status list_parts(const struct skd_gltf_document *document, struct skd_rig *rig,
                                  struct totals *totals, struct skd_error *error)
{
    size_t primitives = 0;
    for (size_t m = 0; m < document->mesh_count; m++)
        primitives += document->meshes[m].primitive_count;
    int32_t *skin_of_mesh = malloc((document->mesh_count + 1) * sizeof *skin_of_mesh);
    rig->mesh.parts = calloc(primitives + 1, sizeof *rig->mesh.parts);
    if (skin_of_mesh == NULL || rig->mesh.parts == NULL) {
        free(skin_of_mesh);
        return skd_fail_memory(error, "the meshes");
    }
    for (size_t m = 0; m < document->mesh_count; m++)
        skin_of_mesh[m] = -1;
    enum skd_status status = SKD_OK;
    for (size_t n = 0; status == SKD_OK && n < document->node_count; n++)
        status = use_mesh(document, (int32_t)n, skin_of_mesh, rig, totals, error);
    free(skin_of_mesh);
    rig->notes[SKD_NOTE_PARTS_UNSKINNED] = primitives - totals->parts;
    if (status == SKD_OK && totals->vertices == 0)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "no mesh of the file is skinned (JOINTS_0 and WEIGHTS_0 on a node with a "
                        "skin); bind one to the armature and export it again");
    return status;
}

static enum skd_status reserve_mesh(struct skd_mesh *mesh, const struct totals *totals,
                                    struct skd_error *error)
{
    mesh->vertex_count = totals->vertices;
    mesh->rest = malloc(totals->vertices * 3 * sizeof *mesh->rest);
    mesh->skins = malloc(totals->vertices * sizeof *mesh->skins);
    mesh->triangles = malloc((totals->triangles * 3 + 1) * sizeof *mesh->triangles);
    if (mesh->rest == NULL || mesh->skins == NULL || mesh->triangles == NULL)
        return skd_fail_memory(error, "the meshes");
    return SKD_OK;
}

static enum skd_status read_positions(const struct skd_gltf_container *container,
                                      const struct skd_part *part, struct skd_mesh *mesh,
                                      struct skd_error *error)
{
    const struct skd_gltf_primitive *primitive =
        &container->document->meshes[part->mesh].primitives[part->primitive];
    struct skd_elements positions;
    char what[64];
    (void)snprintf(what, sizeof what, "POSITION of mesh %d, primitive %d", part->mesh,
                   part->primitive);
    enum skd_status status =
        skd_elements_open(container, primitive->position, 3, what, &positions, error);
    if (status == SKD_OK)
        skd_elements_floats(&positions, 0, part->vertex_count, mesh->rest + part->first_vertex * 3);
    for (size_t v = 0; status == SKD_OK && v < part->vertex_count; v++) {
        const float *rest = mesh->rest + (part->first_vertex + v) * 3;
        mesh->skins[part->first_vertex + v] = part->skin;
        if (!isfinite(rest[0]) || !isfinite(rest[1]) || !isfinite(rest[2]))
            status = skd_fail(error, SKD_BAD_RIG, "%s: vertex %zu is not finite", what, v);
    }
    skd_elements_close(&positions);
    return status;
}

/* Corner k of triangle t in the run of corners. */
static size_t corner_of(int mode, size_t t, size_t k)
{
    if (mode == SKD_GLTF_TRIANGLES)
        return t * 3 + k;
    if (mode == SKD_GLTF_TRIANGLE_FAN)
        return k == 0 ? 0 : t + k;
    /* Each second triangle of a strip is turned so that all face the same way. */
    return t + (t % 2 != 0 && k != 0 ? 3 - k : k);
}

/* The vertex at each corner of the triangles, within the part. Without indices, bytes is NULL. */
static void read_corners(int mode, const struct skd_elements *indices, size_t count, uint32_t *out)
{
    if (indices->bytes != NULL && mode == SKD_GLTF_TRIANGLES) {
        skd_elements_integers(indices, 0, count, out);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        const size_t corner = corner_of(mode, i / 3, i % 3);
        out[i] = (uint32_t)corner;
        if (indices->bytes != NULL)
            skd_elements_integers(indices, corner, 1, &out[i]);
    }
}

static enum skd_status read_triangles(const struct skd_gltf_container *container,
                                      const struct skd_part *part, struct skd_mesh *mesh,
                                      struct skd_error *error)
{
    const struct skd_gltf_primitive *primitive =
        &container->document->meshes[part->mesh].primitives[part->primitive];
    struct skd_elements indices = {.count = part->vertex_count};
    char what[64];
    (void)snprintf(what, sizeof what, "indices of mesh %d, primitive %d", part->mesh,
                   part->primitive);
    enum skd_status status = SKD_OK;
    if (primitive->indices >= 0)
        status = skd_elements_open(container, primitive->indices, 1, what, &indices, error);
    if (status == SKD_OK && indices.bytes != NULL && indices.component != SKD_GLTF_UNSIGNED_BYTE &&
        indices.component != SKD_GLTF_UNSIGNED_SHORT && indices.component != SKD_GLTF_UNSIGNED_INT)
        status = skd_fail(error, SKD_BAD_RIG, "%s are not unsigned integers", what);
    const size_t triangles = triangle_count(primitive->mode, indices.count);
    uint32_t *out = mesh->triangles + mesh->triangle_count * 3;
    if (status == SKD_OK)
        read_corners(primitive->mode, &indices, triangles * 3, out);
    for (size_t i = 0; status == SKD_OK && i < triangles * 3; i++) {
        if (out[i] >= part->vertex_count)
            status = skd_fail(error, SKD_BAD_RIG, "%s name vertex %u of %zu", what, out[i],
                              part->vertex_count);
        out[i] += (uint32_t)part->first_vertex;
    }
    mesh->triangle_count += triangles;
    skd_elements_close(&indices);
    return status;
}

static enum skd_status read_influences(const struct skd_gltf_container *container,
                                       const struct skd_gltf_source *source,
                                       const struct skd_part *part, struct skd_rig *rig,
                                       struct skd_influences *influences, struct skd_error *error)
{
    struct skd_gltf_sets sets;
    enum skd_status status = skd_gltf_sets_open(container, source, rig, part, &sets, error);
    for (size_t v = 0; status == SKD_OK && v < part->vertex_count; v++) {
        struct skd_influence row[SKD_INFLUENCES_MAX];
        const int count = skd_gltf_sets_row(&sets, v, row, rig->notes);
        if (count < 0)
            status = skd_fail(error, SKD_BAD_RIG,
                              "vertex %zu of mesh %d, primitive %d uses a joint that its skin does "
                              "not have (there are %zu)",
                              v, part->mesh, part->primitive, sets.joint_count);
        else
            skd_influences_append(influences, part->first_vertex + v, row, count);
    }
    skd_gltf_sets_close(&sets);
    return status;
}

enum skd_status skd_gltf_read_meshes(const struct skd_gltf_container *container,
                                     const struct skd_gltf_source *source, struct skd_rig *rig,
                                     struct skd_influences *influences, struct skd_error *error)
{
    struct totals totals = {0};
    struct skd_mesh *mesh = &rig->mesh;
    enum skd_status status = list_parts(container->document, rig, &totals, error);
    if (status == SKD_OK)
        status = reserve_mesh(mesh, &totals, error);
    if (status == SKD_OK)
        status = skd_influences_reserve(influences, totals.vertices, totals.influences, error);
    for (size_t p = 0; status == SKD_OK && p < mesh->part_count; p++) {
        const struct skd_part *part = &mesh->parts[p];
        status = read_positions(container, part, mesh, error);
        if (status == SKD_OK)
            status = read_triangles(container, part, mesh, error);
        if (status == SKD_OK)
            status = read_influences(container, source, part, rig, influences, error);
    }
    if (status == SKD_OK)
        skd_influences_trim(influences, totals.vertices);
    return status;
}
