/* See shape.h.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#include "solver/shape.h"

#include "solver/row.h"
#include "solver/symmetric3.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>

enum { ROUNDS = 4 };
static const double ridge_share = 1e-4;

/* B, and what the target lacks. */
static void blend(int n, const float *rest, const uint16_t *joints, const float *weights,
                  const double *matrices, const float *target, double linear[3][3],
                  double missing[3])
{
    const double v[3] = {(double)rest[0], (double)rest[1], (double)rest[2]};
    for (int axis = 0; axis < 3; axis++) {
        missing[axis] = (double)target[axis];
        linear[axis][0] = linear[axis][1] = linear[axis][2] = 0.0;
    }
    for (int i = 0; i < n; i++) {
        double d[3];
        if (joints[i] == SKD_SLOT_EMPTY)
            continue;
        const double *matrix = matrices + SKD_MATRIX_SIZE * (size_t)joints[i];
        const double weight = (double)weights[i];
        row_carry(matrix, v, d);
        for (int axis = 0; axis < 3; axis++) {
            missing[axis] -= weight * d[axis];
            for (int k = 0; k < 3; k++)
                linear[axis][k] += weight * matrix[4 * axis + k];
        }
    }
}

static void solve_offset(double linear[3][3], double missing[3], double offset[3])
{
    double normal[3][3], trace = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            normal[i][j] = linear[0][i] * linear[0][j] + linear[1][i] * linear[1][j] +
                           linear[2][i] * linear[2][j];
        trace += normal[i][i];
        offset[i] = 0.0;
    }
    if (!(trace > 0.0))
        return;
    for (int i = 0; i < 3; i++)
        normal[i][i] += ridge_share * trace / 3.0;
    for (int round = 0; round < ROUNDS; round++) {
        double right[3], step[3];
        for (int i = 0; i < 3; i++)
            right[i] =
                linear[0][i] * missing[0] + linear[1][i] * missing[1] + linear[2][i] * missing[2];
        skd_symmetric3_solve(normal, right, step);
        for (int i = 0; i < 3; i++)
            offset[i] += step[i];
        for (int i = 0; i < 3; i++)
            missing[i] -= linear[i][0] * step[0] + linear[i][1] * step[1] + linear[i][2] * step[2];
    }
}

void skd_shape_solve(size_t count, int slot_count, const float *rest, const uint16_t *joints,
                     const float *weights, const double *matrices, const float *targets,
                     float *offsets_out)
{
    const size_t n = (size_t)slot_count;
    for (size_t item = 0; item < count; item++) {
        double linear[3][3], missing[3], offset[3];
        blend(slot_count, rest + 3 * item, joints + n * item, weights + n * item, matrices,
              targets + 3 * item, linear, missing);
        solve_offset(linear, missing, offset);
        bool fits = true; /* a target near the end of float32 may be out of reach: no offset */
        for (int axis = 0; axis < 3; axis++)
            fits = fits && fabs(offset[axis]) <= (double)FLT_MAX;
        for (size_t axis = 0; axis < 3; axis++)
            offsets_out[3 * item + axis] = fits ? (float)offset[axis] : 0.0f;
    }
}
