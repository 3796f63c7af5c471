/* Journals that are damaged, of others, older or newer: never a wrong state, and what is lost is
 * told. */
#include "journal/read.h"
#include "journal/schema.h"
#include "support/files.h"
#include "support/world.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

/* ---- damage -----------------------------------------------------------------------------------
 */

struct damage {
    struct world world;
    struct bytes file, log;
    char copy[WORLD_PATH_BYTES + 8];
    size_t whole, cut, refused;
};

static void start_damage(struct damage *damage, uint64_t seed, bool folded)
{
    struct world *world = &damage->world;
    world_start(world, seed, 96, 4, 4);
    world_write(world);
    world_open(world);
    for (int i = 0; i < 25; i++) {
        world_act(world);
        world_wait(world);
    }
    if (folded)
        world_close(world);
    damage->file = take_file(world->path, "");
    damage->log = take_file(world->path, "-wal");
    damage->whole = damage->cut = damage->refused = 0;
    (void)snprintf(damage->copy, sizeof damage->copy, "%s.copy", world->path);
}

static void end_damage(struct damage *damage)
{
    free(damage->file.data);
    free(damage->log.data);
    world_end(&damage->world);
}

/* No answer is remembered that the state does not have. */
static bool check_answer(void *user, const char *client_id, uint64_t sequence, uint64_t revision,
                         const char *answer)
{
    const struct skd_session *session = user;
    (void)client_id, (void)sequence, (void)answer;
    assert_true(revision <= session->revision);
    return true;
}

/* Reads what a case made of the copies: a state that was committed, by its number, or an error. */
static void judge(struct damage *damage)
{
    struct world *world = &damage->world;
    struct skd_session *session = NULL;
    struct skd_journal_report report;
    struct skd_error error = {0};
    enum skd_status status = skd_journal_read(damage->copy, NULL, &session, &report, &error);
    if (status != SKD_OK) {
        assert_true(status == SKD_DAMAGED || status == SKD_NEWER);
        assert_int_not_equal(error.text[0], '\0');
        damage->refused++;
        return;
    }
    assert_true(session->revision <= world->session->revision);
    assert_true(random_digest(session) == world->digests[session->revision]);
    skd_remembered_each(&session->remembered, check_answer, session);
    if (report.cut) {
        assert_string_not_equal(session->instance, world->session->instance);
        assert_int_not_equal(session->damage[0], '\0');
        damage->cut++;
    } else {
        damage->whole++;
    }
    /* And its history leads somewhere: back to the base and forth again. */
    struct skd_history *history = &session->history;
    uint64_t digest = random_digest(session);
    for (size_t i = history->position; i > 0; i--)
        skd_session_write(session, history->steps[i - 1], true);
    for (size_t i = 0; i < history->position; i++)
        skd_session_write(session, history->steps[i], false);
    assert_true(random_digest(session) == digest);
    skd_session_destroy(session);
}

static void put_copies(const struct damage *damage)
{
    put_file(damage->copy, "", damage->file.data, damage->file.count);
    put_file(damage->copy, "-wal", damage->log.data, damage->log.count);
}

static void logs_cut_anywhere_give_a_committed_state(void **state)
{
    (void)state;
    static struct damage damage;
    start_damage(&damage, 11, false);
    size_t log = damage.log.count;
    assert_true(log > 10 * 4120);
    put_copies(&damage);
    for (size_t cut = 0; cut < 700; cut++) {
        /* Each byte near the end, then sparser. */
        size_t count = cut < 100 ? log - cut : log - log * (cut - 100) / 600;
        put_file(damage.copy, "-wal", damage.log.data, count);
        judge(&damage);
    }
    assert_int_equal(damage.refused, 0);
    assert_int_equal(damage.cut, 0); /* it looks like a kill */
    end_damage(&damage);
}

static void zeroed_tails_of_logs_are_told(void **state)
{
    (void)state;
    static struct damage damage;
    start_damage(&damage, 12, false);
    size_t log = damage.log.count, frames = (log - 32) / 4120;
    put_copies(&damage);
    for (size_t i = 0; i < 200; i++) {
        uint8_t *data = malloc(log);
        memcpy(data, damage.log.data, log);
        size_t from = random_below(&damage.world.random, log);
        memset(data + from, 0, log - from);
        put_file(damage.copy, "-wal", data, log);
        free(data);
        size_t cut = damage.cut;
        judge(&damage);
        if (from < 32 + 4120 * (frames - 2))
            assert_int_equal(damage.cut, cut + 1);
    }
    assert_int_equal(damage.refused, 0);
    end_damage(&damage);
}

/* Flips a few bits of a file; `suffix` tells which. */
static void flip(struct damage *damage, const struct bytes *of, const char *suffix, int rounds)
{
    for (int i = 0; i < rounds; i++) {
        uint8_t *data = malloc(of->count);
        memcpy(data, of->data, of->count);
        for (size_t flips = 1 + random_below(&damage->world.random, 3); flips > 0; flips--)
            data[random_below(&damage->world.random, of->count)] ^=
                (uint8_t)(1u << random_below(&damage->world.random, 8));
        put_copies(damage);
        put_file(damage->copy, suffix, data, of->count);
        free(data);
        judge(damage);
    }
}

static void flipped_bits_never_give_a_wrong_state(void **state)
{
    (void)state;
    static struct damage damage;
    start_damage(&damage, 13, false);
    flip(&damage, &damage.log, "-wal", 300);
    assert_int_equal(damage.refused, 0); /* the base is not in the log */
    assert_true(damage.cut > 200);
    flip(&damage, &damage.file, "", 300);
    end_damage(&damage);
    start_damage(&damage, 14, true); /* all in the file itself */
    damage.log.count = 0;
    flip(&damage, &damage.file, "", 600);
    assert_true(damage.refused > 0 && damage.cut > 0);
    end_damage(&damage);
}

static void torn_files_are_refused_or_give_a_committed_state(void **state)
{
    (void)state;
    static struct damage damage;
    start_damage(&damage, 15, true);
    damage.log.count = 0;
    size_t size = damage.file.count;
    for (size_t i = 0; i < 300; i++) {
        size_t from = i < 200 ? size * i / 200 : random_below(&damage.world.random, size);
        put_copies(&damage);
        if (i < 200) {
            put_file(damage.copy, "", damage.file.data, from);
        } else {
            uint8_t *data = malloc(size);
            memcpy(data, damage.file.data, size);
            size_t zeros = random_below(&damage.world.random, size - from);
            memset(data + from, 0, zeros);
            put_file(damage.copy, "", data, size);
            free(data);
        }
        judge(&damage);
    }
    assert_true(damage.refused > 100);
    end_damage(&damage);
}

static void damaged_files_are_set_aside(void **state)
{
    (void)state;
    static struct damage damage;
    char aside[WORLD_PATH_BYTES + 16];
    struct skd_session *session;
    struct skd_journal_report report;
    start_damage(&damage, 16, false);
    (void)snprintf(aside, sizeof aside, "%s/aside", damage.world.folder);
    put_copies(&damage);
    damage.log.data[damage.log.count / 2] ^= 1;
    put_file(damage.copy, "-wal", damage.log.data, damage.log.count);
    assert_int_equal(skd_journal_read(damage.copy, aside, &session, &report, NULL), SKD_OK);
    assert_true(report.cut && report.rewrite);
    skd_session_destroy(session);
    assert_int_equal(access(damage.copy, F_OK), 0); /* the caller removes it */
    assert_int_equal(count_files(aside), 2);        /* the file and its log */
    struct stat status;
    assert_int_equal(stat(aside, &status), 0);
    assert_int_equal(status.st_mode & 0777, 0700);
    memset(damage.file.data, 0, 64);
    put_file(damage.copy, "", damage.file.data, damage.file.count);
    assert_int_equal(skd_journal_read(damage.copy, aside, &session, &report, NULL), SKD_DAMAGED);
    assert_int_not_equal(access(damage.copy, F_OK), 0);
    assert_int_equal(count_files(aside), 4);
    end_damage(&damage);
}

/* ---- what is no file of ours ------------------------------------------------------------------
 */

static void execute(const char *path, const char *sql)
{
    sqlite3 *db;
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    if (sqlite3_exec(db, sql, NULL, NULL, NULL) != SQLITE_OK)
        fail_msg("%s", sqlite3_errmsg(db));
    assert_int_equal(sqlite3_close(db), SQLITE_OK);
}

static enum skd_status try_read(const char *path)
{
    struct skd_session *session = NULL;
    struct skd_journal_report report;
    enum skd_status status = skd_journal_read(path, NULL, &session, &report, NULL);
    skd_session_destroy(session);
    return status;
}

static void files_of_others_are_refused(void **state)
{
    (void)state;
    static const char *const changes[] = {
        "CREATE TABLE more(id INTEGER)",
        "CREATE VIEW seen AS SELECT * FROM steps",
        "CREATE TRIGGER pulled AFTER INSERT ON steps BEGIN DELETE FROM steps; END",
        "CREATE INDEX listed ON steps(cause)",
        "DROP TABLE guard",
        "DROP TABLE chunks; CREATE VIEW chunks AS SELECT 1 AS id, 2 AS sum, x'00' AS body",
        "ALTER TABLE steps ADD COLUMN more INTEGER",
        "DELETE FROM session",
        "UPDATE session SET slots=4000000000",
        "UPDATE session SET rig_bytes=1000000000000",
        "UPDATE session SET name=zeroblob(100)",
        "UPDATE chunks SET body=zeroblob(length(body))",
        "UPDATE chunks SET body='text'",
        "DELETE FROM chunks WHERE id=(SELECT min(id) FROM chunks)",
        "PRAGMA application_id=5",
        "PRAGMA user_version=-3",
    };
    static struct world world;
    world_start(&world, 21, 80, 3, 4);
    for (int i = 0; i < 10; i++)
        world_act(&world);
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        world_write(&world);
        assert_int_equal(try_read(world.path), SKD_OK);
        execute(world.path, changes[i]);
        if (try_read(world.path) != SKD_DAMAGED)
            fail_msg("taken: %s", changes[i]);
    }
    char other[WORLD_PATH_BYTES + 8];
    (void)snprintf(other, sizeof other, "%s.none", world.path);
    assert_int_equal(try_read(other), SKD_NO_FILE);
    world_write(&world);
    assert_int_equal(symlink(world.path, other), 0);
    assert_int_equal(try_read(other), SKD_FILE_IO);
    assert_int_equal(try_read(world.folder), SKD_FILE_IO);
    world_end(&world);
}

/* Rows that others may have changed with good checksums are held against the session's rules, but
 * what only the history needs costs the history alone. */
static void lost_parts_are_told(void **state)
{
    (void)state;
    static const struct {
        const char *sql, *said;
    } changes[] = {
        {"DELETE FROM state", "how far it had come"},
        {"UPDATE state SET position=position+1, count=count+1", "how far it had come"},
        {"DELETE FROM steps WHERE id=(SELECT max(id) FROM steps)", "not whole"},
        {"UPDATE steps SET client='other'", "not whole"},
        {"DELETE FROM history WHERE place=3", "not whole"},
        {"UPDATE history SET revision=revision+1 WHERE place=4", "not whole"},
        {"UPDATE history SET step=step+1 WHERE place=2", "not whole"},
        {"UPDATE poses SET name='q' WHERE name='rest'", "poses are lost"},
        {"UPDATE guard SET count=1", "guard"},
        {"UPDATE guard SET body=zeroblob(7)", "guard"},
    };
    static struct world world;
    world_start(&world, 22, 80, 3, 4);
    for (int i = 0; i < 12; i++)
        world_step(&world, 5, (unsigned)i % 16);
    while (world.session->guards.factors == NULL)
        world_act(&world);
    world_step(&world, 3, 0);
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        struct skd_session *session = NULL;
        struct skd_journal_report report;
        struct skd_error error = {0};
        world_write(&world);
        execute(world.path, changes[i].sql);
        if (skd_journal_read(world.path, NULL, &session, &report, &error) != SKD_OK)
            fail_msg("%s: %s", changes[i].sql, error.text);
        assert_true(report.cut);
        if (strstr(report.text, changes[i].said) == NULL)
            fail_msg("%s: \"%s\"", changes[i].sql, report.text);
        assert_string_equal(session->damage, report.text);
        assert_true(random_digest(session) == world.digests[session->revision]);
        skd_session_destroy(session);
    }
    world_end(&world);
}

/* The state of an earlier moment over a history that went another way since. */
static void a_state_that_fits_no_history_is_not_believed(void **state)
{
    (void)state;
    static struct world world;
    char old[WORLD_PATH_BYTES + 8], sql[WORLD_PATH_BYTES + 128];
    world_start(&world, 27, 80, 3, 4);
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 5; i++)
        world_step(&world, 5, 0);
    world_close(&world);
    struct bytes bytes = take_file(world.path, "");
    (void)snprintf(old, sizeof old, "%s.old", world.path);
    put_file(old, "", bytes.data, bytes.count);
    free(bytes.data);
    world_open(&world);
    world_undo(&world);
    world_undo(&world);
    for (int i = 0; i < 3; i++)
        world_step(&world, 5, 0);
    world_close(&world);
    (void)snprintf(sql, sizeof sql,
                   "ATTACH '%s' AS old; DELETE FROM state; INSERT INTO state SELECT * FROM "
                   "old.state",
                   old);
    execute(world.path, sql);
    struct skd_session *read = NULL;
    struct skd_journal_report report;
    assert_int_equal(skd_journal_read(world.path, NULL, &read, &report, NULL), SKD_OK);
    assert_true(report.cut);
    assert_true(random_digest(read) == world.digests[read->revision]);
    skd_session_destroy(read);
    world_end(&world);
}

static void newer_files_are_left_unharmed(void **state)
{
    (void)state;
    static struct world world;
    char sql[64], aside[WORLD_PATH_BYTES + 16];
    world_start(&world, 23, 80, 3, 4);
    world_write(&world);
    (void)snprintf(sql, sizeof sql, "PRAGMA user_version=%d", SKD_JOURNAL_VERSION + 1);
    (void)snprintf(aside, sizeof aside, "%s/aside", world.folder);
    execute(world.path, sql);
    struct bytes before = take_file(world.path, "");
    struct skd_session *session;
    struct skd_journal_report report;
    struct skd_error error;
    assert_int_equal(skd_journal_read(world.path, aside, &session, &report, &error), SKD_NEWER);
    assert_non_null(strstr(error.text, "later skind"));
    struct bytes after = take_file(world.path, "");
    assert_int_equal(after.count, before.count);
    assert_memory_equal(after.data, before.data, before.count);
    assert_int_not_equal(access(aside, F_OK), 0);
    world_open(&world); /* nor does the writer touch it */
    world_step(&world, 3, 0);
    world_wait(&world);
    assert_int_equal(world.suspended, 1);
    free(after.data);
    after = take_file(world.path, "");
    assert_memory_equal(after.data, before.data, before.count);
    free(before.data);
    free(after.data);
    world_end(&world);
}

/* What version 1 had: no column for the person who made a step. */
static void make_version_1(const struct world *world)
{
    execute(world->path, "ALTER TABLE steps DROP COLUMN user; PRAGMA user_version=1");
}

static void older_files_are_brought_up_to_date(void **state)
{
    (void)state;
    static struct world world;
    struct skd_session *read = NULL;
    struct skd_journal_report report;
    world_start(&world, 24, 80, 3, 4);
    for (int i = 0; i < 6; i++)
        world_step(&world, 5, 0);
    const struct skd_history *history = &world.session->history;
    for (size_t i = 0; i < history->count; i++)
        history->steps[i]->author.user[0] = '\0';
    world_write(&world);
    make_version_1(&world);
    struct bytes before = take_file(world.path, "");
    assert_int_equal(skd_journal_read(world.path, NULL, &read, &report, NULL), SKD_OK);
    struct bytes after = take_file(world.path, "");
    assert_memory_equal(after.data, before.data, before.count); /* reading leaves it as it is */
    assert_true(report.rewrite);
    assert_false(report.cut);
    assert_true(random_digest(read) == world.digests[read->revision]);
    assert_int_equal(read->history.count, history->count);
    assert_string_equal(read->history.steps[0]->author.client, history->steps[0]->author.client);
    assert_string_equal(read->history.steps[0]->author.user, "");
    skd_session_destroy(read);
    free(before.data);
    free(after.data);
    execute(world.path, "PRAGMA user_version=0"); /* which has no tables */
    assert_int_equal(try_read(world.path), SKD_DAMAGED);
    world_end(&world);
}

static void verifying_finds_what_differs(void **state)
{
    (void)state;
    static struct world world;
    struct skd_journal_report report;
    struct skd_error error = {0};
    world_start(&world, 25, 80, 3, 4);
    for (int i = 0; i < 20; i++)
        world_act(&world);
    world_write(&world);
    assert_int_equal(skd_journal_verify(world.path, world.session, &report, &error), SKD_OK);
    assert_false(report.cut);
    assert_int_equal(report.revision, world.session->revision);
    float *weight = &world.session->weights[17];
    float before = *weight;
    *weight += 0.25F;
    assert_int_equal(skd_journal_verify(world.path, world.session, &report, &error), SKD_DAMAGED);
    assert_non_null(strstr(error.text, "weights"));
    *weight = before;
    execute(world.path, "UPDATE poses SET name='q' WHERE name='rest'");
    assert_int_equal(skd_journal_verify(world.path, NULL, &report, &error), SKD_OK);
    assert_true(report.cut);
    world_end(&world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(logs_cut_anywhere_give_a_committed_state),
        cmocka_unit_test(zeroed_tails_of_logs_are_told),
        cmocka_unit_test(flipped_bits_never_give_a_wrong_state),
        cmocka_unit_test(torn_files_are_refused_or_give_a_committed_state),
        cmocka_unit_test(damaged_files_are_set_aside),
        cmocka_unit_test(files_of_others_are_refused),
        cmocka_unit_test(lost_parts_are_told),
        cmocka_unit_test(a_state_that_fits_no_history_is_not_believed),
        cmocka_unit_test(newer_files_are_left_unharmed),
        cmocka_unit_test(older_files_are_brought_up_to_date),
        cmocka_unit_test(verifying_finds_what_differs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
