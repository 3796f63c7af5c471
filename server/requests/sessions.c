/* Open sessions by name: list, info, attach, detach, close.
 *
 * Stage: request -> reply. Thread: the loop. All are answered at once: they read what never changes
 * (the rig) or what the loop owns (revision, poses, listeners), never the weights.
 */
#include "requests/handlers.h"

#include "requests/close.h"
#include "requests/describe.h"
#include "requests/live.h"

void skd_handle_session_list(struct skd_call *call)
{
    const struct skd_live *live, *next;
    cJSON *result = cJSON_CreateObject();
    cJSON *list = cJSON_AddArrayToObject(result, "sessions");
    HASH_ITER(hh, call->daemon->sessions, live, next)
    {
        if (live->session != NULL)
            cJSON_AddItemToArray(list, skd_describe_briefly(live));
    }
    skd_call_answer(call, result);
}

void skd_handle_session_info(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live != NULL)
        skd_call_answer(call, skd_describe_wholly(live));
}

void skd_handle_session_attach(struct skd_call *call)
{
    const struct skd_session_params *params = &call->request.params.session;
    struct skd_live *live = skd_call_find_session(call, params->session);
    struct skd_error error;
    if (live == NULL)
        return;
    if (skd_live_attach(live, call->connection_id, &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    cJSON *result = cJSON_CreateObject();
    cJSON_AddStringToObject(result, "session", live->name);
    cJSON_AddNumberToObject(result, "revision", (double)live->session->revision);
    cJSON_AddBoolToObject(result, "resync",
                          !params->has_revision || params->revision != live->session->revision);
    skd_call_answer(call, result);
}

void skd_handle_session_detach(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live == NULL)
        return;
    skd_live_detach(live, call->connection_id);
    skd_call_answer(call, cJSON_CreateObject());
}

void skd_handle_session_close(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live == NULL)
        return;
    skd_session_close(call->daemon, live, "a client closed it");
    skd_call_answer(call, cJSON_CreateObject());
}
