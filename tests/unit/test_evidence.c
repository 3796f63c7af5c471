/* What slots by evidence, candidates, reduction, rest offsets and shapes promise, on a small body.
 * Whether they find what they should is asked in tests/oracle. Scratch is exactly what was asked
 * for, so that a sanitizer sees one byte more.
 */
#include "solver/evidence.h"
#include "solver/reduce.h"
#include "solver/rest.h"
#include "solver/shape.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* A row of vertices along a chain of bones; the last vertex is the first's twin at a seam. Bones
 * from OTHER on are another skin's. */
enum { EMPTY = SKD_SLOT_EMPTY, VERTICES = 24, BONES = 10, OTHER = 8, SLOTS = 4, POSES = 4 };

struct body {
    float rest[VERTICES][3];
    float heads[BONES][3];
    int32_t parents[BONES];
    uint16_t bone_skin[BONES], vertex_skin[VERTICES];
    uint8_t hops[BONES * BONES];
    uint32_t offsets[VERTICES + 1], neighbours[2 * VERTICES], vertices[VERTICES];
    uint16_t joints[VERTICES * SLOTS];
    float weights[VERTICES * SLOTS];
    double matrices[POSES][BONES * SKD_MATRIX_SIZE];
    float targets[POSES][VERTICES * 3];
    struct skd_solve_pose poses[POSES];
    uint16_t lists[VERTICES * SKD_CANDIDATES_MAX];
    uint8_t bone_locked[BONES];
};

/* The bone turns by an angle of its own about an axis through its head. */
static void turn(double *m, const float head[3], double angle, int axis)
{
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    memset(m, 0, SKD_MATRIX_SIZE * sizeof *m);
    m[5 * axis] = 1.0;
    m[5 * a] = m[5 * b] = cos(angle);
    m[4 * a + b] = -sin(angle);
    m[4 * b + a] = sin(angle);
    for (int row = 0; row < 3; row++)
        m[4 * row + 3] =
            (double)head[row] - (m[4 * row] * (double)head[0] + m[4 * row + 1] * (double)head[1] +
                                 m[4 * row + 2] * (double)head[2]);
}

static void find_lists(struct body *body, size_t count, const uint32_t *vertices, uint16_t *lists)
{
    const struct skd_candidates_input input = {
        .vertex_count = VERTICES,
        .slot_count = SLOTS,
        .bone_count = BONES,
        .hops = body->hops,
        .bone_heads = body->heads[0],
        .bone_parents = body->parents,
        .bone_skin = body->bone_skin,
        .vertex_skin = body->vertex_skin,
        .rest = body->rest[0],
        .start_joints = body->joints,
        .start_weights = body->weights,
        .neighbour_offsets = body->offsets,
        .neighbours = body->neighbours,
        .count = count,
        .vertices = vertices,
    };
    void *scratch = malloc(skd_candidates_scratch_bytes(&input));
    assert_non_null(scratch);
    skd_candidates_fill(&input, scratch, lists);
    free(scratch);
}

/* Each vertex starts on one bone; its targets are those of an even blend of it and the next. */
static void set_vertex(struct body *body, uint32_t v, uint32_t like, uint32_t *edges)
{
    const uint16_t bone = (uint16_t)(like % (OTHER - 1));
    body->vertices[v] = v;
    body->rest[v][0] = 0.3F * (float)like;
    body->rest[v][1] = 0.2F * (float)(like % 3);
    body->rest[v][2] = 0.1F;
    for (int i = 0; i < SLOTS; i++) {
        body->joints[SLOTS * v + (uint32_t)i] = i == 0 ? bone : EMPTY;
        body->weights[SLOTS * v + (uint32_t)i] = i == 0 ? 1.0F : 0.0F;
    }
    body->offsets[v] = *edges;
    if (like > 0)
        body->neighbours[(*edges)++] = like - 1;
    if (like + 2 < VERTICES)
        body->neighbours[(*edges)++] = like + 1;
    const uint16_t pair[2] = {bone, (uint16_t)(bone + 1)};
    const float even[2] = {0.5F, 0.5F};
    for (int p = 0; p < POSES; p++)
        skd_skin(1, NULL, 2, body->rest[v], pair, even, body->matrices[p],
                 body->targets[p] + 3 * v);
}

static struct body *make_body(void)
{
    struct body *body = calloc(1, sizeof *body);
    uint32_t edges = 0;
    assert_non_null(body);
    for (int b = 0; b < BONES; b++) {
        body->heads[b][0] = 0.8F * (float)b;
        body->parents[b] = b == OTHER ? -1 : b - 1;
        body->bone_skin[b] = b >= OTHER;
        for (int p = 0; p < POSES; p++)
            turn(body->matrices[p] + b * SKD_MATRIX_SIZE, body->heads[b],
                 0.15 * (double)(1 + (b * 5 + p * 3) % 7), (b + p) % 3);
    }
    skd_hops_build(BONES, body->parents, body->hops);
    for (uint32_t v = 0; v < VERTICES; v++)
        set_vertex(body, v, v + 1 < VERTICES ? v : 0, &edges);
    body->offsets[VERTICES] = edges;
    for (int p = 0; p < POSES; p++)
        body->poses[p] = (struct skd_solve_pose){body->matrices[p], body->targets[p], NULL};
    find_lists(body, VERTICES, body->vertices, body->lists);
    return body;
}

struct solved {
    uint16_t joints[VERTICES * SLOTS];
    float weights[VERTICES * SLOTS], before[VERTICES], after[VERTICES], leftover[VERTICES];
};

static struct skd_solve_options options_of(void)
{
    struct skd_solve_options options = skd_solve_defaults();
    options.length = 8.0;
    options.stiffness = 1e-4;
    return options;
}

static struct skd_solve_batch batch_of(struct body *body, struct solved *solved)
{
    return (struct skd_solve_batch){
        .count = VERTICES,
        .slot_count = SLOTS,
        .vertices = body->vertices,
        .pose_count = POSES,
        .poses = body->poses,
        .rest = body->rest[0],
        .joints = body->joints,
        .weights = body->weights,
        .anchor = body->weights,
        .bone_locked = body->bone_locked,
        .weights_out = solved->weights,
        .residual_before = solved->before,
        .residual_after = solved->after,
        .leftover_out = solved->leftover,
    };
}

static struct solved solve_evidence(struct body *body)
{
    struct solved solved;
    const struct skd_solve_batch batch = batch_of(body, &solved);
    const struct skd_solve_options options = options_of();
    const struct skd_evidence_bones bones = {BONES, body->bone_skin, body->vertex_skin,
                                             body->lists};
    skd_evidence_solve(&batch, &options, &bones, solved.joints);
    return solved;
}

static void lists_have_own_bones_first_and_own_skin_only(void **state)
{
    (void)state;
    struct body *body = make_body();
    for (size_t v = 0; v < VERTICES; v++) {
        const uint16_t *list = body->lists + SKD_CANDIDATES_MAX * v;
        assert_int_equal(list[0], body->joints[SLOTS * v]);
        for (int k = 0; k < SKD_CANDIDATES_MAX; k++) {
            assert_true(k < OTHER ? list[k] < OTHER : list[k] == EMPTY);
            for (int j = 0; j < k && list[k] != EMPTY; j++)
                assert_int_not_equal(list[k], list[j]);
        }
    }
    free(body);
}

static void lists_of_twins_and_parts_are_equal(void **state)
{
    (void)state;
    struct body *body = make_body();
    const size_t bytes = SKD_CANDIDATES_MAX * sizeof(uint16_t);
    assert_memory_equal(body->lists, body->lists + SKD_CANDIDATES_MAX * (VERTICES - 1), bytes);
    for (uint32_t v = 0; v < VERTICES; v++) {
        uint16_t alone[SKD_CANDIDATES_MAX];
        find_lists(body, 1, &v, alone);
        assert_memory_equal(alone, body->lists + SKD_CANDIDATES_MAX * v, bytes);
    }
    free(body);
}

static void missing_bones_are_found(void **state)
{
    (void)state;
    struct body *body = make_body();
    const struct solved solved = solve_evidence(body);
    for (size_t v = 0; v < VERTICES; v++) {
        const uint16_t bone = body->joints[SLOTS * v];
        assert_true(solved.leftover[v] < 1e-3F);
        assert_int_equal(solved.joints[SLOTS * v], bone);
        for (size_t i = 0; i < SLOTS; i++) {
            const size_t slot = SLOTS * v + i;
            const bool is_true = solved.joints[slot] == bone || solved.joints[slot] == bone + 1;
            assert_true(fabsf(solved.weights[slot] - (is_true ? 0.5F : 0.0F)) < 1e-3F);
        }
    }
    free(body);
}

static void locked_bones_neither_come_nor_go(void **state)
{
    (void)state;
    struct body *body = make_body();
    body->bone_locked[2] = body->bone_locked[5] = 1;
    for (size_t v = 0; v < VERTICES; v++) {
        body->joints[SLOTS * v + 2] = body->joints[SLOTS * v] == 2 ? 4 : 2;
        body->weights[SLOTS * v + 2] = 0.25F;
        body->weights[SLOTS * v] = 0.75F;
    }
    const struct solved solved = solve_evidence(body);
    for (size_t slot = 0; slot < VERTICES * SLOTS; slot++) {
        const bool was = body->joints[slot] == 2 || body->joints[slot] == 5;
        const bool is = solved.joints[slot] == 2 || solved.joints[slot] == 5;
        assert_int_equal(was, is);
        if (was)
            assert_true(solved.weights[slot] == body->weights[slot]);
    }
    free(body);
}

static void without_targets_or_lists_it_is_the_plain_solve(void **state)
{
    (void)state;
    struct body *body = make_body();
    struct solved plain;
    const float none[VERTICES] = {0};
    memset(body->lists, 0xff, sizeof body->lists);
    memset(body->bone_skin, 1, sizeof body->bone_skin);
    for (int round = 0; round < 2; round++) {
        const struct skd_solve_batch batch = batch_of(body, &plain);
        const struct skd_solve_options options = options_of();
        skd_solve(&batch, &options);
        const struct solved solved = solve_evidence(body);
        assert_memory_equal(solved.joints, body->joints, sizeof body->joints);
        assert_memory_equal(solved.weights, plain.weights, sizeof plain.weights);
        for (int p = 0; p < POSES; p++)
            body->poses[p].strengths = none;
    }
    free(body);
}

static void reduction_of_bones_that_move_together_costs_nothing(void **state)
{
    (void)state;
    struct body *body = make_body();
    const double *matrices[POSES];
    const uint16_t joints[6] = {0, 1, 2, 3, 4, 5};
    const float weights[6] = {0.3F, 0.2F, 0.15F, 0.15F, 0.12F, 0.08F};
    float kept[6], whole[3], moved[3];
    struct skd_guard *guard = malloc(skd_guard_bytes(BONES));
    assert_non_null(guard);
    for (int p = 0; p < POSES; p++) {
        /* 1 and 2 are carried by one motion, 3 and 4 by another. */
        memcpy(body->matrices[p] + 2 * SKD_MATRIX_SIZE, body->matrices[p] + SKD_MATRIX_SIZE,
               SKD_MATRIX_SIZE * sizeof(double));
        memcpy(body->matrices[p] + 4 * SKD_MATRIX_SIZE, body->matrices[p] + 3 * SKD_MATRIX_SIZE,
               SKD_MATRIX_SIZE * sizeof(double));
        matrices[p] = body->matrices[p];
    }
    skd_guard_build(BONES, POSES, matrices, guard);
    skd_reduce(guard, body->rest[4], 6, joints, weights, 4, kept);
    int used = 0;
    for (int i = 0; i < 6; i++)
        used += kept[i] > 0.0F;
    assert_int_equal(used, 4);
    assert_true(fabsf(kept[1] + kept[2] - 0.35F) < 1e-5F);
    assert_true(fabsf(kept[3] + kept[4] - 0.27F) < 1e-5F);
    skd_skin(1, NULL, 6, body->rest[4], joints, weights, matrices[0], whole);
    skd_skin(1, NULL, 6, body->rest[4], joints, kept, matrices[0], moved);
    for (int axis = 0; axis < 3; axis++)
        assert_true(fabsf(whole[axis] - moved[axis]) < 1e-5F);
    skd_reduce(guard, body->rest[4], 6, joints, weights, 6, kept);
    assert_memory_equal(kept, weights, sizeof kept);
    free(guard);
    free(body);
}

static void rest_moves_with_two_targets_only(void **state)
{
    (void)state;
    struct body *body = make_body();
    struct solved solved = solve_evidence(body);
    struct skd_solve_batch batch = batch_of(body, &solved);
    const struct skd_solve_options options = options_of();
    float weights[VERTICES * SLOTS], rest[VERTICES][3];
    uint8_t doubtful[VERTICES];
    for (int p = 0; p < POSES; p++) {
        for (int k = 0; k < 3 * VERTICES; k++)
            body->targets[p][k] += 0.02F;
    }
    for (int pose_count = 1; pose_count <= 2; pose_count++) {
        batch.pose_count = pose_count;
        memcpy(weights, solved.weights, sizeof weights);
        memcpy(rest, body->rest, sizeof rest);
        skd_rest_solve(&batch, &options, solved.joints, weights, rest[0], doubtful);
        if (pose_count == 1) {
            assert_memory_equal(weights, solved.weights, sizeof weights);
            assert_memory_equal(rest, body->rest, sizeof rest);
        }
        for (size_t v = 0; v < VERTICES; v++)
            assert_int_equal(doubtful[v], memcmp(rest[v], body->rest[v], sizeof rest[v]) != 0);
    }
    assert_true(memcmp(rest, body->rest, sizeof rest) != 0);
    free(body);
}

static void a_shape_puts_the_vertex_at_its_target(void **state)
{
    (void)state;
    struct body *body = make_body();
    const struct solved solved = solve_evidence(body);
    float offsets[VERTICES][3], moved[VERTICES][3], shown[VERTICES][3];
    for (int k = 0; k < 3 * VERTICES; k++)
        body->targets[0][k] += 0.05F * (float)(k % 4);
    skd_shape_solve(VERTICES, SLOTS, body->rest[0], solved.joints, solved.weights,
                    body->matrices[0], body->targets[0], offsets[0]);
    for (size_t v = 0; v < VERTICES; v++) {
        for (int axis = 0; axis < 3; axis++)
            moved[v][axis] = body->rest[v][axis] + offsets[v][axis];
    }
    skd_skin(VERTICES, NULL, SLOTS, moved[0], solved.joints, solved.weights, body->matrices[0],
             shown[0]);
    for (size_t v = 0; v < VERTICES; v++) {
        for (size_t axis = 0; axis < 3; axis++)
            assert_true(fabsf(shown[v][axis] - body->targets[0][3 * v + axis]) < 1e-5F);
    }
    free(body);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_have_own_bones_first_and_own_skin_only),
        cmocka_unit_test(lists_of_twins_and_parts_are_equal),
        cmocka_unit_test(missing_bones_are_found),
        cmocka_unit_test(locked_bones_neither_come_nor_go),
        cmocka_unit_test(without_targets_or_lists_it_is_the_plain_solve),
        cmocka_unit_test(reduction_of_bones_that_move_together_costs_nothing),
        cmocka_unit_test(rest_moves_with_two_targets_only),
        cmocka_unit_test(a_shape_puts_the_vertex_at_its_target),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
