/* history.undo and history.redo: a step's other side is written back, to the bit.
 *
 * Stage: job -> commit -> reply. Thread: the loop finds the step, a worker writes it (and spells it
 * out for listeners that speak lines), the loop commits.
 */
#include "requests/handlers.h"

#include "requests/updates.h"

#include <stdlib.h>

struct turning {
    struct skd_step *step; /* held */
    bool undo;
    bool want_line;
    struct skd_encoded line;
};

static struct skd_update update_of(const struct skd_call *call, uint64_t revision)
{
    const struct turning *turning = call->state;
    return (struct skd_update){
        .session = call->live->name,
        .revision = revision,
        .cause = turning->undo ? "undo" : "redo",
        .client = call->client,
        .step = turning->step,
        .undo = turning->undo,
    };
}

static enum skd_status answer(struct skd_call *call, struct skd_error *error)
{
    struct turning *turning = call->state;
    const struct skd_session *session = call->live->session;
    const struct skd_history *history = &session->history;
    size_t done = turning->undo ? history->position - 1 : history->position + 1;
    if (turning->want_line) {
        struct skd_update update = update_of(call, session->revision + 1);
        enum skd_status status = skd_update_encode(SKD_WIRE_LINES, &update, &turning->line, error);
        if (status != SKD_OK)
            return status;
    }
    cJSON *body = call->reply.body = cJSON_CreateObject();
    cJSON_AddNumberToObject(body, "revision", (double)(session->revision + 1));
    cJSON_AddNumberToObject(body, "vertices", (double)turning->step->count);
    cJSON_AddNumberToObject(body, "undo_steps", (double)done);
    cJSON_AddNumberToObject(body, "redo_steps", (double)(history->count - done));
    return SKD_OK;
}

static void write_back(struct skd_call *call)
{
    const struct turning *turning = call->state;
    skd_session_write(call->live->session, turning->step, turning->undo);
}

static void written_back(struct skd_call *call)
{
    struct turning *turning = call->state;
    struct skd_session *session = call->live->session;
    if (call->status == SKD_OK) {
        skd_session_advance(session);
        skd_history_move(&session->history, turning->undo ? -1 : 1);
        struct skd_update update = update_of(call, session->revision);
        skd_updates_send(call->daemon, call->live, &update, 0, &turning->line);
    }
    skd_call_finish(call);
}

static void dismiss(struct skd_call *call)
{
    struct turning *turning = call->state;
    skd_encoded_finish(&turning->line);
    skd_step_release(turning->step);
    free(turning);
}

static void begin(struct skd_call *call)
{
    struct turning *turning = call->state;
    const struct skd_history *history = &call->live->session->history;
    struct skd_step *step =
        turning->undo ? skd_history_undoable(history) : skd_history_redoable(history);
    if (step == NULL) {
        struct skd_error error;
        if (turning->undo)
            (void)skd_fail(&error, SKD_NOTHING_TO_UNDO, "session \"%s\" has nothing to undo",
                           call->live->name);
        else
            (void)skd_fail(&error, SKD_NOTHING_TO_REDO, "session \"%s\" has nothing to redo",
                           call->live->name);
        skd_call_fail(call, &error);
        return;
    }
    turning->step = skd_step_hold(step);
    turning->want_line = skd_updates_want_line(call->daemon, call->live, 0);
    call->apply = write_back;
    skd_call_work(call, answer, written_back);
}

static void turn(struct skd_call *call, bool undo)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live == NULL)
        return;
    struct turning *turning = calloc(1, sizeof *turning);
    if (turning == NULL) {
        struct skd_error error;
        (void)skd_fail_memory(&error, "a request");
        skd_call_fail(call, &error);
        return;
    }
    turning->undo = undo;
    call->state = turning;
    call->dismiss = dismiss;
    skd_call_take_turn(call, live, begin);
}

void skd_handle_history_undo(struct skd_call *call)
{
    turn(call, true);
}

void skd_handle_history_redo(struct skd_call *call)
{
    turn(call, false);
}
