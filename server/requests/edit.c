/* See edit.h. */
#include "requests/edit.h"

#include "requests/commit.h"
#include "requests/memory.h"
#include "requests/repeats.h"
#include "session/pin_edit.h"

#include <stdlib.h>

static void describe(const struct skd_call *call, uint64_t revision)
{
    const struct skd_edit *edit = call->state;
    const struct skd_history *history = &call->live->session->history;
    size_t done = history->position, undone = history->count - history->position;
    if (!skd_step_is_empty(edit->step)) {
        done = skd_history_steps_with(history, edit->step);
        undone = 0;
    }
    cJSON *body = call->reply.body;
    cJSON_AddStringToObject(body, "session", call->live->name);
    cJSON_AddNumberToObject(body, "revision", (double)revision);
    cJSON_AddNumberToObject(body, "vertices", (double)edit->vertices);
    cJSON_AddNumberToObject(body, "undo_steps", (double)done);
    cJSON_AddNumberToObject(body, "redo_steps", (double)undone);
}

static enum skd_status make(struct skd_call *call, struct skd_error *error)
{
    struct skd_edit *edit = call->state;
    call->reply.body = cJSON_CreateObject();
    enum skd_status status = edit->kind->make(call, edit, error);
    if (status == SKD_CANCELLED)
        skd_call_cancelled(call, error);
    if (status == SKD_OK && edit->kind->forgets_pins)
        status = skd_pins_forget(call->live->session, edit->step, error);
    if (status != SKD_OK)
        return status == SKD_CANCELLED ? error->status : status;
    bool changes = !skd_step_is_empty(edit->step);
    uint64_t revision = call->live->session->revision + changes;
    describe(call, revision);
    return SKD_OK;
}

static void write_step(struct skd_call *call)
{
    const struct skd_edit *edit = call->state;
    skd_session_write(call->live->session, edit->step, false);
}

static void committed(struct skd_call *call)
{
    const struct skd_edit *edit = call->state;
    if (call->status != SKD_OK) {
        skd_call_finish(call);
        return;
    }
    if (skd_step_is_empty(edit->step)) {
        skd_commit_unchanged(call);
        return;
    }
    const struct skd_commit commit = {
        .kind = SKD_COMMIT_STEP,
        .step = edit->step,
        .cause = edit->kind->cause,
        .sender_knows = edit->kind->sender_knows,
    };
    skd_commit(call, &commit);
}

static void dismiss(struct skd_call *call)
{
    struct skd_edit *edit = call->state;
    skd_step_release(edit->step);
    skd_named_poses_finish(&edit->poses);
    free(edit);
}

static void begin(struct skd_call *call)
{
    struct skd_edit *edit = call->state;
    struct skd_session *session = call->live->session;
    struct skd_error error;
    if (skd_repeat_answered(call))
        return;
    if (skd_memory_check_step(call->daemon, session, edit->most, &error) != SKD_OK ||
        skd_history_reserve(&session->history, &error) != SKD_OK ||
        (edit->kind->claim != NULL && edit->kind->claim(session, edit, &error) != SKD_OK)) {
        skd_call_fail(call, &error);
        return;
    }
    call->apply = write_step;
    skd_call_work(call, make, committed);
}

void skd_edit_start(struct skd_call *call, const char *session, const struct skd_edit_kind *kind)
{
    struct skd_live *live = skd_call_find_session(call, session);
    if (live == NULL)
        return;
    struct skd_error error;
    struct skd_edit *edit = calloc(1, sizeof *edit);
    enum skd_status status = edit != NULL ? SKD_OK : skd_fail_memory(&error, "a request");
    if (status == SKD_OK) {
        edit->kind = kind;
        call->state = edit;
        call->dismiss = dismiss;
        if (kind->look_up != NULL)
            status = kind->look_up(call, live->session, edit, &error);
    }
    if (status == SKD_OK)
        skd_call_take_turn(call, live, begin);
    else
        skd_call_fail(call, &error);
}
