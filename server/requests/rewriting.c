/* See rewriting.h. */
#include "requests/rewriting.h"

#include "base/log.h"
#include "journal/whole.h"
#include "requests/keeping.h"

#include <stdlib.h>
#include <string.h>

/* How long a suspended session waits at most from one try to the next; twice as long each time. */
enum { RETRY_MS_MOST = 30000 };

/* A file may grow by this much before it is looked at. */
static const uint64_t SLACK_BYTES = (uint64_t)64 << 20;

bool skd_rewriting_is_due(const struct skd_live *live)
{
    /* Beyond the base and the steps that can be undone, at most as much again is of no use. */
    return live->journal != NULL && !live->rewriting &&
           skd_journal_bytes(live->journal) >
               2 * live->file_bytes + live->session->history.bytes_max + SLACK_BYTES;
}

static enum skd_status write_whole(struct skd_call *call, struct skd_error *error)
{
    struct skd_rewriting *rewriting = call->state;
    return skd_journal_write(rewriting->path, call->live->session, NULL, rewriting->poses.items,
                             rewriting->poses.count, error);
}

/* The new file takes the old one's place. */
static void replace(struct skd_daemon *daemon, struct skd_live *live,
                    const struct skd_rewriting *rewriting)
{
    char old[SKD_STATE_PATH_BYTES] = "";
    struct skd_error error;
    bool was_suspended = live->suspended;
    if (live->file[0] != '\0' &&
        skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN, live->file, old, &error) != SKD_OK)
        old[0] = '\0';
    memcpy(live->file, rewriting->file, sizeof live->file);
    if (old[0] != '\0')
        skd_state_remove(old);
    if (!skd_keeping_reopen(daemon, live))
        return;
    live->file_bytes = skd_journal_bytes(live->journal);
    if (was_suspended)
        skd_keeping_resume(daemon, live);
}

static void written(struct skd_call *call)
{
    const struct skd_rewriting *rewriting = call->state;
    struct skd_live *live = call->live;
    live->away = false;
    if (call->status == SKD_OK)
        replace(call->daemon, live, rewriting);
    else if (live->suspended)
        skd_log(SKD_LOG_DEBUG, "session \"%s\" is still suspended: %s", live->name,
                call->error.text);
    else
        skd_keeping_suspend(call->daemon, live, call->error.text);
    if (live->closed)
        skd_keeping_end(call->daemon, live, live->end);
    rewriting->then(call);
}

static void old_closed(void *user)
{
    skd_call_work(user, write_whole, written);
}

void skd_rewriting_run(struct skd_call *call, void (*then)(struct skd_call *call))
{
    struct skd_rewriting *rewriting = call->state;
    struct skd_live *live = call->live;
    struct skd_journal_file *journal = live->journal;
    rewriting->then = then;
    skd_state_new_file(live->name, rewriting->file);
    call->status = skd_state_path(call->daemon->keeping.folder, SKD_STATE_OPEN, rewriting->file,
                                  rewriting->path, &call->error);
    if (call->status == SKD_OK)
        call->status = skd_named_poses_all(live->session, &rewriting->poses, &call->error);
    if (call->status != SKD_OK) {
        written(call);
        return;
    }
    live->poses_changed = false;
    live->journal = NULL;
    live->away = true;
    if (journal != NULL)
        skd_journal_close(journal, NULL, old_closed, call);
    else
        old_closed(call);
}

void skd_rewriting_finish(struct skd_rewriting *rewriting)
{
    skd_named_poses_finish(&rewriting->poses);
}

static void end(struct skd_call *call)
{
    skd_call_answer(call, NULL);
}

static void begin(struct skd_call *call)
{
    skd_rewriting_run(call, end);
}

/* A call that is dropped before its turn lets the next one be made. */
static void dismiss(struct skd_call *call)
{
    call->live->rewriting = false;
    skd_rewriting_finish(call->state);
    free(call->state);
}

void skd_rewriting_start(struct skd_daemon *daemon, struct skd_live *live)
{
    if (live->rewriting)
        return;
    struct skd_rewriting *rewriting = calloc(1, sizeof *rewriting);
    struct skd_call *call = rewriting != NULL ? skd_call_create_own(daemon) : NULL;
    if (call == NULL) {
        free(rewriting);
        return; /* the next commit, or the next try, comes here again */
    }
    live->rewriting = true;
    call->state = rewriting;
    call->dismiss = dismiss;
    skd_call_take_turn(call, live, begin);
}

/* The timer repeats by itself; it rests while no session is suspended. */
static void on_retry(uv_timer_t *timer)
{
    struct skd_daemon *daemon = timer->data;
    struct skd_live *live, *next;
    bool again = false;
    HASH_ITER(hh, daemon->sessions, live, next)
    {
        if (live->suspended) {
            skd_rewriting_start(daemon, live);
            again = true;
        }
    }
    if (!again || daemon->stopping) {
        uv_timer_stop(timer);
        return;
    }
    uint64_t repeat = 2 * uv_timer_get_repeat(timer);
    uv_timer_set_repeat(timer, repeat < RETRY_MS_MOST ? repeat : RETRY_MS_MOST);
    uv_timer_again(timer);
}

void skd_rewriting_watch(struct skd_daemon *daemon)
{
    uv_timer_t *timer = &daemon->keeping.retry;
    uv_timer_start(timer, on_retry, 0, 0); /* so that it can be started again */
    uv_timer_stop(timer);
}
