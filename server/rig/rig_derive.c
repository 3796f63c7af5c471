/* See rig_derive.h. */
#include "rig/rig_derive.h"

#include "rig/matrix.h"
#include "rig/topology.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Where the bone's origin was at bind: the inverse bind matrix takes it to 0. A bone that is
 * flattened at bind has no such place and begins where its parent does. */
static enum skd_status find_heads(struct skd_skeleton *skeleton, struct skd_error *error)
{
    const int count = skeleton->bone_count;
    bool *is_known = calloc((size_t)count, sizeof *is_known);
    skeleton->heads = calloc((size_t)count * 3, sizeof *skeleton->heads);
    if (is_known == NULL || skeleton->heads == NULL) {
        free(is_known);
        return skd_fail_memory(error, "the bones");
    }
    for (int b = 0; b < count; b++) {
        double bind[SKD_MATRIX_SIZE];
        is_known[b] = skd_matrix_invert(skeleton->inverse_binds + b * SKD_MATRIX_SIZE, bind);
        for (int i = 0; is_known[b] && i < 3; i++) {
            skeleton->heads[b * 3 + i] = (float)bind[i * 4 + 3];
            if (!isfinite(skeleton->heads[b * 3 + i]))
                is_known[b] = false;
        }
    }
    for (int b = 0; b < count; b++) {
        int from = b;
        while (from >= 0 && !is_known[from])
            from = skeleton->parents[from];
        for (int i = 0; from != b && i < 3; i++)
            skeleton->heads[b * 3 + i] = from >= 0 ? skeleton->heads[from * 3 + i] : 0;
    }
    free(is_known);
    return SKD_OK;
}

/* The diagonal of the box around the mesh, posed when matrices are given; 0 when it has none. */
static double box_diagonal(const struct skd_mesh *mesh, const struct skd_influences *influences,
                           const double *matrices)
{
    double low[3] = {INFINITY, INFINITY, INFINITY};
    double high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        const float *rest = mesh->rest + v * 3;
        double p[3] = {0, 0, 0};
        if (matrices == NULL)
            for (int i = 0; i < 3; i++)
                p[i] = (double)rest[i];
        for (size_t k = influences->offsets[v]; matrices != NULL && k < influences->offsets[v + 1];
             k++)
            skd_matrix_add_transformed(matrices + (size_t)influences->joints[k] * SKD_MATRIX_SIZE,
                                       rest, (double)influences->weights[k], p);
        for (int i = 0; i < 3; i++) {
            low[i] = p[i] < low[i] ? p[i] : low[i];
            high[i] = p[i] > high[i] ? p[i] : high[i];
        }
    }
    double sum = 0;
    for (int i = 0; i < 3; i++)
        sum += (high[i] - low[i]) * (high[i] - low[i]);
    const double diagonal = sqrt(sum);
    return isfinite(diagonal) ? diagonal : 0;
}

void skd_rig_measure(struct skd_rig *rig, const struct skd_influences *influences)
{
    rig->length = box_diagonal(&rig->mesh, influences, rig->rest_pose);
    if (!(rig->length > 0))
        rig->length = box_diagonal(&rig->mesh, influences, NULL);
    if (!(rig->length > 0))
        rig->length = 1;
    rig->notes[SKD_NOTE_TRIANGLES_DROPPED] += skd_topology_drop_degenerate(&rig->mesh);
}

enum skd_status skd_rig_derive(struct skd_rig *rig, struct skd_scratch *scratch,
                               struct skd_error *error)
{
    const enum skd_status status = find_heads(&rig->skeleton, error);
    return status != SKD_OK ? status : skd_topology_find_neighbours(&rig->mesh, scratch, error);
}
