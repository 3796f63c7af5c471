/* See gltf_rest.h. */
#include "rig/gltf_rest.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What is at hand while rest positions are written. */
struct moving {
    const struct skd_rig *rig;
    const struct skd_gltf_container *container;
    const struct skd_gltf_claims *claims;
    const float *rest;
    struct skd_gltf_patch *patch;
    struct skd_json *meshes;
    struct skd_json *accessors;
    size_t *leaders; /* [parts] first part with the same POSITION and the same new ones */
    struct skd_gltf_target *targets; /* [parts] of leaders that moved */
};

static const float *old_rest(const struct moving *moving, size_t vertex)
{
    return moving->rig->mesh.rest + 3 * vertex;
}

static bool has_moved(const struct moving *moving, size_t vertex)
{
    const float *was = old_rest(moving, vertex), *is = moving->rest + 3 * vertex;
    return was[0] != is[0] || was[1] != is[1] || was[2] != is[2];
}

static bool has_part_moved(const struct moving *moving, const struct skd_part *part)
{
    size_t v = 0;
    while (v < part->vertex_count && !has_moved(moving, part->first_vertex + v))
        v++;
    return v < part->vertex_count;
}

static enum skd_status check_rest(const float *rest, size_t vertex_count, struct skd_error *error)
{
    for (size_t i = 0; i < 3 * vertex_count; i++)
        if (!isfinite(rest[i]))
            return skd_fail(error, SKD_NOT_FINITE, "the rest position of vertex %zu is not finite",
                            i / 3);
    return SKD_OK;
}

static int32_t position_of(const struct moving *moving, size_t part)
{
    const struct skd_part *from = &moving->rig->mesh.parts[part];
    return moving->container->document->meshes[from->mesh].primitives[from->primitive].position;
}

static void find_leader(const struct moving *moving, size_t part)
{
    const struct skd_part *parts = moving->rig->mesh.parts;
    const size_t bytes = parts[part].vertex_count * 3 * sizeof(float);
    moving->leaders[part] = part;
    for (size_t q = 0; q < part; q++)
        if (moving->leaders[q] == q && position_of(moving, q) == position_of(moving, part) &&
            memcmp(moving->rest + 3 * parts[q].first_vertex,
                   moving->rest + 3 * parts[part].first_vertex, bytes) == 0) {
            moving->leaders[part] = q;
            return;
        }
}

/* All positions of the part, in an accessor of their own. */
static enum skd_status write_new(const struct moving *moving, const struct skd_part *part,
                                 struct skd_gltf_target *target, struct skd_error *error)
{
    const float *positions = moving->rest + 3 * part->first_vertex;
    float bounds[6];
    skd_gltf_find_bounds(positions, part->vertex_count, bounds);
    const struct skd_gltf_addition addition = {.component = SKD_GLTF_FLOAT,
                                               .width = 3,
                                               .is_vertex_data = true,
                                               .count = part->vertex_count,
                                               .bounds = bounds};
    const enum skd_status status = skd_gltf_add_elements(&moving->patch->additions, &addition,
                                                         &target->accessor, &target->offset, error);
    if (status == SKD_OK)
        memcpy(moving->patch->additions.tail + target->offset, positions,
               part->vertex_count * 3 * sizeof *positions);
    return status;
}

static void write_over(const struct moving *moving, const struct skd_part *part,
                       const struct skd_gltf_target *target)
{
    for (size_t v = 0; v < part->vertex_count; v++)
        if (has_moved(moving, part->first_vertex + v))
            memcpy(target->bytes + v * target->stride, moving->rest + 3 * (part->first_vertex + v),
                   3 * sizeof *moving->rest);
    skd_gltf_patch_touch(moving->patch, moving->container->document, target);
    skd_gltf_patch_bounds(moving->patch, moving->accessors[target->accessor], target, 3,
                          part->vertex_count);
}

static enum skd_status write_part(const struct moving *moving, size_t p, struct skd_error *error)
{
    const struct skd_part *part = &moving->rig->mesh.parts[p];
    struct skd_gltf_target *target = &moving->targets[moving->leaders[p]];
    if (moving->leaders[p] == p) {
        const int32_t position = position_of(moving, p);
        *target = skd_gltf_choose_target(moving->container, position, 3, SKD_GLTF_FLOAT,
                                         skd_gltf_is_own(moving->claims, moving->rig,
                                                         moving->container->document,
                                                         moving->leaders, p, position));
        if (target->is_new) {
            const enum skd_status status = write_new(moving, part, target, error);
            if (status != SKD_OK)
                return status;
        } else {
            write_over(moving, part, target);
        }
    }
    struct skd_json primitive, attributes;
    if (target->is_new &&
        skd_gltf_primitive_json(moving->meshes, (size_t)part->mesh, (size_t)part->primitive,
                                &primitive) &&
        skd_json_member(primitive, "attributes", &attributes))
        skd_gltf_patch_attribute(moving->patch, attributes, "POSITION", target->accessor);
    return SKD_OK;
}

enum skd_status skd_gltf_rest_write(const struct skd_rig *rig,
                                    const struct skd_gltf_container *container,
                                    const struct skd_gltf_claims *claims,
                                    const struct skd_gltf_content *content,
                                    struct skd_gltf_patch *patch,
                                    struct skd_gltf_export_report *report, struct skd_error *error)
{
    const struct skd_mesh *mesh = &rig->mesh;
    struct moving moving = {.rig = rig,
                            .container = container,
                            .claims = claims,
                            .rest = content->rest,
                            .patch = patch};
    size_t count = 0;
    if (content->rest == NULL)
        return SKD_OK;
    enum skd_status status = check_rest(content->rest, mesh->vertex_count, error);
    if (status != SKD_OK)
        return status;
    moving.meshes = skd_json_member_elements(container->json, "meshes", &count);
    moving.accessors = skd_json_member_elements(container->json, "accessors", &count);
    moving.leaders = calloc(mesh->part_count + 1, sizeof *moving.leaders);
    moving.targets = calloc(mesh->part_count + 1, sizeof *moving.targets);
    if (moving.meshes == NULL || moving.accessors == NULL || moving.leaders == NULL ||
        moving.targets == NULL)
        status = skd_fail_memory(error, "the rest positions of an export");
    for (size_t p = 0; status == SKD_OK && p < mesh->part_count; p++)
        find_leader(&moving, p);
    for (size_t p = 0; status == SKD_OK && p < mesh->part_count; p++) {
        if (!has_part_moved(&moving, &mesh->parts[p]))
            continue;
        status = write_part(&moving, p, error);
        report->positions++;
    }
    free(moving.meshes);
    free(moving.accessors);
    free(moving.leaders);
    free(moving.targets);
    return status;
}
