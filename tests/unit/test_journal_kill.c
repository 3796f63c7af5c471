/* A process that appends, folds logs in and rewrites whole files is killed at any moment: what it
 * had been told is kept, and what is read is a state that it was in. */
#include "journal/read.h"
#include "journal/whole.h"
#include "support/world.h"

#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

enum { ROUNDS = 40, VERTICES = 20000 };

/* What the child tells its parent: a state that it is about to append, or that was told as kept. */
struct line {
    uint64_t revision;
    uint64_t digest;
    uint64_t is_kept;
};

static void tell(int fd, const struct world *world, bool is_kept)
{
    uint64_t revision = world->session->revision;
    const struct line line = {revision, world->digests[revision], is_kept};
    SKD_ASSERT(write(fd, &line, sizeof line) == (ssize_t)sizeof line);
}

/* Large steps, so that logs are folded in all the time; now and then a whole file. */
static void work_until_killed(struct world *world, int fd)
{
    for (int i = 1; world->session->revision + 2 < WORLD_REVISIONS_MAX; i++) {
        world_step(world, 1 + random_below(&world->random, VERTICES - 1), (unsigned)i % 8);
        tell(fd, world, false);
        world_wait(world);
        tell(fd, world, true);
        if (i % 16 == 0) {
            world_close(world);
            world_write(world);
            world_open(world);
        }
    }
    pause();
}

static pid_t start_child(uint64_t seed, char path[WORLD_PATH_BYTES], char folder[WORLD_PATH_BYTES],
                         int *fd)
{
    static struct world world;
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        world_start(&world, seed, VERTICES, 4, 4);
        world_write(&world);
        SKD_ASSERT(write(ends[1], world.path, WORLD_PATH_BYTES) == WORLD_PATH_BYTES);
        SKD_ASSERT(write(ends[1], world.folder, WORLD_PATH_BYTES) == WORLD_PATH_BYTES);
        tell(ends[1], &world, true);
        world_open(&world);
        work_until_killed(&world, ends[1]);
    }
    close(ends[1]);
    assert_int_equal(read(ends[0], path, WORLD_PATH_BYTES), WORLD_PATH_BYTES);
    assert_int_equal(read(ends[0], folder, WORLD_PATH_BYTES), WORLD_PATH_BYTES);
    *fd = ends[0];
    return child;
}

static void a_kill_loses_nothing_that_was_told(void **state)
{
    (void)state;
    static struct line lines[2 * WORLD_REVISIONS_MAX];
    struct random random = {99};
    size_t steps = 0;
    for (uint64_t round = 0; round < ROUNDS; round++) {
        char path[WORLD_PATH_BYTES], folder[WORLD_PATH_BYTES], command[WORLD_PATH_BYTES + 16];
        int fd;
        pid_t child = start_child(round, path, folder, &fd);
        (void)usleep((useconds_t)(1000 * (5 + random_below(&random, 250))));
        assert_int_equal(kill(child, SIGKILL), 0);
        assert_int_equal(waitpid(child, NULL, 0), child);
        size_t count = 0;
        while (read(fd, &lines[count], sizeof *lines) == (ssize_t)sizeof *lines)
            count++;
        close(fd);
        uint64_t kept = 0;
        for (size_t i = 0; i < count; i++)
            kept = lines[i].is_kept != 0 ? lines[i].revision : kept;
        skd_journal_sweep(folder);
        struct skd_session *read = NULL;
        struct skd_journal_report report;
        struct skd_error error = {0};
        if (skd_journal_read(path, NULL, &read, &report, &error) != SKD_OK)
            fail_msg("round %u: %s", (unsigned)round, error.text);
        if (report.rewrite)
            fail_msg("round %u: not sound (%s)", (unsigned)round, report.text);
        assert_true(read->revision >= kept && read->revision <= kept + 1);
        bool found = false;
        for (size_t i = 0; i < count; i++)
            found |= lines[i].revision == read->revision && lines[i].digest == random_digest(read);
        /* Killed between a step and its line: then it is the next one, which nobody knows. */
        assert_true(found || read->revision == kept + 1);
        steps += kept;
        skd_session_destroy(read);
        (void)snprintf(command, sizeof command, "rm -r '%s'", folder);
        assert_int_equal(system(command), 0);
    }
    assert_true(steps > ROUNDS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_kill_loses_nothing_that_was_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
