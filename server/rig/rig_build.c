/* See rig_build.h. */
#include "rig/rig_build.h"

#include "rig/influences.h"
#include "rig/matrix.h"
#include "rig/names.h"
#include "rig/rig_derive.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static enum skd_status check_sizes(const struct skd_rig_arrays *arrays, struct skd_error *error)
{
    if (arrays->vertex_count == 0 || arrays->bone_count <= 0)
        return skd_fail(error, SKD_BAD_RIG, "a rig needs at least one vertex and one bone");
    if (arrays->vertex_count > SKD_VERTICES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "%zu vertices are more than %zu",
                        arrays->vertex_count, SKD_VERTICES_MAX);
    if (arrays->triangle_count > SKD_TRIANGLES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "%zu triangles are more than %zu",
                        arrays->triangle_count, SKD_TRIANGLES_MAX);
    if (arrays->bone_count > SKD_BONES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "%d bones are more than %d", arrays->bone_count,
                        SKD_BONES_MAX);
    return SKD_OK;
}

static enum skd_status check_mesh(const struct skd_rig_arrays *arrays, struct skd_error *error)
{
    for (size_t i = 0; i < arrays->vertex_count * 3; i++)
        if (!isfinite(arrays->positions[i]))
            return skd_fail(error, SKD_NOT_FINITE, "the position of vertex %zu is not finite",
                            i / 3);
    for (size_t i = 0; i < arrays->triangle_count * 3; i++)
        if (arrays->triangles[i] >= arrays->vertex_count)
            return skd_fail(error, SKD_BAD_INDEX, "triangle %zu names vertex %u of %zu", i / 3,
                            arrays->triangles[i], arrays->vertex_count);
    return SKD_OK;
}

/* A walk up that takes more steps than there are bones goes in a circle. */
static enum skd_status check_parents(const struct skd_rig_arrays *arrays, struct skd_error *error)
{
    const int count = arrays->bone_count;
    for (int b = 0; b < count; b++)
        if (arrays->parents[b] < -1 || arrays->parents[b] >= count)
            return skd_fail(error, SKD_BAD_INDEX, "bone %d has parent %d; there are %d bones", b,
                            arrays->parents[b], count);
    for (int b = 0; b < count; b++) {
        int steps = 0;
        for (int at = b; at >= 0; at = arrays->parents[at])
            if (steps++ > count)
                return skd_fail(error, SKD_BAD_RIG, "bone %d is an ancestor of itself", b);
    }
    return SKD_OK;
}

static enum skd_status check_influences(const struct skd_rig_arrays *arrays,
                                        struct skd_error *error)
{
    const uint32_t *offsets = arrays->influence_offsets;
    if (offsets[0] != 0)
        return skd_fail(error, SKD_COUNT_MISMATCH, "the first influence offset is %u, not 0",
                        offsets[0]);
    for (size_t v = 0; v < arrays->vertex_count; v++) {
        if (offsets[v + 1] < offsets[v])
            return skd_fail(error, SKD_COUNT_MISMATCH,
                            "the influence offsets fall at vertex %zu (%u, then %u)", v, offsets[v],
                            offsets[v + 1]);
        if (offsets[v + 1] - offsets[v] > SKD_INFLUENCES_MAX)
            return skd_fail(error, SKD_TOO_LARGE, "vertex %zu has %u influences, more than %d", v,
                            offsets[v + 1] - offsets[v], SKD_INFLUENCES_MAX);
    }
    for (size_t v = 0; v < arrays->vertex_count; v++)
        for (size_t k = offsets[v]; k < offsets[v + 1]; k++) {
            if (arrays->influence_joints[k] >= arrays->bone_count)
                return skd_fail(error, SKD_BAD_INDEX, "vertex %zu names bone %u of %d", v,
                                arrays->influence_joints[k], arrays->bone_count);
            if (!isfinite(arrays->influence_weights[k]))
                return skd_fail(error, SKD_NOT_FINITE, "a weight of vertex %zu is not finite", v);
        }
    return SKD_OK;
}

static enum skd_status copy_binds(const struct skd_rig_arrays *arrays, struct skd_rig *rig,
                                  struct skd_error *error)
{
    for (int b = 0; b < arrays->bone_count; b++) {
        const double *bind = arrays->bind_matrices + b * 16;
        for (int i = 0; i < 16; i++)
            if (!isfinite(bind[i]))
                return skd_fail(error, SKD_NOT_FINITE,
                                "the bind matrix of bone %d has a number that is not finite", b);
        if (bind[12] != 0 || bind[13] != 0 || bind[14] != 0 || bind[15] != 1)
            return skd_fail(error, SKD_BAD_RIG,
                            "the bind matrix of bone %d has a last row other than 0 0 0 1; send "
                            "matrices row by row, with the translation in the last column",
                            b);
        if (!skd_matrix_invert(bind, rig->skeleton.inverse_binds + b * SKD_MATRIX_SIZE))
            return skd_fail(error, SKD_BAD_RIG,
                            "the bind matrix of bone %d has no inverse; a bone may not be scaled "
                            "to nothing at bind",
                            b);
        skd_matrix_identity(rig->rest_pose + b * SKD_MATRIX_SIZE);
    }
    return SKD_OK;
}

static enum skd_status copy_skeleton(const struct skd_rig_arrays *arrays, struct skd_rig *rig,
                                     struct skd_error *error)
{
    struct skd_skeleton *skeleton = &rig->skeleton;
    const size_t count = (size_t)arrays->bone_count;
    skeleton->bone_count = arrays->bone_count;
    skeleton->names = calloc(count, sizeof *skeleton->names);
    skeleton->parents = malloc(count * sizeof *skeleton->parents);
    skeleton->skins = calloc(count, sizeof *skeleton->skins);
    skeleton->inverse_binds = malloc(count * SKD_MATRIX_SIZE * sizeof(double));
    rig->rest_pose = malloc(count * SKD_MATRIX_SIZE * sizeof(double));
    if (skeleton->names == NULL || skeleton->parents == NULL || skeleton->skins == NULL ||
        skeleton->inverse_binds == NULL || rig->rest_pose == NULL)
        return skd_fail_memory(error, "the bones");
    memcpy(skeleton->parents, arrays->parents, count * sizeof *skeleton->parents);
    for (size_t b = 0; arrays->bone_names != NULL && b < count; b++) {
        skeleton->names[b] = arrays->bone_names[b] ? strdup(arrays->bone_names[b]) : NULL;
        if (arrays->bone_names[b] != NULL && skeleton->names[b] == NULL)
            return skd_fail_memory(error, "the bones");
    }
    rig->skin_count = 1;
    const enum skd_status status = copy_binds(arrays, rig, error);
    return status != SKD_OK ? status : skd_names_make_unique(skeleton->names, count, "bone", error);
}

static enum skd_status copy_mesh(const struct skd_rig_arrays *arrays, struct skd_rig *rig,
                                 struct skd_error *error)
{
    struct skd_mesh *mesh = &rig->mesh;
    mesh->vertex_count = arrays->vertex_count;
    mesh->triangle_count = arrays->triangle_count;
    mesh->rest = malloc(mesh->vertex_count * 3 * sizeof *mesh->rest);
    mesh->triangles = malloc((mesh->triangle_count * 3 + 1) * sizeof *mesh->triangles);
    mesh->skins = calloc(mesh->vertex_count, sizeof *mesh->skins);
    mesh->parts = calloc(1, sizeof *mesh->parts);
    if (mesh->rest == NULL || mesh->triangles == NULL || mesh->skins == NULL || mesh->parts == NULL)
        return skd_fail_memory(error, "the mesh");
    memcpy(mesh->rest, arrays->positions, mesh->vertex_count * 3 * sizeof *mesh->rest);
    if (mesh->triangle_count > 0)
        memcpy(mesh->triangles, arrays->triangles,
               mesh->triangle_count * 3 * sizeof *mesh->triangles);
    mesh->part_count = 1;
    mesh->parts[0] = (struct skd_part){
        .vertex_count = mesh->vertex_count, .mesh = -1, .primitive = -1, .name = strdup("")};
    return mesh->parts[0].name != NULL ? SKD_OK : skd_fail_memory(error, "the mesh");
}

static enum skd_status copy_influences(const struct skd_rig_arrays *arrays, struct skd_rig *rig,
                                       struct skd_influences *influences, struct skd_error *error)
{
    const size_t count = arrays->vertex_count;
    const uint32_t *offsets = arrays->influence_offsets;
    const enum skd_status status =
        skd_influences_reserve(influences, count, offsets[count] + count, error);
    if (status != SKD_OK)
        return status;
    int root = 0;
    while (arrays->parents[root] >= 0)
        root++;
    for (size_t v = 0; v < count; v++) {
        struct skd_influence row[SKD_INFLUENCES_MAX];
        int given = 0;
        for (size_t k = offsets[v]; k < offsets[v + 1]; k++)
            row[given++] =
                (struct skd_influence){arrays->influence_joints[k], arrays->influence_weights[k]};
        given = skd_influences_mend(row, given, (uint16_t)root, rig->notes);
        skd_influences_append(influences, v, row, given);
    }
    skd_influences_trim(influences, count);
    return SKD_OK;
}

enum skd_status skd_rig_from_arrays(const struct skd_rig_arrays *arrays, struct skd_rig **rig,
                                    struct skd_influences *influences, struct skd_error *error)
{
    *rig = NULL;
    *influences = (struct skd_influences){0};
    enum skd_status status = check_sizes(arrays, error);
    if (status == SKD_OK)
        status = check_mesh(arrays, error);
    if (status == SKD_OK)
        status = check_parents(arrays, error);
    if (status == SKD_OK)
        status = check_influences(arrays, error);
    if (status != SKD_OK)
        return status;
    struct skd_scratch scratch = {0};
    struct skd_rig *made = calloc(1, sizeof *made);
    if (made == NULL)
        return skd_fail_memory(error, "a rig");
    status = copy_skeleton(arrays, made, error);
    if (status == SKD_OK)
        status = copy_mesh(arrays, made, error);
    if (status == SKD_OK)
        status = copy_influences(arrays, made, influences, error);
    if (status == SKD_OK) {
        skd_rig_measure(made, influences);
        status = skd_rig_derive(made, &scratch, error);
    }
    skd_scratch_finish(&scratch);
    if (status != SKD_OK)
        goto fail;
    *rig = made;
    return SKD_OK;
fail:
    skd_rig_destroy(made);
    skd_influences_finish(influences);
    return status;
}
