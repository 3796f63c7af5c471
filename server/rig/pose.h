/* Poses: from a clip and a time, or from a client's matrices, to skin matrices M_b.
 *
 * Stage: request (making), job (reading). Thread: any; a pose is a plain array of [bones][12]
 * float64 that the caller owns.
 */
#ifndef SKD_RIG_POSE_H
#define SKD_RIG_POSE_H

#include "rig/rig.h"

/* Samples a clip at `time` seconds (clamped to its keys, as the glTF specification says) and
 * writes the skin matrices. Nodes without a channel keep their own transform. */
SKD_MUST_CHECK enum skd_status skd_pose_from_clip(const struct skd_rig *rig, int clip, double time,
                                                  double *skin_matrices, struct skd_error *error);

/* posed: [bones][16] posed bone matrices in posed space, row by row; the last row must be
 * 0 0 0 1. Skin matrix = posed x inverse bind. */
SKD_MUST_CHECK enum skd_status skd_pose_from_matrices(const struct skd_rig *rig,
                                                      const double *posed, double *skin_matrices,
                                                      struct skd_error *error);

/* A pose that bends every joint by `angle_rad` about an axis of its own, chosen by `seed`: a
 * stand-in for a rig without clips, and a pose unlike its clips for one that has them. The same
 * seed gives the same pose. */
void skd_pose_bend(const struct skd_rig *rig, uint32_t seed, double angle_rad,
                   double *skin_matrices);

#endif
