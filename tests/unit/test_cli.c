/* skinctl's pure parts: the brush, values from the command line, stroke scripts, point caches. */
#include "clients/cli/brush.h"
#include "clients/cli/pc2.h"
#include "clients/cli/print.h"
#include "clients/cli/script.h"
#include "clients/cli/values.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

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

static void numbers_are_read_whole_or_refused(void **state)
{
    static const char *const bad[] = {"", ",", "1,", ",1", "1,,2", "1 2", "1,x", "nan", "1,inf"};
    struct skd_error error;
    double *numbers;
    size_t count;
    (void)state;
    assert_int_equal(skd_value_numbers("--times", "0,0.5,-2e1", &numbers, &count, &error), SKD_OK);
    assert_int_equal(count, 3);
    assert_near(numbers[1], 0.5, 0);
    assert_near(numbers[2], -20, 0);
    free(numbers);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(skd_value_numbers("--times", bad[i], &numbers, &count, &error),
                         SKD_BAD_PARAMS);
        assert_non_null(strstr(error.text, "--times"));
    }
}

/* A file with these bytes; unlink it. */
static void write_file(char path[32], const void *bytes, size_t count)
{
    strcpy(path, "/tmp/skind-test-XXXXXX");
    int file = mkstemp(path);
    assert_true(file >= 0);
    assert_int_equal(write(file, bytes, count), (ssize_t)count);
    close(file);
}

static void targets_may_have_a_mask(void **state)
{
    static const char text[] = "7 0 1 2  # a comment\n\n8 3 4 5 0.25\n";
    static const char wrong[] = "7 0 1 2 1 1\n";
    struct skd_targets targets = {0};
    struct skd_error error;
    char path[32];
    (void)state;
    write_file(path, text, strlen(text));
    assert_int_equal(skd_targets_read(&targets, path, &error), SKD_OK);
    unlink(path);
    assert_int_equal(targets.count, 2);
    assert_int_equal(targets.vertices[1], 8);
    assert_near(targets.positions[5], 5, 0);
    assert_true(targets.has_mask);
    assert_near(targets.mask[0], 1, 0);
    assert_near(targets.mask[1], 0.25, 0);
    skd_targets_finish(&targets);
    assert_int_equal(skd_targets_add(&targets, "--vertex", "3=1,2,3", &error), SKD_OK);
    assert_false(targets.has_mask);
    skd_targets_finish(&targets);
    write_file(path, wrong, strlen(wrong));
    assert_int_equal(skd_targets_read(&targets, path, &error), SKD_BAD_PARAMS);
    assert_non_null(strstr(error.text, "line 1"));
    unlink(path);
    skd_targets_finish(&targets);
}

/* ---- point caches ---- */

enum { POINTS = 2, SAMPLES = 5, CACHE_BYTES = 32 + SAMPLES * POINTS * 12 };

/* Byte by byte as the format says; coordinate c of point p in sample s is 100 s + 10 p + c. */
static void make_cache(unsigned char bytes[CACHE_BYTES])
{
    const uint32_t counts[] = {1, POINTS, 0, 0, SAMPLES};
    const float start = -3.5F, rate = 0.5F;
    size_t used = 32;
    memcpy(bytes, "POINTCACHE2", 12);
    for (size_t i = 0; i < 5; i++)
        for (size_t k = 0; k < 4; k++)
            bytes[12 + 4 * i + k] = (unsigned char)(counts[i] >> (8 * k));
    memcpy(bytes + 20, &start, 4); /* these tests run on little-endian machines */
    memcpy(bytes + 24, &rate, 4);
    for (int sample = 0; sample < SAMPLES; sample++)
        for (int point = 0; point < POINTS; point++)
            for (int c = 0; c < 3; c++, used += 4) {
                const float number = (float)(100 * sample + 10 * point + c);
                memcpy(bytes + used, &number, 4);
            }
}

static enum skd_status read_cache(const unsigned char *bytes, size_t count,
                                  const struct skd_pc2_wanted *wanted, struct skd_pc2 *cache,
                                  struct skd_error *error)
{
    char path[32];
    write_file(path, bytes, count);
    enum skd_status status = skd_pc2_read(path, wanted, cache, error);
    if (status != SKD_OK)
        assert_ptr_equal(strstr(error->text, path), error->text); /* the sentence begins with it */
    unlink(path);
    return status;
}

static void caches_are_read_sample_by_sample(void **state)
{
    unsigned char bytes[CACHE_BYTES];
    struct skd_pc2 cache;
    struct skd_error error;
    (void)state;
    make_cache(bytes);
    for (size_t step = 1; step <= SAMPLES + 1; step++) {
        const struct skd_pc2_wanted wanted = {POINTS, step, SAMPLES};
        assert_int_equal(read_cache(bytes, sizeof bytes, &wanted, &cache, &error), SKD_OK);
        assert_int_equal(cache.samples, SAMPLES);
        assert_int_equal(cache.count, (SAMPLES + step - 1) / step);
        assert_near(cache.rate, 0.5, 0);
        for (size_t i = 0; i < cache.count; i++)
            for (size_t k = 0; k < 3 * POINTS; k++)
                assert_near(cache.positions[3 * POINTS * i + k],
                            100.0 * (double)(i * step) + 10.0 * (double)(k / 3) + (double)(k % 3),
                            0);
        skd_pc2_finish(&cache);
    }
}

static void broken_caches_are_refused(void **state)
{
    static const struct {
        size_t place;
        unsigned char bytes[4]; /* over what is there */
        size_t length;          /* of the file */
        enum skd_status status;
        const char *words;
    } broken[] = {
        {0, {'P'}, 0, SKD_BAD_PARAMS, "no PC2 point cache"},
        {0, {'P'}, 31, SKD_BAD_PARAMS, "no PC2 point cache"},
        {11, {'3'}, CACHE_BYTES, SKD_BAD_PARAMS, "no PC2 point cache"},
        {12, {2}, CACHE_BYTES, SKD_BAD_PARAMS, "version 2"},
        {16, {3}, CACHE_BYTES, SKD_COUNT_MISMATCH, "3 points, but the session 2 vertices"},
        {16, {0}, CACHE_BYTES, SKD_BAD_PARAMS, "no points"},
        {16, {2, 0, 0, 0x80}, CACHE_BYTES, SKD_BAD_PARAMS, "no points"},          /* below 0 */
        {20, {0, 0, 0x80, 0x7F}, CACHE_BYTES, SKD_BAD_PARAMS, "start or a rate"}, /* infinite */
        {24, {0, 0, 0, 0}, CACHE_BYTES, SKD_BAD_PARAMS, "start or a rate"},
        {24, {0, 0, 0xC0, 0x7F}, CACHE_BYTES, SKD_BAD_PARAMS, "start or a rate"}, /* NaN */
        {28, {0}, CACHE_BYTES, SKD_BAD_PARAMS, "no samples"},
        {28, {0xFF, 0xFF, 0xFF, 0x7F}, CACHE_BYTES, SKD_TOO_LARGE, "--step"},
        {28, {6}, CACHE_BYTES, SKD_BAD_PARAMS, "cut short: sample 5"},
        {28, {4}, CACHE_BYTES, SKD_BAD_PARAMS, "longer than the 4 samples"},
        {0, {'P'}, 32, SKD_BAD_PARAMS, "cut short: sample 0"},
        {0, {'P'}, CACHE_BYTES - 1, SKD_BAD_PARAMS, "cut short: sample 4"},
        {32 + 24 + 12, {0, 0, 0xC0, 0x7F}, CACHE_BYTES, SKD_NOT_FINITE, "point 1 of sample 1"},
    };
    const struct skd_pc2_wanted wanted = {POINTS, 1, 2 * SAMPLES};
    struct skd_error error;
    struct skd_pc2 cache;
    (void)state;
    for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
        unsigned char bytes[CACHE_BYTES];
        bool is_field = broken[i].place >= 16;
        make_cache(bytes);
        memcpy(bytes + broken[i].place, broken[i].bytes, is_field ? 4 : 1);
        enum skd_status status = read_cache(bytes, broken[i].length, &wanted, &cache, &error);
        if (status != broken[i].status || strstr(error.text, broken[i].words) == NULL)
            fail_msg("cache %zu gave status %d, \"%s\"", i, status, error.text);
        skd_pc2_finish(&cache);
    }
    assert_int_equal(skd_pc2_read("/nowhere/a.pc2", &wanted, &cache, &error), SKD_NO_FILE);
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
        "  - {pose: own, vertices: [7, 8], positions: [[0, 1, 0], [0.5, 1, 0]], mask: [0, 1]}\n"
        "  - {pose: own, vertices: [7], positions: [[0, 1, 0]], pin: move, slots: evidence,\n"
        "     guard: 2, smooth: 0.5, mix: 0.25, residual: shape}\n";
    struct skd_script *script;
    struct skd_error error = {0};
    (void)state;
    assert_int_equal(skd_script_parse("s.yaml", text, strlen(text), &script, &error), SKD_OK);
    assert_int_equal(script->poses_count, 2);
    assert_string_equal(script->poses[0].clip, "bend");
    assert_near(*script->poses[0].time, 0.5, 0);
    assert_int_equal(script->poses[1].matrices_count, 1);
    assert_near(script->poses[1].matrices[0][11], 2.5, 0);
    assert_int_equal(script->strokes_count, 3);
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
    assert_int_equal(stroke->mask_count, 2);
    assert_near(stroke->mask[1], 1, 0);
    assert_true(stroke->pin == NULL && stroke->guard == NULL && stroke->residual == NULL);
    stroke = &script->strokes[2];
    assert_string_equal(stroke->pin, "move");
    assert_string_equal(stroke->slots, "evidence");
    assert_string_equal(stroke->residual, "shape");
    assert_true(*stroke->guard == 2 && *stroke->smooth == 0.5 && *stroke->mix == 0.25);
    assert_int_equal(stroke->mask_count, 0);
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
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], pin: keep}\n", "pin"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], slots: all}\n", "slots"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], residual: x}\n", "residual"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], guard: 1001}\n", "guard"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], smooth: -1}\n", "smooth"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], mix: 2}\n", "mix"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], mask: [2]}\n", "mask"},
    {"strokes:\n  - {pose: a, vertices: [1], positions: [[0,0,0]], mask: [1, 1]}\n", "mask"},
    {"strokes:\n  - pose: a\n    brush: {bone: b, radius: 1, out: 1}\n    mask: [1]\n", "falloff"},
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
        cmocka_unit_test(numbers_are_read_whole_or_refused),
        cmocka_unit_test(targets_may_have_a_mask),
        cmocka_unit_test(caches_are_read_sample_by_sample),
        cmocka_unit_test(broken_caches_are_refused),
        cmocka_unit_test(counts_are_grouped),
        cmocka_unit_test(script_is_read_member_by_member),
        cmocka_unit_test(malformed_scripts_are_refused_by_name),
        cmocka_unit_test(the_format_in_help_is_what_is_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
