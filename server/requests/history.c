/* history.undo and history.redo: a step's other side is written back, to the bit.
 *
 * Stage: job -> commit -> reply. Thread: a worker finds the step and writes it, the loop commits.
 */
#include "requests/handlers.h"

#include "requests/commit.h"
#include "requests/repeats.h"
#include "session/own_steps.h"

#include <stdlib.h>

struct turning {
    struct skd_step *step; /* the history's */
    size_t index;
    bool undo;
};

static enum skd_status answer(struct skd_call *call, struct skd_error *error)
{
    struct turning *turning = call->state;
    const struct skd_session *session = call->live->session;
    const struct skd_history *history = &session->history;
    const char *own = call->request.params.session.own ? call->author.id : NULL;
    enum skd_status status =
        skd_own_step_find(session, turning->undo ? -1 : 1, own, &turning->index, error);
    if (status != SKD_OK)
        return status;
    turning->step = history->steps[turning->index];
    size_t done = turning->undo ? history->position - 1 : history->position + 1;
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
    const struct turning *turning = call->state;
    if (call->status != SKD_OK) {
        skd_call_finish(call);
        return;
    }
    const struct skd_commit commit = {
        .kind = turning->undo ? SKD_COMMIT_UNDO : SKD_COMMIT_REDO,
        .step = turning->step,
        .index = turning->index,
    };
    skd_commit(call, &commit);
}

static void dismiss(struct skd_call *call)
{
    free(call->state);
}

static void begin(struct skd_call *call)
{
    if (skd_repeat_answered(call))
        return;
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
