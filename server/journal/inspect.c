/* See inspect.h. */
#include "journal/inspect.h"

#include "journal/schema.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* SQLite's file format: https://www.sqlite.org/fileformat2.html, 1.3 and 4.1. */
enum {
    HEAD_BYTES = 100,
    HEAD_VERSION_AT = 60,
    HEAD_APPLICATION_AT = 68,
    LOG_HEAD_BYTES = 32,
    FRAME_HEAD_BYTES = 24,
    PAGE_BYTES_MIN = 512,
    PAGE_BYTES_MAX = 65536,
};
static const uint32_t LOG_MAGIC = 0x377f0682; /* its last bit: sums are over big-endian words */

static uint32_t big_endian(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

static uint32_t little_endian(const uint8_t *bytes)
{
    return (uint32_t)bytes[3] << 24 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[1] << 8 | bytes[0];
}

bool skd_inspect_beside(const char *path, const char *suffix, char out[SKD_PATH_BYTES_MAX])
{
    return snprintf(out, SKD_PATH_BYTES_MAX, "%s%s", path, suffix) < SKD_PATH_BYTES_MAX;
}

enum skd_status skd_inspect_resolve(const char *path, char resolved[SKD_PATH_BYTES_MAX],
                                    struct skd_error *error)
{
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    char *folder = slash == NULL ? strdup(".") : strndup(path, (size_t)(slash - path) + 1);
    char *real = folder != NULL ? realpath(folder, NULL) : NULL;
    const int number = errno;
    free(folder);
    if (real == NULL)
        return skd_fail(error, number == ENOENT || number == ENOTDIR ? SKD_NO_FILE : SKD_FILE_IO,
                        "the folder of \"%s\" cannot be used: %s", path, strerror(number));
    int length =
        snprintf(resolved, SKD_PATH_BYTES_MAX, "%s/%s", strcmp(real, "/") == 0 ? "" : real, name);
    free(real);
    return length < SKD_PATH_BYTES_MAX - 16
               ? SKD_OK
               : skd_fail(error, SKD_TOO_LARGE, "the path \"%.100s...\" is too long", path);
}

/* Opens a plain file. *bytes 0 and fd -1 with SKD_OK: there is none, and it may be missing. */
static enum skd_status open_plain(const char *path, bool may_miss, int *fd, uint64_t *bytes,
                                  struct skd_error *error)
{
    struct stat status;
    *bytes = 0;
    *fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (*fd < 0 && errno == ENOENT && may_miss)
        return SKD_OK;
    if (*fd < 0 && errno == ELOOP)
        return skd_fail(error, SKD_FILE_IO, "\"%s\" is a symbolic link; name the file itself",
                        path);
    if (*fd < 0)
        return skd_fail(error, errno == ENOENT ? SKD_NO_FILE : SKD_FILE_IO,
                        "\"%s\" cannot be opened: %s", path, strerror(errno));
    if (fstat(*fd, &status) != 0 || !S_ISREG(status.st_mode)) {
        close(*fd);
        *fd = -1;
        return skd_fail(error, SKD_FILE_IO, "\"%s\" is not a file", path);
    }
    *bytes = (uint64_t)status.st_size;
    return SKD_OK;
}

static enum skd_status read_all(int fd, void *out, size_t bytes, uint64_t offset, const char *path,
                                struct skd_error *error)
{
    for (size_t done = 0; done < bytes;) {
        ssize_t got = pread(fd, (char *)out + done, bytes - done, (off_t)(offset + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be read: %s", path,
                            got < 0 ? strerror(errno) : "it got shorter");
        done += (size_t)got;
    }
    return SKD_OK;
}

enum skd_status skd_inspect_newer(const char *path, int version, struct skd_error *error)
{
    return skd_fail(error, SKD_NEWER,
                    "\"%s\" was written by a later skind (its version is %d, and %d is the latest "
                    "known here); it is left as it is",
                    path, version, SKD_JOURNAL_VERSION);
}

static enum skd_status check_head(const char *path, const uint8_t head[HEAD_BYTES],
                                  struct skd_error *error)
{
    if (memcmp(head, "SQLite format 3", 16) != 0 ||
        big_endian(head + HEAD_APPLICATION_AT) != SKD_JOURNAL_APPLICATION)
        return skd_fail(error, SKD_DAMAGED,
                        "\"%s\" is no session's file, or its first bytes are damaged", path);
    uint32_t version = big_endian(head + HEAD_VERSION_AT);
    return version > SKD_JOURNAL_VERSION && version <= INT_MAX
               ? skd_inspect_newer(path, (int)version, error)
               : SKD_OK;
}

/* A roll-back journal is never ours, and SQLite would write its pages into the file. */
static enum skd_status refuse_rollback(const char *path, struct skd_error *error)
{
    char journal[SKD_PATH_BYTES_MAX];
    struct stat status;
    return skd_inspect_beside(path, "-journal", journal) && lstat(journal, &status) == 0
               ? skd_fail(error, SKD_FILE_IO, "\"%s\" is in the way, and none of ours: remove it",
                          journal)
               : SKD_OK;
}

enum skd_status skd_inspect(const char *path, struct skd_inspection *inspection,
                            struct skd_error *error)
{
    uint8_t head[HEAD_BYTES];
    char log[SKD_PATH_BYTES_MAX];
    int fd;
    enum skd_status status = open_plain(path, false, &fd, &inspection->bytes, error);
    if (status != SKD_OK)
        return status;
    if (inspection->bytes < PAGE_BYTES_MIN)
        status = skd_fail(error, SKD_DAMAGED, "\"%s\" has %llu bytes only", path,
                          (unsigned long long)inspection->bytes);
    else
        status = read_all(fd, head, sizeof head, 0, path, error);
    close(fd);
    if (status != SKD_OK || (status = check_head(path, head, error)) != SKD_OK ||
        (status = refuse_rollback(path, error)) != SKD_OK)
        return status;
    if (!skd_inspect_beside(path, "-wal", log))
        return skd_fail(error, SKD_TOO_LARGE, "the path \"%.100s...\" is too long", path);
    status = open_plain(log, true, &fd, &inspection->log_bytes, error);
    if (fd >= 0)
        close(fd);
    return status;
}

/* ---- the log ----------------------------------------------------------------------------------
 */

struct log {
    const char *path;
    int fd;
    uint64_t bytes;
    size_t frame_bytes;
    bool is_big_endian; /* the words that are summed */
    uint8_t salts[8];
    uint32_t sums[2];
};

/* The format's checksum: s0 += x0 + s1, s1 += x1 + s0, over pairs of 32-bit words. */
static void add_up(struct log *log, const uint8_t *bytes, size_t count)
{
    uint32_t a = log->sums[0], b = log->sums[1];
    for (size_t i = 0; i < count; i += 8) {
        a += (log->is_big_endian ? big_endian(bytes + i) : little_endian(bytes + i)) + b;
        b += (log->is_big_endian ? big_endian(bytes + i + 4) : little_endian(bytes + i + 4)) + a;
    }
    log->sums[0] = a;
    log->sums[1] = b;
}

static bool sums_are(const struct log *log, const uint8_t *stored)
{
    return big_endian(stored) == log->sums[0] && big_endian(stored + 4) == log->sums[1];
}

static bool read_head(struct log *log, const uint8_t head[LOG_HEAD_BYTES])
{
    uint32_t magic = big_endian(head), page = big_endian(head + 8);
    if ((magic & ~UINT32_C(1)) != LOG_MAGIC || page < PAGE_BYTES_MIN || page > PAGE_BYTES_MAX ||
        (page & (page - 1)) != 0)
        return false;
    log->is_big_endian = (magic & 1) != 0;
    log->frame_bytes = FRAME_HEAD_BYTES + page;
    memcpy(log->salts, head + 16, sizeof log->salts);
    add_up(log, head, 24);
    return sums_are(log, head + 24);
}

static bool is_whole(struct log *log, const uint8_t *frame)
{
    if (memcmp(frame + 8, log->salts, sizeof log->salts) != 0)
        return false;
    add_up(log, frame, 8);
    add_up(log, frame + FRAME_HEAD_BYTES, log->frame_bytes - FRAME_HEAD_BYTES);
    return sums_are(log, frame + 16);
}

/* Whether the frames from the first that is not whole (at) show that a transaction was committed
 * behind it. Without that it may be one that a process died in: SQLite writes a page anew in the
 * place that it has in the log, and corrects the sums that follow only when it commits. A frame
 * that commits tells the pages of the whole file. */
static enum skd_status look_behind(const struct log *log, uint64_t at, uint8_t *frame,
                                   bool *is_torn, struct skd_error *error)
{
    static const uint8_t zeros[FRAME_HEAD_BYTES];
    const uint64_t first = at;
    for (; at + log->frame_bytes <= log->bytes && !*is_torn; at += log->frame_bytes) {
        enum skd_status status = read_all(log->fd, frame, FRAME_HEAD_BYTES, at, log->path, error);
        if (status != SKD_OK)
            return status;
        bool commits =
            big_endian(frame + 4) != 0 && memcmp(frame + 8, log->salts, sizeof log->salts) == 0;
        *is_torn = (commits && at > first) || memcmp(frame, zeros, sizeof zeros) == 0;
    }
    return SKD_OK;
}

static enum skd_status walk(struct log *log, uint8_t *frame, bool *is_torn, struct skd_error *error)
{
    uint64_t at = LOG_HEAD_BYTES;
    for (; at + log->frame_bytes <= log->bytes; at += log->frame_bytes) {
        enum skd_status status = read_all(log->fd, frame, log->frame_bytes, at, log->path, error);
        if (status != SKD_OK)
            return status;
        if (!is_whole(log, frame))
            return look_behind(log, at, frame, is_torn, error);
    }
    return SKD_OK;
}

enum skd_status skd_inspect_log(const char *path, bool *is_torn, struct skd_error *error)
{
    char name[SKD_PATH_BYTES_MAX];
    uint8_t head[LOG_HEAD_BYTES];
    struct log log = {.path = name};
    *is_torn = false;
    if (!skd_inspect_beside(path, "-wal", name))
        return skd_fail(error, SKD_TOO_LARGE, "the path \"%.100s...\" is too long", path);
    enum skd_status status = open_plain(name, true, &log.fd, &log.bytes, error);
    if (status != SKD_OK || log.fd < 0)
        return status;
    uint8_t *frame = malloc(FRAME_HEAD_BYTES + PAGE_BYTES_MAX);
    if (frame == NULL)
        status = skd_fail_memory(error, "a session's log");
    else if (log.bytes > LOG_HEAD_BYTES) {
        status = read_all(log.fd, head, sizeof head, 0, name, error);
        if (status == SKD_OK && read_head(&log, head))
            status = walk(&log, frame, is_torn, error);
        else
            *is_torn = true;
    }
    free(frame);
    close(log.fd);
    return status;
}
