/* See keeping.h. */
#include "requests/keeping.h"

#include "base/log.h"
#include "journal/journal.h"
#include "journal/whole.h"
#include "requests/broadcast.h"
#include "requests/live.h"
#include "requests/named_poses.h"
#include "requests/state_folder.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* How long a suspended session waits for the first try to write it anew. */
enum { RETRY_MS = 1000 };

/* A file could not be written: its session goes on in memory until it can be written anew. */
static void on_suspended(void *user, void *owner, const char *reason)
{
    struct skd_daemon *daemon = user;
    struct skd_live *live = owner;
    skd_journal_close(live->journal, NULL, NULL, NULL);
    live->journal = NULL;
    skd_keeping_suspend(daemon, live, reason);
}

void skd_keeping_suspend(struct skd_daemon *daemon, struct skd_live *live, const char *reason)
{
    struct skd_keeping *keeping = &daemon->keeping;
    skd_log(SKD_LOG_ERROR, "session \"%s\": journal suspended: %s", live->name, reason);
    live->suspended = true;
    /* What is told from here on may never be on the disk: it is another line of revisions than the
     * one that the next start would find there. */
    live->renews = true;
    if (!uv_is_active((uv_handle_t *)&keeping->retry)) {
        uv_timer_set_repeat(&keeping->retry, RETRY_MS);
        uv_timer_again(&keeping->retry);
    }
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", live->name);
    cJSON_AddStringToObject(body, "reason", reason);
    skd_broadcast(daemon, "journal.suspended", body);
}

void skd_keeping_resume(struct skd_daemon *daemon, struct skd_live *live)
{
    live->suspended = false;
    skd_log(SKD_LOG_INFO, "session \"%s\": journal resumed", live->name);
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", live->name);
    skd_broadcast(daemon, "journal.resumed", body);
}

const char *skd_keeping_word(const struct skd_live *live)
{
    if (live->session->durability == SKD_DURABILITY_OFF)
        return "off";
    return live->suspended ? "suspended" : "ok";
}

static void append_poses(struct skd_live *live)
{
    struct skd_pose *pose, *next;
    HASH_ITER(hh, live->session->poses.by_name, pose, next)
    {
        struct skd_record *record = skd_record_create_pose(pose);
        if (record == NULL) {
            live->poses_changed = true; /* the next reopening tells them */
            return;
        }
        skd_journal_append(live->journal, record, NULL, NULL);
    }
}

static enum skd_status open_file(struct skd_daemon *daemon, struct skd_live *live,
                                 struct skd_journal_file **file, struct skd_error *error)
{
    char path[SKD_STATE_PATH_BYTES];
    enum skd_status status =
        skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN, live->file, path, error);
    if (status != SKD_OK)
        return status;
    return skd_journal_open(daemon->keeping.journal, path, live->session->durability,
                            live->session->instance, live, file, error);
}

bool skd_keeping_reopen(struct skd_daemon *daemon, struct skd_live *live)
{
    struct skd_error error;
    bool poses_changed = live->poses_changed;
    if (open_file(daemon, live, &live->journal, &error) != SKD_OK) {
        live->journal = NULL;
        skd_keeping_suspend(daemon, live, error.text);
        return false;
    }
    live->poses_changed = false;
    if (poses_changed)
        append_poses(live);
    return true;
}

enum skd_status skd_keeping_write_first(const struct skd_daemon *daemon,
                                        struct skd_session *session,
                                        char file[SKD_STATE_FILE_BYTES], struct skd_error *error)
{
    char path[SKD_STATE_PATH_BYTES];
    struct skd_named_poses poses;
    file[0] = '\0';
    if (session->durability == SKD_DURABILITY_OFF)
        return SKD_OK;
    skd_state_new_file(session->name, file);
    enum skd_status status =
        skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN, file, path, error);
    if (status != SKD_OK)
        return status;
    status = skd_named_poses_all(session, &poses, error);
    if (status == SKD_OK)
        status = skd_journal_write(path, session, NULL, poses.items, poses.count, error);
    skd_named_poses_finish(&poses);
    return status;
}

void skd_keeping_begin(struct skd_daemon *daemon, struct skd_live *live,
                       const char file[SKD_STATE_FILE_BYTES], const struct skd_error *failure)
{
    if (live->session->durability == SKD_DURABILITY_OFF)
        return;
    memcpy(live->file, file, sizeof live->file);
    if (failure != NULL)
        skd_keeping_suspend(daemon, live, failure->text);
    else if (skd_keeping_reopen(daemon, live))
        live->file_bytes = skd_journal_bytes(live->journal);
}

static void remove_file(const struct skd_daemon *daemon, const struct skd_live *live)
{
    char path[SKD_STATE_PATH_BYTES];
    if (live->file[0] != '\0' &&
        skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN, live->file, path, NULL) == SKD_OK)
        skd_state_remove(path);
}

void skd_keeping_forget(struct skd_daemon *daemon, struct skd_live *live, void (*done)(void *user),
                        void *user)
{
    struct skd_journal_file *journal = live->journal;
    live->journal = NULL;
    live->suspended = false;
    if (journal == NULL)
        remove_file(daemon, live);
    live->file[0] = '\0';
    if (journal != NULL)
        skd_journal_close(journal, "", done, user);
    else
        done(user);
}

/* Whether a file that was to be put away could not be. */
static bool is_left_behind(const struct skd_daemon *daemon, const struct skd_live *live)
{
    char path[SKD_STATE_PATH_BYTES];
    return live->end != SKD_KEEPING_STAYS && live->file[0] != '\0' &&
           skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN, live->file, path, NULL) ==
               SKD_OK &&
           access(path, F_OK) == 0;
}

static void answer_closer(const struct skd_daemon *daemon, struct skd_live *live)
{
    struct skd_call *call = live->closer;
    struct skd_error error;
    live->closer = NULL;
    if (!is_left_behind(daemon, live)) {
        skd_call_answer_prepared(call);
        return;
    }
    (void)skd_fail(&error, SKD_FILE_IO,
                   "session \"%s\" is closed, but its file cannot be put away (the log says why): "
                   "it is open again when skind starts anew",
                   live->name);
    skd_encoded_finish(&call->encoded);
    skd_call_fail(call, &error);
}

/* The file is where it is to be, as far as that goes. */
static void ended(void *user)
{
    struct skd_live *live = user;
    struct skd_daemon *daemon = live->daemon;
    if (live->end == SKD_KEEPING_CLOSED && live->file[0] != '\0')
        skd_state_closed(daemon->keeping.folder, live->file);
    if (live->closer != NULL)
        answer_closer(daemon, live);
    skd_live_release(live);
}

/* The daemon stops, and the session could not be written so far: one more try, which nobody has to
 * wait for any more. What its old file holds stays where that fails. */
static void write_last(const struct skd_daemon *daemon, const struct skd_live *live)
{
    char file[SKD_STATE_FILE_BYTES], old[SKD_STATE_PATH_BYTES];
    struct skd_error error;
    if (skd_keeping_write_first(daemon, live->session, file, &error) != SKD_OK)
        skd_log(SKD_LOG_ERROR,
                "session \"%s\": what was done since its journal was suspended is "
                "lost: %s",
                live->name, error.text);
    else if (live->file[0] != '\0' && skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN,
                                                     live->file, old, &error) == SKD_OK)
        skd_state_remove(old);
}

void skd_keeping_end(struct skd_daemon *daemon, struct skd_live *live, enum skd_keeping_end end)
{
    const char *folder = daemon->keeping.folder;
    char target[SKD_STATE_PATH_BYTES] = "";
    struct skd_error error;
    struct skd_journal_file *journal = live->journal;
    live->end = end;
    if (live->away)
        return;
    live->journal = NULL;
    skd_live_hold(live);
    bool keeps =
        end == SKD_KEEPING_CLOSED && live->session != NULL && live->session->history.count > 0;
    if (keeps && skd_state_path(folder, SKD_STATE_CLOSED, live->file, target, &error) != SKD_OK)
        keeps = false;
    /* Closed while its file was away, and could not be taken up again: it is moved all the same. */
    if (journal == NULL && keeps && live->file[0] != '\0' &&
        open_file(daemon, live, &journal, &error) != SKD_OK)
        skd_log(SKD_LOG_ERROR, "session \"%s\" is closed, but will be open at the next start: %s",
                live->name, error.text);
    if (journal != NULL) {
        skd_journal_close(journal, end == SKD_KEEPING_STAYS ? NULL : target, ended, live);
        return;
    }
    if (end != SKD_KEEPING_STAYS && !keeps)
        remove_file(daemon, live);
    if (end == SKD_KEEPING_STAYS && live->suspended)
        write_last(daemon, live);
    ended(live);
}

enum skd_status skd_keeping_start(struct skd_daemon *daemon, const char *folder,
                                  struct skd_error *error)
{
    struct skd_keeping *keeping = &daemon->keeping;
    const struct skd_journal_events events = {.user = daemon, .suspended = on_suspended};
    (void)snprintf(keeping->folder, sizeof keeping->folder, "%s", folder);
    enum skd_status status = skd_state_folder_take(folder, &keeping->lock, error);
    if (status != SKD_OK)
        return status;
    skd_journal_sweep(folder);
    status = skd_journal_start(&keeping->journal, daemon->loop, &events, error);
    if (status != SKD_OK) {
        close(keeping->lock);
        return status;
    }
    uv_timer_init(daemon->loop, &keeping->retry);
    keeping->retry.data = daemon;
    return SKD_OK;
}

void skd_keeping_stop(struct skd_daemon *daemon)
{
    struct skd_keeping *keeping = &daemon->keeping;
    uv_close((uv_handle_t *)&keeping->retry, NULL);
    skd_journal_stop(keeping->journal);
    cJSON_Delete(keeping->unopened);
    close(keeping->lock);
}
