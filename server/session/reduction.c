/* See reduction.h. */
#include "session/reduction.h"

#include "rig/pose.h"

#include <math.h>
#include <stdlib.h>

enum { POSES_TRIED = 16 };
static const double BEND_RAD = 25.0 * 3.14159265358979323846 / 180.0;

/* Pose `index` of POSES_TRIED: clips in turn, each at evenly spread times. */
static enum skd_status try_pose(const struct skd_rig *rig, int index, double *matrices,
                                struct skd_error *error)
{
    int clip_count = (int)rig->nodes.clip_count;
    if (clip_count == 0) {
        skd_pose_bend(rig, (uint32_t)index, BEND_RAD, matrices);
        return SKD_OK;
    }
    int clip = index % clip_count;
    int rounds = (POSES_TRIED + clip_count - 1) / clip_count;
    double share = ((double)(index / clip_count) + 0.5) / (double)rounds;
    return skd_pose_from_clip(rig, clip, share * rig->nodes.clips[clip].duration, matrices, error);
}

/* Where the vertex goes with all its influences. */
static void skin_all(const struct skd_influences *influences, const float *rest, size_t vertex,
                     const double *matrices, double position[3])
{
    position[0] = position[1] = position[2] = 0;
    for (uint32_t k = influences->offsets[vertex]; k < influences->offsets[vertex + 1]; k++) {
        const double *m = matrices + (size_t)influences->joints[k] * SKD_MATRIX_SIZE;
        for (int axis = 0; axis < 3; axis++, m += 4)
            position[axis] +=
                (double)influences->weights[k] *
                (m[0] * (double)rest[0] + m[1] * (double)rest[1] + m[2] * (double)rest[2] + m[3]);
    }
}

enum skd_status skd_reduction_measure(const struct skd_session *session,
                                      const struct skd_influences *influences,
                                      struct skd_reduction *reduction, struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    size_t cut_count = 0;
    double sum = 0;
    enum skd_status status = SKD_OK;
    *reduction = (struct skd_reduction){.pose_count = POSES_TRIED};
    double *matrices = malloc((size_t)rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof(double));
    if (matrices == NULL)
        return skd_fail_memory(error, "measuring the reduction");
    for (int pose = 0; pose < POSES_TRIED && status == SKD_OK; pose++) {
        status = try_pose(rig, pose, matrices, error);
        for (uint32_t v = 0; v < rig->mesh.vertex_count && status == SKD_OK; v++) {
            if (influences->offsets[v + 1] - influences->offsets[v] <=
                (uint32_t)session->slot_count)
                continue;
            double whole[3];
            float kept[3];
            skin_all(influences, rig->mesh.rest + 3 * (size_t)v, v, matrices, whole);
            skd_skin(1, &v, session->slot_count, rig->mesh.rest, session->joints, session->weights,
                     matrices, kept);
            double moved = sqrt((kept[0] - whole[0]) * (kept[0] - whole[0]) +
                                (kept[1] - whole[1]) * (kept[1] - whole[1]) +
                                (kept[2] - whole[2]) * (kept[2] - whole[2]));
            sum += moved;
            cut_count++;
            reduction->max = fmax(reduction->max, moved);
        }
    }
    if (cut_count > 0)
        reduction->mean = sum / (double)cut_count;
    free(matrices);
    return status;
}
