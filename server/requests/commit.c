/* See commit.h. */
#include "requests/commit.h"

#include "base/log.h"
#include "requests/changes.h"
#include "requests/keeping.h"
#include "requests/live.h"
#include "requests/repeats.h"
#include "requests/rewriting.h"
#include "requests/updates.h"

#include <string.h>

/* The step goes into the history, or from one side of its boundary to the other. Returns how many
 * of the oldest steps had to go. */
static size_t record_in_history(struct skd_call *call, const struct skd_commit *commit)
{
    struct skd_history *history = &call->live->session->history;
    if (commit->kind != SKD_COMMIT_STEP) {
        skd_history_move(history, commit->kind == SKD_COMMIT_UNDO ? -1 : 1, commit->index,
                         call->live->session->revision + 1);
        return 0;
    }
    struct skd_step *step = commit->step;
    step->cause = commit->cause;
    step->revision = call->live->session->revision + 1;
    step->author = call->author;
    return skd_history_push(history, step);
}

/* The record (NULL: no memory) with what the call is answered, should it come a second time. */
static struct skd_record *with_answer(const struct skd_call *call, struct skd_record *record)
{
    if (record == NULL || call->answer == NULL ||
        skd_record_remember(record, call->author.id, call->request.sequence, call->answer))
        return record;
    skd_record_destroy(record);
    return NULL;
}

static struct skd_record *make_record(const struct skd_call *call, const struct skd_commit *commit,
                                      size_t dropped)
{
    uint64_t revision = call->live->session->revision;
    struct skd_record *record =
        commit->kind == SKD_COMMIT_STEP
            ? skd_record_create_step(commit->step, revision, dropped)
            : skd_record_create_move(commit->kind == SKD_COMMIT_UNDO ? -1 : 1, commit->index,
                                     revision);
    return with_answer(call, record);
}

/* True: done(call) is called when the record is as durable as the session wants it. False: it is
 * already, or the session is suspended. A record that there is no memory for suspends it, so that
 * nothing is ever missing in the middle of a journal. */
static bool append(struct skd_call *call, struct skd_record *record, void (*done)(void *call))
{
    struct skd_live *live = call->live;
    if (live->journal != NULL && record != NULL)
        return skd_journal_append(live->journal, record, done, call);
    if (live->journal != NULL) {
        skd_journal_close(live->journal, NULL, NULL, NULL);
        live->journal = NULL;
        skd_keeping_suspend(call->daemon, live, "there is no memory for what is to be written");
    }
    skd_record_destroy(record);
    return false;
}

static void durable(void *user)
{
    struct skd_call *call = user;
    struct skd_daemon *daemon = call->daemon;
    struct skd_live *live = call->live;
    if (live->durable_revision < call->revision)
        live->durable_revision = call->revision;
    if (!live->closed)
        skd_updates_flush(daemon, live);
    skd_call_finish(call);
    skd_call_end_awaiting(live);
    skd_live_release(live);
}

static void note_change(struct skd_call *call, const struct skd_commit *commit)
{
    const struct skd_change change = {
        .revision = call->revision,
        .cause = commit->kind == SKD_COMMIT_UNDO   ? "undo"
                 : commit->kind == SKD_COMMIT_REDO ? "redo"
                                                   : skd_cause_word(commit->cause),
        .step = commit->step,
        .undo = commit->kind == SKD_COMMIT_UNDO,
        .knower = commit->sender_knows ? call->connection_id : 0,
        .author = call->author,
    };
    skd_changes_add(call->live, &change);
}

void skd_commit(struct skd_call *call, const struct skd_commit *commit)
{
    struct skd_daemon *daemon = call->daemon;
    struct skd_live *live = call->live;
    size_t dropped = record_in_history(call, commit);
    skd_session_advance(live->session);
    call->revision = live->session->revision;
    note_change(call, commit);
    struct skd_record *record = make_record(call, commit, dropped);
    skd_repeats_remember(call);
    /* One hold for the call, let go of when it is durable, one for this function. */
    skd_live_hold(live);
    skd_live_hold(live);
    bool waits = append(call, record, durable);
    skd_call_pass_turn(call);
    if (!waits)
        durable(call);
    if (!live->closed && skd_rewriting_is_due(live))
        skd_rewriting_start(daemon, live);
    skd_live_release(live);
}

void skd_commit_unchanged(struct skd_call *call)
{
    if (call->answer == NULL) {
        skd_call_finish(call);
        return;
    }
    call->revision = call->live->session->revision;
    struct skd_record *record = with_answer(call, skd_record_create_answer());
    skd_repeats_remember(call);
    skd_commit_record(call, record);
}

static void answer_now(void *user)
{
    struct skd_call *call = user;
    struct skd_live *live = call->live;
    skd_call_finish(call);
    skd_live_release(live);
}

void skd_commit_record(struct skd_call *call, struct skd_record *record)
{
    skd_live_hold(call->live);
    bool waits = append(call, record, answer_now);
    skd_call_pass_turn(call);
    if (!waits)
        answer_now(call);
}
