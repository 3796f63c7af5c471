/* Fuzz target: a session's file and its log, as somebody else may have made them (journal/read.h).
 *
 * Input: four bytes, little-endian, that say how much of the rest is the file; what follows is its
 * log. Checksums are always 0 here (CMakeLists.txt wraps XXH3), so that what a mutation changed is
 * not merely found to be damaged but read. What comes out must be a session that can be worked on:
 * it is undone to its beginning and redone, and written to another file, which must be read alike.
 */
#include "fuzz.h"

#include "journal/read.h"
#include "journal/whole.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/skind-fuzz-XXXXXX";
static char file[64], file_log[64], copy[64], copy_log[64];

uint64_t __wrap_XXH3_64bits_withSeed(const void *data, size_t bytes, uint64_t seed);

uint64_t __wrap_XXH3_64bits_withSeed(const void *data, size_t bytes, uint64_t seed)
{
    (void)data, (void)bytes, (void)seed;
    return 0;
}

static void remove_files(void)
{
    unlink(file);
    unlink(file_log);
    unlink(copy);
    unlink(copy_log);
}

static void remove_folder(void)
{
    remove_files();
    rmdir(folder);
}

static void make_folder(void)
{
    SKD_ASSERT(mkdtemp(folder) != NULL);
    (void)snprintf(file, sizeof file, "%s/a.skind", folder);
    (void)snprintf(file_log, sizeof file_log, "%s/a.skind-wal", folder);
    (void)snprintf(copy, sizeof copy, "%s/b.skind", folder);
    (void)snprintf(copy_log, sizeof copy_log, "%s/b.skind-wal", folder);
    atexit(remove_folder);
}

static void write_file(const char *path, const uint8_t *data, size_t size)
{
    int descriptor = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    SKD_ASSERT(descriptor >= 0 && write(descriptor, data, size) == (ssize_t)size);
    close(descriptor);
}

static void check(const struct skd_session *session)
{
    const struct skd_rig *rig = session->rig;
    const size_t slots = rig->mesh.vertex_count * (size_t)session->slot_count;
    for (size_t i = 0; i < slots; i++) {
        SKD_ASSERT(session->joints[i] == SKD_SLOT_EMPTY ||
                   session->joints[i] < rig->skeleton.bone_count);
        SKD_ASSERT(isfinite(session->weights[i]));
    }
    for (size_t i = 0; i < 3 * rig->mesh.vertex_count; i++)
        SKD_ASSERT(isfinite(session->rest[i]));
}

static uint64_t sum_up(const struct skd_session *session)
{
    const size_t slots = session->rig->mesh.vertex_count * (size_t)session->slot_count;
    uint64_t sum = session->revision;
    for (size_t i = 0; i < slots; i++) {
        uint32_t bits;
        memcpy(&bits, &session->weights[i], sizeof bits);
        sum = sum * 31 + bits + session->joints[i];
    }
    return sum;
}

static enum skd_status write_copy(struct skd_session *session, struct skd_error *error)
{
    struct skd_pose *poses[SKD_POSES_MAX], *pose, *next;
    size_t count = 0;
    HASH_ITER(hh, session->poses.by_name, pose, next)
    {
        SKD_ASSERT(count < SKD_POSES_MAX);
        poses[count++] = pose;
    }
    return skd_journal_write(copy, session, NULL, poses, count, error);
}

/* The session written and read again is the same one. */
static void write_and_read(struct skd_session *session)
{
    struct skd_journal_report report;
    struct skd_session *again = NULL;
    struct skd_error error = {0};
    uint64_t sum = sum_up(session);
    if (write_copy(session, &error) != SKD_OK) {
        SKD_ASSERT(error.text[0] != '\0');
        return;
    }
    SKD_ASSERT(sum_up(session) == sum); /* undone and redone in place */
    enum skd_status status = skd_journal_read(copy, NULL, &again, &report, &error);
    SKD_ASSERT(status == SKD_OK);
    SKD_ASSERT(!report.cut && sum_up(again) == sum);
    skd_session_destroy(again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct skd_journal_report report = {0};
    struct skd_session *session = NULL;
    struct skd_error error = {0};
    uint32_t file_bytes;
    if (file[0] == '\0')
        make_folder();
    if (size < sizeof file_bytes)
        return 0;
    memcpy(&file_bytes, data, sizeof file_bytes);
    data += sizeof file_bytes;
    size -= sizeof file_bytes;
    size_t part = file_bytes < size ? file_bytes : size;
    write_file(file, data, part);
    if (size > part)
        write_file(file_log, data + part, size - part);
    enum skd_status status = skd_journal_read(file, NULL, &session, &report, &error);
    if (status == SKD_OK) {
        check(session);
        write_and_read(session);
        skd_session_destroy(session);
    } else {
        SKD_ASSERT(error.text[0] != '\0');
    }
    remove_files();
    return 0;
}
