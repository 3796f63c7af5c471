/* skinctl's pure parts: the brush, values from the command line, stroke scripts. */
#include "clients/cli/brush.h"
#include "clients/cli/print.h"
#include "clients/cli/script.h"
#include "clients/cli/values.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* cmocka's own comparison is in float. */
#define assert_near(found, expected, tolerance)                                                    \
    assert_true(fabs((double)(found) - (double)(expected)) <= (tolerance))

/* ---- the brush ---- */

enum { SIDE = 9, VERTICES = SIDE * SIDE + 1, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

/* A flat sheet in z = 0, one unit a square, its normals along +z. The last vertex is a twin of the
 * middle one that only one triangle uses. */
struct sheet {
    float rest[VERTICES][3];
    float posed[VERTICES][3];
    uint32_t triangles[TRIANGLES][3];
};
static const uint32_t middle = SIDE * SIDE / 2, twin = VERTICES - 1;

static struct skd_surface make_sheet(struct sheet *sheet)
{
    size_t used = 0;
    for (uint32_t i = 0; i < VERTICES; i++) {
        uint32_t place = i == twin ? middle : i;
        sheet->rest[i][0] = sheet->posed[i][0] = (float)(place % SIDE);
        sheet->rest[i][1] = sheet->posed[i][1] = (float)(place / SIDE);
        sheet->rest[i][2] = sheet->posed[i][2] = 0;
    }
    for (uint32_t row = 0; row + 1 < SIDE; row++) {
        for (uint32_t column = 0; column + 1 < SIDE; column++) {
            uint32_t corner = row * SIDE + column;
            const uint32_t two[2][3] = {{corner, corner + 1, corner + SIDE + 1},
                                        {corner, corner + SIDE + 1, corner + SIDE}};
            memcpy(sheet->triangles[used], two, sizeof two);
            used += 2;
        }
    }
    for (size_t i = 0; i < used; i++) {
        if (sheet->triangles[i][0] == middle) {
            sheet->triangles[i][0] = twin;
            break;
        }
    }
    return (struct skd_surface){VERTICES, &sheet->rest[0][0], &sheet->posed[0][0], TRIANGLES,
                                &sheet->triangles[0][0]};
}

static void falloffs_run_from_one_to_zero(void **state)
{
    static const double halfway[] = {0.5, 0.5, 1, 0.8660254037844386, 0.25};
    (void)state;
    for (int i = 0; skd_falloff_words[i] != NULL; i++) {
        enum skd_falloff falloff = (enum skd_falloff)i;
        assert_near(skd_falloff_at(falloff, 0), 1, 1e-15);
        assert_near(skd_falloff_at(falloff, 0.5), halfway[i], 1e-15);
        assert_near(skd_falloff_at(falloff, 1), 0, 0);
        assert_near(skd_falloff_at(falloff, 7), 0, 0);
        for (double t = 0; t < 1; t += 0.01)
            assert_true(skd_falloff_at(falloff, t) >= skd_falloff_at(falloff, t + 0.01));
    }
}

static void brush_moves_what_is_within_its_radius(void **state)
{
    static struct sheet sheet;
    struct skd_surface surface = make_sheet(&sheet);
    struct skd_brush brush = {
        .centre = {4, 4, 0}, .radius = 1.2, .falloff = SKD_FALLOFF_LINEAR, .move = {0.5, 0, -2}};
    struct skd_brushed brushed;
    struct skd_error error;
    (void)state;
    surface.rest = NULL; /* not needed for move */
    surface.triangles = NULL;
    assert_int_equal(skd_brush_apply(&brush, &surface, &brushed, &error), SKD_OK);
    /* The middle, its four neighbours, and the twin. */
    const uint32_t expected[] = {middle - SIDE, middle - 1,    middle,
                                 middle + 1,    middle + SIDE, twin};
    assert_int_equal(brushed.count, 6);
    assert_memory_equal(brushed.vertices, expected, sizeof expected);
    assert_near(brushed.nearest, 0, 0);
    for (size_t i = 0; i < 6; i++) {
        bool is_middle = expected[i] == middle || expected[i] == twin;
        double share = is_middle ? 1 : 1 - 1 / 1.2;
        const float *from = sheet.posed[expected[i]], *to = brushed.positions + 3 * i;
        assert_near(to[0] - from[0], 0.5 * share, 1e-6);
        assert_near(to[1] - from[1], 0, 1e-6);
        assert_near(to[2] - from[2], -2 * share, 1e-6);
    }
    skd_brushed_finish(&brushed);
}

static void brush_goes_along_normals_and_keeps_twins_together(void **state)
{
    static struct sheet sheet;
    struct skd_surface surface = make_sheet(&sheet);
    struct skd_brush brush = {.centre = {4, 4, 0}, .radius = 1.2, .out = 0.25};
    struct skd_brushed brushed;
    struct skd_error error;
    (void)state;
    /* A tent: the normals of the middle row lean by the mean of both sides, which is straight up;
     * those beside it lean outwards by 45 degrees. */
    for (size_t i = 0; i < VERTICES; i++)
        sheet.posed[i][2] = -fabsf(sheet.posed[i][0] - 4);
    assert_int_equal(skd_brush_apply(&brush, &surface, &brushed, &error), SKD_OK);
    assert_int_equal(brushed.count, 4); /* those beside the middle are sqrt(2) away now */
    for (size_t i = 0; i < brushed.count; i++) {
        const float *from = sheet.posed[brushed.vertices[i]], *to = brushed.positions + 3 * i;
        bool is_middle = brushed.vertices[i] == middle || brushed.vertices[i] == twin;
        double s = is_middle ? 1 : 1 - 1 / 1.2;
        assert_near(to[2] - from[2], 0.25 * s * s * (3 - 2 * s), 2e-3);
    }
    const float *first = NULL, *second = NULL;
    for (size_t i = 0; i < brushed.count; i++) {
        if (brushed.vertices[i] == middle)
            first = brushed.positions + 3 * i;
        if (brushed.vertices[i] == twin)
            second = brushed.positions + 3 * i;
    }
    assert_non_null(first);
    assert_non_null(second);
    assert_memory_equal(first, second, 3 * sizeof *first);
    skd_brushed_finish(&brushed);
}

static void brush_that_touches_nothing_tells_how_far_it_is(void **state)
{
    static struct sheet sheet;
    struct skd_surface surface = make_sheet(&sheet);
    struct skd_brush brush = {.centre = {4, 4, 3}, .radius = 2.5, .out = 1};
    struct skd_brushed brushed;
    struct skd_error error;
    (void)state;
    assert_int_equal(skd_brush_apply(&brush, &surface, &brushed, &error), SKD_OK);
    assert_int_equal(brushed.count, 0);
    assert_near(brushed.nearest, 3, 1e-12);
    skd_brushed_finish(&brushed);
}

static void bone_centre_is_where_bone_and_parent_meet(void **state)
{
    /* Five vertices in a row: bone 0, 0, 0+1, 1, 1. Joint 65535 is no bone. */
    static const float posed[5][3] = {{0, 0, 0}, {1, 0, 0}, {2, 1, 0}, {3, 0, 0}, {4, 0, 0}};
    static const uint16_t joints[5][2] = {{0, 65535}, {0, 65535}, {0, 1}, {1, 65535}, {1, 0}};
    static const float shares[5][2] = {{1, 0}, {1, 0}, {0.5F, 0.5F}, {1, 0}, {1, 0}};
    const struct skd_weights weights = {5, 2, &joints[0][0], &shares[0][0]};
    double centre[3];
    (void)state;
    assert_true(skd_bone_centre(&weights, &posed[0][0], 1, 0, centre));
    assert_near(centre[0], 2, 0);
    assert_near(centre[1], 1, 0);
    /* Without a parent: nearest to the middle of its own vertices, (0 + 1 + 0.5 * 2) / 2.5. */
    assert_true(skd_bone_centre(&weights, &posed[0][0], 0, -1, centre));
    assert_near(centre[0], 1, 0);
    /* A parent that shares nothing does not matter. */
    assert_true(skd_bone_centre(&weights, &posed[0][0], 0, 5, centre));
    assert_near(centre[0], 1, 0);
    assert_false(skd_bone_centre(&weights, &posed[0][0], 5, 0, centre));
}

/* ---- values ---- */

static void vectors_and_indexes_are_read_whole_or_refused(void **state)
{
    static const char *const bad_vectors[] = {"",        "1",    "1,2",     "1,2,3,4", "1,2,x",
                                              "1,2,nan", "1,,3", "1,2,3 4", "inf,0,0"};
    static const char *const bad_indexes[] = {"",   "a",  "1,",  ",1",        "5-3",
                                              "-1", "1-", "1.5", "4294967296"};
    struct skd_error error;
    double vector[3];
    uint32_t *indexes;
    size_t count;
    (void)state;
    assert_int_equal(skd_value_vector("--move", "-1.5,2e-3,0", vector, &error), SKD_OK);
    assert_near(vector[0], -1.5, 0);
    assert_near(vector[1], 2e-3, 0);
    for (size_t i = 0; i < sizeof bad_vectors / sizeof *bad_vectors; i++) {
        assert_int_not_equal(skd_value_vector("--move", bad_vectors[i], vector, &error), SKD_OK);
        assert_non_null(strstr(error.text, "--move"));
    }
    assert_int_equal(skd_value_indexes("--vertices", "7,0-2,4294967295", &indexes, &count, &error),
                     SKD_OK);
    const uint32_t expected[] = {7, 0, 1, 2, UINT32_MAX};
    assert_int_equal(count, 5);
    assert_memory_equal(indexes, expected, sizeof expected);
    free(indexes);
    for (size_t i = 0; i < sizeof bad_indexes / sizeof *bad_indexes; i++)
        assert_int_not_equal(
            skd_value_indexes("--vertices", bad_indexes[i], &indexes, &count, &error), SKD_OK);
}

static void counts_are_grouped(void **state)
{
    char text[SKD_COUNT_TEXT_BYTES];
    (void)state;
    assert_string_equal(skd_count_text(0, text), "0");
    assert_string_equal(skd_count_text(999, text), "999");
    assert_string_equal(skd_count_text(1000, text), "1,000");
    assert_string_equal(skd_count_text(-1234567, text), "-1,234,567");
    assert_string_equal(skd_bytes_text(1536, text), "1.5 KiB");
}

/* ---- scripts ---- */

static void script_is_read_member_by_member(void **state)
{
    static const char text[] =
        "poses:\n"
        "  - {name: bent, clip: bend, time: 0.5}\n"
        "  - name: own\n"
        "    matrices: [[1,0,0,0, 0,1,0,0, 0,0,1,2.5, 0,0,0,1]]\n"
        "strokes:\n"
        "  - pose: bent\n"
        "    brush: {centre: [1, 2, 3e-1], radius: 0.25, falloff: sharp, move: [0, 0, 1], out: "
        "-1}\n"
        "    method: thesis\n"
        "    constraint: affine\n"
        "    stiffness: 0\n"
        "    lock_bones: [head, \"hand.L\"]\n"
        "  - {pose: own, vertices: [7, 8], positions: [[0, 1, 0], [0.5, 1, 0]]}\n";
    struct skd_script *script;
    struct skd_error error = {0};
    (void)state;
    assert_int_equal(skd_script_parse("s.yaml", text, strlen(text), &script, &error), SKD_OK);
    assert_int_equal(script->poses_count, 2);
    assert_string_equal(script->poses[0].clip, "bend");
    assert_near(*script->poses[0].time, 0.5, 0);
    assert_int_equal(script->poses[1].matrices_count, 1);
    assert_near(script->poses[1].matrices[0][11], 2.5, 0);
    assert_int_equal(script->strokes_count, 2);
    const struct skd_script_stroke *stroke = &script->strokes[0];
    assert_near(stroke->brush->centre[2], 0.3, 0);
    assert_near(*stroke->brush->radius, 0.25, 0);
    assert_near(*stroke->brush->out, -1, 0);
    assert_null(stroke->brush->bone);
    assert_string_equal(stroke->method, "thesis");
    assert_near(*stroke->stiffness, 0, 0);
    assert_int_equal(stroke->lock_bones_count, 2);
    assert_string_equal(stroke->lock_bones[1], "hand.L");
    stroke = &script->strokes[1];
    assert_null(stroke->brush);
    assert_null(stroke->stiffness);
    assert_int_equal(stroke->vertices[1], 8);
    assert_near(stroke->positions[1][0], 0.5, 0);
    skd_script_destroy(script);
}

/* What is wrong, and what the error has to name. */
static const struct {
    const char *text;
    const char *named;
} bad_scripts[] = {
    {"", "empty"},
    {"# only a comment\n", "empty"},
    {"hello", "MAPPING"},
    {"strokes: []\n", "strokes"},
    {"poses: []\n", "strokes"},
    {"strokes:\n  - pose: a\n    brsh: {}\n", "brsh"},
    {"strokes:\n  - brush: {centre: [0,0,0], radius: 1, out: 1}\n", "pose"},
    {"strokes:\n  - pose: a\n", "stroke 1"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,0], out: 1}\n", "radius"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0], radius: 1, out: 1}\n", "line 3"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,0], radius: wide, out: 1}\n", "line 3"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,0], radius: -1, out: 1}\n", "radius"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,0], radius: nan, out: 1}\n", "radius"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,0], radius: 1}\n", "move or out"},
    {"strokes:\n  - pose: a\n    brush: {radius: 1, out: 1}\n", "centre or a bone"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,0], bone: b, radius: 1, out: 1}\n", "both"},
    {"strokes:\n  - pose: a\n    brush: {centre: [0,0,1e999], radius: 1, out: 1}\n", "centre"},
    {"strokes:\n  - pose: a\n    brush: {bone: b, radius: 1, out: .inf}\n", "line 3"},
    {"strokes:\n  - pose: a\n    brush: {bone: b, radius: 1, out: 1, falloff: soft}\n", "falloff"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0],[1,1,1]]}\n", "1 vertices and 2"},
    {"strokes:\n  - {pose: a, vertices: [-1], positions: [[0,0,0]]}\n", "-1"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,1e39]]}\n", "vertex 1"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], method: best}\n", "method"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], stiffness: 11}\n", "stiffness"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], constraint: x}\n", "constraint"},
    {"poses: [{name: a, clip: c}]\nstrokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]]}\n",
     "pose 1"},
    {"poses: [{name: rest, clip: c, time: 0}]\nstrokes: [{pose: a}]\n", "rest"},
    {"poses: [{name: a, clip: c, time: -1}]\nstrokes: [{pose: a}]\n", "time"},
    {"poses: [{name: a, matrices: [[1, 2]]}]\nstrokes: [{pose: a}]\n", "line 1"},
    {"poses: [{name: a, clip: c, time: 0}, {name: a, clip: c, time: 1}]\nstrokes: [{pose: a}]\n",
     "pose 2"},
    {"strokes:\n  - pose: &x a\n  - pose: *x\n", "alias"},
    {"strokes:\n  - pose: a\n\tmethod: exact\n", "tab"},
    {"strokes: [", "libyaml"},
};

static void malformed_scripts_are_refused_by_name(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof bad_scripts / sizeof *bad_scripts; i++) {
        struct skd_script *script;
        struct skd_error error = {0};
        const char *text = bad_scripts[i].text;
        enum skd_status status = skd_script_parse("s.yaml", text, strlen(text), &script, &error);
        if (status == SKD_OK || strstr(error.text, bad_scripts[i].named) == NULL ||
            strncmp(error.text, "s.yaml", 6) != 0)
            fail_msg("script %zu gave \"%s\", which should name \"%s\":\n%s", i, error.text,
                     bad_scripts[i].named, text);
    }
}

/* What --help shows as an example is a script. */
static void the_format_in_help_is_what_is_read(void **state)
{
    const char *text = strchr(skd_script_format, '\n');
    struct skd_script *script;
    struct skd_error error = {0};
    (void)state;
    if (skd_script_parse("help", text, strlen(text), &script, &error) != SKD_OK)
        fail_msg("%s", error.text);
    assert_int_equal(script->poses_count, 1);
    assert_int_equal(script->strokes_count, 2);
    assert_string_equal(script->strokes[0].brush->falloff, "smooth");
    assert_float_equal((float)*script->strokes[0].stiffness, 0.008F, 0);
    assert_int_equal(script->strokes[1].positions_count, 2);
    skd_script_destroy(script);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(falloffs_run_from_one_to_zero),
        cmocka_unit_test(brush_moves_what_is_within_its_radius),
        cmocka_unit_test(brush_goes_along_normals_and_keeps_twins_together),
        cmocka_unit_test(brush_that_touches_nothing_tells_how_far_it_is),
        cmocka_unit_test(bone_centre_is_where_bone_and_parent_meet),
        cmocka_unit_test(vectors_and_indexes_are_read_whole_or_refused),
        cmocka_unit_test(counts_are_grouped),
        cmocka_unit_test(script_is_read_member_by_member),
        cmocka_unit_test(malformed_scripts_are_refused_by_name),
        cmocka_unit_test(the_format_in_help_is_what_is_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
