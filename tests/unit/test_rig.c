/* The rig room's own logic, without files: rows of weights, seams, neighbours, clips, arrays. */
#include "rig/clip.h"
#include "rig/influences.h"
#include "rig/matrix.h"
#include "rig/names.h"
#include "rig/pose.h"
#include "rig/rig_build.h"
#include "rig/topology.h"
#include "rig/weight_rows.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

static void assert_near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.17g is not within %g of %.17g", a, tolerance, b);
}

/* ------------------------------------------------------------------------------- mending */

static double row_sum(const struct skd_influence *row, int count)
{
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += (double)row[i].weight;
    return sum;
}

static void test_mend_valid_row_keeps_its_bits(void **state)
{
    (void)state;
    struct skd_influence row[4] = {{3, 0.25f}, {1, 0.5f}, {2, 0.125f}, {0, 0.125f}};
    size_t notes[SKD_NOTE_COUNT] = {0};
    assert_int_equal(skd_influences_mend(row, 4, 9, notes), 4);
    const struct skd_influence expected[4] = {{1, 0.5f}, {3, 0.25f}, {0, 0.125f}, {2, 0.125f}};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(row[i].bone, expected[i].bone);
        assert_true(row[i].weight == expected[i].weight);
    }
    for (int n = 0; n < SKD_NOTE_COUNT; n++)
        assert_int_equal(notes[n], 0);
}

static void test_mend_policies(void **state)
{
    (void)state;
    static const struct {
        struct skd_influence row[4];
        int count, left;
        uint16_t first;
        size_t invalid, missing, merged, normalised;
    } cases[] = {
        {{{1, 2}, {2, 2}}, 2, 2, 1, 0, 0, 0, 1},
        {{{1, NAN}, {2, 1}, {3, INFINITY}}, 3, 1, 2, 2, 0, 0, 0},
        {{{1, -1}, {2, 1}}, 2, 1, 2, 1, 0, 0, 0},
        {{{1, 0}, {2, -0.0f}}, 2, 1, 7, 0, 1, 0, 0},
        {{{0, 0}}, 0, 1, 7, 0, 1, 0, 0},
        {{{1, NAN}}, 1, 1, 7, 1, 1, 0, 0},
        {{{1, 0.25f}, {2, 0.25f}, {1, 0.25f}, {1, 0.25f}}, 4, 2, 1, 0, 0, 2, 0},
        {{{1, 3e38f}, {1, 3e38f}, {2, 3e38f}}, 3, 2, 1, 0, 0, 1, 1},
        {{{1, 1e-45f}, {2, 1e-45f}}, 2, 2, 1, 0, 0, 0, 1},
        {{{1, 1e30f}, {2, 1e-30f}}, 2, 1, 1, 0, 0, 0, 1},
    };
    for (size_t c = 0; c < COUNT(cases); c++) {
        struct skd_influence row[4];
        size_t notes[SKD_NOTE_COUNT] = {0};
        memcpy(row, cases[c].row, sizeof row);
        const int left = skd_influences_mend(row, cases[c].count, 7, notes);
        assert_int_equal(left, cases[c].left);
        assert_int_equal(row[0].bone, cases[c].first);
        assert_int_equal(notes[SKD_NOTE_WEIGHTS_INVALID], cases[c].invalid);
        assert_int_equal(notes[SKD_NOTE_WEIGHTS_MISSING], cases[c].missing);
        assert_int_equal(notes[SKD_NOTE_JOINTS_MERGED], cases[c].merged);
        assert_int_equal(notes[SKD_NOTE_WEIGHTS_NORMALISED], cases[c].normalised);
        assert_near(row_sum(row, left), 1, SKD_ROW_SUM_EXACT);
    }
}

/* Random rows: the sum as stored, and mending what was mended changes nothing. */
static void test_mend_random(void **state)
{
    (void)state;
    srand(7);
    for (int round = 0; round < 100000; round++) {
        struct skd_influence row[SKD_INFLUENCES_MAX], again[SKD_INFLUENCES_MAX];
        size_t notes[SKD_NOTE_COUNT] = {0}, more[SKD_NOTE_COUNT] = {0};
        const int count = 1 + rand() % 12;
        for (int i = 0; i < count; i++)
            row[i] =
                (struct skd_influence){(uint16_t)(rand() % 20),
                                       (float)(rand() % 1000) * (rand() % 9 == 0 ? 1e-9f : 1e-3f)};
        const int left = skd_influences_mend(row, count, 0, notes);
        assert_near(row_sum(row, left), 1, SKD_ROW_SUM_EXACT);
        memcpy(again, row, sizeof again);
        assert_int_equal(skd_influences_mend(again, left, 0, more), left);
        for (int i = 0; i < left; i++) {
            assert_int_equal(again[i].bone, row[i].bone);
            assert_true(again[i].weight == row[i].weight);
            assert_true(i == 0 || row[i - 1].weight >= row[i].weight);
        }
        for (int n = 0; n < SKD_NOTE_COUNT; n++)
            assert_int_equal(more[n], 0);
    }
}

/* ------------------------------------------------------------------------- rows in files */

static void test_place_keeps_slots(void **state)
{
    (void)state;
    const uint16_t joints[] = {10, 11, 12, 13, 14};
    /* In the file: bones 2 1 - 3, the third slot padded with joint 12 (bone 2) of weight 0. */
    struct skd_file_row row = {.count = 4,
                               .joints = {12, 11, 12, 13},
                               .bones = {2, 1, 2, 3},
                               .weights = {0.5f, 0.25f, 0, 0.25f}};
    const struct skd_influence wanted[] = {{4, 0.5f}, {1, 0.3f}, {2, 0.2f}};
    skd_row_place(&row, wanted, 3, joints);
    const uint32_t expected_joints[] = {12, 11, 14, 0};
    const float expected_weights[] = {0.2f, 0.3f, 0.5f, 0};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(row.joints[i], expected_joints[i]);
        assert_true(row.weights[i] == expected_weights[i]);
    }
}

static void test_place_uses_padding_and_leaves_it(void **state)
{
    (void)state;
    const uint16_t joints[] = {0, 1, 2, 3, 4};
    struct skd_file_row row = {
        .count = 4, .joints = {1, 3, 4, 60000}, .bones = {1, 3, 4, -1}, .weights = {1, 0, 0, 0}};
    const struct skd_influence wanted[] = {{1, 0.75f}, {4, 0.25f}};
    skd_row_place(&row, wanted, 2, joints);
    const uint32_t expected_joints[] = {1, 3, 4, 60000};
    const float expected_weights[] = {0.75f, 0, 0.25f, 0};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(row.joints[i], expected_joints[i]);
        assert_true(row.weights[i] == expected_weights[i]);
    }
}

static void test_quantise_known(void **state)
{
    (void)state;
    /* Thirds of 255 are whole; thirds of 65535 as well; 0.4 0.4 0.2 of 255 is 102 102 51. */
    struct skd_file_row row = {.count = 4,
                               .joints = {5, 6, 7, 8},
                               .bones = {5, 6, 7, 8},
                               .weights = {0.335f, 0.335f, 0.33f, 0}};
    uint32_t numerators[SKD_INFLUENCES_MAX];
    /* 85.425 85.425 84.15: one is left, and of equal remainders the lower bone takes it. */
    const double change = skd_row_quantise(&row, 255, numerators);
    assert_int_equal(numerators[0], 86);
    assert_int_equal(numerators[1], 85);
    assert_int_equal(numerators[2], 84);
    assert_int_equal(numerators[3], 0);
    assert_int_equal(row.joints[3], 8);
    assert_near(change, 86 / 255.0 - 0.335, 1e-7);
    /* The other way round in the file, the same bone is rounded up. */
    struct skd_file_row turned = {.count = 4,
                                  .joints = {8, 7, 6, 5},
                                  .bones = {8, 7, 6, 5},
                                  .weights = {0, 0.33f, 0.335f, 0.335f}};
    skd_row_quantise(&turned, 255, numerators);
    assert_int_equal(numerators[3], 86);
    assert_int_equal(numerators[2], 85);
    /* A weight that rounds to nothing gives its joint up. */
    struct skd_file_row tiny = {.count = 4,
                                .joints = {5, 6, 0, 0},
                                .bones = {5, 6, 0, 0},
                                .weights = {0.999f, 0.001f, 0, 0}};
    skd_row_quantise(&tiny, 255, numerators);
    assert_int_equal(numerators[0], 255);
    assert_int_equal(tiny.joints[1], 0);
}

static void test_quantise_random(void **state)
{
    (void)state;
    srand(11);
    for (int round = 0; round < 50000; round++) {
        const uint32_t steps = round % 2 ? 255 : 65535;
        struct skd_file_row row = {.count = 4 + 4 * (rand() % 3)};
        float before[SKD_INFLUENCES_MAX];
        uint32_t numerators[SKD_INFLUENCES_MAX];
        double sum = 0;
        for (int i = 0; i < row.count; i++) {
            row.bones[i] = i;
            row.joints[i] = (uint32_t)i;
            row.weights[i] = (float)(rand() % 3 ? rand() % 4096 : 0);
            sum += (double)row.weights[i];
        }
        if (sum == 0)
            continue;
        for (int i = 0; i < row.count; i++)
            before[i] = row.weights[i] = (float)((double)row.weights[i] / sum);
        const double change = skd_row_quantise(&row, steps, numerators);
        uint32_t total = 0;
        for (int i = 0; i < row.count; i++) {
            total += numerators[i];
            assert_true(before[i] > 0 || numerators[i] == 0);
            assert_true(fabs((double)numerators[i] - (double)before[i] * steps) < 1.001);
        }
        assert_int_equal(total, steps);
        assert_true(change <= 1.001 / steps);
    }
}

/* ------------------------------------------------------------------------------ topology */

/* A square of four triangles around vertex 4; vertex 5 is 1 again, at a seam. */
static float square_rest[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, .5f, .5f, 0, 1, 0, 0};
static uint32_t square_triangles[] = {0, 1, 4, 5, 2, 4, 2, 3, 4, 3, 0, 4, 0, 5, 1};
static uint32_t square_offsets[] = {0, 1, 2, 3, 4, 5, 6};
static uint16_t square_joints[] = {0, 0, 0, 0, 0, 0};
static float square_weights[] = {1, 1, 1, 1, 1, 1};

static void assert_neighbours(const struct skd_mesh *mesh, uint32_t v, const uint32_t *expected,
                              size_t count)
{
    const uint32_t first = mesh->neighbour_offsets[v];
    assert_int_equal(mesh->neighbour_offsets[v + 1] - first, count);
    for (size_t i = 0; i < count; i++)
        assert_int_equal(mesh->neighbours[first + i], expected[i]);
}

static void free_topology(struct skd_mesh *mesh)
{
    free(mesh->twins);
    free(mesh->neighbour_offsets);
    free(mesh->neighbours);
}

static void test_topology(void **state)
{
    (void)state;
    uint16_t skins[6] = {0};
    struct skd_scratch scratch = {0};
    const struct skd_influences influences = {square_offsets, square_joints, square_weights, 1,
                                              false};
    struct skd_mesh mesh = {.vertex_count = 6,
                            .rest = square_rest,
                            .triangle_count = 5,
                            .triangles = square_triangles,
                            .skins = skins};
    assert_int_equal(skd_topology_find_twins(&mesh, &influences, &scratch, NULL), SKD_OK);
    const uint32_t twins[] = {0, 5, 2, 3, 4, 1};
    assert_memory_equal(mesh.twins, twins, sizeof twins);
    assert_int_equal(skd_topology_find_neighbours(&mesh, &scratch, NULL), SKD_OK);
    assert_neighbours(&mesh, 0, (uint32_t[]){1, 3, 4}, 3);
    assert_neighbours(&mesh, 1, (uint32_t[]){0, 2, 4}, 3);
    assert_neighbours(&mesh, 5, (uint32_t[]){0, 2, 4}, 3);
    assert_neighbours(&mesh, 4, (uint32_t[]){0, 1, 2, 3}, 4);
    free_topology(&mesh);
    /* With another skin, or another weight, they are no twins. */
    skins[5] = 1;
    mesh = (struct skd_mesh){.vertex_count = 6,
                             .rest = square_rest,
                             .triangle_count = 5,
                             .triangles = square_triangles,
                             .skins = skins};
    assert_int_equal(skd_topology_find_twins(&mesh, &influences, &scratch, NULL), SKD_OK);
    assert_null(mesh.twins);
    assert_int_equal(skd_topology_find_neighbours(&mesh, &scratch, NULL), SKD_OK);
    assert_neighbours(&mesh, 1, (uint32_t[]){0, 4, 5}, 3);
    free_topology(&mesh);
    skd_scratch_finish(&scratch);
}

/* A fan of 5,000 triangles around one point that every triangle has a vertex of its own for. */
static void test_topology_of_a_crowd(void **state)
{
    (void)state;
    enum { FAN = 5000 };
    struct skd_scratch scratch = {0};
    float *rest = calloc(FAN * 6, sizeof *rest);
    uint32_t *triangles = calloc(FAN * 3, sizeof *triangles);
    uint32_t *offsets = calloc(FAN * 2 + 1, sizeof *offsets);
    uint16_t *joints = calloc(FAN * 2, sizeof *joints);
    float *weights = calloc(FAN * 2, sizeof *weights);
    for (uint32_t i = 0; i < FAN; i++) {
        rest[(FAN + i) * 3] = 1 + (float)i;
        triangles[i * 3] = i;
        triangles[i * 3 + 1] = FAN + i;
        triangles[i * 3 + 2] = FAN + (i + 1) % FAN;
    }
    for (uint32_t v = 0; v < FAN * 2; v++) {
        offsets[v + 1] = v + 1;
        weights[v] = 1;
    }
    uint16_t *skins = calloc(FAN * 2, sizeof *skins);
    const struct skd_influences influences = {offsets, joints, weights, 1, false};
    struct skd_mesh mesh = {.vertex_count = FAN * 2,
                            .rest = rest,
                            .triangle_count = FAN,
                            .triangles = triangles,
                            .skins = skins};
    assert_int_equal(skd_topology_find_twins(&mesh, &influences, &scratch, NULL), SKD_OK);
    for (uint32_t v = 0; v < FAN; v++)
        assert_int_equal(mesh.twins[v], (v + 1) % FAN);
    assert_int_equal(skd_topology_find_neighbours(&mesh, &scratch, NULL), SKD_OK);
    assert_int_equal(mesh.neighbour_offsets[1], FAN);
    assert_neighbours(&mesh, FAN + 1, (uint32_t[]){0, FAN, FAN + 2}, 3);
    free_topology(&mesh);
    skd_scratch_finish(&scratch);
    free(rest);
    free(triangles);
    free(offsets);
    free(joints);
    free(weights);
    free(skins);
}

static void test_degenerate_triangles(void **state)
{
    (void)state;
    uint32_t triangles[] = {0, 0, 1, 0, 1, 2, 3, 4, 3, 5, 6, 6, 2, 1, 0};
    struct skd_mesh mesh = {.triangle_count = 5, .triangles = triangles};
    assert_int_equal(skd_topology_drop_degenerate(&mesh), 3);
    const uint32_t left[] = {0, 1, 2, 2, 1, 0};
    assert_int_equal(mesh.triangle_count, 2);
    assert_memory_equal(triangles, left, sizeof left);
}

/* --------------------------------------------------------------------------------- clips */

static void test_interpolation(void **state)
{
    (void)state;
    float times[] = {1, 2, 4};
    float steps[] = {0, 0, 0, 10, 20, 30, 20, 20, 20};
    struct skd_channel channel = {
        .path = SKD_TRANSLATION, .key_count = 3, .times = times, .values = steps};
    static const struct {
        double time, step, linear;
    } cases[] = {{-5, 0, 0},  {0.99, 0, 0}, {1, 0, 0},   {1.5, 0, 5}, {1.999, 0, 9.99},
                 {2, 10, 10}, {3, 10, 15},  {4, 20, 20}, {9, 20, 20}, {1e300, 20, 20}};
    for (size_t c = 0; c < COUNT(cases); c++) {
        double out[3];
        channel.interpolation = SKD_STEP;
        skd_channel_sample(&channel, cases[c].time, out);
        assert_near(out[0], cases[c].step, 0);
        channel.interpolation = SKD_LINEAR;
        skd_channel_sample(&channel, cases[c].time, out);
        assert_near(out[0], cases[c].linear, 1e-12);
    }
}

/* A cubic polynomial given by its values and slopes comes back exactly. */
static void test_cubic(void **state)
{
    (void)state;
    float times[] = {1, 3};
    float keys[18];
    for (int k = 0; k < 2; k++) {
        const float t = times[k];
        for (int i = 0; i < 3; i++) {
            keys[k * 9 + i] = keys[k * 9 + 6 + i] = 3 * t * t - 4 * t;
            keys[k * 9 + 3 + i] = t * t * t - 2 * t * t + 5;
        }
    }
    const struct skd_channel channel = {.path = SKD_SCALE,
                                        .interpolation = SKD_CUBICSPLINE,
                                        .key_count = 2,
                                        .times = times,
                                        .values = keys};
    for (double t = 1; t <= 3; t += 0.1) {
        double out[3];
        skd_channel_sample(&channel, t, out);
        assert_near(out[2], t * t * t - 2 * t * t + 5, 1e-12);
    }
    double out[3];
    skd_channel_sample(&channel, 8, out);
    assert_near(out[0], 14, 0);
}

static void test_slerp(void **state)
{
    (void)state;
    const double half = 40 * 3.14159265358979323846 / 180;
    float times[] = {0, 1};
    /* 80 degrees about z, the second key with its sign turned: still the short way. */
    float keys[] = {0, 0, 0, 1, 0, 0, -(float)sin(half), -(float)cos(half)};
    struct skd_channel channel = {.path = SKD_ROTATION,
                                  .interpolation = SKD_LINEAR,
                                  .key_count = 2,
                                  .times = times,
                                  .values = keys};
    for (double u = 0; u <= 1; u += 0.125) {
        double out[4];
        skd_channel_sample(&channel, u, out);
        const double sign = out[3] < 0 ? -1 : 1;
        assert_near(sign * out[2], sin(half * u), 1e-7);
        assert_near(sign * out[3], cos(half * u), 1e-7);
        assert_near(out[2] * out[2] + out[3] * out[3], 1, 1e-15);
    }
    float same[] = {0, 0, 0.6f, 0.8f, 0, 0, 0.6f, 0.8f};
    channel.values = same;
    double out[4];
    skd_channel_sample(&channel, 0.3, out);
    assert_near(out[2], 0.6, 1e-7);
}

/* -------------------------------------------------------------------------------- matrices */

static void test_matrices(void **state)
{
    (void)state;
    srand(5);
    for (int round = 0; round < 1000; round++) {
        double t[3], q[4], s[3], m[12], back[12], inverse[12], product[12];
        for (int i = 0; i < 4; i++)
            q[i] = rand() / (RAND_MAX / 2.0) - 1;
        for (int i = 0; i < 3; i++) {
            t[i] = rand() / (RAND_MAX / 20.0) - 10;
            s[i] = (rand() / (RAND_MAX / 3.0) + 1e-3) * (i == 0 && round % 3 == 0 ? -1 : 1);
        }
        skd_quaternion_normalise(q);
        skd_matrix_from_trs(t, q, s, m);
        skd_matrix_to_trs(m, t, q, s);
        skd_matrix_from_trs(t, q, s, back);
        assert_true(skd_matrix_invert(m, inverse));
        skd_matrix_multiply(m, inverse, product);
        for (int i = 0; i < 12; i++) {
            assert_near(back[i], m[i], 1e-12);
            assert_near(product[i], i % 5 == 0, 1e-9);
        }
    }
    const double flat[12] = {1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0};
    double untouched[12] = {42};
    assert_false(skd_matrix_invert(flat, untouched));
    assert_near(untouched[0], 42, 0);
}

/* ----------------------------------------------------------------------------------- names */

static void test_names(void **state)
{
    (void)state;
    const char *given[] = {"arm", NULL, "arm", "", "joint1", "arm_2", "arm"};
    const char *expected[] = {"arm", "joint1", "arm_2", "joint3", "joint1_4", "arm_2_5", "arm_6"};
    char *names[COUNT(given)];
    for (size_t i = 0; i < COUNT(given); i++)
        names[i] = given[i] != NULL ? strdup(given[i]) : NULL;
    assert_int_equal(skd_names_make_unique(names, COUNT(given), "joint", NULL), SKD_OK);
    for (size_t i = 0; i < COUNT(given); i++) {
        assert_string_equal(names[i], expected[i]);
        free(names[i]);
    }
}

static void test_notes(void **state)
{
    (void)state;
    for (int n = 0; n < SKD_NOTE_COUNT; n++) {
        char text[200];
        const char *name = skd_note_name((enum skd_note)n);
        assert_true(strspn(name, "abcdefghijklmnopqrstuvwxyz_") == strlen(name));
        skd_note_text((enum skd_note)n, 12345, text, sizeof text);
        assert_non_null(strstr(text, "12345"));
    }
}

/* ---------------------------------------------------------------------------------- arrays */

/* Two bones, bone 1 on top of bone 0, and the square of above. */
static int32_t pair_parents[] = {-1, 0};
static double pair_binds[] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1,
                              2, 0, 0, 0, 0, 2, 0, 1, 0, 0, 2, 0, 0, 0, 0, 1};

static struct skd_rig_arrays square_arrays(void)
{
    return (struct skd_rig_arrays){.vertex_count = 6,
                                   .positions = square_rest,
                                   .triangle_count = 5,
                                   .triangles = square_triangles,
                                   .bone_count = 2,
                                   .parents = pair_parents,
                                   .bind_matrices = pair_binds,
                                   .influence_offsets = square_offsets,
                                   .influence_joints = square_joints,
                                   .influence_weights = square_weights};
}

static void test_rig_from_arrays(void **state)
{
    (void)state;
    const struct skd_rig_arrays arrays = square_arrays();
    struct skd_rig *rig = NULL;
    struct skd_influences influences;
    struct skd_error error = {0};
    assert_int_equal(skd_rig_from_arrays(&arrays, &rig, &influences, &error), SKD_OK);
    assert_string_equal(rig->skeleton.names[1], "bone1");
    assert_int_equal(skd_rig_find_bone(rig, "bone1"), 1);
    assert_int_equal(skd_rig_find_bone(rig, "nobody"), -1);
    assert_int_equal(skd_rig_find_clip(rig, "walk"), -1);
    assert_near(rig->length, sqrt(2), 1e-6);
    assert_near((double)rig->skeleton.heads[4], 1, 0);
    assert_null(rig->mesh.twins); /* only a file splits vertices */
    assert_int_equal(influences.most, 1);
    assert_null(rig->source);
    assert_true(skd_rig_bytes(rig) > 6 * 12);
    /* Posed at the bind matrices themselves, nothing moves. */
    double skin[24];
    assert_int_equal(skd_pose_from_matrices(rig, pair_binds, skin, &error), SKD_OK);
    for (int i = 0; i < 24; i++)
        assert_near(skin[i], i % 12 % 5 == 0, 1e-15);
    double wrong[32];
    memcpy(wrong, pair_binds, sizeof wrong);
    wrong[28] = 1;
    assert_int_equal(skd_pose_from_matrices(rig, wrong, skin, &error), SKD_BAD_PARAMS);
    wrong[28] = NAN;
    assert_int_equal(skd_pose_from_matrices(rig, wrong, skin, &error), SKD_NOT_FINITE);
    assert_int_equal(skd_pose_from_clip(rig, 0, 0, skin, &error), SKD_NO_CLIP);
    skd_rig_destroy(rig);
    skd_influences_finish(&influences);
}

static void assert_refused(const struct skd_rig_arrays *arrays, enum skd_status expected)
{
    struct skd_rig *rig = NULL;
    struct skd_influences influences;
    struct skd_error error = {0};
    assert_int_equal(skd_rig_from_arrays(arrays, &rig, &influences, &error), expected);
    assert_null(rig);
    assert_null(influences.offsets);
    assert_true(strlen(error.text) > 10);
}

/* Bends keep every joint together: a bone and its parent carry the joint to one place, however the
 * bones are ordered. */
static void test_bend(void **state)
{
    (void)state;
    enum { BONES = 5 };
    static const int32_t orders[][BONES] = {{-1, 0, 1, 2, 1}, {1, 2, 3, 4, -1}, {3, -1, 1, 2, 0}};
    static const float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const uint32_t triangles[] = {0, 1, 2}, offsets[] = {0, 1, 2, 3};
    static const uint16_t joints[] = {0, 1, 2};
    static const float weights[] = {1, 1, 1};
    double binds[BONES * 16] = {0}, bent[BONES * SKD_MATRIX_SIZE];
    for (int b = 0; b < BONES; b++) {
        for (int i = 0; i < 4; i++)
            binds[16 * b + 5 * i] = 1;
        binds[16 * b + 3] = 0.3 * b;
        binds[16 * b + 7] = 1.0 / (b + 1);
    }
    for (size_t order = 0; order < sizeof orders / sizeof *orders; order++) {
        struct skd_rig_arrays arrays = {3,      positions,     1,     triangles, BONES,
                                        NULL,   orders[order], binds, offsets,   joints,
                                        weights};
        struct skd_rig *rig;
        struct skd_influences influences;
        assert_int_equal(skd_rig_from_arrays(&arrays, &rig, &influences, NULL), SKD_OK);
        skd_pose_bend(rig, 7, 0.5, bent);
        for (int b = 0; b < BONES; b++) {
            const double *own = bent + b * SKD_MATRIX_SIZE;
            int32_t parent = orders[order][b];
            double here[3] = {0}, there[3] = {0};
            skd_matrix_add_transformed(own, rig->skeleton.heads + 3 * b, 1, here);
            skd_matrix_add_transformed(parent < 0 ? rig->rest_pose + b * SKD_MATRIX_SIZE
                                                  : bent + parent * SKD_MATRIX_SIZE,
                                       rig->skeleton.heads + 3 * b, 1, there);
            for (int i = 0; i < 3; i++)
                assert_near(here[i], there[i], 1e-12);
            if (parent < 0) /* the trace of a turn by 0.5 */
                assert_near(own[0] + own[5] + own[10], 1 + 2 * cos(0.5), 1e-12);
        }
        skd_rig_destroy(rig);
        skd_influences_finish(&influences);
    }
}

/* A rig of so many vertices and bones, each of them anywhere; what becomes of it. */
static enum skd_status make_large(size_t vertex_count, int bone_count)
{
    struct skd_rig *rig = NULL;
    struct skd_influences influences;
    struct skd_error error = {0};
    struct skd_rig_arrays arrays = square_arrays();
    float *positions = calloc(3 * vertex_count, sizeof *positions);
    uint32_t *offsets = calloc(vertex_count + 1, sizeof *offsets);
    int32_t *parents = calloc((size_t)bone_count, sizeof *parents);
    double *binds = calloc(16 * (size_t)bone_count, sizeof *binds);
    assert_true(positions != NULL && offsets != NULL && parents != NULL && binds != NULL);
    positions[3] = positions[7] = 1;
    for (int b = 0; b < bone_count; b++) {
        parents[b] = b - 1;
        for (int i = 0; i < 16; i += 5)
            binds[16 * b + i] = 1;
    }
    arrays.vertex_count = vertex_count;
    arrays.positions = positions;
    arrays.triangle_count = 1;
    arrays.triangles = (uint32_t[]){0, 1, 2};
    arrays.bone_count = bone_count;
    arrays.parents = parents;
    arrays.bind_matrices = binds;
    arrays.influence_offsets = offsets;
    enum skd_status status = skd_rig_from_arrays(&arrays, &rig, &influences, &error);
    if (status == SKD_OK) {
        assert_true(rig->mesh.vertex_count == vertex_count);
        assert_int_equal(rig->skeleton.bone_count, bone_count);
    }
    skd_rig_destroy(rig);
    skd_influences_finish(&influences);
    free(positions);
    free(offsets);
    free(parents);
    free(binds);
    return status;
}

static void test_as_large_as_the_limits_say(void **state)
{
    (void)state;
    assert_int_equal(make_large(SKD_VERTICES_MAX - 1, 1), SKD_OK);
    assert_int_equal(make_large(SKD_VERTICES_MAX, 1), SKD_OK);
    assert_int_equal(make_large(SKD_VERTICES_MAX + 1, 1), SKD_TOO_LARGE);
    assert_int_equal(make_large(3, SKD_BONES_MAX - 1), SKD_OK);
    assert_int_equal(make_large(3, SKD_BONES_MAX), SKD_OK);
    assert_int_equal(make_large(3, SKD_BONES_MAX + 1), SKD_TOO_LARGE);
}

static void test_arrays_that_are_wrong(void **state)
{
    (void)state;
    struct skd_rig_arrays arrays = square_arrays();
    arrays.vertex_count = 0;
    assert_refused(&arrays, SKD_BAD_RIG);
    arrays = square_arrays();
    arrays.vertex_count = SKD_VERTICES_MAX + 1;
    assert_refused(&arrays, SKD_TOO_LARGE);
    arrays = square_arrays();
    arrays.triangle_count = SKD_TRIANGLES_MAX + 1;
    assert_refused(&arrays, SKD_TOO_LARGE);
    arrays = square_arrays();
    arrays.bone_count = SKD_BONES_MAX + 1;
    assert_refused(&arrays, SKD_TOO_LARGE);
    arrays = square_arrays();
    arrays.positions = (float[18]){[7] = NAN};
    assert_refused(&arrays, SKD_NOT_FINITE);
    arrays.positions = (float[18]){[17] = INFINITY};
    assert_refused(&arrays, SKD_NOT_FINITE);
    arrays = square_arrays();
    arrays.triangles = (uint32_t[15]){[14] = 6};
    assert_refused(&arrays, SKD_BAD_INDEX);
    arrays = square_arrays();
    arrays.parents = (int32_t[]){-1, 2};
    assert_refused(&arrays, SKD_BAD_INDEX);
    arrays.parents = (int32_t[]){1, 0};
    assert_refused(&arrays, SKD_BAD_RIG);
    arrays.parents = (int32_t[]){0, -1};
    assert_refused(&arrays, SKD_BAD_RIG);
    arrays = square_arrays();
    arrays.bind_matrices = (double[32]){[15] = 1};
    assert_refused(&arrays, SKD_BAD_RIG);
    arrays = square_arrays();
    arrays.influence_offsets = (uint32_t[]){1, 1, 2, 3, 4, 5, 6};
    assert_refused(&arrays, SKD_COUNT_MISMATCH);
    arrays.influence_offsets = (uint32_t[]){0, 3, 2, 3, 4, 5, 6};
    assert_refused(&arrays, SKD_COUNT_MISMATCH);
    arrays.influence_offsets = (uint32_t[]){0, 65, 65, 65, 65, 65, 65};
    assert_refused(&arrays, SKD_TOO_LARGE);
    arrays = square_arrays();
    arrays.influence_joints = (uint16_t[6]){[3] = 2};
    assert_refused(&arrays, SKD_BAD_INDEX);
    arrays = square_arrays();
    arrays.influence_weights = (float[6]){[2] = NAN};
    assert_refused(&arrays, SKD_NOT_FINITE);
}

static void test_arrays_that_are_mended(void **state)
{
    (void)state;
    struct skd_rig_arrays arrays = square_arrays();
    arrays.influence_offsets = (uint32_t[]){0, 2, 2, 3, 4, 5, 6};
    arrays.influence_joints = (uint16_t[]){1, 1, 1, 1, 1, 1};
    arrays.influence_weights = (float[]){0.5f, 0.5f, 2, 1, 1, -1};
    arrays.bone_names = (const char *const[]){"hip", NULL};
    struct skd_rig *rig = NULL;
    struct skd_influences influences;
    assert_int_equal(skd_rig_from_arrays(&arrays, &rig, &influences, NULL), SKD_OK);
    assert_int_equal(rig->notes[SKD_NOTE_JOINTS_MERGED], 1);
    assert_int_equal(rig->notes[SKD_NOTE_WEIGHTS_MISSING], 2);
    assert_int_equal(rig->notes[SKD_NOTE_WEIGHTS_NORMALISED], 1);
    assert_int_equal(rig->notes[SKD_NOTE_WEIGHTS_INVALID], 1);
    assert_int_equal(influences.joints[influences.offsets[1]], 0);
    assert_string_equal(rig->skeleton.names[0], "hip");
    assert_string_equal(rig->skeleton.names[1], "bone1");
    skd_rig_destroy(rig);
    skd_influences_finish(&influences);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mend_valid_row_keeps_its_bits),
        cmocka_unit_test(test_mend_policies),
        cmocka_unit_test(test_mend_random),
        cmocka_unit_test(test_place_keeps_slots),
        cmocka_unit_test(test_place_uses_padding_and_leaves_it),
        cmocka_unit_test(test_quantise_known),
        cmocka_unit_test(test_quantise_random),
        cmocka_unit_test(test_topology),
        cmocka_unit_test(test_topology_of_a_crowd),
        cmocka_unit_test(test_degenerate_triangles),
        cmocka_unit_test(test_interpolation),
        cmocka_unit_test(test_cubic),
        cmocka_unit_test(test_slerp),
        cmocka_unit_test(test_matrices),
        cmocka_unit_test(test_names),
        cmocka_unit_test(test_notes),
        cmocka_unit_test(test_rig_from_arrays),
        cmocka_unit_test(test_bend),
        cmocka_unit_test(test_as_large_as_the_limits_say),
        cmocka_unit_test(test_arrays_that_are_wrong),
        cmocka_unit_test(test_arrays_that_are_mended),
    };
    return cmocka_run_group_tests_name("rig", tests, NULL, NULL);
}
