/* See pose_spread.h. */
#include "session/pose_spread.h"

#include "rig/matrix.h"

#include <math.h>

/* Below this share of L bones are not told apart: 25 degrees at every joint leave no vertex of a
 * MakeHuman body below it, 5 degrees an eighth, its own clips a quarter. */
static const double SPREAD_PER_LENGTH = 0.002;

/* Fewer than this share of the vertices are not worth a warning. */
static const double SHARE_TOLD = 0.05;

/* How far the poses move a vertex's first bone and another of its slots' apart: the root mean
 * square over the poses of |d_0 - d_i|, for the slot where it is largest. */
static double spread(const struct skd_stroke *stroke, size_t vertex)
{
    const struct skd_session *session = stroke->session;
    size_t slots = (size_t)session->slot_count;
    const uint16_t *joints = session->joints + vertex * slots;
    const float *rest = session->rest + 3 * vertex;
    double most = 0.0;
    for (size_t i = 1; i < slots && joints[0] != SKD_SLOT_EMPTY; i++) {
        double sum = 0.0;
        for (int p = 0; p < stroke->pose_count && joints[i] != SKD_SLOT_EMPTY; p++) {
            const double *matrices = stroke->poses[p].matrices;
            double apart[3] = {0};
            skd_matrix_add_transformed(matrices + (size_t)SKD_MATRIX_SIZE * joints[0], rest, 1,
                                       apart);
            skd_matrix_add_transformed(matrices + (size_t)SKD_MATRIX_SIZE * joints[i], rest, -1,
                                       apart);
            for (int axis = 0; axis < 3; axis++)
                sum += apart[axis] * apart[axis];
        }
        most = fmax(most, sum / stroke->pose_count);
    }
    return sqrt(most);
}

size_t skd_pose_spread_count_still(const struct skd_stroke *stroke)
{
    double least = SPREAD_PER_LENGTH * stroke->session->rig->length;
    size_t still = 0, count = stroke->step->count;
    for (size_t i = 0; i < count; i++)
        still += spread(stroke, stroke->step->vertices[i]) < least;
    return (double)still > SHARE_TOLD * (double)count ? still : 0;
}
