/* Where the joints of the figure are: the one table of measures that the skin (body.c), the
 * skeleton and the weights share.
 *
 * Pure; any thread. Only the left side and the middle are stored; the right side is the mirror
 * image in x.
 */
#ifndef SKD_GENERATE_ANATOMY_H
#define SKD_GENERATE_ANATOMY_H

#include "geometry.h"

/* Parents come before children. FINGER_FIRST + 3 * finger + k is phalanx k of a finger; finger 0
 * is the thumb, 4 the little finger. */
enum anatomy_bone {
    BONE_HIPS,
    BONE_SPINE,
    BONE_CHEST,
    BONE_UPPER_CHEST,
    BONE_NECK,
    BONE_HEAD,
    BONE_JAW,
    BONE_CLAVICLE,
    BONE_UPPER_ARM,
    BONE_FOREARM,
    BONE_HAND,
    BONE_FINGER_FIRST,
    BONE_THIGH = BONE_FINGER_FIRST + 15,
    BONE_SHIN,
    BONE_FOOT,
    BONE_TOE,
    BONE_COUNT,
    BONE_CENTRE_COUNT = BONE_CLAVICLE
};

enum { FINGER_COUNT = 5, PHALANX_COUNT = 3 };

static inline int finger_bone(int finger, int phalanx)
{
    return BONE_FINGER_FIRST + PHALANX_COUNT * finger + phalanx;
}

/* Right-handed: along x up = side. */
struct frame {
    struct vec3 origin, along, up, side;
};

struct anatomy {
    struct vec3 head[BONE_COUNT], tail[BONE_COUNT];
    struct vec3 hinge[BONE_COUNT];   /* unit axis; turning about it bends the bone */
    struct frame upper_arm, forearm; /* origin at the joint; up is the back of the hand's side */
    struct frame hand;               /* side points to the thumb (and forward) */
    struct frame finger[FINGER_COUNT][PHALANX_COUNT];
};

void skd_anatomy_init(struct anatomy *anatomy);

/* The point at (along, up, side) in the frame, in metres. */
struct vec3 skd_frame_point(const struct frame *frame, double along, double up, double side);

#endif
