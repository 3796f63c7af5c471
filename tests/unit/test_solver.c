/* The solver by hand-made problems, and its guarantees on many random vertices in long double.
 * Optima of random and degenerate families are compared with oracles in tests/oracle.
 */
#include "solver/solve.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BONES = 24, SLOTS_MOST = 16, VERTICES_MOST = 20000 };

/* A batch with room for its arrays. */
struct scene {
    struct skd_solve_batch batch;
    struct skd_solve_options options;
    struct skd_solve_pose pose;
    uint32_t vertices[VERTICES_MOST];
    float targets[VERTICES_MOST * 3];
    float rest[VERTICES_MOST * 3];
    uint16_t joints[VERTICES_MOST * SLOTS_MOST];
    float weights[VERTICES_MOST * SLOTS_MOST];
    float anchor[VERTICES_MOST * SLOTS_MOST];
    uint8_t vertex_locked[VERTICES_MOST];
    uint8_t bone_locked[BONES];
    double matrices[BONES * SKD_MATRIX_SIZE];
    float weights_out[VERTICES_MOST * SLOTS_MOST];
    float before[VERTICES_MOST];
    float after[VERTICES_MOST];
};

static size_t vertices_wanted(void)
{
    const char *quick = getenv("SKIND_QUICK");
    return quick && *quick && *quick != '0' ? 1000 : VERTICES_MOST;
}

static struct scene *scene_create(size_t count, int slots)
{
    struct scene *scene = calloc(1, sizeof *scene);
    assert_non_null(scene);
    scene->options = skd_solve_defaults();
    scene->options.length = 1.0;
    scene->pose = (struct skd_solve_pose){.matrices = scene->matrices, .targets = scene->targets};
    scene->batch = (struct skd_solve_batch){
        .count = count,
        .slot_count = slots,
        .vertices = scene->vertices,
        .pose_count = 1,
        .poses = &scene->pose,
        .rest = scene->rest,
        .joints = scene->joints,
        .weights = scene->weights,
        .anchor = scene->anchor,
        .vertex_locked = scene->vertex_locked,
        .bone_locked = scene->bone_locked,
        .weights_out = scene->weights_out,
        .residual_before = scene->before,
        .residual_after = scene->after,
    };
    for (size_t i = 0; i < count; i++)
        scene->vertices[i] = (uint32_t)i;
    for (int bone = 0; bone < BONES; bone++) {
        for (int axis = 0; axis < 3; axis++)
            scene->matrices[bone * SKD_MATRIX_SIZE + 5 * axis] = 1.0;
    }
    return scene;
}

static double draw(uint64_t *state)
{
    *state = *state * 6364136223846793005U + 1442695040888963407U;
    return (double)(*state >> 11) * 0x1p-53;
}

static void draw_matrix(uint64_t *state, double *matrix)
{
    const double angle = 2.0 * draw(state) - 1.0, turn = 2.0 * draw(state) - 1.0;
    const double c = cos(angle), s = sin(angle), k = cos(turn), h = sin(turn);
    const double rows[SKD_MATRIX_SIZE] = {c,     -s,    0,  0.1 * draw(state),
                                          s * k, c * k, -h, 0.1 * draw(state),
                                          s * h, c * h, k,  0.1 * draw(state)};
    memcpy(matrix, rows, sizeof rows);
}

/* A posed character before its first stroke, some of its slots without weight. */
static struct scene *scene_draw(uint64_t seed, size_t count, int slots)
{
    struct scene *scene = scene_create(count, slots);
    for (int bone = 0; bone < BONES; bone++)
        draw_matrix(&seed, scene->matrices + bone * SKD_MATRIX_SIZE);
    for (size_t v = 0; v < count; v++) {
        float *row = scene->weights + v * (size_t)slots;
        const int first = (int)(draw(&seed) * BONES);
        double sum = 0.0;
        for (int i = 0; i < slots; i++) {
            scene->joints[v * (size_t)slots + (size_t)i] = (uint16_t)((first + i) % BONES);
            row[i] = draw(&seed) < 0.5 && i > 0 ? 0.0F : (float)draw(&seed);
            sum += (double)row[i];
        }
        for (int i = 0; i < slots; i++)
            row[i] = (float)((double)row[i] / sum);
        for (int axis = 0; axis < 3; axis++)
            scene->rest[3 * v + (size_t)axis] = (float)(0.6 * draw(&seed) - 0.3);
    }
    memcpy(scene->anchor, scene->weights, sizeof scene->anchor);
    skd_skin(count, NULL, slots, scene->rest, scene->joints, scene->weights, scene->matrices,
             scene->targets);
    for (size_t i = 0; i < 3 * count; i++)
        scene->targets[i] += (float)(0.1 * (draw(&seed) - 0.5));
    return scene;
}

/* Residual of a row in long double. */
static void residual(const struct scene *scene, size_t item, const float *row, long double r[3])
{
    const int slots = scene->batch.slot_count;
    const size_t v = scene->vertices[item];
    for (int axis = 0; axis < 3; axis++) {
        r[axis] = -(long double)scene->targets[3 * item + (size_t)axis];
        for (int i = 0; i < slots; i++) {
            const uint16_t bone = scene->joints[v * (size_t)slots + (size_t)i];
            const double *m = scene->matrices + bone * SKD_MATRIX_SIZE + 4 * axis;
            const float *rest = scene->rest + 3 * v;
            if (bone != SKD_SLOT_EMPTY)
                r[axis] += (long double)row[i] *
                           ((long double)m[0] * (long double)rest[0] +
                            (long double)m[1] * (long double)rest[1] +
                            (long double)m[2] * (long double)rest[2] + (long double)m[3]);
        }
    }
}

static long double square(const long double r[3])
{
    return r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
}

static void check_row(const float *row, int slots)
{
    double sum = 0.0;
    for (int i = 0; i < slots; i++) {
        assert_true(row[i] >= 0.0F);
        sum += (double)row[i];
    }
    assert_true(fabs(sum - 1.0) <= 1e-7);
}

static void defaults_are_the_documented_ones(void **state)
{
    (void)state;
    const struct skd_solve_options options = skd_solve_defaults();
    assert_int_equal(options.method, SKD_METHOD_EXACT);
    assert_int_equal(options.constraint, SKD_CONSTRAINT_SIMPLEX);
    assert_int_equal(options.simd, SKD_SIMD_AUTO);
    assert_true(options.stiffness == 0.008 && options.length == 0.0);
    assert_true(options.thesis_k == 0.05 && options.thesis_h == 1.2);
}

/* One vertex at the origin on bones at x = 0 and x = 1, the rest of its slots empty: with the
 * target at x the energy is (w - x)^2 + 2 (kappa L)^2 (w - o)^2 in w, the second bone's weight. */
static struct scene *scene_on_a_line(int slots, double target, double weight)
{
    struct scene *scene = scene_create(1, slots);
    scene->matrices[SKD_MATRIX_SIZE + 3] = 1.0;
    for (int i = 0; i < slots; i++)
        scene->joints[i] = SKD_SLOT_EMPTY;
    scene->joints[slots - 2] = 0;
    scene->joints[slots - 1] = 1;
    scene->weights[slots - 2] = (float)(1.0 - weight);
    scene->weights[slots - 1] = (float)weight;
    memcpy(scene->anchor, scene->weights, sizeof scene->anchor);
    scene->targets[0] = (float)target;
    return scene;
}

static void a_point_between_two_bones(void **state)
{
    (void)state;
    for (int slots = 2; slots <= SLOTS_MOST; slots++) {
        for (int stiff = 0; stiff < 2; stiff++) {
            struct scene *scene = scene_on_a_line(slots, 0.75, 0.25);
            scene->options.stiffness = stiff ? 0.5 : 0.0;
            scene->options.length = 2.0;
            const double ridge = stiff ? 1.0 : 0.0;
            const double weight = (0.75 + 2.0 * ridge * 0.25) / (1.0 + 2.0 * ridge);
            skd_solve(&scene->batch, &scene->options);
            assert_true(fabs((double)scene->weights_out[slots - 1] - weight) < 1e-7);
            assert_true(fabs((double)scene->weights_out[slots - 2] - (1.0 - weight)) < 1e-7);
            for (int i = 0; i < slots - 2; i++)
                assert_true(scene->weights_out[i] == 0.0F);
            assert_true(fabs((double)scene->before[0] - 0.5) < 1e-6);
            assert_true(fabs((double)scene->after[0] - fabs(weight - 0.75)) < 1e-6);
            free(scene);
        }
    }
}

static void bounds_hold_unless_affine(void **state)
{
    (void)state;
    for (int slots = 2; slots <= 8; slots++) {
        struct scene *scene = scene_on_a_line(slots, 1.5, 0.25);
        scene->options.stiffness = 0.0;
        skd_solve(&scene->batch, &scene->options);
        assert_true(scene->weights_out[slots - 1] == 1.0F);
        assert_true(scene->weights_out[slots - 2] == 0.0F);
        scene->options.constraint = SKD_CONSTRAINT_AFFINE;
        skd_solve(&scene->batch, &scene->options);
        assert_true(fabs((double)scene->weights_out[slots - 1] - 1.5) < 1e-6);
        assert_true(fabs((double)scene->weights_out[slots - 2] + 0.5) < 1e-6);
        free(scene);
    }
}

static void locks_keep_bits(void **state)
{
    (void)state;
    for (int slots = 3; slots <= 8; slots++) {
        struct scene *scene = scene_draw(3, 500, slots);
        for (int bone = 0; bone < BONES; bone += 3)
            scene->bone_locked[bone] = 1;
        for (size_t v = 0; v < 500; v += 5)
            scene->vertex_locked[v] = 1;
        skd_solve(&scene->batch, &scene->options);
        size_t changed = 0;
        for (size_t v = 0; v < 500; v++) {
            const size_t row = v * (size_t)slots;
            check_row(scene->weights_out + row, slots);
            for (size_t i = row; i < row + (size_t)slots; i++) {
                const bool same = scene->weights_out[i] == scene->weights[i];
                if (scene->vertex_locked[v] || scene->bone_locked[scene->joints[i]])
                    assert_true(same);
                changed += !same;
            }
        }
        assert_true(changed > 100);
        free(scene);
    }
}

static void nothing_to_solve_changes_nothing(void **state)
{
    (void)state;
    for (int slots = 1; slots <= SLOTS_MOST; slots++) {
        struct scene *scene = scene_draw(4, 50, slots);
        const size_t bytes = 50 * (size_t)slots * sizeof(float);
        /* every bone locked */
        memset(scene->bone_locked, 1, sizeof scene->bone_locked);
        skd_solve(&scene->batch, &scene->options);
        assert_memory_equal(scene->weights_out, scene->weights, bytes);
        /* every bone in one place */
        memset(scene->bone_locked, 0, sizeof scene->bone_locked);
        for (int bone = 1; bone < BONES; bone++)
            memcpy(scene->matrices + bone * SKD_MATRIX_SIZE, scene->matrices,
                   SKD_MATRIX_SIZE * sizeof(double));
        skd_solve(&scene->batch, &scene->options);
        assert_memory_equal(scene->weights_out, scene->weights, bytes);
        /* no bone at all */
        for (size_t i = 0; i < 50 * (size_t)slots; i++) {
            scene->joints[i] = SKD_SLOT_EMPTY;
            scene->weights[i] = scene->anchor[i] = 0.0F;
        }
        skd_solve(&scene->batch, &scene->options);
        assert_memory_equal(scene->weights_out, scene->weights, bytes);
        /* no vertex */
        scene->batch.count = 0;
        skd_solve(&scene->batch, &scene->options);
        free(scene);
    }
}

/* Not one vertex farther on the first stroke; on later ones no higher energy than before or at the
 * anchor, in long double, from differences. */
static void nothing_gets_worse(void **state)
{
    (void)state;
    const size_t count = vertices_wanted();
    const int slot_counts[] = {2, 4, 8};
    for (int run = 0; run < 3; run++) {
        const int slots = slot_counts[run];
        struct scene *scene = scene_draw(5 + (uint64_t)run, count, slots);
        for (int stroke = 0; stroke < 3; stroke++) {
            const long double ridge =
                powl((long double)scene->options.stiffness * (long double)scene->options.length, 2);
            skd_solve(&scene->batch, &scene->options);
            for (size_t v = 0; v < count; v++) {
                const size_t row = v * (size_t)slots;
                const float *before = scene->weights + row, *after = scene->weights_out + row;
                long double r[3], q[3], drawn = 0.0L;
                check_row(after, slots);
                residual(scene, v, before, r);
                residual(scene, v, after, q);
                for (int i = 0; i < slots; i++) {
                    const long double o = (long double)scene->anchor[row + (size_t)i];
                    drawn += ((long double)before[i] - (long double)after[i]) *
                             ((long double)before[i] + (long double)after[i] - 2.0L * o);
                }
                assert_true(square(r) - square(q) + ridge * drawn >= -1e-19L);
                if (stroke == 0) {
                    assert_true(square(q) <= square(r) + 1e-19L);
                    assert_true(scene->after[v] <= scene->before[v]);
                }
                assert_true(fabsl((long double)scene->after[v] - sqrtl(square(q))) < 1e-7L);
            }
            memcpy(scene->weights, scene->weights_out, sizeof scene->weights);
            for (size_t i = 0; i < 3 * count; i++)
                scene->targets[i] += (i + (size_t)stroke) % 3 ? 0.01F : -0.02F;
        }
        free(scene);
    }
}

static void bits_do_not_depend_on_the_way(void **state)
{
    (void)state;
    const size_t count = 1003;
    struct scene *scene = scene_draw(9, count, 4);
    for (int affine = 0; affine < 2; affine++) {
        scene->options.constraint = affine ? SKD_CONSTRAINT_AFFINE : SKD_CONSTRAINT_SIMPLEX;
        scene->options.simd = SKD_SIMD_PLAIN;
        scene->batch.count = count;
        skd_solve(&scene->batch, &scene->options);
        struct scene *whole = malloc(sizeof *whole);
        assert_non_null(whole);
        memcpy(whole, scene, sizeof *whole);
        const enum skd_simd ways[] = {SKD_SIMD_AUTO, SKD_SIMD_AVX2, SKD_SIMD_AVX512};
        for (int way = 0; way < 3; way++) {
            for (size_t chunk = 1; chunk <= 500; chunk = 3 * chunk + 1) {
                scene->options.simd = ways[way];
                for (size_t first = 0; first < count; first += chunk) {
                    struct skd_solve_batch part = scene->batch;
                    struct skd_solve_pose pose = scene->pose;
                    part.count = count - first < chunk ? count - first : chunk;
                    part.vertices += first;
                    pose.targets += 3 * first;
                    part.poses = &pose;
                    part.weights_out += 4 * first;
                    part.residual_before += first;
                    part.residual_after += first;
                    skd_solve(&part, &scene->options);
                }
                assert_memory_equal(scene->weights_out, whole->weights_out, 16 * count);
                assert_memory_equal(scene->before, whole->before, 4 * count);
                assert_memory_equal(scene->after, whole->after, 4 * count);
            }
        }
        free(whole);
    }
    free(scene);
}

/* Targets that the weights already reach are the minimum of every one of the thesis's quadratics,
 * and targets out of reach bring its penalties and its normalising out. */
static void thesis_keeps_what_is_reached(void **state)
{
    (void)state;
    const size_t count = 400;
    struct scene *scene = scene_draw(10, count, 4);
    scene->options.method = SKD_METHOD_THESIS;
    skd_solve(&scene->batch, &scene->options);
    size_t farther = 0;
    for (size_t v = 0; v < count; v++) {
        check_row(scene->weights_out + 4 * v, 4);
        farther += scene->after[v] > scene->before[v];
    }
    assert_true(farther > 0);
    skd_skin(count, NULL, 4, scene->rest, scene->joints, scene->weights, scene->matrices,
             scene->targets);
    skd_solve(&scene->batch, &scene->options);
    for (size_t i = 0; i < 4 * count; i++)
        assert_true(fabsf(scene->weights_out[i] - scene->weights[i]) < 2e-6F);
    free(scene);
}

static void skinning_by_hand(void **state)
{
    (void)state;
    const float rest[6] = {1, 2, 3, -1, 0, 4};
    const uint16_t joints[6] = {0, 1, SKD_SLOT_EMPTY, 1, SKD_SLOT_EMPTY, 0};
    const float weights[6] = {0.25F, 0.75F, 0.0F, 1.0F, 0.0F, 0.0F};
    const double matrices[2 * SKD_MATRIX_SIZE] = {1, 0,  0, 8, 0, 1, 0, 0, 0, 0, 1, 0,
                                                  0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 2, 4};
    const uint32_t order[2] = {1, 0};
    float out[6];
    skd_skin(2, NULL, 3, rest, joints, weights, matrices, out);
    const float expected[6] = {0.75F, 1.25F, 8.25F, 0.0F, -1.0F, 12.0F};
    assert_memory_equal(out, expected, sizeof out);
    skd_skin(2, order, 3, rest, joints, weights, matrices, out);
    assert_memory_equal(out, expected + 3, 3 * sizeof(float));
    assert_memory_equal(out + 3, expected, 3 * sizeof(float));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(defaults_are_the_documented_ones),
        cmocka_unit_test(a_point_between_two_bones),
        cmocka_unit_test(bounds_hold_unless_affine),
        cmocka_unit_test(locks_keep_bits),
        cmocka_unit_test(nothing_to_solve_changes_nothing),
        cmocka_unit_test(nothing_gets_worse),
        cmocka_unit_test(bits_do_not_depend_on_the_way),
        cmocka_unit_test(thesis_keeps_what_is_reached),
        cmocka_unit_test(skinning_by_hand),
    };
    return cmocka_run_group_tests_name("solver", tests, NULL, NULL);
}
