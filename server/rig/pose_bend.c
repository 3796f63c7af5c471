/* A pose that bends every joint; see skd_pose_bend in pose.h. */
#include "rig/matrix.h"
#include "rig/pose.h"

#include <math.h>
#include <string.h>

/* A whole number well mixed, the same on every machine (the finaliser of MurmurHash3). */
static uint32_t mix(uint32_t x)
{
    x = (x ^ (x >> 16)) * 0x85ebca6bu;
    x = (x ^ (x >> 13)) * 0xc2b2ae35u;
    return x ^ (x >> 16);
}

/* An axis of length one that belongs to this seed and bone. */
static void choose_axis(uint32_t seed, uint32_t bone, double axis[3])
{
    double length = 0;
    for (uint32_t i = 0; i < 3; i++) {
        axis[i] = (double)mix(seed * 0x9e3779b9u + bone * 3 + i) / 2147483648.0 - 1.0;
        length += axis[i] * axis[i];
    }
    length = sqrt(length);
    for (int i = 0; i < 3; i++)
        axis[i] = length > 0 ? axis[i] / length : i == 0;
}

/* Turns by `angle` about `axis` through `centre` (Rodrigues' formula). */
static void turn_about(const double axis[3], double angle, const double centre[3], double *m)
{
    const double c = cos(angle), s = sin(angle), t = 1 - c;
    const double x = axis[0], y = axis[1], z = axis[2];
    const double turned[SKD_MATRIX_SIZE] = {
        t * x * x + c,     t * x * y - s * z, t * x * z + s * y, 0,
        t * x * y + s * z, t * y * y + c,     t * y * z - s * x, 0,
        t * x * z - s * y, t * y * z + s * x, t * z * z + c,     0,
    };
    memcpy(m, turned, sizeof turned);
    for (int row = 0; row < 3; row++)
        m[4 * row + 3] = centre[row] - (m[4 * row] * centre[0] + m[4 * row + 1] * centre[1] +
                                        m[4 * row + 2] * centre[2]);
}

/* With P the rest pose and D_b a turn about bone b's posed head, a bone's skin matrix is
 * D_root ... D_parent D_b P_b: each joint carries everything below it. */
void skd_pose_bend(const struct skd_rig *rig, uint32_t seed, double angle_rad,
                   double *skin_matrices)
{
    const struct skd_skeleton *skeleton = &rig->skeleton;
    for (int bone = 0; bone < skeleton->bone_count; bone++) {
        double chain[SKD_MATRIX_SIZE], turn[SKD_MATRIX_SIZE], joined[SKD_MATRIX_SIZE];
        skd_matrix_identity(chain);
        for (int32_t joint = bone; joint >= 0; joint = skeleton->parents[joint]) {
            double axis[3], centre[3] = {0, 0, 0};
            choose_axis(seed, (uint32_t)joint, axis);
            skd_matrix_add_transformed(rig->rest_pose + joint * SKD_MATRIX_SIZE,
                                       skeleton->heads + 3 * joint, 1, centre);
            turn_about(axis, angle_rad, centre, turn);
            skd_matrix_multiply(turn, chain, joined);
            memcpy(chain, joined, sizeof chain);
        }
        skd_matrix_multiply(chain, rig->rest_pose + bone * SKD_MATRIX_SIZE,
                            skin_matrices + bone * SKD_MATRIX_SIZE);
    }
}
