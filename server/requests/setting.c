/* weights.set: weights that a client knows become the session's, as one step of its history.
 *
 * Stage: job -> commit -> reply. Thread: a worker checks the rows, makes the step and writes it
 * (and spells it out for listeners that speak lines), the loop commits.
 */
#include "requests/handlers.h"

#include "requests/updates.h"
#include "session/setting.h"

#include <stdlib.h>

struct setting {
    struct skd_step *step; /* NULL until the rows were found good */
    bool want_line;
    struct skd_encoded line;
};

static struct skd_update update_of(const struct skd_call *call, uint64_t revision)
{
    const struct setting *setting = call->state;
    return (struct skd_update){
        .session = call->live->name,
        .revision = revision,
        .cause = "set",
        .client = call->client,
        .step = setting->step,
    };
}

static cJSON *describe(const struct skd_call *call, uint64_t revision)
{
    const struct setting *setting = call->state;
    const struct skd_history *history = &call->live->session->history;
    size_t done = history->position, undone = history->count - history->position;
    if (setting->step->count > 0) {
        done = skd_history_steps_with(history, setting->step);
        undone = 0;
    }
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", call->live->name);
    cJSON_AddNumberToObject(body, "revision", (double)revision);
    cJSON_AddNumberToObject(body, "vertices", (double)setting->step->count);
    cJSON_AddNumberToObject(body, "undo_steps", (double)done);
    cJSON_AddNumberToObject(body, "redo_steps", (double)undone);
    return body;
}

static enum skd_status prepare(struct skd_call *call, struct skd_error *error)
{
    const struct skd_weights_set_params *params = &call->request.params.weights_set;
    struct setting *setting = call->state;
    const struct skd_session *session = call->live->session;
    const struct skd_setting wanted = {
        .vertices = params->vertices.data,
        .count = params->vertices.count,
        .weights = params->weights.data,
        .weight_count = params->weights.count,
    };
    enum skd_status status = skd_setting_prepare(session, &wanted, &setting->step, error);
    if (status != SKD_OK)
        return status;
    uint64_t revision = session->revision + (setting->step->count > 0);
    if (setting->want_line) {
        struct skd_update update = update_of(call, revision);
        status = skd_update_encode(SKD_WIRE_LINES, &update, &setting->line, error);
        if (status != SKD_OK)
            return status;
    }
    call->reply.body = describe(call, revision);
    return SKD_OK;
}

static void commit(struct skd_call *call)
{
    const struct setting *setting = call->state;
    skd_session_write(call->live->session, setting->step, false);
}

static void committed(struct skd_call *call)
{
    struct setting *setting = call->state;
    struct skd_session *session = call->live->session;
    if (call->status == SKD_OK && setting->step->count > 0) {
        session->revision++;
        skd_history_push(&session->history, setting->step);
        struct skd_update update = update_of(call, session->revision);
        skd_updates_send(call->daemon, call->live, &update, call->connection_id, &setting->line);
    }
    skd_call_finish(call);
}

static void dismiss(struct skd_call *call)
{
    struct setting *setting = call->state;
    skd_encoded_finish(&setting->line);
    skd_step_release(setting->step);
    free(setting);
}

static void begin(struct skd_call *call)
{
    struct setting *setting = call->state;
    struct skd_error error;
    if (skd_history_reserve(&call->live->session->history, &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    setting->want_line = skd_updates_want_line(call->daemon, call->live, call->connection_id);
    call->apply = commit;
    skd_call_work(call, prepare, committed);
}

void skd_handle_weights_set(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.weights_set.session);
    if (live == NULL)
        return;
    struct setting *setting = calloc(1, sizeof *setting);
    if (setting == NULL) {
        struct skd_error error;
        (void)skd_fail_memory(&error, "a request");
        skd_call_fail(call, &error);
        return;
    }
    call->state = setting;
    call->dismiss = dismiss;
    skd_call_take_turn(call, live, begin);
}
