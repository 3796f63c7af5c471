/* See pose.h and nodes.h. */
#include "rig/pose.h"

#include "rig/clip.h"
#include "rig/matrix.h"
#include "rig/nodes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void skd_nodes_globals(const struct skd_node *items, const int32_t *order, size_t count,
                       double *globals)
{
    for (size_t i = 0; i < count; i++) {
        const struct skd_node *node = &items[order[i]];
        double *global = globals + (size_t)order[i] * SKD_MATRIX_SIZE;
        double local[SKD_MATRIX_SIZE];
        if (node->has_matrix)
            memcpy(local, node->local, sizeof local);
        else
            skd_matrix_from_trs(node->translation, node->rotation, node->scale, local);
        if (node->parent >= 0)
            skd_matrix_multiply(globals + (size_t)node->parent * SKD_MATRIX_SIZE, local, global);
        else
            memcpy(global, local, sizeof local);
    }
}

void skd_nodes_skin_matrices(const struct skd_skeleton *skeleton, const double *globals,
                             double *skin_matrices)
{
    for (int b = 0; b < skeleton->bone_count; b++)
        skd_matrix_multiply(globals + (size_t)skeleton->nodes[b] * SKD_MATRIX_SIZE,
                            skeleton->inverse_binds + b * SKD_MATRIX_SIZE,
                            skin_matrices + b * SKD_MATRIX_SIZE);
}

static void apply_channel(const struct skd_channel *channel, double time, struct skd_node *nodes)
{
    struct skd_node *node = &nodes[channel->node];
    double *const parts[] = {node->translation, node->rotation, node->scale};
    skd_channel_sample(channel, time, parts[channel->path]);
}

enum skd_status skd_pose_from_clip(const struct skd_rig *rig, int clip, double time,
                                   double *skin_matrices, struct skd_error *error)
{
    const struct skd_nodes *nodes = &rig->nodes;
    if (clip < 0 || (size_t)clip >= nodes->clip_count)
        return skd_fail(error, SKD_NO_CLIP, "clip %d is not there: the rig has %zu clips", clip,
                        nodes->clip_count);
    if (!isfinite(time))
        return skd_fail(error, SKD_NOT_FINITE,
                        "the time in clip \"%s\" is not a finite number of seconds",
                        nodes->clips[clip].name);
    struct skd_node *posed = malloc(nodes->count * sizeof *posed);
    double *globals = malloc(nodes->count * SKD_MATRIX_SIZE * sizeof *globals);
    if (posed == NULL || globals == NULL) {
        free(posed);
        free(globals);
        return skd_fail_memory(error, "the nodes of a pose");
    }
    memcpy(posed, nodes->items, nodes->count * sizeof *posed);
    for (size_t i = 0; i < nodes->clips[clip].channel_count; i++)
        apply_channel(&nodes->clips[clip].channels[i], time, posed);
    skd_nodes_globals(posed, nodes->order, nodes->count, globals);
    skd_nodes_skin_matrices(&rig->skeleton, globals, skin_matrices);
    free(posed);
    free(globals);
    return SKD_OK;
}

enum skd_status skd_pose_from_matrices(const struct skd_rig *rig, const double *posed,
                                       double *skin_matrices, struct skd_error *error)
{
    const struct skd_skeleton *skeleton = &rig->skeleton;
    for (int b = 0; b < skeleton->bone_count; b++) {
        const double *matrix = posed + b * 16;
        for (int i = 0; i < 16; i++)
            if (!isfinite(matrix[i]))
                return skd_fail(error, SKD_NOT_FINITE,
                                "the matrix of bone %d (\"%s\") has a number that is not finite", b,
                                skeleton->names[b]);
        if (matrix[12] != 0 || matrix[13] != 0 || matrix[14] != 0 || matrix[15] != 1)
            return skd_fail(error, SKD_BAD_PARAMS,
                            "the matrix of bone %d (\"%s\") has a last row other than 0 0 0 1; "
                            "send matrices row by row, with the translation in the last column",
                            b, skeleton->names[b]);
    }
    for (int b = 0; b < skeleton->bone_count; b++)
        skd_matrix_multiply(posed + b * 16, skeleton->inverse_binds + b * SKD_MATRIX_SIZE,
                            skin_matrices + b * SKD_MATRIX_SIZE);
    return SKD_OK;
}
