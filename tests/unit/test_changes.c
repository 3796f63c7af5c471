/* The ring of what a session's last revisions did (requests/changes.h). */
#include "requests/live.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

static struct skd_live *create(void)
{
    struct skd_live *live = calloc(1, sizeof *live);
    assert_non_null(live);
    return live;
}

static void destroy(struct skd_live *live)
{
    skd_changes_finish(&live->changes);
    free(live);
}

/* Adds a change of so many vertices, whose step the ring alone holds. */
static void add(struct skd_live *live, uint64_t revision, size_t vertices, bool in_history)
{
    struct skd_step *step = skd_step_create(vertices, 4);
    assert_non_null(step);
    step->in_history = in_history;
    const struct skd_change change = {
        .revision = revision, .cause = "stroke", .author = {.client = "somebody"}, .step = step};
    skd_changes_add(live, &change);
    skd_step_release(step);
}

static void test_it_holds_the_last_1024(void **state)
{
    struct skd_live *live = create();
    (void)state;
    assert_null(skd_changes_find(&live->changes, 1));
    for (uint64_t revision = 7; revision < 7 + 3000; revision++) {
        add(live, revision, 1, true);
        uint64_t oldest = revision - 6 > 1024 ? revision - 1023 : 7;
        assert_int_equal(skd_changes_find(&live->changes, oldest)->revision, oldest);
        assert_int_equal(skd_changes_find(&live->changes, revision)->revision, revision);
        assert_null(skd_changes_find(&live->changes, oldest - 1));
        assert_null(skd_changes_find(&live->changes, revision + 1));
        assert_int_equal(skd_changes_nearest(&live->changes, 1)->revision, oldest);
    }
    assert_string_equal(skd_changes_find(&live->changes, 3000)->author.client, "somebody");
    destroy(live);
}

/* 1 MiB and a little more each: 32 bytes of weights before and after, 4 of index. */
enum { MIB_VERTICES = (1 << 20) / 36 };

static void test_what_the_history_holds_costs_nothing(void **state)
{
    struct skd_live *live = create();
    (void)state;
    for (uint64_t revision = 1; revision <= 100; revision++)
        add(live, revision, MIB_VERTICES, true);
    assert_non_null(skd_changes_find(&live->changes, 1));
    destroy(live);
}

static void test_what_only_the_ring_holds_is_limited(void **state)
{
    struct skd_live *live = create();
    (void)state;
    for (uint64_t revision = 1; revision <= 200; revision++)
        add(live, revision, MIB_VERTICES, revision % 2 == 0);
    /* Every second one counts: some 63 or 64 of these are left, and those between. */
    size_t bytes = 0;
    for (uint64_t revision = 200; skd_changes_find(&live->changes, revision) != NULL; revision--)
        bytes += revision % 2 == 0
                     ? 0
                     : skd_step_bytes(skd_changes_find(&live->changes, revision)->step);
    assert_true(bytes <= SKD_CHANGES_BYTES_MAX && bytes > SKD_CHANGES_BYTES_MAX - (2 << 20));
    destroy(live);
}

static void test_the_newest_stays_however_large(void **state)
{
    struct skd_live *live = create();
    (void)state;
    add(live, 1, 1, true);
    add(live, 2, 80 * (size_t)MIB_VERTICES, false);
    assert_null(skd_changes_find(&live->changes, 1));
    assert_non_null(skd_changes_find(&live->changes, 2));
    destroy(live);
}

static void test_a_copy_outlives_the_ring(void **state)
{
    struct skd_live *live = create();
    (void)state;
    add(live, 1, 3, true);
    struct skd_change copy = skd_change_copy(skd_changes_find(&live->changes, 1));
    destroy(live);
    assert_int_equal(copy.step->count, 3);
    assert_int_equal(copy.step->references, 1);
    skd_change_release(&copy);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_it_holds_the_last_1024),
        cmocka_unit_test(test_what_the_history_holds_costs_nothing),
        cmocka_unit_test(test_what_only_the_ring_holds_is_limited),
        cmocka_unit_test(test_the_newest_stays_however_large),
        cmocka_unit_test(test_a_copy_outlives_the_ring),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
