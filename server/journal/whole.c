/* See whole.h. */
#include "journal/whole.h"

#include "base/temporary.h"
#include "journal/base_rows.h"
#include "journal/guard_rows.h"
#include "journal/inspect.h"
#include "journal/remembered_rows.h"
#include "journal/source_rows.h"
#include "journal/step_rows.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* ---- rows -------------------------------------------------------------------------------------
 */

struct whole {
    struct skd_store store;
    struct skd_pose_rows poses;
    struct skd_session_row row;
};

/* The base, with the session undone to it meanwhile. */
static enum skd_status write_base(struct whole *whole, struct skd_session *session,
                                  struct skd_error *error)
{
    struct skd_history *history = &session->history;
    for (size_t i = history->position; i > 0; i--)
        skd_session_write(session, history->steps[i - 1], true);
    enum skd_status status =
        skd_base_write(&whole->store, &whole->poses, session, &whole->row, error);
    for (size_t i = 0; i < history->position; i++)
        skd_session_write(session, history->steps[i], false);
    return status;
}

/* The poses of a step's sheets, as skd_step_row_write wants them; the caller's to free. */
static struct skd_pose **poses_of(const struct skd_step *step)
{
    size_t count = 0;
    for (const struct skd_sheet_change *pins = step->pins; pins != NULL; pins = pins->next)
        count++;
    struct skd_pose **poses = malloc((count + 1) * sizeof(struct skd_pose *));
    if (poses == NULL)
        return NULL;
    count = 0;
    for (const struct skd_sheet_change *pins = step->pins; pins != NULL; pins = pins->next)
        poses[count++] = pins->sheet->pose;
    poses[count] = step->shape != NULL ? step->shape->sheet->pose : NULL;
    return poses;
}

static enum skd_status write_step(struct whole *whole, const struct skd_step *step, uint64_t place,
                                  uint64_t *chain, struct skd_error *error)
{
    struct skd_history_row item = {.step = place + 1, .revision = step->revision};
    struct skd_pose **poses = poses_of(step);
    if (poses == NULL)
        return skd_fail_memory(error, "the poses of a step");
    enum skd_status status =
        skd_step_row_write(&whole->store, &whole->poses, item.step, step, poses, &item.sum, error);
    free(poses);
    if (status != SKD_OK)
        return status;
    *chain = item.chain = skd_history_chain(*chain, place, &item);
    return skd_history_row_write(&whole->store, place, &item, error);
}

static enum skd_status write_history(struct whole *whole, const struct skd_session *session,
                                     const char *instance, struct skd_error *error)
{
    const struct skd_history *history = &session->history;
    struct skd_state_row state = {
        .revision = session->revision,
        .position = history->position,
        .count = history->count,
        .exported = session->exported,
        .durability = session->durability,
        .history_bytes = history->bytes_max,
        .chain = whole->row.sum,
    };
    enum skd_status status = SKD_OK;
    memcpy(state.instance, instance, sizeof state.instance);
    for (size_t i = 0; i < history->count && status == SKD_OK; i++)
        status = write_step(whole, history->steps[i], i, &state.chain, error);
    return status == SKD_OK ? skd_state_row_write(&whole->store, whole->row.sum, &state, error)
                            : status;
}

static enum skd_status write_guard(struct whole *whole, const struct skd_session *session,
                                   struct skd_error *error)
{
    struct skd_guard_row guard;
    enum skd_status status = skd_guard_row_pack(&session->guards, &guard, error);
    if (status == SKD_OK)
        status = skd_guard_row_write(&whole->store, &guard, error);
    skd_guard_row_finish(&guard);
    return status;
}

static enum skd_status write_all(struct whole *whole, struct skd_session *session,
                                 const struct skd_journal_identity *identity,
                                 struct skd_pose *const *poses, size_t pose_count,
                                 struct skd_error *error)
{
    struct skd_store *store = &whole->store;
    enum skd_status status = write_base(whole, session, error);
    if (status == SKD_OK)
        status = write_history(whole, session,
                               identity != NULL ? identity->instance : session->instance, error);
    for (size_t i = 0; i < pose_count && status == SKD_OK; i++)
        status = skd_pose_rows_put(store, &whole->poses, poses[i], error);
    if (status == SKD_OK)
        status = write_guard(whole, session, error);
    if (status == SKD_OK)
        status = skd_source_rows_write(store, session->rig, error);
    /* What clients sent to this session they did not send to another. */
    if (status == SKD_OK && identity == NULL)
        status = skd_remembered_rows_write(store, session, error);
    /* A log from now on: appending to the file never needs a roll-back journal. */
    return status == SKD_OK ? skd_store_command(store, "COMMIT; PRAGMA journal_mode=WAL", error)
                            : status;
}

/* ---- files ------------------------------------------------------------------------------------
 */

static int open_folder(const char *path)
{
    return open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
}

/* An empty file of ours in the target's folder; *temporary is the caller's to free. */
static enum skd_status make_temporary(const char *path, char **temporary, struct skd_error *error)
{
    char folder[SKD_PATH_BYTES_MAX];
    (void)snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(path, '/') - path) + 1, path);
    int fd = open_folder(folder);
    if (fd >= 0) {
        skd_temporary_sweep(fd, SKD_TEMPORARY_IDLE_S);
        close(fd);
    }
    *temporary = skd_temporary_name(path);
    if (*temporary == NULL)
        return skd_fail_memory(error, "a path");
    if (strlen(*temporary) >= SKD_PATH_BYTES_MAX - 16)
        return skd_fail(error, SKD_TOO_LARGE, "the path \"%.100s...\" is too long", path);
    fd = open(*temporary, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd < 0)
        return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be written: %s", path, strerror(errno));
    int result = fchmod(fd, 0600); /* whatever the umask */
    close(fd);
    return result == 0 ? SKD_OK
                       : skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be written: %s", path,
                                  strerror(errno));
}

static enum skd_status sync_file(const char *path, int flags, struct skd_error *error)
{
    int fd = open(path, flags | O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    int result = fd >= 0 ? fsync(fd) : -1;
    const int number = errno;
    if (fd >= 0)
        close(fd);
    return result == 0 ? SKD_OK
                       : skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be brought to the disk: %s",
                                  path, strerror(number));
}

static enum skd_status sync_folder(const char *path, struct skd_error *error)
{
    char folder[SKD_PATH_BYTES_MAX];
    (void)snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(path, '/') - path) + 1, path);
    return sync_file(folder, O_DIRECTORY, error);
}

static void remove_beside(const char *path)
{
    static const char *const suffixes[] = {"-wal", "-shm", "-journal"};
    char name[SKD_PATH_BYTES_MAX];
    for (size_t i = 0; i < sizeof suffixes / sizeof *suffixes; i++) {
        if (skd_inspect_beside(path, suffixes[i], name))
            (void)unlink(name);
    }
}

/* The target may have a log of another file beside it, which SQLite would take for the new one's:
 * that goes first. */
static enum skd_status put_in_place(const char *temporary, const char *path,
                                    struct skd_error *error)
{
    enum skd_status status = sync_file(temporary, 0, error);
    if (status != SKD_OK)
        return status;
    remove_beside(path);
    if (rename(temporary, path) != 0)
        return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be written: %s", path, strerror(errno));
    return sync_folder(path, error);
}

enum skd_status skd_journal_write(const char *path, struct skd_session *session,
                                  const struct skd_journal_identity *identity,
                                  struct skd_pose *const *poses, size_t pose_count,
                                  struct skd_error *error)
{
    char target[SKD_PATH_BYTES_MAX], *temporary = NULL;
    struct whole *whole = calloc(1, sizeof *whole);
    if (whole == NULL)
        return skd_fail_memory(error, "a session's file");
    memcpy(whole->row.name, identity != NULL ? identity->name : session->name,
           sizeof whole->row.name);
    enum skd_status status = skd_inspect_resolve(path, target, error);
    if (status == SKD_OK)
        status = make_temporary(target, &temporary, error);
    if (status != SKD_OK)
        goto done;
    status = skd_store_open(&whole->store, temporary, SKD_STORE_NEW, NULL, error);
    if (status == SKD_OK)
        status = write_all(whole, session, identity, poses, pose_count, error);
    if (status == SKD_FILE_IO) /* in the words of who wants it, who knows of no temporary file */
        (void)skd_fail(error, status, "\"%s\" cannot be written: %s", path,
                       sqlite3_errmsg(whole->store.db));
    skd_store_drop_log(&whole->store);
    skd_store_close(&whole->store);
    if (status == SKD_OK)
        status = put_in_place(temporary, target, error);
    if (status != SKD_OK) {
        remove_beside(temporary);
        (void)unlink(temporary);
    }
done:
    free(temporary);
    skd_pose_rows_finish(&whole->poses);
    free(whole);
    return status;
}

void skd_journal_sweep(const char *folder)
{
    int fd = open_folder(folder);
    if (fd < 0)
        return;
    skd_temporary_sweep(fd, 0);
    close(fd);
}
