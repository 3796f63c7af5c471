/* The session room: seams, history and a stroke's checks, on rigs made here. */
#include "rig/rig_build.h"
#include "session/creation.h"
#include "session/seams.h"
#include "session/setting.h"
#include "session/stroke_run.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* ---- seams ------------------------------------------------------------------------------- */

static void seams_without_twins_change_nothing(void **state)
{
    (void)state;
    struct skd_mesh mesh = {.vertex_count = 4};
    struct skd_seams seams;
    const uint32_t vertices[] = {2, 0};
    const float positions[] = {1, 2, 3, 4, 5, 6};
    assert_int_equal(skd_seams_join(&mesh, vertices, positions, 2, &seams, NULL), SKD_OK);
    assert_int_equal(seams.count, 2);
    assert_null(seams.vertices);
    assert_null(seams.positions);
}

static void seams_bring_the_twins_along(void **state)
{
    (void)state;
    /* Rings: {0 2 5}, {1}, {3 4}. */
    uint32_t twins[] = {2, 1, 5, 4, 3, 0};
    struct skd_mesh mesh = {.vertex_count = 6, .twins = twins};
    struct skd_seams seams;
    const uint32_t vertices[] = {5, 1};
    const float positions[] = {7, 8, 9, 1, 2, 3};
    assert_int_equal(skd_seams_join(&mesh, vertices, positions, 2, &seams, NULL), SKD_OK);
    assert_int_equal(seams.count, 4);
    bool seen[6] = {false};
    for (size_t i = 0; i < seams.count; i++) {
        uint32_t vertex = seams.vertices[i];
        assert_false(seen[vertex]);
        seen[vertex] = true;
        assert_memory_equal(seams.positions + 3 * i, vertex == 1 ? positions + 3 : positions, 12);
    }
    assert_true(seen[0] && seen[1] && seen[2] && seen[5]);
    free(seams.vertices);
    free(seams.positions);
}

static void seams_take_the_mean_where_twins_differ(void **state)
{
    (void)state;
    uint32_t twins[] = {1, 0};
    struct skd_mesh mesh = {.vertex_count = 2, .twins = twins};
    struct skd_seams seams;
    const uint32_t vertices[] = {1, 0};
    const float positions[] = {2, 0, -4, 4, 0, 8};
    const float mean[] = {3, 0, 2};
    assert_int_equal(skd_seams_join(&mesh, vertices, positions, 2, &seams, NULL), SKD_OK);
    assert_int_equal(seams.count, 2);
    assert_memory_equal(seams.positions, mean, sizeof mean);
    assert_memory_equal(seams.positions + 3, mean, sizeof mean);
    free(seams.vertices);
    free(seams.positions);
}

/* A hostile file may put all its vertices at one place: each ring is walked once. */
static void seams_survive_one_huge_ring(void **state)
{
    (void)state;
    enum { COUNT = 200000 };
    uint32_t *twins = malloc(COUNT * sizeof *twins);
    uint32_t *vertices = malloc(COUNT * sizeof *vertices);
    float *positions = calloc(COUNT * 3, sizeof *positions);
    for (uint32_t i = 0; i < COUNT; i++) {
        twins[i] = (i + 1) % COUNT;
        vertices[i] = COUNT - 1 - i;
    }
    struct skd_mesh mesh = {.vertex_count = COUNT, .twins = twins};
    struct skd_seams seams;
    assert_int_equal(skd_seams_join(&mesh, vertices, positions, COUNT, &seams, NULL), SKD_OK);
    assert_int_equal(seams.count, COUNT);
    free(seams.vertices);
    free(seams.positions);
    free(twins);
    free(vertices);
    free(positions);
}

/* ---- history ----------------------------------------------------------------------------- */

static void push(struct skd_history *history, size_t vertices)
{
    struct skd_step *step = skd_step_create(vertices, 4);
    assert_int_equal(skd_history_reserve(history, NULL), SKD_OK);
    skd_history_push(history, step);
    skd_step_release(step);
}

static void history_goes_back_and_forth(void **state)
{
    (void)state;
    struct skd_history history = {.bytes_max = SKD_HISTORY_BYTES_DEFAULT};
    assert_null(skd_history_undoable(&history));
    for (size_t i = 1; i <= 40; i++)
        push(&history, i);
    assert_int_equal(skd_history_undoable(&history)->count, 40);
    assert_null(skd_history_redoable(&history));
    skd_history_move(&history, -1, 39, 41);
    skd_history_move(&history, -1, 38, 42);
    assert_int_equal(skd_history_undoable(&history)->count, 38);
    assert_int_equal(skd_history_redoable(&history)->count, 39);
    push(&history, 7); /* what was undone is gone */
    assert_int_equal(history.count, 39);
    assert_null(skd_history_redoable(&history));
    assert_int_equal(skd_history_undoable(&history)->count, 7);
    skd_history_finish(&history);
}

static void history_forgets_the_oldest(void **state)
{
    (void)state;
    struct skd_history history = {.bytes_max = SKD_HISTORY_BYTES_DEFAULT};
    size_t vertices = SKD_HISTORY_BYTES_DEFAULT / 36 / 4 + 1; /* a quarter of the limit each */
    for (int i = 0; i < 6; i++)
        push(&history, vertices);
    assert_true(history.bytes <= SKD_HISTORY_BYTES_DEFAULT);
    assert_int_equal(history.count, 3);
    assert_int_equal(history.position, 3);
    skd_history_finish(&history);
}

/* What is promised before a push is what the push then does. */
static void history_tells_what_a_push_will_leave(void **state)
{
    (void)state;
    struct skd_history history = {.bytes_max = SKD_HISTORY_BYTES_DEFAULT};
    const size_t large = SKD_HISTORY_BYTES_DEFAULT / 36 / 4 + 1;
    const size_t sizes[] = {1, large, large, 5, large, large, 2, 3 * large, 1, 4 * large};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct skd_step *step = skd_step_create(sizes[i], 4);
        if (i == 6)
            skd_history_move(&history, -1, history.position - 1, 0); /* undone: it goes too */
        size_t told = skd_history_steps_with(&history, step);
        assert_int_equal(skd_history_reserve(&history, NULL), SKD_OK);
        skd_history_push(&history, step);
        skd_step_release(step);
        assert_int_equal(history.position, told);
        assert_int_equal(history.count, told);
    }
    assert_int_equal(history.count, 1);
    skd_history_finish(&history);
}

/* ---- a stroke ---------------------------------------------------------------------------- */

/* Two bones, one above the other, and a strip of vertices between them; 2 and 3 are at one place
 * and hang on the same bones. */
static struct skd_session *make_session(void)
{
    static const double binds[] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1,
                                   1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1};
    static const char *const names[] = {"lower", "upper"};
    static const int32_t parents[] = {-1, 0};
    static const float positions[] = {0, 0, 0, 0, 0.5f, 0, 0, 1, 0, 0, 1, 0, 0, 2, 0.5f};
    static const uint32_t triangles[] = {0, 1, 4, 1, 2, 4, 2, 3, 4};
    static const uint32_t offsets[] = {0, 1, 3, 5, 7, 8};
    static const uint16_t joints[] = {0, 0, 1, 0, 1, 0, 1, 1};
    static const float weights[] = {1, 0.75f, 0.25f, 0.5f, 0.5f, 0.5f, 0.5f, 1};
    struct skd_rig_arrays arrays = {5,       positions, 3,       triangles, 2,      names,
                                    parents, binds,     offsets, joints,    weights};
    struct skd_rig *rig;
    struct skd_influences influences;
    struct skd_session *session;
    struct skd_session_options options = {4, SKD_FILL_HOP, false};
    assert_int_equal(skd_rig_from_arrays(&arrays, &rig, &influences, NULL), SKD_OK);
    assert_int_equal(skd_session_create(rig, &influences, "", &options, &session, NULL), SKD_OK);
    skd_influences_finish(&influences);
    return session;
}

/* As a file that split one vertex into 2 and 3 would have it. */
static void join_twins(struct skd_session *session)
{
    static const uint32_t rings[] = {0, 1, 3, 2, 4};
    assert_null(session->rig->mesh.twins); /* arrays split nothing */
    session->rig->mesh.twins = malloc(sizeof rings);
    memcpy(session->rig->mesh.twins, rings, sizeof rings);
}

static enum skd_status try_stroke(struct skd_session *session, struct skd_stroke_input input,
                                  struct skd_error *error)
{
    struct skd_stroke stroke = {
        .session = session, .pose = skd_poses_find(&session->poses, "rest"), .input = input};
    enum skd_status status = skd_stroke_claim(&stroke, error);
    if (status == SKD_OK)
        status = skd_stroke_prepare(&stroke, error);
    skd_stroke_dismiss(&stroke);
    return status;
}

static struct skd_stroke_input make_input(const uint32_t *vertices, const float *positions,
                                          size_t count)
{
    return (struct skd_stroke_input){.vertices = vertices,
                                     .positions = positions,
                                     .count = count,
                                     .mix = 1,
                                     .options = skd_solve_defaults()};
}

static void stroke_refuses_bad_input(void **state)
{
    (void)state;
    struct skd_session *session = make_session();
    struct skd_error error;
    const char *const no_bones[] = {"lower", "tail"};
    const uint32_t outside[] = {5}, twice[] = {1, 2, 1}, good[] = {1, 2};
    float positions[9] = {0};
    struct skd_stroke_input input = make_input(good, positions, 2);
    assert_int_equal(try_stroke(session, input, &error), SKD_OK);
    input.vertices = outside, input.count = 1;
    assert_int_equal(try_stroke(session, input, &error), SKD_BAD_INDEX);
    assert_non_null(strstr(error.text, "5 vertices"));
    input.vertices = twice, input.count = 3;
    assert_int_equal(try_stroke(session, input, &error), SKD_BAD_INDEX);
    input.vertices = good, input.count = 2;
    positions[5] = NAN;
    assert_int_equal(try_stroke(session, input, &error), SKD_NOT_FINITE);
    assert_non_null(strstr(error.text, "vertex 2"));
    positions[5] = -INFINITY;
    assert_int_equal(try_stroke(session, input, &error), SKD_NOT_FINITE);
    positions[5] = 0;
    input.locked_bones = no_bones, input.locked_bone_count = 2;
    assert_int_equal(try_stroke(session, input, &error), SKD_NO_BONE);
    input.locked_bone_count = 1;
    assert_int_equal(try_stroke(session, input, &error), SKD_OK);
    input.options.method = SKD_METHOD_THESIS;
    assert_int_equal(try_stroke(session, input, &error), SKD_UNSUPPORTED);
    input.locked_bone_count = 0;
    input.locked_vertices = outside, input.locked_vertex_count = 1;
    assert_int_equal(try_stroke(session, input, &error), SKD_BAD_INDEX);
    skd_session_destroy(session);
}

/* Bends the upper bone, moves one of two twins, and looks at both and at the undo. */
static void stroke_moves_twins_and_is_undone_to_the_bit(void **state)
{
    (void)state;
    struct skd_session *session = make_session();
    join_twins(session);
    size_t weight_bytes = 5 * 4 * sizeof(float);
    float *before = malloc(weight_bytes);
    memcpy(before, session->weights, weight_bytes);
    struct skd_pose *bent = skd_pose_create("bent", 2);
    const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const double turned[12] = {0, -1, 0, 2, 1, 0, 0, 1, 0, 0, 1, 0};
    memcpy(bent->matrices, identity, sizeof identity);
    memcpy(bent->matrices + 12, turned, sizeof turned);
    const uint32_t vertices[] = {3};
    const float positions[] = {0, 1, 0}; /* on the lower bone */
    struct skd_stroke stroke = {
        .session = session, .pose = bent, .input = make_input(vertices, positions, 1)};
    assert_int_equal(skd_stroke_claim(&stroke, NULL), SKD_OK);
    assert_int_equal(skd_stroke_prepare(&stroke, NULL), SKD_OK);
    assert_int_equal(stroke.step->count, 2);
    skd_stroke_solve(&stroke, 0, 2);
    assert_int_equal(skd_stroke_finish(&stroke, NULL), SKD_OK);
    skd_session_write(session, stroke.step, false);
    assert_memory_equal(session->weights + 2 * 4, session->weights + 3 * 4, 4 * sizeof(float));
    assert_true(stroke.after.max < stroke.before.max);
    skd_session_write(session, stroke.step, true);
    assert_memory_equal(session->weights, before, weight_bytes);
    skd_stroke_dismiss(&stroke);
    skd_pose_release(bent);
    free(before);
    skd_session_destroy(session);
}

/* ---- weights that are set ------------------------------------------------------------------ */

static enum skd_status try_setting(struct skd_session *session, const uint32_t *vertices,
                                   size_t count, const float *weights, size_t weight_count,
                                   struct skd_error *error)
{
    const struct skd_setting setting = {
        .vertices = vertices, .count = count, .weights = weights, .weight_count = weight_count};
    struct skd_step *step = NULL;
    enum skd_status status = skd_setting_prepare(session, &setting, &step, error);
    skd_step_release(step);
    return status;
}

static void setting_refuses_bad_rows(void **state)
{
    (void)state;
    struct skd_session *session = make_session();
    struct skd_error error;
    const uint32_t good[] = {4, 1}, outside[] = {4, 5}, twice[] = {4, 4};
    static const struct {
        float row[4]; /* of vertex 1: bones lower, upper, and two empty slots */
        enum skd_status status;
        const char *said;
    } rows[] = {
        {{0.5F, 0.5F, 0, 0}, SKD_OK, ""},
        {{0.5F, 0.5009F, 0, 0}, SKD_OK, ""},
        {{0.5F, 0.4991F, 0, 0}, SKD_OK, ""},
        {{0.5F, 0.5011F, 0, 0}, SKD_BAD_PARAMS, "sums to 1.0011"},
        {{0.5F, 0.4989F, 0, 0}, SKD_BAD_PARAMS, "sums to 0.9989"},
        {{0, 0, 0, 0}, SKD_BAD_PARAMS, "sums to 0"},
        {{1.25F, -0.25F, 0, 0}, SKD_BAD_PARAMS, "has 1.25 in slot 0"},
        {{1, -1e-6F, 0, 0}, SKD_BAD_PARAMS, "has -1e-06 in slot 1"},
        {{NAN, 1, 0, 0}, SKD_NOT_FINITE, "weights[1] (vertex 1) is not finite in slot 0"},
        {{1, 0, 0, -INFINITY}, SKD_NOT_FINITE, "slot 3"},
        {{0.5F, 0.25F, 0.25F, 0}, SKD_BAD_PARAMS, "no bone (joint 65535)"},
    };
    assert_int_equal(session->joints[1 * 4 + 2], SKD_SLOT_EMPTY);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        float weights[8] = {1};
        memcpy(weights + 4, rows[i].row, sizeof rows[i].row);
        error = (struct skd_error){0};
        assert_int_equal(try_setting(session, good, 2, weights, 8, &error), rows[i].status);
        assert_non_null(strstr(error.text, rows[i].said));
    }
    const float weights[16] = {1, 0, 0, 0, 1, 0, 0, 0};
    assert_int_equal(try_setting(session, outside, 2, weights, 8, &error), SKD_BAD_INDEX);
    assert_int_equal(try_setting(session, twice, 2, weights, 8, &error), SKD_BAD_INDEX);
    assert_int_equal(try_setting(session, good, 2, weights, 16, &error), SKD_COUNT_MISMATCH);
    assert_int_equal(try_setting(session, NULL, 0, NULL, 0, &error), SKD_OK);
    skd_session_destroy(session);
}

static void setting_keeps_good_rows_and_takes_twins_along(void **state)
{
    (void)state;
    struct skd_session *session = make_session();
    join_twins(session);
    float before[20];
    memcpy(before, session->weights, sizeof before);
    const uint32_t vertices[] = {3, 0, 1};
    const float rows[] = {0.3F, 0.7F - 0x1p-25F, 0, 0, 1, 0, 0, 0, 0.75F, 0.2505F, 0, 0};
    const struct skd_setting setting = {
        .vertices = vertices, .count = 3, .weights = rows, .weight_count = 12};
    struct skd_step *step;
    assert_int_equal(skd_setting_prepare(session, &setting, &step, NULL), SKD_OK);
    assert_memory_equal(session->weights, before, sizeof before); /* nothing is written yet */
    assert_int_equal(step->count, 4);
    assert_memory_equal(step->vertices, ((const uint32_t[]){3, 0, 1, 2}), 4 * sizeof(uint32_t));
    skd_session_write(session, step, false);
    assert_memory_equal(session->weights + 3 * 4, rows, 16);
    assert_memory_equal(session->weights + 2 * 4, rows, 16); /* the twin */
    assert_memory_equal(session->weights + 0 * 4, rows + 4, 16);
    const float *scaled = session->weights + 1 * 4;
    assert_true(fabs((double)scaled[0] + (double)scaled[1] - 1) <= 1e-7);
    assert_true(fabs((double)scaled[0] - 0.75 / 1.0005) < 1e-7);
    skd_session_write(session, step, true);
    assert_memory_equal(session->weights, before, sizeof before);
    skd_step_release(step);
    skd_session_destroy(session);
}

/* Both twins named: each its own. A twin with other bones in its slots: left alone. */
static void setting_leaves_twins_alone_that_it_must(void **state)
{
    (void)state;
    struct skd_session *session = make_session();
    join_twins(session);
    const uint32_t both[] = {2, 3};
    const float rows[] = {0.25F, 0.75F, 0, 0, 0.5F, 0.5F, 0, 0};
    struct skd_setting setting = {.vertices = both, .count = 2, .weights = rows, .weight_count = 8};
    struct skd_step *step;
    assert_int_equal(skd_setting_prepare(session, &setting, &step, NULL), SKD_OK);
    assert_int_equal(step->count, 2);
    assert_memory_equal(step->after, rows, sizeof rows);
    skd_step_release(step);
    session->joints[3 * 4] = 1;
    session->joints[3 * 4 + 1] = 0;
    setting.count = 1, setting.weight_count = 4;
    assert_int_equal(skd_setting_prepare(session, &setting, &step, NULL), SKD_OK);
    assert_int_equal(step->count, 1);
    skd_step_release(step);
    skd_session_destroy(session);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(seams_without_twins_change_nothing),
        cmocka_unit_test(seams_bring_the_twins_along),
        cmocka_unit_test(seams_take_the_mean_where_twins_differ),
        cmocka_unit_test(seams_survive_one_huge_ring),
        cmocka_unit_test(history_goes_back_and_forth),
        cmocka_unit_test(history_forgets_the_oldest),
        cmocka_unit_test(history_tells_what_a_push_will_leave),
        cmocka_unit_test(stroke_refuses_bad_input),
        cmocka_unit_test(stroke_moves_twins_and_is_undone_to_the_bit),
        cmocka_unit_test(setting_refuses_bad_rows),
        cmocka_unit_test(setting_keeps_good_rows_and_takes_twins_along),
        cmocka_unit_test(setting_leaves_twins_alone_that_it_must),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
