/* See clips.h. */
#include "clips.h"

#include <stdlib.h>
#include <string.h>

/* Angles of one bone in degrees. */
struct angles {
    double bend, twist, swing;
};

/* side: SIDE_LEFT, SIDE_RIGHT; SIDE_CENTRE stands for both sides, or for a bone of the middle. */
struct pose_entry {
    enum anatomy_bone kind;
    enum skeleton_side side;
    struct angles angles;
};

struct pose {
    struct vec3 hips; /* added to the hips' place at rest */
    const struct pose_entry *entries;
    uint32_t entry_count;
    struct angles finger[FINGER_COUNT]; /* every joint of a finger, both hands */
};

/* ---- angles to keys ------------------------------------------------------------------------ */

static struct quat turn(double x, double y, double z, double degrees)
{
    double s = sin_degrees(0.5 * degrees);
    return (struct quat){x * s, y * s, z * s, cos_degrees(0.5 * degrees)};
}

/* What one joint of a chain takes of the anatomical bone's angles. */
static struct angles chain_share(const struct skeleton_bone *bone, struct angles angles)
{
    double chain = bone->segment_count;
    double bent = bone->side == SIDE_CENTRE ? 1.0 / chain : bone->segment == 0 ? 1.0 : 0.0;
    return (struct angles){angles.bend * bent, angles.twist / chain, angles.swing * bent};
}

static void write_rotation(const struct skeleton_bone *bone, struct angles angles, float out[4])
{
    double mirror = bone->side == SIDE_RIGHT ? -1.0 : 1.0;
    struct quat swing = turn(0, 0, 1, mirror * angles.swing);
    struct quat bend = turn(1, 0, 0, angles.bend);
    struct quat twist = turn(0, 1, 0, mirror * angles.twist);
    struct quat q = quat_multiply(bone->rest, quat_multiply(swing, quat_multiply(bend, twist)));
    double length = sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    out[0] = (float)(q.x / length);
    out[1] = (float)(q.y / length);
    out[2] = (float)(q.z / length);
    out[3] = (float)(q.w / length);
}

static void write_hips(const struct skeleton_bone *hips, struct vec3 offset, float out[4])
{
    out[0] = (float)(hips->translation[0] + offset.x);
    out[1] = (float)(hips->translation[1] + offset.y);
    out[2] = (float)(hips->translation[2] + offset.z);
}

/* Takes the memory: a rotation for every bone and one track for the hips' place, the last. */
static enum skd_status clip_init(struct clip *clip, const char *name,
                                 const struct skeleton *skeleton, struct skd_error *error)
{
    clip->name = name;
    clip->track_count = skeleton->bone_count + 1;
    clip->track = calloc(clip->track_count, sizeof *clip->track);
    if (clip->track == NULL)
        return skd_fail_memory(error, "the animation clips");
    for (uint32_t b = 0; b < skeleton->bone_count; ++b)
        clip->track[b].bone = b;
    clip->track[skeleton->bone_count].is_translation = 1;
    return SKD_OK;
}

/* ---- poses --------------------------------------------------------------------------------- */

static struct angles pose_angles(const struct pose *pose, const struct skeleton_bone *bone)
{
    int kind = (int)bone->kind;
    if (kind >= BONE_FINGER_FIRST && kind < BONE_THIGH)
        return pose->finger[(kind - BONE_FINGER_FIRST) / PHALANX_COUNT];
    for (uint32_t i = 0; i < pose->entry_count; ++i) {
        const struct pose_entry *entry = &pose->entries[i];
        if (entry->kind == bone->kind && (entry->side == SIDE_CENTRE || entry->side == bone->side))
            return entry->angles;
    }
    return (struct angles){0, 0, 0};
}

static void write_pose(struct clip *clip, const struct skeleton *skeleton, const struct pose *pose,
                       uint32_t key)
{
    for (uint32_t b = 0; b < skeleton->bone_count; ++b)
        write_rotation(&skeleton->bone[b],
                       chain_share(&skeleton->bone[b], pose_angles(pose, &skeleton->bone[b])),
                       clip->track[b].value[key]);
    write_hips(&skeleton->bone[0], pose->hips, clip->track[skeleton->bone_count].value[key]);
}

static const struct pose rest_pose = {.entry_count = 0};

#define COUNT_OF(array) (sizeof(array) / sizeof *(array))

static const struct pose_entry crouch_entries[] = {
    {BONE_SPINE, SIDE_CENTRE, {18, 14, 0}},      {BONE_CHEST, SIDE_CENTRE, {10, 14, 0}},
    {BONE_UPPER_CHEST, SIDE_CENTRE, {5, 14, 0}}, {BONE_NECK, SIDE_CENTRE, {-12, -18, 0}},
    {BONE_HEAD, SIDE_CENTRE, {-10, -15, 0}},     {BONE_UPPER_ARM, SIDE_CENTRE, {35, 0, -25}},
    {BONE_FOREARM, SIDE_CENTRE, {105, 0, 0}},    {BONE_HAND, SIDE_CENTRE, {40, 0, 0}},
    {BONE_THIGH, SIDE_CENTRE, {75, 0, 0}},       {BONE_SHIN, SIDE_CENTRE, {105, 0, 0}},
    {BONE_FOOT, SIDE_CENTRE, {28, 0, 0}},        {BONE_JAW, SIDE_CENTRE, {10, 0, 0}},
};
static const struct pose crouch_pose = {
    .hips = {0, -0.388, -0.18},
    .entries = crouch_entries,
    .entry_count = COUNT_OF(crouch_entries),
    .finger = {{25, 0, 0}, {72, 0, 0}, {74, 0, 0}, {74, 0, 0}, {72, 0, 0}},
};

static const struct pose_entry kick_entries[] = {
    {BONE_SPINE, SIDE_CENTRE, {-8, -12, 0}},    {BONE_CHEST, SIDE_CENTRE, {-5, -12, 0}},
    {BONE_UPPER_ARM, SIDE_LEFT, {-20, 0, -35}}, {BONE_UPPER_ARM, SIDE_RIGHT, {60, 0, 10}},
    {BONE_FOREARM, SIDE_LEFT, {60, 40, 0}},     {BONE_FOREARM, SIDE_RIGHT, {120, -40, 0}},
    {BONE_HAND, SIDE_CENTRE, {-35, 0, 0}},      {BONE_THIGH, SIDE_LEFT, {80, 0, 0}},
    {BONE_SHIN, SIDE_LEFT, {110, 0, 0}},        {BONE_FOOT, SIDE_LEFT, {-30, 0, 0}},
    {BONE_TOE, SIDE_CENTRE, {25, 0, 0}},
};
static const struct pose kick_pose = {
    .entries = kick_entries,
    .entry_count = COUNT_OF(kick_entries),
    .finger = {{10, 0, 0}, {20, 0, 0}, {30, 0, 0}, {40, 0, 0}, {50, 0, 0}},
};

static const struct pose_entry overhead_entries[] = {
    {BONE_SPINE, SIDE_CENTRE, {-6, 0, 4}},       {BONE_CHEST, SIDE_CENTRE, {-6, 0, 4}},
    {BONE_UPPER_CHEST, SIDE_CENTRE, {-4, 0, 3}}, {BONE_NECK, SIDE_CENTRE, {-15, 0, 0}},
    {BONE_HEAD, SIDE_CENTRE, {-15, 0, 0}},       {BONE_CLAVICLE, SIDE_CENTRE, {22, 0, 0}},
    {BONE_UPPER_ARM, SIDE_CENTRE, {15, 0, 85}},  {BONE_FOREARM, SIDE_CENTRE, {15, 30, 0}},
    {BONE_HAND, SIDE_CENTRE, {-15, 0, 0}},       {BONE_THIGH, SIDE_RIGHT, {-18, 0, 0}},
    {BONE_SHIN, SIDE_RIGHT, {12, 0, 0}},         {BONE_TOE, SIDE_RIGHT, {25, 0, 0}},
};
static const struct pose overhead_pose = {
    .entries = overhead_entries,
    .entry_count = COUNT_OF(overhead_entries),
    .finger = {{-8, 0, 0}, {-4, 0, 0}, {-4, 0, 0}, {-4, 0, 0}, {-4, 0, 0}},
};

static const struct pose_entry floor_entries[] = {
    {BONE_HIPS, SIDE_CENTRE, {55, 0, 0}},      {BONE_SPINE, SIDE_CENTRE, {25, 0, 0}},
    {BONE_CHEST, SIDE_CENTRE, {20, 0, 0}},     {BONE_UPPER_CHEST, SIDE_CENTRE, {15, 0, 0}},
    {BONE_NECK, SIDE_CENTRE, {-15, 0, 0}},     {BONE_CLAVICLE, SIDE_CENTRE, {-8, 0, 0}},
    {BONE_UPPER_ARM, SIDE_CENTRE, {95, 0, 0}}, {BONE_FOREARM, SIDE_CENTRE, {5, 0, 0}},
    {BONE_THIGH, SIDE_CENTRE, {62, 0, 0}},     {BONE_SHIN, SIDE_CENTRE, {12, 0, 0}},
    {BONE_FOOT, SIDE_CENTRE, {5, 0, 0}},
};
static const struct pose floor_pose = {
    .hips = {0, -0.02, -0.02},
    .entries = floor_entries,
    .entry_count = COUNT_OF(floor_entries),
    .finger = {{15, 0, 0}, {12, 0, 0}, {12, 0, 0}, {12, 0, 0}, {12, 0, 0}},
};

/* One pose a second, from rest back to rest. */
static void write_poses(struct clip *clip, const struct skeleton *skeleton,
                        const struct pose *const *poses, uint32_t pose_count)
{
    clip->times_count = 1;
    clip->times[0].key_count = pose_count;
    for (uint32_t key = 0; key < pose_count; ++key) {
        clip->times[0].time[key] = (float)key;
        write_pose(clip, skeleton, poses[key], key);
    }
}

/* ---- walk ---------------------------------------------------------------------------------- */

enum { WALK_STEPS = 8 }; /* eighths of a cycle; a second in all */

/* The left side from its heel strike; the right side is half a cycle behind. */
static const double walk_thigh[WALK_STEPS] = {26, 20, 8, -4, -12, 2, 22, 30};
static const double walk_shin[WALK_STEPS] = {6, 18, 12, 8, 22, 56, 58, 22};
static const double walk_foot[WALK_STEPS] = {0, -6, 4, 8, -10, -14, 0, 4};
static const double walk_toe[WALK_STEPS] = {4, 0, 0, 8, 40, 10, 4, 6};
static const double walk_arm[WALK_STEPS] = {-22, -15, 0, 15, 22, 15, 0, -15};
static const double walk_elbow[WALK_STEPS] = {8, 9, 12, 16, 20, 16, 12, 9};
static const double walk_sway[WALK_STEPS] = {1.0, 0.7, 0, -0.7, -1.0, -0.7, 0, 0.7};
static const double walk_height[WALK_STEPS] = {-0.0145, -0.0155, -0.0085, -0.0070,
                                               -0.0145, -0.0155, -0.0085, -0.0070};

static struct angles walk_angles(const struct skeleton_bone *bone, uint32_t step)
{
    uint32_t phase = (step + (bone->side == SIDE_RIGHT ? WALK_STEPS / 2 : 0)) % WALK_STEPS;
    switch ((int)bone->kind) {
    case BONE_HIPS:
        return (struct angles){0, -5 * walk_sway[phase], 0};
    case BONE_SPINE:
    case BONE_CHEST:
        return (struct angles){1, 4 * walk_sway[phase], 0};
    case BONE_UPPER_CHEST:
        return (struct angles){1, 3 * walk_sway[phase], 0};
    case BONE_NECK:
        return (struct angles){0, -5 * walk_sway[phase], 0};
    case BONE_UPPER_ARM:
        return (struct angles){walk_arm[phase], 0, -40};
    case BONE_FOREARM:
        return (struct angles){walk_elbow[phase], 0, 0};
    case BONE_THIGH:
        return (struct angles){walk_thigh[phase], 0, 0};
    case BONE_SHIN:
        return (struct angles){walk_shin[phase], 0, 0};
    case BONE_FOOT:
        return (struct angles){walk_foot[phase], 0, 0};
    case BONE_TOE:
        return (struct angles){walk_toe[phase], 0, 0};
    default:
        break;
    }
    if (bone->kind >= BONE_FINGER_FIRST && bone->kind < BONE_FINGER_FIRST + PHALANX_COUNT)
        return (struct angles){6, 0, 0};
    if (bone->kind >= BONE_FINGER_FIRST && bone->kind < BONE_THIGH)
        return (struct angles){18, 0, 0};
    return (struct angles){0, 0, 0};
}

static void write_walk(struct clip *clip, const struct skeleton *skeleton)
{
    clip->times_count = 1;
    clip->times[0].key_count = WALK_STEPS + 1;
    for (uint32_t key = 0; key <= WALK_STEPS; ++key) {
        uint32_t step = key % WALK_STEPS; /* the last key is the first again */
        clip->times[0].time[key] = (float)key / WALK_STEPS;
        for (uint32_t b = 0; b < skeleton->bone_count; ++b)
            write_rotation(&skeleton->bone[b],
                           chain_share(&skeleton->bone[b], walk_angles(&skeleton->bone[b], step)),
                           clip->track[b].value[key]);
        write_hips(&skeleton->bone[0], vec3(0, walk_height[step], 0),
                   clip->track[skeleton->bone_count].value[key]);
    }
}

/* ---- range of motion ----------------------------------------------------------------------- */

/* Degrees that a joint can do; the further joints of a limb's chain only twist. */
static const struct angles motions[BONE_COUNT] = {
    [BONE_HIPS] = {25, 0, 25},        [BONE_SPINE] = {28, 0, 25},   [BONE_CHEST] = {28, 0, 25},
    [BONE_UPPER_CHEST] = {25, 0, 25}, [BONE_NECK] = {30, 0, 25},    [BONE_HEAD] = {30, 0, 28},
    [BONE_JAW] = {25, 0, 0},          [BONE_CLAVICLE] = {25, 0, 0}, [BONE_UPPER_ARM] = {60, 0, 45},
    [BONE_FOREARM] = {60, 40, 0},     [BONE_HAND] = {50, 0, 25},    [BONE_THIGH] = {60, 0, 30},
    [BONE_SHIN] = {60, 0, 0},         [BONE_FOOT] = {-30, 0, 25},   [BONE_TOE] = {35, 0, 0},
};
static const struct angles motion_of_finger = {55, 0, 0};
static const struct angles motion_of_twist = {0, 30, 0};

static struct angles motion_of(const struct skeleton_bone *bone)
{
    if (bone->side != SIDE_CENTRE && bone->segment > 0)
        return motion_of_twist;
    if (bone->kind >= BONE_FINGER_FIRST && bone->kind < BONE_THIGH)
        return motion_of_finger;
    return motions[bone->kind];
}

/* Each joint moves for two seconds out of nine and a half, its neighbours at other times: rest,
 * a bend, rest, a swing or twist on half a bend, rest. */
static void write_motion(struct clip *clip, const struct skeleton *skeleton)
{
    enum { KEYS = 6 };
    static const float offsets[KEYS] = {0.0f, 0.5f, 1.0f, 1.5f, 2.0f, 2.5f};
    clip->times_count = CLIP_MAX_TIMES;
    for (uint32_t slot = 0; slot < CLIP_MAX_TIMES; ++slot) {
        clip->times[slot].key_count = KEYS;
        for (uint32_t key = 1; key < KEYS; ++key)
            clip->times[slot].time[key] = (float)slot + offsets[key];
    }
    for (uint32_t b = 0; b < skeleton->bone_count; ++b) {
        const struct skeleton_bone *bone = &skeleton->bone[b];
        struct angles motion = motion_of(bone);
        const struct angles rest = {0, 0, 0}, bend = {motion.bend, 0, 0};
        const struct angles swing = {0.4 * motion.bend, motion.twist, motion.swing};
        const struct angles keys[KEYS] = {rest, rest, bend, rest, swing, rest};
        clip->track[b].times = b % CLIP_MAX_TIMES;
        for (uint32_t key = 0; key < KEYS; ++key)
            write_rotation(bone, keys[key], clip->track[b].value[key]);
    }
    for (uint32_t key = 0; key < KEYS; ++key)
        write_hips(&skeleton->bone[0], vec3(0, 0, 0), clip->track[skeleton->bone_count].value[key]);
}

/* -------------------------------------------------------------------------------------------- */

enum skd_status skd_clips_init(struct clip clips[CLIP_COUNT], const struct skeleton *skeleton,
                               struct skd_error *error)
{
    static const char *const names[CLIP_COUNT] = {"walk", "bend", "reach", "range_of_motion"};
    static const struct pose *const bend[] = {&rest_pose, &crouch_pose, &kick_pose, &rest_pose};
    static const struct pose *const reach[] = {&rest_pose, &overhead_pose, &floor_pose, &rest_pose};
    memset(clips, 0, CLIP_COUNT * sizeof *clips);
    for (int i = 0; i < CLIP_COUNT; ++i) {
        enum skd_status status = clip_init(&clips[i], names[i], skeleton, error);
        if (status != SKD_OK)
            return status;
    }
    write_walk(&clips[0], skeleton);
    write_poses(&clips[1], skeleton, bend, COUNT_OF(bend));
    write_poses(&clips[2], skeleton, reach, COUNT_OF(reach));
    write_motion(&clips[3], skeleton);
    return SKD_OK;
}

void skd_clips_finish(struct clip clips[CLIP_COUNT])
{
    for (int i = 0; i < CLIP_COUNT; ++i)
        free(clips[i].track);
}
