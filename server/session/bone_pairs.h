/* Which bone is the other side's, by the names that riggers and exporters give.
 *
 * Stage: job. Thread: a worker. Reads a skeleton, owns nothing of it.
 *
 *     arm.L arm_l arm-L L_arm  "Bip01 L Arm"      a letter that stands alone
 *     LeftArm mixamorig:LeftArm arm_left LEFT_ARM a word
 *     lShldr LArm armL arm_L2 leftarm             only where the other side is there too
 *     arm.L.001 b_LeftFoot_018                    what numbers follow
 */
#ifndef SKD_SESSION_BONE_PAIRS_H
#define SKD_SESSION_BONE_PAIRS_H

#include "rig/rig.h"

struct skd_bone_pairs {
    uint16_t *partners; /* [bones] a bone without a side, or without a partner, is its own */
    uint8_t *unpaired;  /* [bones] 1: has a side, and the other side's bone is not there */
};

/* Pairs the bones of each skin: a's partner is b exactly where b's is a. A number at the end may
 * differ between the sides where the rest of the name finds one bone only.
 * Errors: SKD_NO_MEMORY. Finish in any case. */
SKD_MUST_CHECK enum skd_status skd_bone_pairs_build(const struct skd_skeleton *skeleton,
                                                    struct skd_bone_pairs *pairs,
                                                    struct skd_error *error);
void skd_bone_pairs_finish(struct skd_bone_pairs *pairs);

#endif
