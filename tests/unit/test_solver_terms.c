/* The further terms of the energy by hand-made problems: poses, guard, pulls, slots that changed.
 * Random problems are compared with SciPy in tests/oracle/test_solver_terms_oracle.py.
 */
#include "solver/guard.h"
#include "solver/solve.h"
#include "solver/stiffness.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SLOTS_MOST = 16, BONES = 9, POSES = 5 };

/* One vertex at the origin; bone 0 is there in every pose, bone 1 at x = reach of the pose. */
struct line {
    struct skd_solve_batch batch;
    struct skd_solve_options options;
    struct skd_solve_pose poses[3];
    double matrices[3][3 * SKD_MATRIX_SIZE];
    float targets[3][3];
    float strengths[3][1];
    uint32_t vertex;
    float rest[3];
    uint16_t joints[SLOTS_MOST], start_joints[SLOTS_MOST];
    float weights[SLOTS_MOST], anchor[SLOTS_MOST], pulls[SLOTS_MOST], start_weights[SLOTS_MOST];
    float weights_out[SLOTS_MOST];
    float before, after, leftover;
    struct skd_guard *guard;
};

static void set_bones(double *matrices, double second, double third)
{
    memset(matrices, 0, 3 * SKD_MATRIX_SIZE * sizeof *matrices);
    for (int bone = 0; bone < 3; bone++) {
        for (int axis = 0; axis < 3; axis++)
            matrices[bone * SKD_MATRIX_SIZE + 5 * axis] = 1.0;
    }
    matrices[SKD_MATRIX_SIZE + 3] = second;
    matrices[2 * SKD_MATRIX_SIZE + 3] = third;
}

/* The last two slots are bones 0 and 1, weighing 1 - weight and weight; the others are empty. */
static struct line *line_create(int slots, double weight)
{
    struct line *line = calloc(1, sizeof *line);
    assert_non_null(line);
    line->options = skd_solve_defaults();
    line->options.length = 1.0;
    line->batch = (struct skd_solve_batch){
        .count = 1,
        .slot_count = slots,
        .vertices = &line->vertex,
        .pose_count = 1,
        .poses = line->poses,
        .rest = line->rest,
        .joints = line->joints,
        .weights = line->weights,
        .anchor = line->anchor,
        .weights_out = line->weights_out,
        .residual_before = &line->before,
        .residual_after = &line->after,
        .leftover_out = &line->leftover,
    };
    for (int p = 0; p < 3; p++) {
        set_bones(line->matrices[p], 1.0, 0.0);
        line->strengths[p][0] = 1.0F;
        line->poses[p] =
            (struct skd_solve_pose){line->matrices[p], line->targets[p], line->strengths[p]};
    }
    for (int i = 0; i < slots; i++)
        line->joints[i] = SKD_SLOT_EMPTY;
    line->joints[slots - 2] = 0;
    line->joints[slots - 1] = 1;
    line->weights[slots - 2] = line->anchor[slots - 2] = (float)(1.0 - weight);
    line->weights[slots - 1] = line->anchor[slots - 1] = (float)weight;
    return line;
}

static void line_guard(struct line *line, double second, double third)
{
    double matrices[3 * SKD_MATRIX_SIZE];
    const double *poses[1] = {matrices};
    set_bones(matrices, second, third);
    line->guard = malloc(skd_guard_bytes(3));
    assert_non_null(line->guard);
    skd_guard_build(3, 1, poses, line->guard);
    line->batch.guard = line->guard;
}

static void line_destroy(struct line *line)
{
    free(line->guard);
    free(line);
}

/* f = 2 (w - 0.75)^2 + 0.5 (3 w - 0.6)^2 + 0.3 (2 (w - o))^2 + 2 kappa^2 (w - o)^2
 *   + 2 mu^2 (w - u)^2 in the second bone's weight w. */
static void every_term_pulls_its_weight(void **state)
{
    (void)state;
    const double o = 0.25, u = 0.5, kappa = 0.4, mu = 0.7, lambda = 0.3;
    for (int slots = 2; slots <= SLOTS_MOST; slots++) {
        struct line *line = line_create(slots, o);
        set_bones(line->matrices[1], 3.0, 0.0);
        line->targets[0][0] = 0.75F;
        line->targets[1][0] = 0.6F;
        line->targets[2][0] = 100.0F;
        line->strengths[0][0] = 2.0F;
        line->strengths[1][0] = 0.5F;
        line->strengths[2][0] = 0.0F;
        line->batch.pose_count = 3;
        line->pulls[slots - 2] = (float)(1.0 - u);
        line->pulls[slots - 1] = (float)u;
        line->batch.pulls = line->pulls;
        line_guard(line, 2.0, 0.0);
        line->options.stiffness = kappa;
        line->options.smooth = mu;
        line->options.guard = lambda;
        const double k = 2.0 * kappa * kappa, m = 2.0 * mu * mu, g = 4.0 * lambda;
        const double target = (double)line->targets[1][0];
        const double w =
            (2.0 * 0.75 + 0.5 * 3.0 * target + (g + k) * o + m * u) / (2.0 + 0.5 * 9.0 + g + k + m);
        skd_solve(&line->batch, &line->options);
        assert_true(fabs((double)line->weights_out[slots - 1] - w) < 1e-7);
        assert_true(fabs((double)line->weights_out[slots - 2] - (1.0 - w)) < 1e-7);
        assert_true(fabs((double)line->after - fabs(w - 0.75)) < 1e-6);
        const double squares = 2.0 * pow(w - 0.75, 2.0) + 0.5 * pow(3.0 * w - target, 2.0);
        assert_true(fabs((double)line->leftover - sqrt(squares / 2.5)) < 1e-6);
        line_destroy(line);
    }
}

/* Bone 2 weighed 0.5 at the start and stood at x = 4 in the guard pose; its slot is bone 1's now,
 * which reaches x = 5 there. f = w^2 + lambda (5 w - 0.5 * 4)^2 + 2 kappa^2 w^2 + ..., the anchor
 * being (0.5, 0). */
static void a_dropped_bone_still_counts(void **state)
{
    (void)state;
    for (int slots = 2; slots <= 8; slots++) {
        struct line *line = line_create(slots, 0.25);
        memcpy(line->start_joints, line->joints, sizeof line->joints);
        memcpy(line->start_weights, line->weights, sizeof line->weights);
        line->start_joints[slots - 1] = 2;
        line->start_weights[slots - 2] = line->start_weights[slots - 1] = 0.5F;
        line->anchor[slots - 2] = 0.5F;
        line->anchor[slots - 1] = 0.0F;
        line->batch.start_joints = line->start_joints;
        line->batch.start_weights = line->start_weights;
        line->options.stiffness = 0.01;
        line->options.guard = 3.0;
        line_guard(line, 5.0, 4.0);
        skd_solve(&line->batch, &line->options);
        /* |w - o|^2 = w^2 + (1 - w - 0.5)^2 */
        const double k = 0.01 * 0.01;
        const double w = (3.0 * 5.0 * 2.0 + 0.5 * k) / (1.0 + 3.0 * 25.0 + 2.0 * k);
        assert_true(fabs((double)line->weights_out[slots - 1] - w) < 1e-7);
        assert_true(fabs((double)line->weights_out[slots - 2] - (1.0 - w)) < 1e-7);
        /* Where nothing can be gained the row stays: the anchor is no row to go back to. */
        line->batch.vertex_locked = (const uint8_t *)"\1";
        skd_solve(&line->batch, &line->options);
        assert_memory_equal(line->weights_out, line->weights, (size_t)slots * sizeof(float));
        line_destroy(line);
    }
}

static double draw(uint64_t *state)
{
    *state = *state * 6364136223846793005U + 1442695040888963407U;
    return (double)(*state >> 11) * 0x1p-53 - 0.5;
}

static void pair_factors_hold_the_mean(void **state)
{
    (void)state;
    static double matrices[POSES][BONES * SKD_MATRIX_SIZE];
    const double *poses[POSES];
    uint64_t seed = 7;
    for (int q = 0; q < POSES; q++) {
        poses[q] = matrices[q];
        for (int k = 0; k < BONES * SKD_MATRIX_SIZE; k++)
            matrices[q][k] = draw(&seed);
        memcpy(matrices[q] + SKD_MATRIX_SIZE, matrices[q], SKD_MATRIX_SIZE * sizeof(double));
    }
    for (int count = 1; count <= POSES; count++) {
        struct skd_guard *guard = malloc(skd_guard_bytes(BONES));
        assert_non_null(guard);
        skd_guard_build(BONES, count, poses, guard);
        for (int pair = 0; pair < BONES * BONES; pair++) {
            const int i = pair / BONES, j = pair % BONES;
            const double v[3] = {draw(&seed), draw(&seed), draw(&seed)};
            long double mean = 0.0L;
            for (int row = 0; row < 3 * count; row++) {
                const double *a = matrices[row / 3] + SKD_MATRIX_SIZE * i + 4 * (row % 3);
                const double *b = matrices[row / 3] + SKD_MATRIX_SIZE * j + 4 * (row % 3);
                long double apart = (long double)a[3] - (long double)b[3];
                for (int axis = 0; axis < 3; axis++)
                    apart += ((long double)a[axis] - (long double)b[axis]) * (long double)v[axis];
                mean += apart * apart / count;
            }
            const double found = skd_guard_pair(guard, i, j, v);
            assert_true(fabsl((long double)found - mean) <= 1e-15L);
            assert_true(found == skd_guard_pair(guard, j, i, v));
            assert_true((i != j && i + j != 1) || found == 0.0);
        }
        free(guard);
    }
    assert_true(skd_guard_bytes(0) == sizeof(struct skd_guard));
    assert_true(skd_guard_bytes(2) == sizeof(struct skd_guard) + 10 * sizeof(double));
}

static double choose_stiffness(struct line *line)
{
    float leftovers[1];
    line->options.stiffness = SKD_STIFFNESS_PROBE;
    line->batch.leftover_out = leftovers;
    skd_solve(&line->batch, &line->options);
    return skd_stiffness_choose(&line->batch, line->options.length, leftovers);
}

static void stiffness_by_hand(void **state)
{
    (void)state;
    struct line *line = line_create(4, 0.25);
    line->targets[0][0] = 0.5F;
    assert_true(choose_stiffness(line) == 5e-4);
    line->batch.pose_count = 2;
    line->targets[1][0] = 0.5F;
    assert_true(choose_stiffness(line) == 1e-4);
    line->targets[0][1] = line->targets[1][1] = 0.01F;
    assert_true(fabs(choose_stiffness(line) - 0.02) < 1e-8);
    line->targets[0][1] = line->targets[1][1] = 0.5F;
    assert_true(choose_stiffness(line) == 0.03);
    line->batch.vertex_locked = (const uint8_t *)"\1";
    assert_true(choose_stiffness(line) == 5e-4);
    line->batch.count = 0;
    assert_true(choose_stiffness(line) == 5e-4);
    line_destroy(line);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_term_pulls_its_weight),
        cmocka_unit_test(a_dropped_bone_still_counts),
        cmocka_unit_test(pair_factors_hold_the_mean),
        cmocka_unit_test(stiffness_by_hand),
    };
    return cmocka_run_group_tests_name("solver_terms", tests, NULL, NULL);
}
