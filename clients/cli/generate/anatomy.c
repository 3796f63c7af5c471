/* See anatomy.h. Measures in metres after the means of adult body tables, rounded; angles in
 * degrees.
 */
#include "anatomy.h"

static const double arm_drop = 42.0;  /* of the A-pose, below the horizontal */
static const double elbow_bend = 9.0; /* at rest, forward */

struct finger_measure {
    double along, up, side; /* first joint in the hand's frame */
    double spread;          /* degrees towards the thumb */
    double curl;            /* degrees a joint, towards the palm */
    double length[PHALANX_COUNT];
};

/* Entry 0, the thumb, has a direction of its own. */
static const struct finger_measure finger_measures[FINGER_COUNT] = {
    {0.020, -0.006, 0.024, 0.0, 5.0, {0.043, 0.034, 0.027}},
    {0.084, 0.001, 0.0290, 6.0, 5.0, {0.041, 0.025, 0.021}},
    {0.087, 0.003, 0.0095, 1.0, 5.0, {0.045, 0.028, 0.023}},
    {0.083, 0.002, -0.0100, -4.0, 5.0, {0.041, 0.026, 0.022}},
    {0.076, -0.001, -0.0285, -10.0, 5.0, {0.032, 0.020, 0.019}},
};

struct vec3 skd_frame_point(const struct frame *frame, double along, double up, double side)
{
    struct vec3 point = vec3_mad(frame->origin, frame->along, along);
    return vec3_mad(vec3_mad(point, frame->up, up), frame->side, side);
}

/* Turns along towards side, about up. */
static struct frame frame_yaw(struct frame frame, double degrees)
{
    double c = cos_degrees(degrees), s = sin_degrees(degrees);
    struct vec3 along = frame.along;
    frame.along = vec3_mad(vec3_scale(along, c), frame.side, s);
    frame.side = vec3_mad(vec3_scale(frame.side, c), along, -s);
    return frame;
}

/* Turns along away from up, about side: what a finger does when it curls. */
static struct frame frame_curl(struct frame frame, double degrees)
{
    double c = cos_degrees(degrees), s = sin_degrees(degrees);
    struct vec3 along = frame.along;
    frame.along = vec3_mad(vec3_scale(along, c), frame.up, -s);
    frame.up = vec3_mad(vec3_scale(frame.up, c), along, s);
    return frame;
}

static void set_bone(struct anatomy *a, int bone, struct vec3 head, struct vec3 tail,
                     struct vec3 hinge)
{
    struct vec3 along = vec3_unit(vec3_sub(tail, head));
    a->head[bone] = head;
    a->tail[bone] = tail;
    a->hinge[bone] = vec3_unit(vec3_mad(hinge, along, -vec3_dot(hinge, along)));
}

static void place_middle(struct anatomy *a)
{
    static const struct vec3 line[] = {{0, 0.955, -0.005}, {0, 1.035, -0.015}, {0, 1.150, -0.020},
                                       {0, 1.270, -0.025}, {0, 1.480, -0.032}, {0, 1.560, -0.008},
                                       {0, 1.750, 0.010}};
    struct vec3 right = vec3(1, 0, 0);
    for (int bone = BONE_HIPS; bone <= BONE_HEAD; ++bone)
        set_bone(a, bone, line[bone], line[bone + 1], right);
    set_bone(a, BONE_JAW, vec3(0, 1.592, 0.024), vec3(0, 1.540, 0.105), right);
}

static void place_leg(struct anatomy *a)
{
    struct vec3 hip = vec3(0.090, 0.925, -0.002), knee = vec3(0.102, 0.500, 0.006);
    struct vec3 ankle = vec3(0.112, 0.090, -0.030), ball = vec3(0.126, 0.022, 0.098);
    struct vec3 right = vec3(1, 0, 0), left = vec3(-1, 0, 0);
    set_bone(a, BONE_THIGH, hip, knee, left);
    set_bone(a, BONE_SHIN, knee, ankle, right);
    set_bone(a, BONE_FOOT, ankle, ball, left);
    set_bone(a, BONE_TOE, ball, vec3(0.133, 0.016, 0.172), left);
}

static void place_arm(struct anatomy *a)
{
    double c = cos_degrees(arm_drop), s = sin_degrees(arm_drop);
    struct vec3 shoulder = vec3(0.172, 1.420, -0.016);
    a->upper_arm = (struct frame){shoulder, {c, -s, 0}, {s, c, 0}, {0, 0, 1}};
    a->forearm = frame_yaw(a->upper_arm, elbow_bend);
    a->forearm.origin = skd_frame_point(&a->upper_arm, 0.285, 0, 0);
    a->hand = a->forearm;
    a->hand.origin = skd_frame_point(&a->forearm, 0.255, 0, 0);

    struct vec3 down = vec3_scale(a->upper_arm.up, -1.0);
    set_bone(a, BONE_CLAVICLE, vec3(0.020, 1.440, 0.012), shoulder, vec3(0, 0, 1));
    set_bone(a, BONE_UPPER_ARM, shoulder, a->forearm.origin, down);
    set_bone(a, BONE_FOREARM, a->forearm.origin, a->hand.origin, down);
    set_bone(a, BONE_HAND, a->hand.origin, skd_frame_point(&a->hand, 0.085, 0, 0),
             vec3_scale(a->hand.side, -1.0));
}

/* Out of the palm's front edge, half along the fingers and a little below the palm. */
static struct frame thumb_frame(const struct frame *hand)
{
    struct frame thumb = *hand;
    struct vec3 along =
        vec3_mad(vec3_mad(vec3_scale(hand->along, 0.74), hand->side, 0.62), hand->up, -0.26);
    thumb.along = vec3_unit(along);
    /* The pad of the thumb faces the palm's middle: up, its back, points away from there. */
    struct vec3 up = vec3_mad(vec3_scale(hand->side, 0.55), hand->up, 0.85);
    thumb.up = vec3_unit(vec3_mad(up, thumb.along, -vec3_dot(up, thumb.along)));
    thumb.side = vec3_cross(thumb.along, thumb.up);
    return thumb;
}

static void place_fingers(struct anatomy *a)
{
    for (int finger = 0; finger < FINGER_COUNT; ++finger) {
        const struct finger_measure *m = &finger_measures[finger];
        struct frame frame = finger == 0 ? thumb_frame(&a->hand) : frame_yaw(a->hand, m->spread);
        frame.origin = skd_frame_point(&a->hand, m->along, m->up, m->side);
        for (int k = 0; k < PHALANX_COUNT; ++k) {
            frame = frame_curl(frame, m->curl);
            struct vec3 tail = skd_frame_point(&frame, m->length[k], 0, 0);
            a->finger[finger][k] = frame;
            set_bone(a, finger_bone(finger, k), frame.origin, tail, vec3_scale(frame.side, -1.0));
            frame.origin = tail;
        }
    }
}

void skd_anatomy_init(struct anatomy *anatomy)
{
    place_middle(anatomy);
    place_leg(anatomy);
    place_arm(anatomy);
    place_fingers(anatomy);
}
