/* The journal: what was written is read back to the bit, whatever else becomes of the file is never
 * a wrong state, and nobody is told that something is kept before it is. */
#include "journal/compare.h"
#include "journal/read.h"
#include "journal/whole.h"
#include "support/files.h"
#include "support/world.h"

#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>
#include <xxhash.h>

/* ---- helpers ----------------------------------------------------------------------------------
 */

static void assert_same_poses(const struct skd_session *a, const struct skd_session *b)
{
    const struct skd_pose *pose = a->poses.by_name, *other = b->poses.by_name;
    size_t bytes = (size_t)a->rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof(double);
    for (; pose != NULL && other != NULL; pose = pose->hh.next, other = other->hh.next) {
        assert_string_equal(pose->name, other->name);
        assert_memory_equal(pose->matrices, other->matrices, bytes);
    }
    assert_ptr_equal(pose, other);
}

struct answers {
    size_t count;
    uint64_t digest; /* of all, in their order */
};

static bool take_answer(void *user, const char *client_id, uint64_t sequence, uint64_t revision,
                        const char *answer)
{
    struct answers *answers = user;
    char line[256];
    (void)snprintf(line, sizeof line, "%s %u %u %s", client_id, (unsigned)sequence,
                   (unsigned)revision, answer);
    answers->count++;
    answers->digest = XXH3_64bits_withSeed(line, strlen(line), answers->digest);
    return true;
}

static struct answers answers_of(const struct skd_session *session)
{
    struct answers answers = {0};
    skd_remembered_each(&session->remembered, take_answer, &answers);
    return answers;
}

static void assert_same_answers(const struct skd_session *a, const struct skd_session *b)
{
    struct answers one = answers_of(a), other = answers_of(b);
    assert_int_equal(one.count, other.count);
    assert_true(one.digest == other.digest);
}

/* All that a session is, what can be undone and redone too. */
static void assert_same(const struct skd_session *live, const struct skd_session *read)
{
    struct skd_error error = {0};
    if (skd_compare_sessions(live, read, &error) != SKD_OK)
        fail_msg("%s", error.text);
    assert_true(random_digest(live) == random_digest(read));
    assert_string_equal(live->name, read->name);
    assert_string_equal(live->instance, read->instance);
    assert_int_equal(live->exported, read->exported);
    assert_int_equal(live->durability, read->durability);
    assert_int_equal(live->history.bytes_max, read->history.bytes_max);
    assert_int_equal(live->history.bytes, read->history.bytes);
    assert_int_equal(live->history.base_revision, read->history.base_revision);
    for (size_t i = 0; i < live->history.count; i++)
        assert_int_equal(live->history.steps[i]->revision, read->history.steps[i]->revision);
    assert_memory_equal(&live->slots, &read->slots, sizeof live->slots);
    assert_same_poses(live, read);
    assert_same_answers(live, read);
}

static struct skd_session *must_read(const char *path, bool cut)
{
    struct skd_session *session = NULL;
    struct skd_journal_report report;
    struct skd_error error = {0};
    if (skd_journal_read(path, NULL, &session, &report, &error) != SKD_OK)
        fail_msg("%s", error.text);
    if (report.cut != cut)
        fail_msg("cut is %d: %s", report.cut, report.text);
    assert_int_equal(report.revision, session->revision);
    assert_int_equal(report.rewrite, cut);
    return session;
}

/* ---- there and back ---------------------------------------------------------------------------
 */

static void whole_files_are_read_back_to_the_bit(void **state)
{
    (void)state;
    static struct world world;
    for (uint64_t seed = 0; seed < 24; seed++) {
        world_start(&world, seed, 64 + 40 * (size_t)(seed % 5), 2 + (int)(seed % 7),
                    seed % 2 == 0 ? 4 : 8);
        for (uint64_t i = 0; i < 8 * (seed % 12); i++)
            world_act(&world);
        uint64_t before = random_digest(world.session);
        world_write(&world);
        assert_true(random_digest(world.session) == before);
        struct skd_session *read = must_read(world.path, false);
        assert_same(world.session, read);
        skd_session_destroy(read);
        world_end(&world);
    }
}

static void appended_files_are_read_back_to_the_bit(void **state)
{
    (void)state;
    static struct world world;
    for (uint64_t seed = 100; seed < 124; seed++) {
        char copy[WORLD_PATH_BYTES + 8];
        world_start(&world, seed, 64 + 40 * (size_t)(seed % 5), 2 + (int)(seed % 7),
                    seed % 2 == 0 ? 4 : 8);
        for (uint64_t i = 0; i < 4 * (seed % 5); i++)
            world_act(&world);
        world_write(&world);
        world_open(&world);
        (void)snprintf(copy, sizeof copy, "%s.copy", world.path);
        for (int round = 0; round < 4; round++) {
            for (size_t i = random_below(&world.random, 30); i > 0; i--)
                world_act(&world);
            world_wait(&world);
            /* As a kill would leave it. */
            struct bytes file = take_file(world.path, ""), log = take_file(world.path, "-wal");
            put_file(copy, "", file.data, file.count);
            put_file(copy, "-wal", log.data, log.count);
            free(file.data);
            free(log.data);
            struct skd_session *read = must_read(copy, false);
            assert_same(world.session, read);
            skd_session_destroy(read);
            if (round % 2 == 1) { /* a file that was closed is appended to again */
                world_close(&world);
                read = must_read(world.path, false);
                assert_same(world.session, read);
                skd_session_destroy(read);
                world_open(&world);
            }
        }
        assert_int_equal(world.suspended, 0);
        world_end(&world);
    }
}

/* A log that was not folded in is gone on with. */
static void appending_goes_on_after_a_kill(void **state)
{
    (void)state;
    static struct world world;
    char copy[WORLD_PATH_BYTES + 8];
    world_start(&world, 7, 200, 5, 4);
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 20; i++)
        world_act(&world);
    world_wait(&world);
    (void)snprintf(copy, sizeof copy, "%s.copy", world.path);
    struct bytes file = take_file(world.path, ""), log = take_file(world.path, "-wal");
    put_file(copy, "", file.data, file.count);
    put_file(copy, "-wal", log.data, log.count);
    free(file.data);
    free(log.data);
    world_close(&world);
    memcpy(world.path, copy, strlen(copy) + 1);
    world_open(&world);
    for (int i = 0; i < 20; i++)
        world_act(&world);
    world_close(&world);
    struct skd_session *read = must_read(world.path, false);
    assert_same(world.session, read);
    skd_session_destroy(read);
    world_end(&world);
}

static void a_fork_is_the_same_session_of_another_name(void **state)
{
    (void)state;
    static struct world world;
    struct skd_journal_identity identity = {.name = "other", .instance = "0123456789abcdef"};
    world_start(&world, 8, 100, 4, 4);
    for (int i = 0; i < 30; i++)
        world_act(&world);
    assert_int_equal(skd_journal_write(world.path, world.session, &identity, NULL, 0, NULL),
                     SKD_OK);
    struct skd_session *read = must_read(world.path, false);
    assert_string_equal(read->name, "other");
    assert_string_equal(read->instance, "0123456789abcdef");
    assert_int_equal(skd_compare_sessions(world.session, read, NULL), SKD_OK);
    skd_session_destroy(read);
    world_end(&world);
}

/* A name becomes part of a file's name, so it is held against the wire's rule. */
static void names_that_are_paths_are_refused(void **state)
{
    (void)state;
    static const char *const names[] = {"../up", "a/b", ".hidden", "", "two words"};
    static struct world world;
    struct skd_journal_report report;
    struct skd_session *read = NULL;
    world_start(&world, 26, 80, 3, 4);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct skd_journal_identity identity = {.instance = "0123456789abcdef"};
        memcpy(identity.name, names[i], strlen(names[i]) + 1);
        assert_int_equal(skd_journal_write(world.path, world.session, &identity, NULL, 0, NULL),
                         SKD_OK);
        assert_int_equal(skd_journal_read(world.path, NULL, &read, &report, NULL), SKD_DAMAGED);
    }
    world_end(&world);
}

/* A step of all kinds, forward and back: what replaying found as `before` is what was there. */
static void undo_after_reading_leads_back_to_each_revision(void **state)
{
    (void)state;
    static struct world world;
    world_start(&world, 9, 300, 6, 8);
    for (int i = 0; i < 24; i++)
        world_step(&world, 1 + random_below(&world.random, 40), (unsigned)i % 16);
    world_write(&world);
    struct skd_session *read = must_read(world.path, false);
    for (size_t position = read->history.position; position > 0; position--) {
        assert_true(random_digest(read) == world.digests[position]);
        skd_session_write(read, read->history.steps[position - 1], true);
    }
    assert_true(random_digest(read) == world.digests[0]);
    skd_session_destroy(read);
    world_end(&world);
}

/* ---- writing ----------------------------------------------------------------------------------
 */

static void files_are_private_and_whole_or_the_old_one(void **state)
{
    (void)state;
    static struct world world;
    struct stat status;
    struct skd_error error;
    world_start(&world, 31, 4000, 3, 4);
    world_write(&world);
    assert_int_equal(stat(world.path, &status), 0);
    assert_int_equal(status.st_mode & 0777, 0600);
    struct bytes before = take_file(world.path, "");
    for (int i = 0; i < 20; i++)
        world_step(&world, 400, RANDOM_PINS);
    /* A disk that is full. */
    const struct rlimit small = {.rlim_cur = 100000, .rlim_max = RLIM_INFINITY};
    const struct rlimit none = {.rlim_cur = RLIM_INFINITY, .rlim_max = RLIM_INFINITY};
    (void)signal(SIGXFSZ, SIG_IGN);
    uint64_t digest = random_digest(world.session);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    enum skd_status full = skd_journal_write(world.path, world.session, NULL, NULL, 0, &error);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &none), 0);
    assert_int_equal(full, SKD_FILE_IO);
    assert_true(random_digest(world.session) == digest);
    struct bytes after = take_file(world.path, "");
    assert_int_equal(after.count, before.count);
    assert_memory_equal(after.data, before.data, before.count);
    assert_int_equal(count_files(world.folder), 1);
    put_file(world.folder, "/.skind-0123456789abcdef.tmp", before.data, 10);
    put_file(world.folder, "/.skind-0123456789abcdef.tmp-wal", before.data, 10);
    skd_journal_sweep(world.folder);
    assert_int_equal(count_files(world.folder), 1);
    free(before.data);
    free(after.data);
    world_end(&world);
}

static void nobody_is_told_before_it_is_written(void **state)
{
    (void)state;
    static struct world world;
    char copy[WORLD_PATH_BYTES + 8];
    world_start(&world, 32, 200, 4, 4);
    world_write(&world);
    world_open(&world);
    (void)snprintf(copy, sizeof copy, "%s.copy", world.path);
    for (int i = 0; i < 40; i++) {
        world_step(&world, 5, RANDOM_PINS);
        if (i % 4 == 3)
            (void)uv_run(&world.loop, UV_RUN_ONCE);
        size_t told = world.told;
        struct bytes file = take_file(world.path, ""), log = take_file(world.path, "-wal");
        put_file(copy, "", file.data, file.count);
        put_file(copy, "-wal", log.data, log.count);
        struct skd_session *read = NULL;
        struct skd_journal_report report;
        if (skd_journal_read(copy, NULL, &read, &report, NULL) == SKD_OK)
            assert_true(read->revision >= told);
        skd_session_destroy(read);
        free(file.data);
        free(log.data);
    }
    world_wait(&world);
    assert_int_equal(world.told, 40);
    world_end(&world);
}

static void durability_second_is_told_at_once_and_written_soon(void **state)
{
    (void)state;
    static struct world world;
    world_start(&world, 33, 200, 4, 4);
    world.session->durability = SKD_DURABILITY_SECOND;
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 10; i++)
        world_step(&world, 5, 0);
    assert_int_equal(world.waiting, 0);
    world_close(&world);
    struct skd_session *read = must_read(world.path, false);
    assert_true(random_digest(read) == random_digest(world.session));
    /* Others may have been told more than such a file has. */
    assert_string_not_equal(read->instance, world.session->instance);
    skd_session_destroy(read);
    world_end(&world);
}

static void a_file_that_cannot_be_written_is_suspended_once(void **state)
{
    (void)state;
    static struct world world;
    world_start(&world, 34, 200, 4, 4);
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 5; i++)
        world_step(&world, 5, 0);
    world_wait(&world);
    uint64_t kept = world.session->revision;
    const struct rlimit small = {.rlim_cur = 20000, .rlim_max = RLIM_INFINITY};
    const struct rlimit none = {.rlim_cur = RLIM_INFINITY, .rlim_max = RLIM_INFINITY};
    (void)signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    for (int i = 0; i < 8; i++)
        world_step(&world, 20, RANDOM_PINS);
    world_wait(&world); /* all are told, kept or not */
    assert_int_equal(world.suspended, 1);
    world_step(&world, 5, 0);
    assert_int_equal(world.waiting, 0);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &none), 0);
    world_close(&world);
    struct skd_session *read = must_read(world.path, false);
    assert_true(read->revision >= kept && read->revision < world.session->revision);
    assert_true(random_digest(read) == world.digests[read->revision]);
    skd_session_destroy(read);
    world_write(&world); /* and so it resumes */
    world_open(&world);
    world_step(&world, 5, 0);
    world_close(&world);
    read = must_read(world.path, false);
    assert_same(world.session, read);
    skd_session_destroy(read);
    assert_int_equal(world.suspended, 1);
    world_end(&world);
}

static void set_true(void *user)
{
    *(bool *)user = true;
}

static void closing_moves_or_removes_the_file(void **state)
{
    (void)state;
    static struct world world;
    char moved[WORLD_PATH_BYTES + 8];
    world_start(&world, 35, 200, 4, 4);
    (void)snprintf(moved, sizeof moved, "%s.moved", world.path);
    for (int round = 0; round < 2; round++) {
        bool ended = false;
        world_write(&world);
        world_open(&world);
        for (int i = 0; i < 5; i++)
            world_step(&world, 5, 0);
        skd_journal_close(world.file, round == 0 ? moved : "", set_true, &ended);
        while (!ended)
            (void)uv_run(&world.loop, UV_RUN_ONCE);
        assert_int_equal(world.waiting, 0);
        assert_int_equal(count_files(world.folder), 1); /* the moved one, without a log */
        if (round == 0) {
            struct skd_session *read = must_read(moved, false);
            assert_same(world.session, read);
            skd_session_destroy(read);
        }
    }
    world.file = NULL;
    world_end(&world);
}

/* The log stays small however much is written, and stopping writes all. */
static void the_log_is_folded_in(void **state)
{
    (void)state;
    static struct world world;
    world_start(&world, 36, 40000, 4, 8);
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 60; i++) {
        world_step(&world, 20000, 0);
        world_wait(&world);
        struct bytes log = take_file(world.path, "-wal");
        assert_true(log.count < (size_t)24 << 20);
        free(log.data);
    }
    assert_true(skd_journal_bytes(world.file) > (size_t)60 * 20000 * 36);
    skd_journal_stop(world.journal);
    world.journal = NULL;
    assert_int_equal(world.waiting, 0);
    struct skd_session *read = must_read(world.path, false);
    assert_true(random_digest(read) == random_digest(world.session));
    skd_session_destroy(read);
    world_end(&world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(whole_files_are_read_back_to_the_bit),
        cmocka_unit_test(appended_files_are_read_back_to_the_bit),
        cmocka_unit_test(appending_goes_on_after_a_kill),
        cmocka_unit_test(a_fork_is_the_same_session_of_another_name),
        cmocka_unit_test(names_that_are_paths_are_refused),
        cmocka_unit_test(undo_after_reading_leads_back_to_each_revision),
        cmocka_unit_test(files_are_private_and_whole_or_the_old_one),
        cmocka_unit_test(nobody_is_told_before_it_is_written),
        cmocka_unit_test(durability_second_is_told_at_once_and_written_soon),
        cmocka_unit_test(a_file_that_cannot_be_written_is_suspended_once),
        cmocka_unit_test(closing_moves_or_removes_the_file),
        cmocka_unit_test(the_log_is_folded_in),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
