/* Edits of whole rows: bones paired by name, the nearest point, mirror, prune, reduce, pins that
 * are weighed and cleared, and poses that are picked; on rigs made here. */
#include "rig/rig_build.h"
#include "session/bone_pairs.h"
#include "session/creation.h"
#include "session/guard_choice.h"
#include "session/mirror.h"
#include "session/nearest.h"
#include "session/pin_edit.h"
#include "session/prune.h"
#include "session/reduction.h"
#include "session/row_edit.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* ---- bone pairs -------------------------------------------------------------------------- */

enum { ALONE = -1, MISSING = -2 };

static void check_pairs(int count, const char *const *names, const int *expected)
{
    char *copies[32];
    uint16_t skins[32] = {0};
    struct skd_bone_pairs pairs;
    for (int i = 0; i < count; i++)
        copies[i] = strdup(names[i]);
    const struct skd_skeleton skeleton = {.bone_count = count, .names = copies, .skins = skins};
    assert_int_equal(skd_bone_pairs_build(&skeleton, &pairs, NULL), SKD_OK);
    for (int i = 0; i < count; i++) {
        int partner = expected[i] >= 0 ? expected[i] : i;
        if (pairs.partners[i] != partner || pairs.unpaired[i] != (expected[i] == MISSING))
            fail_msg("%s: partner %s, unpaired %d", names[i], names[pairs.partners[i]],
                     pairs.unpaired[i]);
        assert_int_equal(pairs.partners[pairs.partners[i]], i);
    }
    skd_bone_pairs_finish(&pairs);
    for (int i = 0; i < count; i++)
        free(copies[i]);
}

/* Each convention by a pair of its own. */
static void pairs_follow_the_usual_names(void **state)
{
    (void)state;
    static const char *const names[][2] = {
        {"arm.L", "arm.R"},
        {"arm_l", "arm_r"},
        {"hand-l", "hand-r"},
        {"foot.l", "foot.r"},
        {"UpperLeg_L", "UpperLeg_R"},
        {"L_arm", "R_arm"},
        {"Bip01 L Arm", "Bip01 R Arm"},
        {"mixamorig:LeftArm", "mixamorig:RightArm"},
        {"LeftHandIndex1", "RightHandIndex1"},
        {"handLeft", "handRight"},
        {"left_leg", "right_leg"},
        {"leftLeg", "rightLeg"},
        {"LEFT_LEG", "RIGHT_LEG"},
        {"leftarm", "rightarm"},
        {"lShldr", "rShldr"},
        {"LArm", "RArm"},
        {"armL", "armR"},
        {"arm_L2", "arm_R2"},
        {"arm.L.001", "arm.R.001"},
        {"b_LeftFoot_018", "b_RightFoot_021"},
        {"Left_eye.L", "Right_eye.R"},
        {"\xe5\xb7\xa6\xe8\x85\x95", "\xe5\x8f\xb3\xe8\x85\x95"}, /* as MikuMikuDance names arms */
    };
    static const int expected[] = {1, 0};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        check_pairs(2, names[i], expected);
}

static void pairs_tell_chance_from_sides(void **state)
{
    (void)state;
    static const char *const names[] = {"spine",  "bright", "collar", "ball",     "Leftover",
                                        "root",   "arm.L",  "leg.R",  "clLeftia", "hip.l.x",
                                        "tail.l", "tail.r", "tail"};
    static const int expected[] = {ALONE,   ALONE, ALONE,   ALONE, ALONE, ALONE, MISSING,
                                   MISSING, ALONE, MISSING, 11,    10,    ALONE};
    check_pairs(13, names, expected);
}

/* Numbers may differ only while they leave one bone to choose. */
static void pairs_are_mutual(void **state)
{
    (void)state;
    static const char *const doubtful[] = {"LeftFoot_1", "RightFoot_2", "RightFoot_3"};
    static const int none[] = {MISSING, MISSING, MISSING};
    check_pairs(3, doubtful, none);
    static const char *const exact[] = {"a_L_1", "a_R_1", "a_R_2"};
    static const int first[] = {1, 0, MISSING};
    check_pairs(3, exact, first);
    static const char *const skewed[] = {"L_x_L", "L_x_R", "R_x_L"};
    static const int swapped[] = {MISSING, 2, 1};
    check_pairs(3, skewed, swapped);
}

static void pairs_stay_within_a_skin(void **state)
{
    (void)state;
    char left[] = "arm.L", right[] = "arm.R";
    char *names[] = {left, right, left, right};
    uint16_t skins[] = {0, 0, 1, 2};
    const struct skd_skeleton skeleton = {.bone_count = 4, .names = names, .skins = skins};
    struct skd_bone_pairs pairs;
    assert_int_equal(skd_bone_pairs_build(&skeleton, &pairs, NULL), SKD_OK);
    assert_memory_equal(pairs.partners, ((const uint16_t[]){1, 0, 2, 3}), 8);
    assert_memory_equal(pairs.unpaired, ((const uint8_t[]){0, 0, 1, 1}), 4);
    skd_bone_pairs_finish(&pairs);
}

/* ---- the nearest point ------------------------------------------------------------------- */

static uint32_t chance(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return *seed >> 8;
}

static double square_apart(const float a[3], const double b[3])
{
    double square = 0;
    for (int i = 0; i < 3; i++)
        square += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
    return square;
}

/* Against looking at all; `grid` makes many coordinates equal. */
static void try_nearest(size_t count, uint32_t grid)
{
    struct skd_point *points = malloc((count + 1) * sizeof *points);
    uint8_t *axes = malloc(count + 1);
    uint32_t seed = (uint32_t)count * 31 + grid;
    for (size_t i = 0; i < count; i++) {
        points[i].vertex = (uint32_t)i;
        for (int axis = 0; axis < 3; axis++)
            points[i].at[axis] = (float)(chance(&seed) % grid) / (float)grid;
    }
    skd_nearest_build(count, points, axes);
    for (int turn = 0; turn < 200; turn++) {
        double at[3], limit = turn % 2 ? 1e-4 : 10, least = limit;
        for (int axis = 0; axis < 3; axis++)
            at[axis] = (double)(chance(&seed) % grid) / grid + (turn % 3 == 0 ? 0.001 : 0);
        for (size_t i = 0; i < count; i++)
            least = fmin(least, square_apart(points[i].at, at));
        double square = limit;
        const struct skd_point *found = skd_nearest_find(count, points, axes, at, &square);
        assert_true(square <= least && square >= least);
        assert_int_equal(found != NULL, least < limit);
        if (found != NULL)
            assert_true(square_apart(found->at, at) <= least);
    }
    free(points);
    free(axes);
}

static void nearest_is_the_nearest(void **state)
{
    (void)state;
    const size_t counts[] = {0, 1, 8, 9, 17, 1000, 5000};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        try_nearest(counts[i], 1 << 20);
        try_nearest(counts[i], 5);
        try_nearest(counts[i], 1); /* all at one place */
    }
}

/* ---- rows ---------------------------------------------------------------------------------- */

enum { N = 4, BONES = 6 };
static const char *const bone_names[BONES] = {"hips", "arm.L", "arm.R", "leg.L", "leg.R", "pin.L"};

/* A session of bones that stand in a row along x, with rows given whole: 0 is no influence. */
static struct skd_session *make_session(size_t count, const float *positions,
                                        const float (*rows)[BONES], int slots)
{
    static const int32_t parents[] = {-1, 0, 0, 0, 0, 0};
    double binds[BONES * 16] = {0};
    uint32_t *offsets = calloc(count + 1, sizeof *offsets);
    uint16_t *joints = malloc(count * BONES * sizeof *joints);
    float *weights = malloc(count * BONES * sizeof *weights);
    for (int bone = 0; bone < BONES; bone++) {
        for (int i = 0; i < 4; i++)
            binds[bone * 16 + i * 5] = 1;
        binds[bone * 16 + 3] = bone % 2 ? bone : -bone;
    }
    for (size_t v = 0; v < count; v++) {
        offsets[v + 1] = offsets[v];
        for (uint16_t bone = 0; bone < BONES; bone++) {
            if (!(rows[v][bone] > 0))
                continue;
            joints[offsets[v + 1]] = bone;
            weights[offsets[v + 1]++] = rows[v][bone];
        }
    }
    struct skd_rig_arrays arrays = {count,   positions, 0,       NULL,   BONES,  bone_names,
                                    parents, binds,     offsets, joints, weights};
    struct skd_rig *rig;
    struct skd_influences influences;
    struct skd_session *session;
    struct skd_session_options options = {slots, SKD_FILL_HOP, SKD_CUT_REFUSE};
    assert_int_equal(skd_rig_from_arrays(&arrays, &rig, &influences, NULL), SKD_OK);
    assert_int_equal(skd_session_create(rig, &influences, "", &options, &session, NULL), SKD_OK);
    skd_influences_finish(&influences);
    free(offsets);
    free(joints);
    free(weights);
    return session;
}

/* What a vertex weighs on each bone. */
static void read_row(const struct skd_session *session, size_t vertex, float out[BONES])
{
    size_t slots = (size_t)session->slot_count;
    memset(out, 0, BONES * sizeof *out);
    for (size_t i = 0; i < slots; i++) {
        uint16_t bone = session->joints[vertex * slots + i];
        float weight = session->weights[vertex * slots + i];
        if (bone == SKD_SLOT_EMPTY)
            assert_true(weight >= 0 && weight <= 0);
        else
            out[bone] += weight;
    }
}

static void check_row(const struct skd_session *session, size_t vertex, const float expected[BONES])
{
    float row[BONES];
    read_row(session, vertex, row);
    for (int bone = 0; bone < BONES; bone++)
        if (fabs((double)row[bone] - (double)expected[bone]) > 1e-7)
            fail_msg("vertex %zu has %g on %s, not %g", vertex, (double)row[bone], bone_names[bone],
                     (double)expected[bone]);
}

static double sum_of(const struct skd_session *session, size_t vertex)
{
    double sum = 0;
    for (int i = 0; i < session->slot_count; i++)
        sum += (double)session->weights[vertex * (size_t)session->slot_count + (size_t)i];
    return sum;
}

static void row_put_keeps_slots_where_it_can(void **state)
{
    (void)state;
    uint16_t joints[N] = {7, 3, 9, SKD_SLOT_EMPTY};
    float weights[N] = {0.5F, 0.25F, 0.25F, 0};
    skd_row_put(N, joints, weights, 3, (const uint16_t[]){3, 4, 5},
                (const float[]){0.2F, 0.3F, 0.5F});
    assert_memory_equal(joints, ((const uint16_t[]){7, 3, 5, 4}), sizeof joints);
    assert_memory_equal(weights, ((const float[]){0, 0.2F, 0.5F, 0.3F}), sizeof weights);
    skd_row_put(N, joints, weights, 4, (const uint16_t[]){1, 2, 5, 3},
                (const float[]){0.25F, 0.25F, 0.25F, 0.25F});
    assert_memory_equal(joints, ((const uint16_t[]){2, 3, 5, 1}), sizeof joints);
}

/* ---- mirror -------------------------------------------------------------------------------- */

static const struct skd_mirror_input to_right = {.scope = {.all = true}, .tolerance = 1e-3};

static struct skd_step *mirror(struct skd_session *session, struct skd_mirror_input input,
                               size_t unmatched, int unpaired)
{
    struct skd_step *step = NULL;
    struct skd_mirror_report report;
    assert_int_equal(skd_mirror_prepare(session, &input, &step, &report, NULL), SKD_OK);
    assert_int_equal(report.unmatched, unmatched);
    for (int bone = 0; bone < BONES; bone++)
        assert_int_equal(report.unpaired[bone], bone == unpaired);
    free(report.unpaired);
    skd_session_write(session, step, false);
    return step;
}

/* Pairs at +-1 and +-2, one vertex on the plane, one on the right without a partner. */
static const float sides[] = {1, 0, 0, -1, 0, 0, 2, 1, 0, -2, 1, 0, 0, 3, 0, -5, 0, 0};
static const float side_rows[][BONES] = {{0.5F, 0.3F, 0, 0.2F}, {1},
                                         {0, 0, 0, 1},          {0.25F, 0.25F, 0.25F, 0.25F},
                                         {0.2F, 0.6F, 0.2F},    {0, 1}};

static void mirror_writes_one_side_from_the_other(void **state)
{
    (void)state;
    struct skd_session *session = make_session(6, sides, side_rows, N);
    float before[6 * N];
    uint16_t joints[6 * N];
    memcpy(before, session->weights, sizeof before);
    memcpy(joints, session->joints, sizeof joints);
    struct skd_step *step = mirror(session, to_right, 1, -1);
    assert_int_equal(step->count, 3); /* 1, 3 and 4 */
    assert_non_null(step->joints_after);
    check_row(session, 0, side_rows[0]);
    check_row(session, 1, (const float[BONES]){0.5F, 0, 0.3F, 0, 0.2F});
    check_row(session, 3, (const float[BONES]){0, 0, 0, 0, 1});
    check_row(session, 4, (const float[BONES]){0.2F, 0.4F, 0.4F});
    check_row(session, 5, side_rows[5]);
    skd_session_write(session, step, true);
    assert_memory_equal(session->weights, before, sizeof before);
    assert_memory_equal(session->joints, joints, sizeof joints);
    assert_memory_equal(session->anchor, before, sizeof before);
    skd_session_write(session, step, false);
    skd_step_release(step);
    step = mirror(session, to_right, 1, -1); /* once more is nothing */
    assert_true(skd_step_is_empty(step));
    skd_step_release(step);
    skd_session_destroy(session);
}

static void mirror_goes_the_other_way_and_where_it_is_told(void **state)
{
    (void)state;
    struct skd_session *session = make_session(6, sides, side_rows, N);
    struct skd_mirror_input input = to_right;
    const uint32_t named[] = {0, 1, 4};
    input.from_negative = true;
    input.scope = (struct skd_edit_scope){.vertices = named, .count = 3};
    struct skd_step *step = mirror(session, input, 0, -1);
    assert_int_equal(step->count, 2); /* 1 is on the side that is read */
    check_row(session, 0, side_rows[1]);
    check_row(session, 1, side_rows[1]);
    check_row(session, 2, side_rows[2]);
    check_row(session, 4, (const float[BONES]){0.2F, 0.4F, 0.4F});
    skd_step_release(step);
    skd_session_destroy(session);
    /* Across x = 0.6, what is nearest to where 1 reflects to is 2. */
    session = make_session(6, sides, side_rows, N);
    input = to_right;
    input.origin = 0.6;
    input.tolerance = 0.15;
    step = mirror(session, input, 3, -1);
    check_row(session, 1, (const float[BONES]){0, 0, 0, 0, 1});
    skd_step_release(step);
    skd_session_destroy(session);
}

/* A bone whose partner is not there keeps its weight, and is told about. */
static void mirror_tells_of_bones_without_a_partner(void **state)
{
    (void)state;
    static const float positions[] = {1, 0, 0, -1, 0, 0};
    static const float rows[][BONES] = {{0.5F, 0.25F, 0, 0, 0, 0.25F}, {1}};
    struct skd_session *session = make_session(2, positions, rows, N);
    struct skd_step *step = mirror(session, to_right, 0, 5);
    check_row(session, 1, (const float[BONES]){0.5F, 0, 0.25F, 0, 0, 0.25F});
    skd_step_release(step);
    skd_session_destroy(session);
}

/* Six bones on the plane and four slots: a bone stays with its partner or goes with it. */
static void mirror_keeps_the_plane_symmetric(void **state)
{
    (void)state;
    static const float positions[] = {0, 0, 0, 1, 0, 0};
    static const float rows[][BONES] = {{0.3F, 0.28F, 0, 0.42F}, {1}};
    struct skd_session *session = make_session(2, positions, rows, N);
    struct skd_step *step = mirror(session, to_right, 0, -1);
    float row[BONES];
    read_row(session, 0, row);
    assert_true(row[1] >= row[2] && row[1] <= row[2] && row[3] >= row[4] && row[3] <= row[4]);
    assert_true(fabs(sum_of(session, 0) - 1) <= 1e-7);
    /* hips 0.3 and legs 0.21 each fit into four slots; arms 0.14 each do not any more */
    assert_true(fabs((double)row[3] - 0.21 / 0.72) < 1e-6);
    assert_true(row[1] <= 0);
    skd_step_release(step);
    skd_session_destroy(session);
}

static void mirror_takes_twins_along(void **state)
{
    (void)state;
    static const float positions[] = {-1, 0, 0, 1, 0, 0, -1, 0, 0};
    static const float rows[][BONES] = {{1}, {0, 1}, {1}};
    struct skd_session *session = make_session(3, positions, rows, N);
    static const uint32_t rings[] = {2, 1, 0}, named[] = {2};
    session->rig->mesh.twins = malloc(sizeof rings);
    memcpy(session->rig->mesh.twins, rings, sizeof rings);
    struct skd_mirror_input input = to_right;
    input.scope = (struct skd_edit_scope){.vertices = named, .count = 1};
    struct skd_step *step = mirror(session, input, 0, -1);
    assert_int_equal(step->count, 2);
    assert_memory_equal(session->weights, session->weights + 2 * N, N * sizeof(float));
    assert_memory_equal(session->joints, session->joints + 2 * N, N * sizeof(uint16_t));
    check_row(session, 0, (const float[BONES]){0, 0, 1});
    skd_step_release(step);
    skd_session_destroy(session);
}

static void edits_refuse_bad_vertices_and_stop(void **state)
{
    (void)state;
    struct skd_session *session = make_session(6, sides, side_rows, N);
    const uint32_t outside[] = {6}, twice[] = {1, 1};
    atomic_bool cancelled = true;
    struct skd_edit_scope scopes[] = {{.vertices = outside, .count = 1},
                                      {.vertices = twice, .count = 2},
                                      {.all = true, .cancelled = &cancelled}};
    static const enum skd_status expected[] = {SKD_BAD_INDEX, SKD_BAD_INDEX, SKD_CANCELLED};
    for (size_t i = 0; i < 3; i++) {
        struct skd_step *step = NULL;
        struct skd_mirror_report report;
        struct skd_mirror_input input = to_right;
        struct skd_reduction moved;
        struct skd_reduction_input reduction = {.scope = scopes[i], .keep = 1, .by_size = true};
        size_t removed;
        input.scope = scopes[i];
        assert_int_equal(skd_mirror_prepare(session, &input, &step, &report, NULL), expected[i]);
        free(report.unpaired);
        assert_int_equal(skd_prune_prepare(session, &scopes[i], 0.5, &step, &removed, NULL),
                         expected[i]);
        assert_int_equal(skd_reduction_prepare(session, &reduction, &step, &moved, NULL),
                         expected[i]);
        assert_null(step);
    }
    skd_session_destroy(session);
}

/* ---- prune --------------------------------------------------------------------------------- */

static size_t prune(struct skd_session *session, double below, struct skd_step **step)
{
    const struct skd_edit_scope scope = {.all = true};
    size_t removed;
    assert_int_equal(skd_prune_prepare(session, &scope, below, step, &removed, NULL), SKD_OK);
    skd_session_write(session, *step, false);
    return removed;
}

static void prune_removes_and_scales(void **state)
{
    (void)state;
    static const float positions[] = {0, 0, 0, 1, 0, 0, 2, 0, 0};
    static const float rows[][BONES] = {
        {0.98F, 0.015F, 0.005F}, {0.25F, 0.25F, 0.25F, 0.25F}, {0.99F, 0.01F}};
    struct skd_session *session = make_session(3, positions, rows, N);
    struct skd_step *step;
    assert_int_equal(prune(session, 0.01, &step), 1); /* 0.01 is not below 0.01 */
    assert_int_equal(step->count, 1);
    assert_null(step->joints_after);
    check_row(session, 0, (const float[BONES]){0.98F / 0.995F, 0.015F / 0.995F});
    skd_step_release(step);
    assert_int_equal(prune(session, 1, &step), 1 + 3 + 1); /* one is left everywhere */
    check_row(session, 0, (const float[BONES]){1});
    check_row(session, 1, (const float[BONES]){1}); /* of equal ones, the lowest bone's */
    check_row(session, 2, (const float[BONES]){1});
    skd_session_write(session, step, true);
    check_row(session, 1, rows[1]);
    skd_step_release(step);
    skd_session_destroy(session);
}

/* Random rows at many bounds: sums, what stays, and that pruning twice is pruning once. */
static void prune_holds_for_random_rows(void **state)
{
    (void)state;
    enum { COUNT = 400 };
    static float positions[COUNT * 3], rows[COUNT][BONES];
    uint32_t seed = 5;
    for (size_t v = 0; v < COUNT; v++) {
        float sum = 0;
        positions[3 * v] = (float)v;
        for (int bone = 0; bone < BONES; bone++)
            sum += rows[v][bone] = powf((float)(chance(&seed) % 1000 + 1) / 1000.0F, 4);
        for (int bone = 0; bone < BONES; bone++)
            rows[v][bone] /= sum;
    }
    for (int turn = 0; turn < 12; turn++) {
        const double below = pow(0.5, turn);
        struct skd_session *session =
            make_session(COUNT, positions, (const float(*)[BONES])rows, 8);
        float before[COUNT * 8];
        memcpy(before, session->weights, sizeof before);
        struct skd_step *step;
        size_t removed = prune(session, below, &step), gone = 0;
        for (size_t v = 0; v < COUNT; v++) {
            assert_true(fabs(sum_of(session, v) - 1) <= 1e-7);
            for (size_t i = v * 8; i < v * 8 + 8; i++) {
                bool kept = session->weights[i] > 0;
                gone += before[i] > 0 && !kept;
                assert_false(kept && !(before[i] > 0));
                assert_true(!kept || before[i] >= (float)below || session->weights[i] >= 1);
            }
        }
        assert_int_equal(gone, removed);
        skd_step_release(step);
        assert_int_equal(prune(session, below, &step), 0);
        assert_true(skd_step_is_empty(step));
        skd_step_release(step);
        skd_session_destroy(session);
    }
}

/* ---- reduce -------------------------------------------------------------------------------- */

static struct skd_step *reduce(struct skd_session *session, struct skd_reduction_input input,
                               struct skd_reduction *moved)
{
    struct skd_step *step = NULL;
    assert_int_equal(skd_reduction_prepare(session, &input, &step, moved, NULL), SKD_OK);
    skd_session_write(session, step, false);
    return step;
}

static void reduce_by_size_keeps_the_largest(void **state)
{
    (void)state;
    static const float positions[] = {0, 0, 0, 1, 0, 0};
    static const float rows[][BONES] = {{0.4F, 0.1F, 0.3F, 0.2F}, {0.5F, 0.5F}};
    struct skd_session *session = make_session(2, positions, rows, N);
    struct skd_reduction moved;
    struct skd_step *step = reduce(
        session, (struct skd_reduction_input){.scope = {.all = true}, .keep = 2, .by_size = true},
        &moved);
    assert_int_equal(step->count, 1);
    check_row(session, 0, (const float[BONES]){0.4F / 0.7F, 0, 0.3F / 0.7F});
    check_row(session, 1, rows[1]);
    assert_int_equal(moved.pose_count, 24); /* no clips: bends */
    assert_true(moved.max >= moved.mean && moved.mean > 0);
    skd_step_release(step);
    skd_session_destroy(session);
}

/* Two light bones that move far matter more than two heavy ones that move as one. */
static void reduce_by_poses_keeps_what_moves(void **state)
{
    (void)state;
    static const float positions[] = {0, 0, 0};
    static const float rows[][BONES] = {{0.36F, 0.34F, 0, 0.3F}};
    struct skd_session *session = make_session(1, positions, rows, N);
    struct skd_pose *pose = skd_pose_create("p", BONES);
    for (int bone = 0; bone < BONES; bone++) {
        double *m = pose->matrices + bone * SKD_MATRIX_SIZE;
        memset(m, 0, SKD_MATRIX_SIZE * sizeof *m);
        m[0] = m[5] = m[10] = 1;
        m[3] = bone == 3 ? 10 : bone == 1 ? 0.1 : 0;
    }
    struct skd_reduction moved;
    struct skd_step *step =
        reduce(session,
               (struct skd_reduction_input){
                   .scope = {.all = true}, .keep = 2, .poses = &pose, .pose_count = 1},
               &moved);
    float row[BONES];
    read_row(session, 0, row);
    assert_true(row[3] > 0.25F && (row[0] > 0) != (row[1] > 0));
    assert_int_equal(moved.pose_count, 1);
    assert_true(moved.max < 0.05);
    assert_true(fabs(sum_of(session, 0) - 1) <= 1e-7);
    skd_step_release(step);
    skd_pose_release(pose);
    skd_session_destroy(session);
}

/* ---- guards -------------------------------------------------------------------------------- */

static struct skd_pose *shifted(const char *name, double x)
{
    struct skd_pose *pose = skd_pose_create(name, BONES);
    for (int bone = 0; bone < BONES; bone++) {
        double *m = pose->matrices + bone * SKD_MATRIX_SIZE;
        memset(m, 0, SKD_MATRIX_SIZE * sizeof *m);
        m[0] = m[5] = m[10] = 1;
        m[3] = x;
    }
    return pose;
}

static void guards_pick_the_farthest(void **state)
{
    (void)state;
    struct skd_session *session = make_session(6, sides, side_rows, N);
    struct skd_pose *poses[] = {shifted("a", 1), shifted("b", 10), shifted("c", 9),
                                shifted("d", 4), shifted("e", -5), shifted("f", 10)};
    struct skd_guards_input input = {.poses = poses, .pose_count = 6, .most = 4};
    struct skd_guards guards;
    static const char *const expected[] = {"b", "e", "d",
                                           "a"}; /* 0 10 -5 4; c and a are both 1 off */
    assert_int_equal(skd_guards_build(session, &input, &guards, NULL), SKD_OK);
    assert_int_equal(guards.candidate_count, 6);
    assert_int_equal(guards.poses.count, 4);
    for (size_t i = 0; i < 4; i++)
        assert_string_equal(guards.poses.items[i].name, expected[i]);
    assert_non_null(guards.factors);
    assert_int_equal(guards.factors->pose_count, 4);
    assert_true(skd_guards_bytes(&guards) > 0);
    skd_guards_finish(&guards);
    input.most = 64; /* "f" is "b" once more */
    assert_int_equal(skd_guards_build(session, &input, &guards, NULL), SKD_OK);
    assert_int_equal(guards.poses.count, 5);
    skd_guards_finish(&guards);
    struct skd_pose *rest = skd_poses_find(&session->poses, "rest");
    input.poses = &rest, input.pose_count = 1;
    assert_int_equal(skd_guards_build(session, &input, &guards, NULL), SKD_BAD_PARAMS);
    skd_guards_finish(&guards);
    input.pose_count = 0;
    assert_int_equal(skd_guards_build(session, &input, &guards, NULL), SKD_OK);
    assert_null(guards.factors);
    for (size_t i = 0; i < 6; i++)
        skd_pose_release(poses[i]);
    skd_session_destroy(session);
}

static void guards_refuse_what_does_not_fit(void **state)
{
    (void)state;
    struct skd_session *session = make_session(6, sides, side_rows, N);
    struct skd_guards guards;
    struct skd_error error;
    static double matrices[(SKD_GUARD_CANDIDATES_MAX + 1) * BONES * 16];
    const char *const clips[] = {"walk"};
    atomic_bool cancelled = true;
    for (size_t i = 0; i < sizeof matrices / sizeof *matrices; i++)
        matrices[i] = i % 16 % 5 == 0;
    struct skd_guards_input input = {.matrices = matrices, .matrix_count = BONES + 1, .most = 8};
    assert_int_equal(skd_guards_build(session, &input, &guards, &error), SKD_COUNT_MISMATCH);
    skd_guards_finish(&guards);
    input.matrix_count = (SKD_GUARD_CANDIDATES_MAX + 1) * BONES;
    assert_int_equal(skd_guards_build(session, &input, &guards, &error), SKD_TOO_LARGE);
    skd_guards_finish(&guards);
    input.matrix_count = 2 * BONES;
    matrices[BONES * 16 + 3] = NAN;
    assert_int_equal(skd_guards_build(session, &input, &guards, &error), SKD_NOT_FINITE);
    skd_guards_finish(&guards);
    matrices[BONES * 16 + 3] = 2;
    input.cancelled = &cancelled;
    assert_int_equal(skd_guards_build(session, &input, &guards, &error), SKD_CANCELLED);
    skd_guards_finish(&guards);
    input = (struct skd_guards_input){.clips = clips, .clip_count = 1, .most = 8};
    assert_int_equal(skd_guards_build(session, &input, &guards, &error), SKD_NO_CLIP);
    skd_guards_finish(&guards);
    skd_session_destroy(session);
}

/* ---- pins ---------------------------------------------------------------------------------- */

static void pin(struct skd_session *session, struct skd_pose *pose, uint32_t vertex, float strength)
{
    struct skd_sheet *sheet;
    assert_int_equal(skd_sheets_need(&session->pins, pose, &sheet, NULL), SKD_OK);
    struct skd_sheet_change *change =
        skd_sheet_change_create(&session->pins, sheet, &vertex, 1, NULL);
    memcpy(change->after, ((const float[]){1, 2, 3, strength}), 4 * sizeof(float));
    skd_sheet_change_write(change, false);
    skd_sheet_change_destroy(change);
}

static float strength_of(const struct skd_session *session, const struct skd_pose *pose,
                         uint32_t vertex)
{
    const float *row = skd_sheet_row(&session->pins, skd_sheets_find(&session->pins, pose), vertex);
    return row != NULL ? row[3] : -1;
}

static size_t edit_pins(struct skd_session *session, struct skd_pin_edit edit,
                        struct skd_step **step)
{
    size_t vertices;
    assert_int_equal(skd_pin_edit_prepare(session, &edit, step, &vertices, NULL), SKD_OK);
    assert_int_equal((*step)->count, 0);
    skd_session_write(session, *step, false);
    return vertices;
}

static void pins_are_weighed_and_cleared(void **state)
{
    (void)state;
    struct skd_session *session = make_session(6, sides, side_rows, N);
    struct skd_pose *a = shifted("a", 1), *b = shifted("b", 2);
    const uint32_t some[] = {5, 2};
    for (uint32_t vertex = 0; vertex < 4; vertex++)
        pin(session, a, vertex, 1);
    pin(session, b, 2, 1);
    pin(session, b, 5, 1);
    struct skd_step *weighed, *nothing, *cleared;
    struct skd_pin_edit edit = {.scope = {.all = true}, .pose = "a", .strength = 0};
    assert_int_equal(edit_pins(session, edit, &weighed), 4);
    assert_true(strength_of(session, a, 3) >= 0 && strength_of(session, a, 3) <= 0);
    assert_true(strength_of(session, b, 2) >= 1);
    assert_int_equal(edit_pins(session, edit, &nothing), 0);
    assert_true(skd_step_is_empty(nothing));
    skd_step_release(nothing);
    edit = (struct skd_pin_edit){.scope = {.vertices = some, .count = 2}, .clear = true};
    assert_int_equal(edit_pins(session, edit, &cleared), 2); /* 2 in both poses, 5 in one */
    assert_true(strength_of(session, a, 2) < 0 && strength_of(session, b, 5) < 0);
    assert_int_equal(skd_sheets_find(&session->pins, a)->used, 3);
    assert_int_equal(skd_sheets_find(&session->pins, b)->used, 0);
    skd_session_write(session, cleared, true);
    assert_int_equal(skd_sheets_find(&session->pins, b)->used, 2);
    skd_session_write(session, weighed, true);
    assert_true(strength_of(session, a, 3) >= 1);
    skd_step_release(weighed);
    skd_step_release(cleared);
    skd_pose_release(a);
    skd_pose_release(b);
    skd_session_destroy(session);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pairs_follow_the_usual_names),
        cmocka_unit_test(pairs_tell_chance_from_sides),
        cmocka_unit_test(pairs_are_mutual),
        cmocka_unit_test(pairs_stay_within_a_skin),
        cmocka_unit_test(nearest_is_the_nearest),
        cmocka_unit_test(row_put_keeps_slots_where_it_can),
        cmocka_unit_test(mirror_writes_one_side_from_the_other),
        cmocka_unit_test(mirror_goes_the_other_way_and_where_it_is_told),
        cmocka_unit_test(mirror_tells_of_bones_without_a_partner),
        cmocka_unit_test(mirror_keeps_the_plane_symmetric),
        cmocka_unit_test(mirror_takes_twins_along),
        cmocka_unit_test(edits_refuse_bad_vertices_and_stop),
        cmocka_unit_test(prune_removes_and_scales),
        cmocka_unit_test(prune_holds_for_random_rows),
        cmocka_unit_test(reduce_by_size_keeps_the_largest),
        cmocka_unit_test(reduce_by_poses_keeps_what_moves),
        cmocka_unit_test(guards_pick_the_farthest),
        cmocka_unit_test(guards_refuse_what_does_not_fit),
        cmocka_unit_test(pins_are_weighed_and_cleared),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
