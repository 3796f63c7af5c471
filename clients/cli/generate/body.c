/* See body.h. Trunk rings have 9 corners a half (16 around), neck and head 7 (12 around), arms and
 * legs 12, fingers 6, the front of the foot 8:
 *
 *      trunk, from above            arm and palm, against the way       finger i
 *                                   to the hand (up = back of hand)
 *        8   7   6 (back)              6  7  8  9  10                    4---3     (top i, i + 1)
 *        .       5                     5           11 (thumb)            5   2
 *        .       4 (left)              4  3  2  1  0                     0---1     (palm i, i + 1)
 *        .       3                     columns 4..0 from the little
 *        0   1   2 (front)             finger to the index finger
 *
 * The arm leaves the trunk through the window between corners 2..6 of its last three rows; the
 * leg ring is half the lowest trunk ring closed by three crotch corners; the fingers stand on the
 * palm's end side by side; the thumb leaves the palm's front edge; the front of the foot leaves
 * the ankle block's front.
 */
#include "body.h"

#include <stdlib.h>

enum { TRUNK = 9, HEAD = 7, LIMB = 12, FINGER = 6, FOOT = 8 };

static const struct cage_marks trunk_marks = {0};
static const struct cage_marks arm_marks = {.arm = 1.0};
static const struct cage_marks leg_marks = {.leg = 1.0};

/* ---- trunk, neck and head ------------------------------------------------------------------ */

/* A ring around the vertical axis: heights at front, side and back; half width; depths. box = 1
 * pushes the ellipse out to a rectangle. */
struct level {
    double y_front, y_side, y_back, width, front, back, box;
};

static const struct level trunk_levels[] = {
    {0.816, 0.890, 0.812, 0.173, 0.088, 0.096, 0.16}, /* crotch and groin */
    {0.885, 0.955, 0.895, 0.169, 0.100, 0.118, 0.14}, /* hips */
    {0.975, 1.030, 0.990, 0.150, 0.104, 0.104, 0.10}, /* pelvis */
    {1.075, 1.098, 1.085, 0.131, 0.100, 0.083, 0.08}, /* waist */
    {1.175, 1.180, 1.180, 0.139, 0.106, 0.094, 0.10}, /* ribs */
    {1.262, 1.255, 1.270, 0.155, 0.116, 0.112, 0.12}, /* chest */
    {1.335, 1.316, 1.350, 0.164, 0.120, 0.121, 0.12}, /* armpit */
};
enum { TRUNK_LEVELS = sizeof trunk_levels / sizeof *trunk_levels };

static const struct level head_levels[] = {
    {1.510, 1.530, 1.548, 0.055, 0.038, 0.075, 0.00},  /* neck */
    {1.533, 1.572, 1.590, 0.059, 0.094, 0.074, 0.00},  /* jaw */
    {1.586, 1.612, 1.626, 0.068, 0.104, 0.082, 0.00},  /* mouth */
    {1.644, 1.655, 1.664, 0.0765, 0.102, 0.096, 0.00}, /* eyes */
    {1.692, 1.700, 1.706, 0.0755, 0.095, 0.094, 0.00}, /* brow */
    {1.732, 1.735, 1.738, 0.0520, 0.064, 0.062, 0.00}, /* crown */
};
enum { HEAD_LEVELS = sizeof head_levels / sizeof *head_levels };

/* Corner k of a half ring of count corners, from the front (+z) over the left (+x) to the back. */
static struct vec3 level_point(const struct level *level, int k, int count)
{
    double degrees = 180.0 * k / (count - 1);
    double s = k == count - 1 ? 0.0 : sin_degrees(degrees), c = cos_degrees(degrees);
    double reach = fmax(fabs(s), fabs(c));
    double push = 1.0 + level->box * (1.0 / reach - 1.0);
    double y_middle = c > 0 ? level->y_front : level->y_back;
    double y = level->y_side + (y_middle - level->y_side) * c * c;
    return vec3(level->width * s * push, y, (c > 0 ? level->front : level->back) * c * push);
}

static void move_corner(struct cage *cage, uint16_t corner, struct vec3 to)
{
    cage->value[corner][VALUE_X] = to.x;
    cage->value[corner][VALUE_Y] = to.y;
    cage->value[corner][VALUE_Z] = to.z;
}

static void add_level(struct cage *cage, const struct level *level, int count, uint16_t *ring)
{
    for (int k = 0; k < count; ++k)
        ring[k] = skd_cage_add_vertex(cage, level_point(level, k, count), trunk_marks);
}

/* The two rows above the armpit, which lack the window's inside, and the side of the neck. */
struct shoulder {
    uint16_t armpit[TRUNK], middle[TRUNK], top[TRUNK]; /* middle[3..5] are not used */
    uint16_t neck[HEAD];
};

static uint16_t shoulder_corner(struct cage *cage, double x, double y, double z, double arm)
{
    return skd_cage_add_vertex(cage, vec3(x, y, z), (struct cage_marks){.arm = arm});
}

static void build_shoulder(struct cage *cage, struct shoulder *s)
{
    uint16_t *m = s->middle, *t = s->top;
    m[0] = shoulder_corner(cage, 0, 1.398, 0.098, 0);
    m[1] = shoulder_corner(cage, 0.070, 1.398, 0.102, 0.1);
    m[2] = shoulder_corner(cage, 0.147, 1.384, 0.058, 0.9);
    m[6] = shoulder_corner(cage, 0.150, 1.390, -0.088, 0.9);
    m[7] = shoulder_corner(cage, 0.075, 1.405, -0.118, 0.1);
    m[8] = shoulder_corner(cage, 0, 1.410, -0.104, 0);
    t[0] = shoulder_corner(cage, 0, 1.458, 0.046, 0);
    t[1] = shoulder_corner(cage, 0.050, 1.464, 0.040, 0.15);
    t[2] = shoulder_corner(cage, 0.155, 1.441, 0.036, 0.9);
    t[3] = shoulder_corner(cage, 0.163, 1.455, 0.010, 0.9);
    t[4] = shoulder_corner(cage, 0.166, 1.460, -0.017, 0.9);
    t[5] = shoulder_corner(cage, 0.163, 1.457, -0.046, 0.9);
    t[6] = shoulder_corner(cage, 0.156, 1.445, -0.072, 0.9);
    t[7] = shoulder_corner(cage, 0.058, 1.484, -0.082, 0.15);
    t[8] = shoulder_corner(cage, 0, 1.494, -0.078, 0);
    s->neck[0] = t[0];
    s->neck[1] = t[1];
    s->neck[2] = shoulder_corner(cage, 0.062, 1.480, 0.014, 0.15);
    s->neck[3] = shoulder_corner(cage, 0.070, 1.492, -0.018, 0.15);
    s->neck[4] = shoulder_corner(cage, 0.068, 1.494, -0.050, 0.15);
    s->neck[5] = t[7];
    s->neck[6] = t[8];

    for (int side = 0; side < 2; ++side) {
        int first = side ? 6 : 0;
        skd_cage_bridge(cage, PART_TORSO, s->armpit, m, first, first + 2, TRUNK);
        skd_cage_bridge(cage, PART_TORSO, m, t, first, first + 2, TRUNK);
    }
    for (int k = 0; k < 4; ++k)
        skd_cage_add_face(cage, PART_TORSO, s->neck[k + 1], t[k + 2], t[k + 3], s->neck[k + 2]);
}

static void build_head(struct cage *cage, const uint16_t *neck)
{
    uint16_t ring[HEAD], below[HEAD];
    for (int k = 0; k < HEAD; ++k)
        below[k] = neck[k];
    for (int row = 0; row < HEAD_LEVELS; ++row) {
        add_level(cage, &head_levels[row], HEAD, ring);
        skd_cage_bridge(cage, PART_TORSO, below, ring, 0, HEAD - 1, HEAD);
        for (int k = 0; k < HEAD; ++k)
            below[k] = ring[k];
    }
    uint16_t parting[5] = {ring[0], 0, 0, 0, ring[HEAD - 1]};
    for (int k = 1; k < 4; ++k) {
        double z = 0.034 - 0.034 * (k - 1);
        parting[k] = skd_cage_add_vertex(cage, vec3(0, k == 2 ? 1.751 : 1.748, z), trunk_marks);
    }
    for (int k = 0; k < 4; ++k)
        skd_cage_add_face(cage, PART_TORSO, parting[k], ring[k + 1], ring[k + 2], parting[k + 1]);
}

/* Gives out the lowest ring, on which the leg stands, and the shoulder. */
static void build_trunk(struct cage *cage, uint16_t *lowest, struct shoulder *shoulder)
{
    uint16_t below[TRUNK], ring[TRUNK];
    for (int row = 0; row < TRUNK_LEVELS; ++row) {
        add_level(cage, &trunk_levels[row], TRUNK, ring);
        if (row > 0)
            skd_cage_bridge(cage, PART_TORSO, below, ring, 0, TRUNK - 1, TRUNK);
        for (int k = 0; k < TRUNK; ++k) {
            if (row == 0)
                lowest[k] = ring[k];
            below[k] = ring[k];
        }
    }
    for (int k = 0; k < TRUNK; ++k)
        shoulder->armpit[k] = ring[k];
    for (int k = 2; k <= 6; ++k)
        cage->value[ring[k]][VALUE_ARM] = 0.8;
    move_corner(cage, ring[2], vec3(0.143, 1.328, 0.074));
    move_corner(cage, ring[6], vec3(0.147, 1.336, -0.086));
    build_shoulder(cage, shoulder);
    build_head(cage, shoulder->neck);
}

/* ---- arm and hand -------------------------------------------------------------------------- */

/* A ring around a limb: centre at (along, up, side) in a frame, half sizes. */
struct girth {
    double along, up, side, height, width, box;
};

/* Corner k of an arm's ring; see the picture above. */
static struct vec3 arm_point(const struct frame *frame, const struct girth *girth, int k)
{
    double degrees = 30.0 * (k - 2);
    double s = -sin_degrees(degrees), c = -cos_degrees(degrees);
    double push = 1.0 + girth->box * (1.0 / fmax(fabs(s), fabs(c)) - 1.0);
    return skd_frame_point(frame, girth->along, girth->up + girth->height * c * push,
                           girth->side + girth->width * s * push);
}

static void add_arm_ring(struct cage *cage, const struct frame *frame, const struct girth *girth,
                         uint16_t *ring)
{
    for (int k = 0; k < LIMB; ++k) {
        struct cage_marks marks = arm_marks;
        marks.column = k <= 4 ? k : k == 5 ? 4.0 : k <= 10 ? 10.0 - k : 0.0;
        ring[k] = skd_cage_add_vertex(cage, arm_point(frame, girth, k), marks);
    }
}

static const struct girth upper_arm_girths[] = {
    {0.075, -0.002, 0.000, 0.062, 0.060, 0.0},
    {0.155, -0.001, 0.003, 0.050, 0.053, 0.0},
    {0.235, 0.000, 0.000, 0.042, 0.046, 0.0},
};
static const struct girth forearm_girths[] = {
    {0.000, 0.001, -0.002, 0.041, 0.044, 0.0},
    {0.060, 0.002, 0.002, 0.041, 0.047, 0.0},
    {0.150, 0.001, 0.000, 0.033, 0.038, 0.0},
    {0.244, 0.000, 0.000, 0.0215, 0.0285, 0.1},
};
static const struct girth palm_girths[] = {
    {0.022, 0.000, 0.001, 0.0185, 0.0330, 0.3},
    {0.060, 0.001, 0.000, 0.0165, 0.0410, 0.4},
};

/* The end of the palm: column by column, how far the web reaches. */
static const double web_along[5] = {0.089, 0.1005, 0.1025, 0.0965, 0.080};
static const double web_side[5] = {0.0385, 0.0200, 0.0000, -0.0195, -0.0370};

/* A finger's ring: a hexagon about the frame's axis, in the order of the picture above. */
struct finger_girth {
    const struct frame *frame;
    double along, height, width, point; /* point: how far the sides stand before the rest */
};

static void add_finger_ring(struct cage *cage, const struct finger_girth *girth, double column,
                            int finger, uint16_t *ring)
{
    static const double up[FINGER] = {-0.866, -0.866, 0.0, 0.866, 0.866, 0.0};
    static const double across[FINGER] = {-0.5, 0.5, 1.0, 0.5, -0.5, -1.0};
    for (int k = 0; k < FINGER; ++k) {
        double along = girth->along + (k == 2 || k == 5 ? girth->point : 0.0);
        struct vec3 point =
            skd_frame_point(girth->frame, along, girth->height * up[k], -girth->width * across[k]);
        struct cage_marks marks = {.arm = 1.0};
        marks.thumb = finger == 0;
        marks.finger = finger != 0;
        marks.column = column + (k >= 1 && k <= 3);
        ring[k] = skd_cage_add_vertex(cage, point, marks);
    }
}

/* Where a finger's first ring stands on its first bone: just past the web, so that the gap between
 * two fingers has a round ground. The thumb has none. */
static const double past_web[FINGER_COUNT] = {0.0, 0.0235, 0.0235, 0.0235, 0.0165};

/* From its base ring to its closed tip. radius is the middle joint's. */
static void build_finger(struct cage *cage, const struct anatomy *a, int finger, double radius,
                         const uint16_t *base)
{
    const double column = finger == 0 ? 0.0 : finger - 1;
    const enum cage_part part = PART_FINGER_FIRST + finger;
    const struct frame *last = &a->finger[finger][2];
    double tip = vec3_length(vec3_sub(a->tail[finger_bone(finger, 2)], last->origin));
    const struct finger_girth rows[] = {
        {&a->finger[finger][0], past_web[finger], 1.02 * radius, 0.97 * radius, 0.0},
        {&a->finger[finger][1], finger == 0 ? 0.006 : 0.0, radius, radius, 0.0},
        {last, 0.0, 0.88 * radius, 0.94 * radius, 0.0},
        {last, 0.80 * tip, 0.58 * radius, 0.66 * radius, 0.16 * tip},
    };
    const int row_count = sizeof rows / sizeof *rows;
    uint16_t ring[FINGER], below[FINGER];
    for (int k = 0; k < FINGER; ++k)
        below[k] = base[k];
    for (int row = finger == 0; row < row_count; ++row) {
        add_finger_ring(cage, &rows[row], column, finger, ring);
        skd_cage_bridge(cage, part, below, ring, 0, FINGER, FINGER);
        for (int k = 0; k < FINGER; ++k)
            below[k] = ring[k];
    }
    skd_cage_add_face(cage, part, ring[0], ring[1], ring[2], ring[5]);
    skd_cage_add_face(cage, part, ring[5], ring[2], ring[3], ring[4]);
}

/* The palm's last ring and the three corners between the fingers; one base ring a finger. */
static void build_web(struct cage *cage, const struct frame *hand, const uint16_t *palm,
                      uint16_t base[4][FINGER])
{
    uint16_t bottom[5], middle[5], top[5];
    for (int c = 0; c < 5; ++c) {
        int is_outer = c == 0 || c == 4;
        double along = web_along[c] - (is_outer ? 0.0 : 0.006), height = is_outer ? 0.007 : 0.0095;
        double up = is_outer ? 0.0 : 0.002, side = web_side[c];
        struct cage_marks marks = {.arm = 1.0, .column = c};
        bottom[c] = skd_cage_add_vertex(
            cage, skd_frame_point(hand, along + (is_outer ? 0.0 : 0.004), up - height, side),
            marks);
        top[c] = skd_cage_add_vertex(cage, skd_frame_point(hand, along - 0.004, up + height, side),
                                     marks);
        double edge = c == 0 ? 0.0025 : c == 4 ? -0.0025 : 0.0;
        middle[c] =
            skd_cage_add_vertex(cage, skd_frame_point(hand, web_along[c], up, side + edge), marks);
    }
    uint16_t ring[LIMB];
    for (int c = 0; c < 5; ++c) {
        ring[c] = bottom[c];
        ring[10 - c] = top[c];
    }
    ring[5] = middle[4];
    ring[11] = middle[0];
    skd_cage_bridge(cage, PART_HAND, palm, ring, 0, LIMB, LIMB);
    for (int i = 0; i < 4; ++i) {
        const uint16_t corners[FINGER] = {bottom[i],  bottom[i + 1], middle[i + 1],
                                          top[i + 1], top[i],        middle[i]};
        for (int k = 0; k < FINGER; ++k)
            base[i][k] = corners[k];
    }
}

static void build_hand(struct cage *cage, const struct anatomy *a, const uint16_t *wrist)
{
    static const double radius[FINGER_COUNT] = {0.0115, 0.0092, 0.0096, 0.0090, 0.0079};
    uint16_t near[LIMB], far[LIMB], base[4][FINGER];
    add_arm_ring(cage, &a->hand, &palm_girths[0], near);
    add_arm_ring(cage, &a->hand, &palm_girths[1], far);
    skd_cage_bridge(cage, PART_HAND, wrist, near, 0, LIMB, LIMB);
    skd_cage_bridge(cage, PART_HAND, near, far, 0, 10, LIMB);
    build_web(cage, &a->hand, far, base);
    for (int i = 0; i < 4; ++i)
        build_finger(cage, a, i + 1, radius[i + 1], base[i]);

    const uint16_t thumb[FINGER] = {near[0], far[0], far[11], far[10], near[10], near[11]};
    for (int k = 0; k < FINGER; ++k)
        cage->value[thumb[k]][VALUE_THUMB] = 0.6;
    cage->value[near[1]][VALUE_THUMB] = cage->value[far[1]][VALUE_THUMB] = 0.3;
    build_finger(cage, a, 0, radius[0], thumb);
}

static void build_arm(struct cage *cage, const struct anatomy *a, const struct shoulder *s)
{
    uint16_t below[LIMB] = {s->armpit[2], s->armpit[3], s->armpit[4], s->armpit[5],
                            s->armpit[6], s->middle[6], s->top[6],    s->top[5],
                            s->top[4],    s->top[3],    s->top[2],    s->middle[2]};
    enum { UPPER = 3, LOWER = 4 };
    for (int row = 0; row < UPPER + LOWER; ++row) {
        uint16_t ring[LIMB];
        if (row < UPPER)
            add_arm_ring(cage, &a->upper_arm, &upper_arm_girths[row], ring);
        else
            add_arm_ring(cage, &a->forearm, &forearm_girths[row - UPPER], ring);
        skd_cage_bridge(cage, PART_ARM, below, ring, 0, LIMB, LIMB);
        for (int k = 0; k < LIMB; ++k)
            below[k] = ring[k];
    }
    build_hand(cage, a, below);
}

/* ---- leg and foot -------------------------------------------------------------------------- */

/* A level ring around the leg: centre, half sizes to the left and right, front, back; the front
 * corners 0 and 2 stand this many degrees off the front. */
struct shank {
    double x, y, z, inner, outer, front, back, corner;
};

static const struct shank shanks[] = {
    {0.0930, 0.750, -0.006, 0.080, 0.081, 0.085, 0.088, 30}, /* below the crotch */
    {0.0990, 0.620, 0.003, 0.067, 0.069, 0.074, 0.072, 30},  /* thigh */
    {0.1020, 0.495, 0.004, 0.049, 0.050, 0.055, 0.050, 30},  /* knee */
    {0.1030, 0.435, -0.004, 0.046, 0.049, 0.046, 0.052, 30}, /* below the knee */
    {0.1050, 0.345, -0.016, 0.050, 0.053, 0.041, 0.058, 30}, /* calf */
    {0.1090, 0.200, -0.026, 0.034, 0.036, 0.034, 0.037, 34}, /* above the ankle */
    {0.1110, 0.100, -0.030, 0.031, 0.033, 0.038, 0.034, 46}, /* ankle */
};
enum { SHANKS = sizeof shanks / sizeof *shanks };

/* Corner k of a leg's ring; 1 is the front, 4 the outer side. */
static struct vec3 shank_point(const struct shank *shank, int k)
{
    int step = k <= 7 ? k - 1 : k - 13; /* to the outer side, or below zero to the inner one */
    double degrees = shank->corner * step;
    if (abs(step) > 1)
        degrees = shank->corner + (150.0 - shank->corner) * (abs(step) - 1) / 4.0;
    if (abs(step) == 6)
        degrees = 180.0;
    if (step < -1)
        degrees = -degrees;
    double s = sin_degrees(degrees), c = cos_degrees(degrees);
    return vec3(shank->x + s * (s > 0 ? shank->outer : shank->inner), shank->y,
                shank->z + c * (c > 0 ? shank->front : shank->back));
}

static void add_shank(struct cage *cage, const struct shank *shank, uint16_t *ring)
{
    for (int k = 0; k < LIMB; ++k)
        ring[k] = skd_cage_add_vertex(cage, shank_point(shank, k), leg_marks);
}

/* The front of the foot: rings from the instep to the toes, in the foot's direction. */
struct sole {
    double z, centre, width, top, side, bottom;
};

static const struct sole soles[] = {
    {0.038, 0.1170, 0.036, 0.076, 0.036, 0.003},
    {0.098, 0.1250, 0.047, 0.046, 0.022, -0.002},
    {0.140, 0.1290, 0.046, 0.032, 0.016, -0.001},
    {0.170, 0.1280, 0.034, 0.023, 0.013, 0.003},
};
enum { SOLES = sizeof soles / sizeof *soles };

/* Corners: 0..2 over the instep from the inner side, 3 the outer side, 4..6 below, 7 inner. */
static void add_sole_ring(struct cage *cage, const struct sole *sole, uint16_t *ring)
{
    static const double across[FOOT] = {-0.72, -0.1, 0.66, 1.0, 0.8, 0.0, -0.8, -1.0};
    for (int k = 0; k < FOOT; ++k) {
        double y = k == 3 || k == 7 ? sole->side : k < 3 ? sole->top : sole->bottom;
        if (k == 2)
            y -= 0.25 * (sole->top - sole->side); /* the foot falls off to the outside */
        ring[k] = skd_cage_add_vertex(
            cage, vec3(sole->centre + sole->width * across[k], y, sole->z), leg_marks);
    }
}

static void build_toes(struct cage *cage, const uint16_t *window)
{
    uint16_t ring[FOOT], below[FOOT];
    for (int k = 0; k < FOOT; ++k)
        below[k] = window[k];
    for (int row = 0; row < SOLES; ++row) {
        add_sole_ring(cage, &soles[row], ring);
        skd_cage_bridge(cage, PART_LEG, ring, below, 0, FOOT, FOOT);
        for (int k = 0; k < FOOT; ++k)
            below[k] = ring[k];
    }
    uint16_t tip = skd_cage_add_vertex(cage, vec3(0.126, 0.012, 0.181), leg_marks);
    skd_cage_add_face(cage, PART_LEG, ring[7], tip, ring[1], ring[0]);
    skd_cage_add_face(cage, PART_LEG, tip, ring[3], ring[2], ring[1]);
    skd_cage_add_face(cage, PART_LEG, ring[6], ring[5], tip, ring[7]);
    skd_cage_add_face(cage, PART_LEG, ring[5], ring[4], ring[3], tip);
}

static void build_foot(struct cage *cage, const uint16_t *ankle)
{
    static const struct shank block[] = {
        {0.1115, 0.046, -0.038, 0.033, 0.034, 0.050, 0.048, 66},
        {0.1120, 0.001, -0.034, 0.027, 0.028, 0.046, 0.042, 72},
    };
    uint16_t heel[LIMB], sole[LIMB];
    for (int k = 0; k < LIMB; ++k)
        if (k != 1)
            heel[k] = skd_cage_add_vertex(cage, shank_point(&block[0], k), leg_marks);
    add_shank(cage, &block[1], sole);
    skd_cage_bridge(cage, PART_LEG, heel, ankle, 2, LIMB, LIMB);
    skd_cage_bridge(cage, PART_LEG, sole, heel, 2, LIMB, LIMB);

    uint16_t middle[5] = {sole[1], 0, 0, 0, sole[7]};
    for (int k = 1; k < 4; ++k)
        middle[k] = skd_cage_add_vertex(cage, vec3(0.112, -0.003, -0.004 - 0.018 * k), leg_marks);
    for (int k = 0; k < 4; ++k) {
        skd_cage_add_face(cage, PART_LEG, middle[k], middle[k + 1], sole[k + 3], sole[k + 2]);
        skd_cage_add_face(cage, PART_LEG, sole[(LIMB - k) % LIMB], sole[LIMB - 1 - k],
                          middle[k + 1], middle[k]);
    }
    const uint16_t window[FOOT] = {ankle[0], ankle[1], ankle[2], heel[2],
                                   sole[2],  sole[1],  sole[0],  heel[0]};
    build_toes(cage, window);
}

static void build_leg(struct cage *cage, const uint16_t *lowest)
{
    uint16_t ring[LIMB], above[LIMB];
    for (int k = 0; k < TRUNK; ++k)
        above[k] = lowest[k];
    for (int k = TRUNK; k < LIMB; ++k) {
        double z = -0.045 + 0.034 * (k - TRUNK);
        above[k] = skd_cage_add_vertex(cage, vec3(0, k == 10 ? 0.792 : 0.797, z), trunk_marks);
    }
    for (int row = 0; row < SHANKS; ++row) {
        add_shank(cage, &shanks[row], ring);
        skd_cage_bridge(cage, PART_LEG, ring, above, 0, LIMB, LIMB);
        for (int k = 0; k < LIMB; ++k)
            above[k] = ring[k];
    }
    build_foot(cage, above);
}

void skd_body_build(struct cage *cage, const struct anatomy *anatomy)
{
    uint16_t lowest[TRUNK];
    struct shoulder shoulder;
    build_trunk(cage, lowest, &shoulder);
    build_arm(cage, anatomy, &shoulder);
    build_leg(cage, lowest);
    skd_cage_mirror(cage);
}

/* ---- details ------------------------------------------------------------------------------- */

/* A push by `move` at centre that fades to nothing at the ellipsoid's skin. */
struct form {
    struct vec3 centre, radius, move;
};

static const struct form forms[] = {
    /* face */
    {{0, 1.632, 0.104}, {0.016, 0.036, 0.05}, {0, 0, 0.011}},                /* nose, bridge */
    {{0, 1.611, 0.110}, {0.015, 0.020, 0.05}, {0, -0.002, 0.014}},           /* nose, tip */
    {{0.010, 1.606, 0.105}, {0.011, 0.011, 0.04}, {0.003, 0, 0.006}},        /* nostrils */
    {{0.032, 1.644, 0.090}, {0.024, 0.019, 0.06}, {0, 0, -0.011}},           /* eye sockets */
    {{0.032, 1.643, 0.085}, {0.015, 0.011, 0.06}, {0, 0, 0.007}},            /* eyes */
    {{0.026, 1.664, 0.095}, {0.036, 0.015, 0.05}, {0, 0, 0.005}},            /* brows */
    {{0.046, 1.616, 0.080}, {0.026, 0.022, 0.05}, {0.003, 0, 0.003}},        /* cheekbones */
    {{0, 1.582, 0.104}, {0.025, 0.0075, 0.05}, {0, 0, 0.005}},               /* upper lip */
    {{0, 1.569, 0.102}, {0.022, 0.0080, 0.05}, {0, 0, 0.005}},               /* lower lip */
    {{0, 1.543, 0.094}, {0.024, 0.020, 0.05}, {0, 0, 0.006}},                /* chin */
    {{0.076, 1.634, -0.006}, {0.040, 0.034, 0.020}, {0.017, 0.001, -0.010}}, /* ears */
    /* trunk */
    {{0.075, 1.345, 0.110}, {0.085, 0.075, 0.10}, {0, 0, 0.010}},        /* chest */
    {{0.080, 1.365, -0.125}, {0.060, 0.100, 0.08}, {0, 0, -0.010}},      /* shoulder blades */
    {{0, 1.180, -0.100}, {0.034, 0.300, 0.10}, {0, 0, 0.007}},           /* groove of the spine */
    {{0, 1.180, 0.105}, {0.022, 0.190, 0.06}, {0, 0, -0.002}},           /* groove of the belly */
    {{0, 1.060, 0.100}, {0.011, 0.014, 0.06}, {0, 0, -0.007}},           /* navel */
    {{0.072, 0.885, -0.110}, {0.098, 0.125, 0.14}, {0, -0.004, -0.019}}, /* buttocks */
    {{0, 0.885, -0.110}, {0.022, 0.090, 0.12}, {0, 0, 0.014}},           /* and between */
    {{0.055, 1.462, 0.040}, {0.055, 0.010, 0.05}, {0, 0, 0.003}},        /* collar bones */
    /* legs */
    {{0.102, 0.502, 0.055}, {0.034, 0.042, 0.06}, {0, 0, 0.0035}},   /* kneecaps */
    {{0.144, 0.086, -0.030}, {0.024, 0.026, 0.026}, {0.004, 0, 0}},  /* outer ankle */
    {{0.080, 0.094, -0.026}, {0.024, 0.026, 0.026}, {-0.004, 0, 0}}, /* inner ankle */
};
enum { FORMS = sizeof forms / sizeof *forms };

struct vec3 skd_body_detail(struct vec3 point)
{
    struct vec3 moved = point;
    for (int i = 0; i < FORMS; ++i) {
        const struct form *form = &forms[i];
        double x = (fabs(point.x) - form->centre.x) / form->radius.x;
        double y = (point.y - form->centre.y) / form->radius.y;
        double z = (point.z - form->centre.z) / form->radius.z;
        double fade = 1.0 - (x * x + y * y + z * z);
        if (fade <= 0.0)
            continue;
        fade *= fade;
        moved.x += (point.x < 0 ? -1.0 : 1.0) * form->move.x * fade;
        moved.y += form->move.y * fade;
        moved.z += form->move.z * fade;
    }
    moved.y = fmax(moved.y, 0.0);
    return moved;
}
