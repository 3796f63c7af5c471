/* The figure's joints: which bones there are for a bone count, and their rest transforms.
 *
 * Pure; any thread; owns nothing beyond itself. Bones stand in file order, parents first.
 *
 * 53 bones are the whole figure. With fewer, the jaw (for an even count) and then fingertips,
 * middle joints, toes and fingers go; with more, the longest bones are cut into chains: "thigh.L"
 * goes on in "thigh_twist_1.L", "spine" in "spine_2".
 *
 * A bone's own axes: Y along the bone, X its hinge (turning about +X bends it), Z = X x Y. The
 * right side's axes are the mirror image such that the same angle about X mirrors the motion.
 */
#ifndef SKD_GENERATE_SKELETON_H
#define SKD_GENERATE_SKELETON_H

#include <stdint.h>

#include "anatomy.h"

enum { SKELETON_MAX_BONES = 250, SKELETON_NAME_BYTES = 48 };

enum skeleton_side { SIDE_CENTRE, SIDE_LEFT, SIDE_RIGHT, SIDE_COUNT };

struct skeleton_bone {
    char name[SKELETON_NAME_BYTES];
    int parent; /* -1 for the root */
    enum anatomy_bone kind;
    enum skeleton_side side;
    uint32_t segment, segment_count; /* place in the chain that an anatomical bone is cut into */
    struct vec3 head, along;         /* in the figure's space; along is a unit vector */
    double length;
    struct quat rest;       /* local, as written */
    float rotation[4];      /* local, x y z w */
    float translation[3];   /* local */
    float inverse_bind[16]; /* column major */
};

struct skeleton {
    uint32_t bone_count;
    struct skeleton_bone bone[SKELETON_MAX_BONES];
    /* First and last bone of a kind's chain; -1 when the bone was left out. Bones of the middle are
     * entered under all sides. */
    int first[BONE_COUNT][SIDE_COUNT], last[BONE_COUNT][SIDE_COUNT];
};

/* bone_count must be in 20..250. */
void skd_skeleton_init(struct skeleton *skeleton, const struct anatomy *anatomy,
                       uint32_t bone_count);

#endif
