/* Each allocation of reading and of writing a session's file fails in turn: what comes back is that
 * there is no memory, and never a file that is called damaged, a state that is half, or a leak. */
#include "journal/compare.h"
#include "journal/read.h"
#include "journal/whole.h"
#include "support/world.h"

#include <setjmp.h>
#include <sqlite3.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* ---- failing allocations: ours by the linker's --wrap, SQLite's by its own setting -------------
 */

static size_t countdown; /* allocations until one fails; 0: none does */
static size_t failed;
static sqlite3_mem_methods plain;

static bool fails(void)
{
    if (countdown == 0 || --countdown > 0)
        return false;
    failed++;
    return true;
}

void *__real_malloc(size_t bytes);
void *__real_calloc(size_t count, size_t bytes);
void *__real_realloc(void *old, size_t bytes);
void *__wrap_malloc(size_t bytes);
void *__wrap_calloc(size_t count, size_t bytes);
void *__wrap_realloc(void *old, size_t bytes);

void *__wrap_malloc(size_t bytes)
{
    return fails() ? NULL : __real_malloc(bytes);
}

void *__wrap_calloc(size_t count, size_t bytes)
{
    return fails() ? NULL : __real_calloc(count, bytes);
}

void *__wrap_realloc(void *old, size_t bytes)
{
    return fails() ? NULL : __real_realloc(old, bytes);
}

static void *sqlite_malloc(int bytes)
{
    return fails() ? NULL : plain.xMalloc(bytes);
}

static void *sqlite_realloc(void *old, int bytes)
{
    return fails() ? NULL : plain.xRealloc(old, bytes);
}

static int set_up(void **state)
{
    (void)state;
    if (sqlite3_config(SQLITE_CONFIG_GETMALLOC, &plain) != SQLITE_OK)
        return -1;
    sqlite3_mem_methods failing = plain;
    failing.xMalloc = sqlite_malloc;
    failing.xRealloc = sqlite_realloc;
    return sqlite3_config(SQLITE_CONFIG_MALLOC, &failing) == SQLITE_OK ? 0 : -1;
}

/* ---- tests ------------------------------------------------------------------------------------
 */

/* A session with something of everything. */
static void start(struct world *world)
{
    world_start(world, 3, 60, 3, 4);
    for (int i = 0; i < 14; i++)
        world_step(world, 4, (unsigned)i % 16);
    while (world->session->guards.factors == NULL)
        world_act(world);
}

/* Fails the first allocation, the second, ... until all is done without a failure. */
static void reading_without_memory_is_no_damage(void **state)
{
    (void)state;
    static struct world world;
    size_t tried = 0;
    start(&world);
    world_write(&world);
    char aside[WORLD_PATH_BYTES + 16];
    (void)snprintf(aside, sizeof aside, "%s/aside", world.folder);
    for (bool ran = false; !ran; tried++) {
        struct skd_session *session = NULL;
        struct skd_journal_report report;
        struct skd_error error = {0};
        failed = 0;
        countdown = tried + 1;
        enum skd_status status = skd_journal_read(world.path, aside, &session, &report, &error);
        ran = failed == 0;
        countdown = 0;
        if (status == SKD_OK) { /* some allocations of SQLite's it can do without */
            assert_false(report.cut);
            assert_int_equal(skd_compare_sessions(world.session, session, NULL), SKD_OK);
        } else if (status != SKD_NO_MEMORY) {
            fail_msg("allocation %zu: %s", tried, error.text);
        }
        skd_session_destroy(session);
    }
    assert_true(tried > 200);
    world_end(&world);
}

static void writing_without_memory_changes_nothing(void **state)
{
    (void)state;
    static struct world world;
    size_t tried = 0;
    start(&world);
    world_write(&world);
    uint64_t digest = random_digest(world.session);
    for (bool ran = false; !ran; tried++) {
        struct skd_error error = {0};
        failed = 0;
        countdown = tried + 1;
        enum skd_status status =
            skd_journal_write(world.path, world.session, NULL, NULL, 0, &error);
        ran = failed == 0;
        countdown = 0;
        if (status != SKD_OK && status != SKD_NO_MEMORY)
            fail_msg("allocation %zu: %s", tried, error.text);
        assert_true(random_digest(world.session) == digest);
    }
    assert_true(tried > 100);
    struct skd_session *read;
    struct skd_journal_report report;
    assert_int_equal(skd_journal_read(world.path, NULL, &read, &report, NULL), SKD_OK);
    assert_int_equal(skd_compare_sessions(world.session, read, NULL), SKD_OK);
    skd_session_destroy(read);
    world_end(&world);
}

/* The writer's allocations fail: the file is suspended, everybody is told, and it holds a state
 * that was, no older than the last that was told before. */
static void appending_without_memory_suspends(void **state)
{
    (void)state;
    static struct world world;
    for (size_t tried = 1; tried < 400; tried += 3) {
        start(&world);
        world_write(&world);
        world_open(&world);
        world_step(&world, 4, RANDOM_PINS);
        world_wait(&world);
        uint64_t kept = world.session->revision;
        struct skd_step *step = random_step(world.session, &world.random, 5, RANDOM_SHAPE);
        skd_session_write(world.session, step, false);
        world.session->revision++;
        struct skd_record *record = skd_record_create_step(step, world.session->revision, 0);
        skd_step_release(step);
        countdown = tried; /* nobody else allocates meanwhile */
        assert_true(skd_journal_append(world.file, record, NULL, NULL));
        world_close(&world);
        countdown = 0;
        struct skd_session *read;
        struct skd_journal_report report;
        struct skd_error error = {0};
        if (skd_journal_read(world.path, NULL, &read, &report, &error) != SKD_OK)
            fail_msg("allocation %zu: %s", tried, error.text);
        assert_false(report.cut);
        assert_true(read->revision == kept || read->revision == kept + 1);
        assert_true(random_digest(read) ==
                    (read->revision == kept ? world.digests[kept] : random_digest(world.session)));
        skd_session_destroy(read);
        world_end(&world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reading_without_memory_is_no_damage),
        cmocka_unit_test(writing_without_memory_changes_nothing),
        cmocka_unit_test(appending_without_memory_suspends),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
