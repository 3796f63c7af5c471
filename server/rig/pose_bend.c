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

static bool is_known(const double *chains, int32_t bone)
{
    return !isnan(chains[bone * SKD_MATRIX_SIZE]);
}

/* chain_b = chain_parent D_b, with D_b a turn about b's head where the rest pose puts it. */
static void extend_chain(const struct skd_rig *rig, uint32_t seed, double angle_rad, int32_t bone,
                         double *chains)
{
    const struct skd_skeleton *skeleton = &rig->skeleton;
    double *chain = chains + bone * SKD_MATRIX_SIZE;
    double axis[3], centre[3] = {0, 0, 0}, turn[SKD_MATRIX_SIZE];
    int32_t parent = skeleton->parents[bone];
    choose_axis(seed, (uint32_t)bone, axis);
    skd_matrix_add_transformed(rig->rest_pose + bone * SKD_MATRIX_SIZE, skeleton->heads + 3 * bone,
                               1, centre);
    turn_about(axis, angle_rad, centre, turn);
    if (parent < 0)
        memcpy(chain, turn, sizeof turn);
    else
        skd_matrix_multiply(chains + parent * SKD_MATRIX_SIZE, turn, chain);
}

/* A bone's skin matrix is chain_b P_b, with P the rest pose: each joint carries everything below
 * it. Every chain is made once, from its parent's, in whatever order the bones stand. Until then
 * its first element is NaN, which a turn's never is. */
void skd_pose_bend(const struct skd_rig *rig, uint32_t seed, double angle_rad,
                   double *skin_matrices)
{
    const int32_t *parents = rig->skeleton.parents;
    int bone_count = rig->skeleton.bone_count;
    for (int bone = 0; bone < bone_count; bone++)
        skin_matrices[bone * SKD_MATRIX_SIZE] = NAN;
    for (int32_t bone = 0; bone < bone_count; bone++) {
        while (!is_known(skin_matrices, bone)) {
            int32_t top = bone;
            while (parents[top] >= 0 && !is_known(skin_matrices, parents[top]))
                top = parents[top];
            extend_chain(rig, seed, angle_rad, top, skin_matrices);
        }
    }
    for (int bone = 0; bone < bone_count; bone++) {
        double chain[SKD_MATRIX_SIZE];
        memcpy(chain, skin_matrices + bone * SKD_MATRIX_SIZE, sizeof chain);
        skd_matrix_multiply(chain, rig->rest_pose + bone * SKD_MATRIX_SIZE,
                            skin_matrices + bone * SKD_MATRIX_SIZE);
    }
}
