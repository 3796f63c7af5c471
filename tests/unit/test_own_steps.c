/* The history's order: a step taken out of the middle of it, and whose it may be. */
#include "session/own_steps.h"
#include "support/random_session.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* ---- order ------------------------------------------------------------------------------- */

/* A history of steps that made the revisions 1, 2, ..., of so many vertices each. */
static struct skd_history make_history(size_t count)
{
    struct skd_history history = {.bytes_max = SKD_HISTORY_BYTES_DEFAULT};
    for (size_t i = 1; i <= count; i++) {
        struct skd_step *step = skd_step_create(i, 4);
        step->revision = i;
        assert_int_equal(skd_history_reserve(&history, NULL), SKD_OK);
        assert_int_equal(skd_history_push(&history, step), 0);
        skd_step_release(step);
    }
    return history;
}

/* Which steps stand where (by their counts of vertices), with the revisions that they made. */
static void assert_order(const struct skd_history *history, size_t position, const size_t *counts,
                         const uint64_t *revisions)
{
    assert_int_equal(history->position, position);
    for (size_t i = 0; i < history->count; i++) {
        assert_int_equal(history->steps[i]->count, counts[i]);
        assert_int_equal(history->steps[i]->revision, revisions[i]);
    }
}

static void moving_at_the_boundary_keeps_the_order(void **state)
{
    (void)state;
    static const size_t counts[] = {1, 2, 3};
    static const uint64_t revisions[] = {1, 2, 3};
    struct skd_history history = make_history(3);
    skd_history_move(&history, -1, 2, 4);
    skd_history_move(&history, -1, 1, 5);
    assert_order(&history, 1, counts, revisions);
    skd_history_move(&history, 1, 1, 6);
    assert_order(&history, 2, counts, revisions);
    skd_history_finish(&history);
}

static void steps_are_taken_past_others(void **state)
{
    (void)state;
    struct skd_history history = make_history(5);
    skd_history_move(&history, -1, 1, 6);
    assert_order(&history, 4, (const size_t[]){1, 3, 4, 5, 2}, (const uint64_t[]){1, 0, 0, 6, 0});
    skd_history_move(&history, -1, 0, 7);
    assert_order(&history, 3, (const size_t[]){3, 4, 5, 1, 2}, (const uint64_t[]){0, 0, 7, 0, 0});
    /* The farther one of what was undone comes back first. */
    skd_history_move(&history, 1, 4, 8);
    assert_order(&history, 4, (const size_t[]){3, 4, 5, 2, 1}, (const uint64_t[]){0, 0, 7, 8, 0});
    assert_int_equal(skd_history_redoable(&history)->count, 1);
    size_t bytes = history.bytes;
    skd_history_move(&history, 1, 4, 9);
    assert_int_equal(history.bytes, bytes);
    assert_null(skd_history_redoable(&history));
    skd_history_finish(&history);
}

/* ---- whose ------------------------------------------------------------------------------- */

enum { VERTICES = 60, BONES = 5, TOOLS = 3, STEPS_MAX = 40 };

/* A session whose steps are made by a few tools, and which of them touches what. */
struct shop {
    struct random random;
    struct skd_session *session;
    float *base;                        /* the weights before the first step */
    const struct skd_step *made[10000]; /* all steps there were, by their number; not held */
    bool touched[10000][VERTICES];      /* by the same numbers */
    size_t made_count;
};

static const char *tool_name(size_t tool)
{
    static const char *const names[TOOLS] = {"ann", "bob", "cat"};
    return names[tool];
}

static size_t number_of(const struct shop *shop, const struct skd_step *step)
{
    size_t number = shop->made_count;
    while (shop->made[--number] != step)
        ;
    return number;
}

static void make_step(struct shop *shop, size_t tool)
{
    static const unsigned changes[] = {0,           RANDOM_PINS,  RANDOM_JOINTS,
                                       RANDOM_REST, RANDOM_SHAPE, RANDOM_CLEAR};
    struct skd_session *session = shop->session;
    unsigned change = changes[random_below(&shop->random, sizeof changes / sizeof *changes)];
    struct skd_step *step =
        random_step(session, &shop->random, 1 + random_below(&shop->random, 6), change);
    (void)snprintf(step->author.client, sizeof step->author.client, "%s's", tool_name(tool));
    (void)snprintf(step->author.id, sizeof step->author.id, "%s", tool_name(tool));
    bool *touched = shop->touched[shop->made_count];
    for (size_t i = 0; i < step->count; i++)
        touched[step->vertices[i]] = true;
    for (size_t i = 0; step->pins != NULL && i < step->pins->count; i++)
        touched[step->pins->vertices[i]] = true;
    shop->made[shop->made_count++] = step;
    skd_session_write(session, step, false);
    assert_int_equal(skd_history_reserve(&session->history, NULL), SKD_OK);
    skd_history_push(&session->history, step);
    skd_session_advance(session);
    skd_step_release(step);
}

static bool share_a_vertex(const bool *one, const bool *other)
{
    for (size_t v = 0; v < VERTICES; v++) {
        if (one[v] && other[v])
            return true;
    }
    return false;
}

/* What skd_own_step_find has to say, by looking at every pair. */
static enum skd_status expect(const struct shop *shop, int direction, const char *tool,
                              size_t *index)
{
    const struct skd_history *history = &shop->session->history;
    size_t first = direction < 0 ? 0 : history->position;
    size_t end = direction < 0 ? history->position : history->count;
    bool found = false;
    for (size_t i = first; i < end; i++) {
        if (strcmp(history->steps[i]->author.id, tool) == 0 && (direction < 0 || !found)) {
            *index = i;
            found = true;
        }
    }
    if (!found)
        return direction < 0 ? SKD_NOTHING_TO_UNDO : SKD_NOTHING_TO_REDO;
    const bool *own = shop->touched[number_of(shop, history->steps[*index])];
    for (size_t i = first; i < end; i++) {
        bool on_the_way = direction < 0 ? i > *index : i < *index;
        if (on_the_way && share_a_vertex(own, shop->touched[number_of(shop, history->steps[i])]))
            return SKD_CONFLICT;
    }
    return SKD_OK;
}

/* Every vertex has what the step that was made last, of those that are done, gave it. */
static void assert_weights(const struct shop *shop)
{
    const struct skd_session *session = shop->session;
    const struct skd_history *history = &session->history;
    size_t slots = (size_t)session->slot_count;
    for (uint32_t v = 0; v < VERTICES; v++) {
        const float *expected = shop->base + v * slots;
        size_t newest = 0;
        for (size_t i = 0; i < history->position; i++) {
            const struct skd_step *step = history->steps[i];
            size_t number = number_of(shop, step) + 1;
            for (size_t k = 0; k < step->count && number > newest; k++) {
                if (step->vertices[k] == v) {
                    expected = step->after + k * slots;
                    newest = number;
                }
            }
        }
        assert_memory_equal(session->weights + v * slots, expected, slots * sizeof(float));
    }
}

/* The history, as it stands, leads from the base to here, and back. */
static void assert_replays(struct shop *shop, uint64_t base)
{
    struct skd_session *session = shop->session;
    const struct skd_history *history = &session->history;
    uint64_t now = random_digest(session);
    for (size_t i = history->position; i > 0; i--)
        skd_session_write(session, history->steps[i - 1], true);
    assert_true(random_digest(session) == base);
    for (size_t i = 0; i < history->count; i++)
        skd_session_write(session, history->steps[i], false);
    for (size_t i = history->count; i > history->position; i--)
        skd_session_write(session, history->steps[i - 1], true);
    assert_true(random_digest(session) == now);
}

/* Returns what became of it. */
static enum skd_status move_own(struct shop *shop, int direction, const char *tool)
{
    struct skd_session *session = shop->session;
    struct skd_error error = {0};
    size_t expected = 0, index = 0;
    enum skd_status status = expect(shop, direction, tool, &expected);
    assert_int_equal(skd_own_step_find(session, direction, tool, &index, &error), status);
    if (status == SKD_CONFLICT) {
        bool names = false; /* it says whose step it is */
        for (size_t other = 0; other < TOOLS; other++)
            names |=
                strcmp(tool, tool_name(other)) != 0 && strstr(error.text, tool_name(other)) != NULL;
        assert_true(names && strstr(error.text, tool) == NULL);
    }
    if (status != SKD_OK)
        return status;
    assert_int_equal(index, expected);
    skd_session_write(session, session->history.steps[index], direction < 0);
    skd_history_move(&session->history, direction, index, session->revision + 1);
    skd_session_advance(session);
    return SKD_OK;
}

static void move_any(struct shop *shop, int direction)
{
    struct skd_session *session = shop->session;
    const struct skd_history *history = &session->history;
    struct skd_error error;
    size_t index;
    enum skd_status status = skd_own_step_find(session, direction, NULL, &index, &error);
    bool has_any = direction < 0 ? history->position > 0 : history->position < history->count;
    assert_int_equal(status, has_any         ? SKD_OK
                             : direction < 0 ? SKD_NOTHING_TO_UNDO
                                             : SKD_NOTHING_TO_REDO);
    if (!has_any)
        return;
    assert_int_equal(index, direction < 0 ? history->position - 1 : history->position);
    skd_session_write(session, history->steps[index], direction < 0);
    skd_history_move(&session->history, direction, index, session->revision + 1);
    skd_session_advance(session);
}

static void own_steps_of_many_tools(void **state)
{
    (void)state;
    static struct shop shop;
    size_t moved = 0, refused = 0;
    for (uint64_t seed = 0; seed < 12; seed++) {
        memset(&shop, 0, sizeof shop);
        shop.random.state = seed;
        shop.session = random_session(&shop.random, VERTICES, BONES, seed % 2 == 0 ? 4 : 8);
        size_t bytes = VERTICES * (size_t)shop.session->slot_count * sizeof(float);
        uint64_t base = random_digest(shop.session);
        shop.base = malloc(bytes);
        memcpy(shop.base, shop.session->weights, bytes);
        for (size_t i = 0; i < 400; i++) {
            size_t tool = random_below(&shop.random, TOOLS), choice = random_below(&shop.random, 8);
            int direction = random_below(&shop.random, 2) == 0 ? 1 : -1;
            enum skd_status status = SKD_OK;
            if (shop.session->history.position == STEPS_MAX)
                choice = 7;
            if (choice < 3)
                make_step(&shop, tool);
            else if (choice < 7)
                moved += (status = move_own(&shop, direction, tool_name(tool))) == SKD_OK;
            else
                move_any(&shop, shop.session->history.position == STEPS_MAX ? -1 : direction);
            refused += status == SKD_CONFLICT;
            assert_weights(&shop);
            assert_replays(&shop, base);
        }
        free(shop.base);
        skd_session_destroy(shop.session);
    }
    assert_true(moved > 200 && refused > 200);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(moving_at_the_boundary_keeps_the_order),
        cmocka_unit_test(steps_are_taken_past_others),
        cmocka_unit_test(own_steps_of_many_tools),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
