/* See weights.h. */
#include "weights.h"

#include <string.h>

/* Influences below this are dropped: nobody sees them, and they would cost a slot. */
static const double least_weight = 1.0 / 1024.0;

/* ---- cutting planes ------------------------------------------------------------------------ */

/* Half the width of the blend at a bone's head, in metres. */
static const double head_bands[BONE_COUNT] = {
    [BONE_SPINE] = 0.050,    [BONE_CHEST] = 0.050,     [BONE_UPPER_CHEST] = 0.050,
    [BONE_NECK] = 0.032,     [BONE_HEAD] = 0.030,      [BONE_JAW] = 0.014,
    [BONE_CLAVICLE] = 0.060, [BONE_UPPER_ARM] = 0.055, [BONE_FOREARM] = 0.042,
    [BONE_HAND] = 0.024,     [BONE_THIGH] = 0.070,     [BONE_SHIN] = 0.060,
    [BONE_FOOT] = 0.032,     [BONE_TOE] = 0.022,
};

/* Planes that are not the bisector of a bone and its parent, on the left side; zero: the bisector.
 */
static const struct vec3 head_normals[BONE_COUNT] = {
    [BONE_SPINE] = {0, 1, 0},      [BONE_CHEST] = {0, 1, 0},        [BONE_UPPER_CHEST] = {0, 1, 0},
    [BONE_NECK] = {0, 0.94, 0.34}, [BONE_HEAD] = {0, 0.82, 0.57},   [BONE_JAW] = {0, -0.96, -0.28},
    [BONE_CLAVICLE] = {1, 0, 0},   [BONE_THIGH] = {0.45, -0.89, 0}, [BONE_FOOT] = {0, -0.97, 0.24},
};

static double finger_band(int kind)
{
    int finger = (kind - BONE_FINGER_FIRST) / PHALANX_COUNT;
    int phalanx = (kind - BONE_FINGER_FIRST) % PHALANX_COUNT;
    static const double thumb[PHALANX_COUNT] = {0.020, 0.011, 0.008};
    static const double other[PHALANX_COUNT] = {0.012, 0.008, 0.0065};
    return finger == 0 ? thumb[phalanx] : other[phalanx];
}

static struct weight_cut make_cut(const struct skeleton *skeleton, uint32_t index)
{
    const struct skeleton_bone *bone = &skeleton->bone[index];
    struct weight_cut cut = {bone->head, bone->along, 0.5 * bone->length};
    if (bone->segment > 0 || bone->parent < 0)
        return cut;
    struct vec3 normal = head_normals[bone->kind];
    if (vec3_dot(normal, normal) == 0.0)
        normal = vec3_add(bone->along, skeleton->bone[bone->parent].along);
    else if (bone->side == SIDE_RIGHT)
        normal.x = -normal.x;
    cut.normal = vec3_unit(normal);
    int is_finger = bone->kind >= BONE_FINGER_FIRST && bone->kind < BONE_THIGH;
    cut.half_band = is_finger ? finger_band(bone->kind) : head_bands[bone->kind];
    return cut;
}

/* ---- which bones move which part ----------------------------------------------------------- */

static void list_chain(struct weight_list *list, const struct skeleton *skeleton, int kind,
                       enum skeleton_side side)
{
    if (skeleton->first[kind][side] < 0)
        return;
    for (int bone = skeleton->first[kind][side]; bone <= skeleton->last[kind][side]; ++bone)
        list->bone[list->count++] = (uint8_t)bone;
}

static void list_root(struct weight_list *list, const struct skeleton *skeleton, int kind,
                      enum skeleton_side side)
{
    list->root = (uint8_t)skeleton->last[kind][side];
}

/* The blend at the wrist reaches the thumb's root. */
static void list_up_to_hand(struct weight_list *list, const struct skeleton *skeleton,
                            enum skeleton_side side)
{
    list_root(list, skeleton, BONE_UPPER_ARM, side);
    list_chain(list, skeleton, BONE_FOREARM, side);
    list_chain(list, skeleton, BONE_HAND, side);
}

static void make_lists(struct weight_model *model, enum skeleton_side side)
{
    const struct skeleton *skeleton = model->skeleton;
    const int is_right = side == SIDE_RIGHT;
    const enum skeleton_side other = is_right ? SIDE_LEFT : SIDE_RIGHT;

    struct weight_list *torso = &model->list[PART_TORSO][is_right];
    list_root(torso, skeleton, BONE_HIPS, side);
    for (int kind = BONE_SPINE; kind < BONE_CENTRE_COUNT; ++kind)
        list_chain(torso, skeleton, kind, SIDE_CENTRE);
    list_chain(torso, skeleton, BONE_CLAVICLE, side);
    list_chain(torso, skeleton, BONE_UPPER_ARM, side);
    list_chain(torso, skeleton, BONE_THIGH, side);
    list_chain(torso, skeleton, BONE_THIGH, other);

    struct weight_list *arm = &model->list[PART_ARM][is_right];
    list_root(arm, skeleton, BONE_UPPER_CHEST, side);
    for (int kind = BONE_CLAVICLE; kind <= BONE_HAND; ++kind)
        list_chain(arm, skeleton, kind, side);

    struct weight_list *hand = &model->list[PART_HAND][is_right];
    list_up_to_hand(hand, skeleton, side);
    for (int finger = 0; finger < FINGER_COUNT; ++finger)
        list_chain(hand, skeleton, finger_bone(finger, 0), side);
    list_chain(hand, skeleton, finger_bone(0, 1), side); /* the thumb's web */

    for (int finger = 0; finger < FINGER_COUNT; ++finger) {
        struct weight_list *list = &model->list[PART_FINGER_FIRST + finger][is_right];
        list_up_to_hand(list, skeleton, side);
        for (int phalanx = 0; phalanx < PHALANX_COUNT; ++phalanx)
            list_chain(list, skeleton, finger_bone(finger, phalanx), side);
        for (int next = 1; finger > 0 && next < FINGER_COUNT; ++next)
            if (next == finger - 1 || next == finger + 1)
                list_chain(list, skeleton, finger_bone(next, 0), side);
    }

    struct weight_list *leg = &model->list[PART_LEG][is_right];
    list_root(leg, skeleton, BONE_HIPS, side);
    for (int kind = BONE_THIGH; kind < BONE_COUNT; ++kind)
        list_chain(leg, skeleton, kind, side);
    list_chain(leg, skeleton, BONE_THIGH, other);
}

void skd_weights_init(struct weight_model *model, const struct skeleton *skeleton)
{
    memset(model, 0, sizeof *model);
    model->skeleton = skeleton;
    for (uint32_t bone = 0; bone < skeleton->bone_count; ++bone)
        model->cut[bone] = make_cut(skeleton, bone);
    make_lists(model, SIDE_LEFT);
    make_lists(model, SIDE_RIGHT);
}

/* ---- one point ----------------------------------------------------------------------------- */

struct weight_point {
    enum cage_part part;
    enum skeleton_side side;
    struct vec3 position;
    const double *value;
};

/* How much of the palm's or a finger's point belongs to finger 1..4: by the column across the hand
 * up to the web, by the finger alone beyond it. */
static double finger_share(const struct weight_point *point, int finger)
{
    double column = point->value[VALUE_COLUMN];
    double off = column - (finger - 0.5);
    if ((finger == 1 && off < 0) || (finger == FINGER_COUNT - 1 && off > 0))
        off = 0.0;
    double across = smooth_step((0.75 - fabs(off)) / 0.5);
    double own = point->part == (enum cage_part)(PART_FINGER_FIRST + finger);
    double past_web = smooth_step(4.0 * point->value[VALUE_FINGER] - 1.35);
    return across + (own - across) * past_web;
}

/* Near the crotch both thighs share; further down each leg is its own. */
static double thigh_share(const struct weight_point *point, enum skeleton_side side)
{
    double x = side == SIDE_RIGHT ? -point->position.x : point->position.x;
    double across = smooth_step((x + 0.030) / 0.075);
    double own = side == point->side;
    return across + (own - across) * smooth_step(2.4 * point->value[VALUE_LEG] - 1.0);
}

/* What holds a bone's reach back besides its plane: 1 nothing, 0 all. */
static double share(const struct skeleton_bone *bone, const struct weight_point *point)
{
    const double *value = point->value;
    if (bone->segment > 0)
        return 1.0;
    switch ((int)bone->kind) {
    case BONE_NECK:
        return smooth_step((0.125 - fabs(point->position.x)) / 0.07);
    case BONE_JAW:
        return smooth_step((point->position.z - 0.030) / 0.045);
    case BONE_CLAVICLE:
        return smooth_step(1.7 * value[VALUE_ARM] - 0.15);
    case BONE_UPPER_ARM:
        return smooth_step(1.4 * value[VALUE_ARM] - 0.4);
    case BONE_THIGH:
        return thigh_share(point, bone->side);
    default:
        break;
    }
    if (bone->kind < BONE_FINGER_FIRST || bone->kind >= BONE_THIGH)
        return 1.0;
    int finger = ((int)bone->kind - BONE_FINGER_FIRST) / PHALANX_COUNT;
    if (((int)bone->kind - BONE_FINGER_FIRST) % PHALANX_COUNT > 0)
        return 1.0;
    return finger == 0 ? smooth_step(1.4 * value[VALUE_THUMB] - 0.2) : finger_share(point, finger);
}

/* The share of the point past the bone's plane. The clavicle and the thumb's first bone lie inside
 * the body: their marks alone say what is theirs. */
static double past_plane(const struct weight_cut *cut, const struct skeleton_bone *bone,
                         const struct weight_point *point)
{
    int by_marks = bone->kind == BONE_CLAVICLE || bone->kind == BONE_FINGER_FIRST;
    if (by_marks && bone->segment == 0)
        return 1.0;
    double distance = vec3_dot(vec3_sub(point->position, cut->origin), cut->normal);
    return smooth_step(0.5 + 0.5 * distance / cut->half_band);
}

/* The arm hangs on the whole of the chest, however many bones that has: the clavicle takes from all
 * of them alike. */
static void take_from_all(const uint8_t *bones, int count, double *own, double taken)
{
    for (int i = 0; i < count; ++i)
        own[bones[i]] *= 1.0 - taken;
}

/* Keeps the four largest of weight[bones]; ties go to the earlier bone. */
static int choose_largest(const uint8_t *bones, int count, const double *weight,
                          uint8_t chosen[INFLUENCE_COUNT])
{
    int chosen_count = 0;
    for (int i = 0; i < count; ++i) {
        double w = weight[bones[i]];
        if (w < least_weight)
            continue;
        int place = chosen_count < INFLUENCE_COUNT ? chosen_count++ : INFLUENCE_COUNT;
        while (place > 0 && weight[chosen[place - 1]] < w) {
            if (place < INFLUENCE_COUNT)
                chosen[place] = chosen[place - 1];
            --place;
        }
        if (place < INFLUENCE_COUNT)
            chosen[place] = bones[i];
    }
    return chosen_count;
}

/* Rounds the smaller ones and gives the largest the exact rest. */
static void normalise(const uint8_t *chosen, int count, const double *weight,
                      uint8_t joint[INFLUENCE_COUNT], float out[INFLUENCE_COUNT])
{
    double sum = 0.0;
    for (int i = 0; i < count; ++i)
        sum += weight[chosen[i]];
    float rest = 1.0f;
    for (int i = INFLUENCE_COUNT - 1; i > 0; --i) {
        joint[i] = i < count ? chosen[i] : 0;
        /* 2^-20 steps: the rest, and any sum of the four, is then exact in float32. */
        out[i] =
            i < count ? (float)(nearbyint(weight[chosen[i]] / sum * 1048576.0) / 1048576.0) : 0.0f;
        rest -= out[i];
    }
    joint[0] = chosen[0];
    out[0] = rest;
}

void skd_weights_at(const struct weight_model *model, enum cage_part part, int is_right,
                    struct vec3 position, const double value[VALUE_COUNT],
                    uint8_t joint[INFLUENCE_COUNT], float weight[INFLUENCE_COUNT])
{
    const struct weight_list *list = &model->list[part][is_right];
    const struct weight_point point = {part, is_right ? SIDE_RIGHT : SIDE_LEFT, position, value};
    double reach[SKELETON_MAX_BONES], own[SKELETON_MAX_BONES];
    uint8_t reached[SKELETON_MAX_BONES];
    int reached_count = 0;

    for (int i = 0; i < list->count; ++i)
        reach[list->bone[i]] = 0.0;
    reach[list->root] = own[list->root] = 1.0;
    reached[reached_count++] = list->root;
    for (int i = 0; i < list->count; ++i) {
        uint8_t index = list->bone[i];
        const struct skeleton_bone *bone = &model->skeleton->bone[index];
        const int is_arm_root = bone->kind == BONE_CLAVICLE;
        double room = is_arm_root ? 1.0 : reach[bone->parent];
        double past = room == 0.0 ? 0.0 : past_plane(&model->cut[index], bone, &point);
        if (past == 0.0)
            continue;
        reach[index] = own[index] = room * past * share(bone, &point);
        if (is_arm_root)
            take_from_all(reached, reached_count, own, reach[index]);
        else
            own[bone->parent] -= reach[index];
        reached[reached_count++] = index;
    }
    uint8_t chosen[INFLUENCE_COUNT] = {0};
    int count = choose_largest(reached, reached_count, own, chosen);
    normalise(chosen, count, own, joint, weight);
}
