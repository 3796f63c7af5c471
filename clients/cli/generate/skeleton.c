/* See skeleton.h. */
#include "skeleton.h"

#include <stdio.h>
#include <string.h>

#include "base/error.h"

struct bone_kind {
    const char *name;
    int8_t parent;
    uint8_t is_whole; /* is never cut into a chain */
};

static const struct bone_kind bone_kinds[BONE_COUNT] = {
    [BONE_HIPS] = {"hips", -1, 1},
    [BONE_SPINE] = {"spine", BONE_HIPS, 0},
    [BONE_CHEST] = {"chest", BONE_SPINE, 0},
    [BONE_UPPER_CHEST] = {"upper_chest", BONE_CHEST, 0},
    [BONE_NECK] = {"neck", BONE_UPPER_CHEST, 0},
    [BONE_HEAD] = {"head", BONE_NECK, 1},
    [BONE_JAW] = {"jaw", BONE_HEAD, 1},
    [BONE_CLAVICLE] = {"clavicle", BONE_UPPER_CHEST, 1},
    [BONE_UPPER_ARM] = {"upper_arm", BONE_CLAVICLE, 0},
    [BONE_FOREARM] = {"forearm", BONE_UPPER_ARM, 0},
    [BONE_HAND] = {"hand", BONE_FOREARM, 1},
    [BONE_THIGH] = {"thigh", BONE_HIPS, 0},
    [BONE_SHIN] = {"shin", BONE_THIGH, 0},
    [BONE_FOOT] = {"foot", BONE_SHIN, 1},
    [BONE_TOE] = {"toe", BONE_FOOT, 1},
};

static const char *const finger_names[FINGER_COUNT] = {"thumb", "index", "middle", "ring", "pinky"};

static int is_finger(int kind)
{
    return kind >= BONE_FINGER_FIRST && kind < BONE_THIGH;
}

static int parent_kind(int kind)
{
    if (!is_finger(kind))
        return bone_kinds[kind].parent;
    return (kind - BONE_FINGER_FIRST) % PHALANX_COUNT == 0 ? BONE_HAND : kind - 1;
}

static int is_centre(int kind)
{
    return kind < BONE_CENTRE_COUNT;
}

/* ---- which bones --------------------------------------------------------------------------- */

static void drop_pairs(uint32_t *segments, uint32_t pair_count)
{
    int order[3 * FINGER_COUNT + 1], count = 0;
    for (int phalanx = PHALANX_COUNT - 1; phalanx >= 0; --phalanx) {
        if (phalanx == 0)
            order[count++] = BONE_TOE;
        for (int finger = FINGER_COUNT - 1; finger >= 0; --finger)
            order[count++] = finger_bone(finger, phalanx);
    }
    for (uint32_t i = 0; i < pair_count; ++i)
        segments[order[i]] = 0;
}

static void cut_longest(const struct anatomy *anatomy, uint32_t *segments, uint32_t spare)
{
    while (spare > 0) {
        int longest = -1;
        double length = 0.0;
        for (int kind = 0; kind < BONE_COUNT; ++kind) {
            if ((!is_finger(kind) && bone_kinds[kind].is_whole) || (!is_centre(kind) && spare < 2))
                continue;
            double piece =
                vec3_length(vec3_sub(anatomy->tail[kind], anatomy->head[kind])) / segments[kind];
            if (piece > length) {
                length = piece;
                longest = kind;
            }
        }
        segments[longest]++;
        spare -= is_centre(longest) ? 1 : 2;
    }
}

static void choose_bones(const struct anatomy *anatomy, uint32_t bone_count, uint32_t *segments)
{
    enum { WHOLE_FIGURE = 2 * BONE_COUNT - BONE_CENTRE_COUNT };
    for (int kind = 0; kind < BONE_COUNT; ++kind)
        segments[kind] = 1;
    if (bone_count >= WHOLE_FIGURE) {
        cut_longest(anatomy, segments, bone_count - WHOLE_FIGURE);
        return;
    }
    uint32_t missing = WHOLE_FIGURE - bone_count;
    if (missing % 2 == 1)
        segments[BONE_JAW] = 0;
    drop_pairs(segments, missing / 2);
}

/* ---- transforms ---------------------------------------------------------------------------- */

/* The rotation that takes the axes to x, y, z (orthonormal, right-handed); Shepperd's method. */
static struct quat quat_from_axes(struct vec3 x, struct vec3 y, struct vec3 z)
{
    const double m[3][3] = {{x.x, y.x, z.x}, {x.y, y.y, z.y}, {x.z, y.z, z.z}};
    double trace = m[0][0] + m[1][1] + m[2][2];
    double q[4]; /* x y z w */
    if (trace > 0) {
        double s = 2.0 * sqrt(1.0 + trace);
        q[0] = (m[2][1] - m[1][2]) / s;
        q[1] = (m[0][2] - m[2][0]) / s;
        q[2] = (m[1][0] - m[0][1]) / s;
        q[3] = 0.25 * s;
    } else {
        int i = m[0][0] >= m[1][1] && m[0][0] >= m[2][2] ? 0 : m[1][1] >= m[2][2] ? 1 : 2;
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double s = 2.0 * sqrt(1.0 + m[i][i] - m[j][j] - m[k][k]);
        q[i] = 0.25 * s;
        q[j] = (m[j][i] + m[i][j]) / s;
        q[k] = (m[k][i] + m[i][k]) / s;
        q[3] = (m[k][j] - m[j][k]) / s;
    }
    return (struct quat){q[0], q[1], q[2], q[3]};
}

static void write_inverse_bind(struct skeleton_bone *bone, struct quat world, struct vec3 head)
{
    struct quat back = quat_conjugate(world);
    const struct vec3 columns[4] = {
        quat_rotate(back, vec3(1, 0, 0)), quat_rotate(back, vec3(0, 1, 0)),
        quat_rotate(back, vec3(0, 0, 1)), quat_rotate(back, vec3_scale(head, -1.0))};
    for (int c = 0; c < 4; ++c) {
        bone->inverse_bind[4 * c] = (float)columns[c].x;
        bone->inverse_bind[4 * c + 1] = (float)columns[c].y;
        bone->inverse_bind[4 * c + 2] = (float)columns[c].z;
        bone->inverse_bind[4 * c + 3] = c == 3 ? 1.0f : 0.0f;
    }
}

/* Local transforms are rounded first and the chain is walked with the rounded ones, so that the
 * inverse binds undo what a reader computes. */
static void pose_at_rest(struct skeleton *skeleton, const struct anatomy *anatomy)
{
    struct quat world[SKELETON_MAX_BONES];
    struct vec3 place[SKELETON_MAX_BONES];
    for (uint32_t b = 0; b < skeleton->bone_count; ++b) {
        struct skeleton_bone *bone = &skeleton->bone[b];
        struct vec3 hinge = anatomy->hinge[bone->kind];
        if (bone->side == SIDE_RIGHT)
            hinge = vec3(hinge.x, -hinge.y, -hinge.z);
        struct quat wanted = quat_from_axes(hinge, bone->along, vec3_cross(hinge, bone->along));
        struct quat parent = {0, 0, 0, 1};
        struct vec3 origin = vec3(0, 0, 0);
        if (bone->parent >= 0) {
            parent = world[bone->parent];
            origin = place[bone->parent];
        }
        struct quat local = quat_normalise(quat_multiply(quat_conjugate(parent), wanted));
        struct vec3 offset = quat_rotate(quat_conjugate(parent), vec3_sub(bone->head, origin));
        bone->rotation[0] = (float)local.x;
        bone->rotation[1] = (float)local.y;
        bone->rotation[2] = (float)local.z;
        bone->rotation[3] = (float)local.w;
        bone->translation[0] = (float)offset.x;
        bone->translation[1] = (float)offset.y;
        bone->translation[2] = (float)offset.z;
        bone->rest = (struct quat){bone->rotation[0], bone->rotation[1], bone->rotation[2],
                                   bone->rotation[3]};
        offset = vec3(bone->translation[0], bone->translation[1], bone->translation[2]);
        world[b] = quat_normalise(quat_multiply(parent, bone->rest));
        place[b] = vec3_add(origin, quat_rotate(parent, offset));
        write_inverse_bind(bone, world[b], place[b]);
    }
}

/* ---- bones --------------------------------------------------------------------------------- */

static void name_bone(struct skeleton_bone *bone)
{
    static const char *const suffixes[SIDE_COUNT] = {"", ".L", ".R"};
    const char *suffix = suffixes[bone->side];
    char kind[16], chain[24] = "";
    if (is_finger(bone->kind)) {
        int place = (int)bone->kind - BONE_FINGER_FIRST;
        snprintf(kind, sizeof kind, "%s_%d", finger_names[place / PHALANX_COUNT],
                 place % PHALANX_COUNT + 1);
    } else {
        snprintf(kind, sizeof kind, "%s", bone_kinds[bone->kind].name);
    }
    if (bone->segment > 0 && bone->side == SIDE_CENTRE)
        snprintf(chain, sizeof chain, "_%u", bone->segment + 1);
    else if (bone->segment > 0)
        snprintf(chain, sizeof chain, "_twist_%u", bone->segment);
    snprintf(bone->name, sizeof bone->name, "%s%s%s", kind, chain, suffix);
}

static struct vec3 on_side(struct vec3 point, enum skeleton_side side)
{
    return side == SIDE_RIGHT ? vec3(-point.x, point.y, point.z) : point;
}

static void add_chain(struct skeleton *skeleton, const struct anatomy *anatomy, int kind,
                      enum skeleton_side side, uint32_t segment_count)
{
    struct vec3 head = on_side(anatomy->head[kind], side);
    struct vec3 tail = on_side(anatomy->tail[kind], side);
    double length = vec3_length(vec3_sub(tail, head)) / segment_count;
    int parent = parent_kind(kind) < 0 ? -1 : skeleton->last[parent_kind(kind)][side];
    skeleton->first[kind][side] = segment_count > 0 ? (int)skeleton->bone_count : -1;
    skeleton->last[kind][side] =
        segment_count > 0 ? (int)(skeleton->bone_count + segment_count) - 1 : -1;
    for (uint32_t segment = 0; segment < segment_count; ++segment) {
        SKD_ASSERT(skeleton->bone_count < SKELETON_MAX_BONES);
        struct skeleton_bone *bone = &skeleton->bone[skeleton->bone_count];
        bone->parent = parent;
        bone->kind = (enum anatomy_bone)kind;
        bone->side = side;
        bone->segment = segment;
        bone->segment_count = segment_count;
        bone->length = length;
        bone->along = vec3_unit(vec3_sub(tail, head));
        bone->head = vec3_mad(head, bone->along, length * segment);
        name_bone(bone);
        parent = (int)skeleton->bone_count++;
    }
}

void skd_skeleton_init(struct skeleton *skeleton, const struct anatomy *anatomy,
                       uint32_t bone_count)
{
    uint32_t segments[BONE_COUNT];
    choose_bones(anatomy, bone_count, segments);
    memset(skeleton, 0, sizeof *skeleton);
    for (int kind = 0; kind < BONE_CENTRE_COUNT; ++kind) {
        add_chain(skeleton, anatomy, kind, SIDE_CENTRE, segments[kind]);
        for (int side = SIDE_LEFT; side < SIDE_COUNT; ++side) {
            skeleton->first[kind][side] = skeleton->first[kind][SIDE_CENTRE];
            skeleton->last[kind][side] = skeleton->last[kind][SIDE_CENTRE];
        }
    }
    for (enum skeleton_side side = SIDE_LEFT; side < SIDE_COUNT; ++side)
        for (int kind = BONE_CENTRE_COUNT; kind < BONE_COUNT; ++kind)
            add_chain(skeleton, anatomy, kind, side, segments[kind]);
    SKD_ASSERT(skeleton->bone_count == bone_count);
    pose_at_rest(skeleton, anatomy);
}
