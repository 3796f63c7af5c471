/* What the journal asks of the disk, watched through an SQLite file system of the test's own:
 * nobody is told before the log is on the disk, and each write, truncation or sync that fails
 * leaves a file that holds a state which was. */
#include "journal/read.h"
#include "support/world.h"

#include <setjmp.h>
#include <sqlite3.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* ---- the file system --------------------------------------------------------------------------
 */

struct watched {
    sqlite3_file base;
    bool is_log;
    sqlite3_file *real; /* behind this one */
};

static sqlite3_vfs *plain;
static atomic_bool log_is_ahead; /* it was written since it was synced */
static atomic_int countdown;     /* operations until one fails; 0: none does */
static atomic_int failed;
static int failure; /* what it fails with */

static bool fails(void)
{
    if (atomic_load(&countdown) == 0 || atomic_fetch_sub(&countdown, 1) != 1)
        return false;
    atomic_store(&countdown, 1); /* and so do all after it */
    atomic_fetch_add(&failed, 1);
    return true;
}

static sqlite3_file *real(sqlite3_file *file)
{
    return ((struct watched *)file)->real;
}

static int on_close(sqlite3_file *file)
{
    return real(file)->pMethods != NULL ? real(file)->pMethods->xClose(real(file)) : SQLITE_OK;
}

static int on_read(sqlite3_file *file, void *out, int bytes, sqlite3_int64 at)
{
    return real(file)->pMethods->xRead(real(file), out, bytes, at);
}

static int on_write(sqlite3_file *file, const void *bytes, int count, sqlite3_int64 at)
{
    if (fails())
        return failure;
    if (((struct watched *)file)->is_log)
        atomic_store(&log_is_ahead, true);
    return real(file)->pMethods->xWrite(real(file), bytes, count, at);
}

static int on_truncate(sqlite3_file *file, sqlite3_int64 size)
{
    return fails() ? failure : real(file)->pMethods->xTruncate(real(file), size);
}

static int on_sync(sqlite3_file *file, int flags)
{
    if (fails())
        return SQLITE_IOERR_FSYNC;
    if (((struct watched *)file)->is_log)
        atomic_store(&log_is_ahead, false);
    return real(file)->pMethods->xSync(real(file), flags);
}

static int on_size(sqlite3_file *file, sqlite3_int64 *size)
{
    return real(file)->pMethods->xFileSize(real(file), size);
}

static int on_lock(sqlite3_file *file, int level)
{
    return real(file)->pMethods->xLock(real(file), level);
}

static int on_unlock(sqlite3_file *file, int level)
{
    return real(file)->pMethods->xUnlock(real(file), level);
}

static int on_check(sqlite3_file *file, int *result)
{
    return real(file)->pMethods->xCheckReservedLock(real(file), result);
}

static int on_control(sqlite3_file *file, int operation, void *argument)
{
    return real(file)->pMethods->xFileControl(real(file), operation, argument);
}

static int on_sector(sqlite3_file *file)
{
    return real(file)->pMethods->xSectorSize(real(file));
}

static int on_traits(sqlite3_file *file)
{
    return real(file)->pMethods->xDeviceCharacteristics(real(file));
}

static int on_open(sqlite3_vfs *vfs, sqlite3_filename name, sqlite3_file *file, int flags,
                   int *out_flags)
{
    /* Version 1: no shared memory, so the log only works with exclusive locking, as ours does. */
    static const sqlite3_io_methods methods = {
        .iVersion = 1,
        .xClose = on_close,
        .xRead = on_read,
        .xWrite = on_write,
        .xTruncate = on_truncate,
        .xSync = on_sync,
        .xFileSize = on_size,
        .xLock = on_lock,
        .xUnlock = on_unlock,
        .xCheckReservedLock = on_check,
        .xFileControl = on_control,
        .xSectorSize = on_sector,
        .xDeviceCharacteristics = on_traits,
    };
    struct watched *watched = (struct watched *)file;
    (void)vfs;
    watched->is_log = (flags & SQLITE_OPEN_WAL) != 0;
    watched->real = (sqlite3_file *)(watched + 1);
    int result = plain->xOpen(plain, name, watched->real, flags, out_flags);
    watched->base.pMethods = result == SQLITE_OK ? &methods : NULL;
    return result;
}

static int set_up(void **state)
{
    static sqlite3_vfs watching;
    (void)state;
    plain = sqlite3_vfs_find(NULL);
    if (plain == NULL)
        return -1;
    watching = *plain;
    watching.zName = "watching";
    watching.szOsFile = plain->szOsFile + (int)sizeof(struct watched);
    watching.xOpen = on_open;
    return sqlite3_vfs_register(&watching, 1) == SQLITE_OK ? 0 : -1;
}

/* ---- tests ------------------------------------------------------------------------------------
 */

static void nobody_is_told_before_the_log_is_on_the_disk(void **state)
{
    (void)state;
    static struct world world;
    world_start(&world, 41, 200, 4, 4);
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 30; i++) {
        atomic_store(&log_is_ahead, true); /* until this step's sync, should it write nothing */
        world_step(&world, 5, RANDOM_PINS);
        world_wait(&world);
        assert_false(atomic_load(&log_is_ahead));
    }
    world_end(&world);
}

/* Durability second: written soon, and synced at most a second later. */
static void what_was_told_first_is_synced_within_a_second(void **state)
{
    (void)state;
    static struct world world;
    world_start(&world, 42, 200, 4, 4);
    world.session->durability = SKD_DURABILITY_SECOND;
    world_write(&world);
    world_open(&world);
    atomic_store(&log_is_ahead, false);
    world_step(&world, 5, 0);
    uint64_t began = uv_hrtime();
    bool was_ahead = false;
    while (uv_hrtime() - began < UINT64_C(1100000000)) {
        was_ahead |= atomic_load(&log_is_ahead);
        uv_sleep(5);
    }
    assert_true(was_ahead);
    assert_false(atomic_load(&log_is_ahead));
    world_end(&world);
}

/* From some operation on, the disk fails for good. */
static void try_failing(int operation, int with)
{
    static struct world world;
    world_start(&world, 43, 200, 4, 4);
    world_write(&world);
    world_open(&world);
    for (int i = 0; i < 3; i++)
        world_act(&world);
    world_step(&world, 5, 0);
    world_wait(&world);
    uint64_t kept = world.session->revision;
    failure = with;
    atomic_store(&failed, 0);
    atomic_store(&countdown, operation);
    for (int i = 0; i < 6; i++) {
        world_step(&world, 10, (unsigned)i % 16);
        world_wait(&world);
        if (world.suspended == 0)
            kept = world.session->revision;
    }
    world_close(&world);
    atomic_store(&countdown, 0);
    assert_true(world.suspended <= 1);
    struct skd_session *read = NULL;
    struct skd_journal_report report;
    struct skd_error error = {0};
    if (skd_journal_read(world.path, NULL, &read, &report, &error) != SKD_OK)
        fail_msg("operation %d: %s", operation, error.text);
    assert_false(report.cut);
    assert_true(read->revision >= kept);
    assert_true(random_digest(read) == world.digests[read->revision]);
    skd_session_destroy(read);
    world_end(&world);
}

static void a_failing_disk_suspends_and_loses_nothing_told(void **state)
{
    (void)state;
    int failing = 0;
    for (int operation = 1; operation < 400; operation += operation < 60 ? 1 : 7) {
        try_failing(operation, operation % 2 == 0 ? SQLITE_FULL : SQLITE_IOERR_WRITE);
        failing += atomic_load(&failed) > 0;
    }
    assert_true(failing > 60);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nobody_is_told_before_the_log_is_on_the_disk),
        cmocka_unit_test(what_was_told_first_is_synced_within_a_second),
        cmocka_unit_test(a_failing_disk_suspends_and_loses_nothing_told),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
