/* The generator's own stages, where a file does not show them: skeletons of every size, weights
 * that agree across the borders of parts, counts that are exact, refusals that leave nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clients/cli/generate/body.h"
#include "clients/cli/generate/generate.h"
#include "clients/cli/generate/skeleton.h"
#include "clients/cli/generate/surface.h"
#include "clients/cli/generate/tessellation.h"
#include "clients/cli/generate/weights.h"

struct stages {
    struct anatomy anatomy;
    struct cage cage;
    struct surface surface;
    struct skeleton skeleton;
    struct weight_model weights;
    struct tessellation tessellation;
};

static int set_up(void **state)
{
    struct stages *stages = calloc(1, sizeof *stages);
    if (stages == NULL)
        return -1;
    skd_anatomy_init(&stages->anatomy);
    skd_body_build(&stages->cage, &stages->anatomy);
    skd_surface_init(&stages->surface, &stages->cage);
    *state = stages;
    return 0;
}

static int tear_down(void **state)
{
    free(*state);
    return 0;
}

/* ---- skeleton ------------------------------------------------------------------------------ */

static void multiply(const double a[16], const double b[16], double out[16])
{
    for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 4; ++r) {
            out[4 * c + r] = 0.0;
            for (int k = 0; k < 4; ++k)
                out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
        }
}

/* Column major, as glTF defines translation * rotation. */
static void local_matrix(const struct skeleton_bone *bone, double out[16])
{
    double x = bone->rotation[0], y = bone->rotation[1], z = bone->rotation[2];
    double w = bone->rotation[3];
    const double matrix[16] = {
        1 - 2 * (y * y + z * z), 2 * (x * y + z * w),     2 * (x * z - y * w),     0,
        2 * (x * y - z * w),     1 - 2 * (x * x + z * z), 2 * (y * z + x * w),     0,
        2 * (x * z + y * w),     2 * (y * z - x * w),     1 - 2 * (x * x + y * y), 0,
        bone->translation[0],    bone->translation[1],    bone->translation[2],    1};
    memcpy(out, matrix, sizeof matrix);
}

static void check_bind(const struct skeleton *skeleton)
{
    static double world[SKELETON_MAX_BONES][16];
    for (uint32_t b = 0; b < skeleton->bone_count; ++b) {
        const struct skeleton_bone *bone = &skeleton->bone[b];
        double local[16], inverse[16], product[16];
        local_matrix(bone, local);
        if (bone->parent < 0)
            memcpy(world[b], local, sizeof local);
        else
            multiply(world[bone->parent], local, world[b]);
        for (int i = 0; i < 16; ++i)
            inverse[i] = bone->inverse_bind[i];
        multiply(world[b], inverse, product);
        for (int i = 0; i < 16; ++i)
            assert_true(fabs(product[i] - (i % 5 == 0)) < 1e-6);
        /* Y runs along the bone. */
        struct vec3 y = vec3(world[b][4], world[b][5], world[b][6]);
        assert_true(vec3_dot(y, bone->along) > 1.0 - 1e-6);
    }
}

static void every_bone_count_has_its_skeleton(void **state)
{
    struct stages *stages = *state;
    for (uint32_t count = SKD_GENERATE_MIN_BONES; count <= SKD_GENERATE_MAX_BONES; ++count) {
        struct skeleton *skeleton = &stages->skeleton;
        skd_skeleton_init(skeleton, &stages->anatomy, count);
        assert_int_equal(skeleton->bone_count, count);
        uint32_t left = 0, right = 0;
        for (uint32_t b = 0; b < count; ++b) {
            const struct skeleton_bone *bone = &skeleton->bone[b];
            assert_true(bone->parent < (int)b);
            assert_true((bone->parent < 0) == (b == 0));
            left += bone->side == SIDE_LEFT;
            right += bone->side == SIDE_RIGHT;
            for (uint32_t other = 0; other < b; ++other)
                assert_string_not_equal(bone->name, skeleton->bone[other].name);
        }
        assert_int_equal(left, right);
        check_bind(skeleton);
    }
}

/* ---- weights ------------------------------------------------------------------------------- */

static double weight_of(const uint8_t joint[INFLUENCE_COUNT], const float weight[INFLUENCE_COUNT],
                        uint32_t bone)
{
    double sum = 0.0;
    for (int i = 0; i < INFLUENCE_COUNT; ++i)
        sum += joint[i] == bone ? weight[i] : 0.0f;
    return sum;
}

/* The largest difference between the weights that the two faces of an edge give one point. */
static double border_gap(const struct stages *stages, const struct surface_edge *edge, double along)
{
    const struct cage *cage = &stages->cage;
    uint8_t joint[2][INFLUENCE_COUNT];
    float weight[2][INFLUENCE_COUNT];
    for (int f = 0; f < 2; ++f) {
        double t = f == 0 ? along : 1.0 - along;
        const double u[4] = {t, 1.0, 1.0 - t, 0.0}, v[4] = {0.0, t, 1.0, 1.0 - t};
        double value[VALUE_COUNT];
        uint16_t face = edge->face[f];
        skd_surface_evaluate(&stages->surface, face, u[edge->side[f]], v[edge->side[f]], value);
        skd_weights_at(&stages->weights, (enum cage_part)cage->part[face], cage->is_right[face],
                       vec3(value[VALUE_X], value[VALUE_Y], value[VALUE_Z]), value, joint[f],
                       weight[f]);
    }
    double gap = 0.0;
    for (uint32_t b = 0; b < stages->skeleton.bone_count; ++b)
        gap =
            fmax(gap, fabs(weight_of(joint[0], weight[0], b) - weight_of(joint[1], weight[1], b)));
    return gap;
}

static void weights_agree_where_parts_meet(void **state)
{
    struct stages *stages = *state;
    static const uint32_t counts[] = {20, 31, 53, 100, 250};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; ++i) {
        skd_skeleton_init(&stages->skeleton, &stages->anatomy, counts[i]);
        skd_weights_init(&stages->weights, &stages->skeleton);
        for (uint32_t e = 0; e < stages->surface.edge_count; ++e) {
            const struct surface_edge *edge = &stages->surface.edge[e];
            /* With chains, a left and a right bone may tie for the last of the four places. */
            int is_middle = stages->cage.mirror[edge->start] == edge->start &&
                            stages->cage.mirror[edge->end] == edge->end;
            if (is_middle && counts[i] > SKD_GENERATE_DEFAULT_BONES)
                continue;
            for (int step = 0; step <= 8; ++step) {
                double gap = border_gap(stages, edge, step / 8.0);
                if (gap > 0.01) {
                    const uint16_t *face = edge->face;
                    const double *at = stages->cage.value[edge->start];
                    fail_msg("%u bones, parts %d and %d meet near (%.3f %.3f %.3f): %.3f apart",
                             counts[i], stages->cage.part[face[0]], stages->cage.part[face[1]],
                             at[0], at[1], at[2], gap);
                }
            }
        }
    }
}

static void weights_sum_to_one_to_the_bit(void **state)
{
    struct stages *stages = *state;
    skd_skeleton_init(&stages->skeleton, &stages->anatomy, 120);
    skd_weights_init(&stages->weights, &stages->skeleton);
    for (uint32_t face = 0; face < stages->cage.face_count; ++face) {
        for (int step = 0; step < 25; ++step) {
            double value[VALUE_COUNT];
            uint8_t joint[INFLUENCE_COUNT];
            float weight[INFLUENCE_COUNT], sum = 0.0f;
            skd_surface_evaluate(&stages->surface, face, (step % 5) / 4.0, (step / 5) / 4.0, value);
            skd_weights_at(&stages->weights, (enum cage_part)stages->cage.part[face],
                           stages->cage.is_right[face],
                           vec3(value[VALUE_X], value[VALUE_Y], value[VALUE_Z]), value, joint,
                           weight);
            for (int i = 0; i < INFLUENCE_COUNT; ++i) {
                assert_true(weight[i] >= 0.0f && joint[i] < 120);
                assert_true(weight[i] > 0.0f || joint[i] == 0);
                assert_true(i == 0 || weight[i] <= weight[i - 1] + 4e-6f); /* rounded */
                sum += weight[i];
            }
            assert_true(sum == 1.0f);
        }
    }
}

/* ---- tessellation -------------------------------------------------------------------------- */

struct visits {
    uint8_t *seen;
    uint32_t count;
    float *position;
    const struct surface *surface;
};

static void visit(uint32_t vertex, uint32_t face, double u, double v, void *user)
{
    struct visits *visits = user;
    double value[VALUE_COUNT];
    assert_true(vertex < visits->count && !visits->seen[vertex]);
    assert_true(u >= 0.0 && u <= 1.0 && v >= 0.0 && v <= 1.0);
    visits->seen[vertex] = 1;
    skd_surface_evaluate(visits->surface, face, u, v, value);
    for (int i = 0; i < 3; ++i)
        visits->position[3 * (size_t)vertex + (size_t)i] = (float)value[VALUE_X + i];
}

/* Every vertex once, every triangle's corners different, no triangle without area. */
static void check_count(struct stages *stages, uint32_t count)
{
    struct tessellation *t = &stages->tessellation;
    skd_tessellation_init(t, &stages->surface, count);
    assert_int_equal(t->vertex_count, count);
    assert_int_equal(t->triangle_count, 2 * (count - 2));
    struct visits visits = {calloc(count, 1), count, calloc(count, 3 * sizeof(float)),
                            &stages->surface};
    uint32_t(*triangle)[3] = malloc(skd_tessellation_face_limit(t) * sizeof *triangle);
    assert_true(visits.seen != NULL && visits.position != NULL && triangle != NULL);
    skd_tessellation_visit(t, visit, &visits);
    for (uint32_t vertex = 0; vertex < count; ++vertex)
        assert_true(visits.seen[vertex]);
    uint32_t triangles = 0;
    for (uint32_t face = 0; face < stages->cage.face_count; ++face) {
        uint32_t made = skd_tessellation_triangles(t, face, visits.position, triangle);
        for (uint32_t i = 0; i < made; ++i) {
            struct vec3 corner[3];
            for (int k = 0; k < 3; ++k) {
                const float *p = &visits.position[3 * (size_t)triangle[i][k]];
                corner[k] = vec3(p[0], p[1], p[2]);
            }
            struct vec3 area =
                vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
            assert_true(vec3_length(area) > 1e-10);
        }
        triangles += made;
    }
    assert_int_equal(triangles, t->triangle_count);
    free(visits.seen);
    free(visits.position);
    free(triangle);
}

static void every_count_is_met_exactly(void **state)
{
    struct stages *stages = *state;
    for (uint32_t count = 1000; count < 1040; ++count)
        check_count(stages, count);
    for (uint32_t count = 1040; count < 60000; count = count * 9 / 8 + 1)
        check_count(stages, count);
}

static void a_cage_is_left_right_symmetric(void **state)
{
    const struct stages *stages = *state;
    const struct cage *cage = &stages->cage;
    assert_true(cage->vertex_count <= SKD_GENERATE_MIN_VERTICES);
    /* Closed and of genus 0. */
    assert_int_equal(cage->vertex_count - stages->surface.edge_count + cage->face_count, 2);
    for (uint32_t v = 0; v < cage->vertex_count; ++v) {
        const double *one = cage->value[v], *two = cage->value[cage->mirror[v]];
        assert_true(fabs(one[VALUE_X] + two[VALUE_X]) < 1e-12);
        for (int i = VALUE_Y; i < VALUE_COUNT; ++i)
            assert_true(fabs(one[i] - two[i]) < 1e-12);
    }
}

/* ---- the call ------------------------------------------------------------------------------ */

static void check_refused(uint32_t vertices, uint16_t bones, const char *range)
{
    const struct skd_generate_options options = {.vertex_count = vertices, .bone_count = bones};
    struct skd_error error = {0};
    assert_int_equal(skd_generate_humanoid(&options, "refused.glb", &error), SKD_BAD_PARAMS);
    assert_int_equal(error.status, SKD_BAD_PARAMS);
    assert_non_null(strstr(error.text, range));
    assert_int_equal(access("refused.glb", F_OK), -1);
}

static void counts_out_of_range_are_refused(void **state)
{
    (void)state;
    check_refused(999, 53, "1000 to 5000000");
    check_refused(5000001, 53, "1000 to 5000000");
    check_refused(0, 53, "1000 to 5000000");
    check_refused(5000, 19, "20 to 250");
    check_refused(5000, 251, "20 to 250");
}

static void note_progress(double fraction, void *user)
{
    double *last = user;
    assert_true(fraction >= *last && fraction <= 1.0);
    *last = fraction;
}

/* A file that cannot take its name leaves nothing beside it. */
static void a_failed_write_leaves_nothing(void **state)
{
    (void)state;
    char folder[] = "/tmp/skind-generate-XXXXXX";
    char path[64];
    assert_non_null(mkdtemp(folder));
    const struct skd_generate_options options = {1000, 20, NULL, NULL};
    struct skd_error error = {0};
    snprintf(path, sizeof path, "%s/nowhere/body.glb", folder);
    assert_int_equal(skd_generate_humanoid(&options, path, &error), SKD_FILE_IO);
    assert_non_null(strstr(error.text, "nowhere"));
    snprintf(path, sizeof path, "%s/.", folder); /* a folder's name cannot be taken */
    assert_int_equal(skd_generate_humanoid(&options, path, &error), SKD_FILE_IO);
    assert_int_equal(rmdir(folder), 0);
}

static void progress_rises_to_one(void **state)
{
    (void)state;
    char folder[] = "/tmp/skind-generate-XXXXXX";
    char path[64];
    assert_non_null(mkdtemp(folder));
    double last = 0.0;
    const struct skd_generate_options options = {2000, 53, note_progress, &last};
    snprintf(path, sizeof path, "%s/body.glb", folder);
    assert_int_equal(skd_generate_humanoid(&options, path, NULL), SKD_OK);
    assert_true(last == 1.0);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_cage_is_left_right_symmetric, set_up, tear_down),
        cmocka_unit_test_setup_teardown(every_bone_count_has_its_skeleton, set_up, tear_down),
        cmocka_unit_test_setup_teardown(weights_agree_where_parts_meet, set_up, tear_down),
        cmocka_unit_test_setup_teardown(weights_sum_to_one_to_the_bit, set_up, tear_down),
        cmocka_unit_test_setup_teardown(every_count_is_met_exactly, set_up, tear_down),
        cmocka_unit_test(counts_out_of_range_are_refused),
        cmocka_unit_test(a_failed_write_leaves_nothing),
        cmocka_unit_test(progress_rises_to_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
