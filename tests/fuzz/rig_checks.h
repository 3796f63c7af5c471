/* What every rig keeps, wherever it came from (rig/rig.h); for the fuzz targets that make rigs. */
#ifndef SKD_TESTS_RIG_CHECKS_H
#define SKD_TESTS_RIG_CHECKS_H

#include "rig/rig.h"

#include <math.h>

static void check_influences(const struct skd_rig *rig, const struct skd_influences *influences)
{
    for (size_t v = 0; v < rig->mesh.vertex_count; v++) {
        double sum = 0;
        for (size_t k = influences->offsets[v]; k < influences->offsets[v + 1]; k++) {
            SKD_ASSERT(influences->joints[k] < rig->skeleton.bone_count);
            SKD_ASSERT(influences->weights[k] > 0);
            sum += (double)influences->weights[k];
        }
        SKD_ASSERT(fabs(sum - 1) < 1e-6);
    }
}

static void check_mesh(const struct skd_rig *rig)
{
    const struct skd_mesh *mesh = &rig->mesh;
    SKD_ASSERT(rig->length > 0 && isfinite(rig->length));
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        SKD_ASSERT(isfinite(mesh->rest[i]));
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++)
        SKD_ASSERT(mesh->triangles[i] < mesh->vertex_count);
    for (int b = 0; b < rig->skeleton.bone_count; b++)
        SKD_ASSERT(rig->skeleton.parents[b] >= -1 &&
                   rig->skeleton.parents[b] < rig->skeleton.bone_count);
}

#endif
