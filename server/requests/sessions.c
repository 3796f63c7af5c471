/* Open sessions by name: list, info, attach, detach.
 *
 * Stage: request -> reply. Thread: the loop. All are answered at once: they read what never changes
 * (the rig) or what the loop owns (revision, poses, listeners), never the weights.
 */
#include "requests/handlers.h"

#include "requests/describe.h"
#include "requests/listeners.h"
#include "requests/presence.h"
#include "requests/updates.h"

#include <string.h>

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
    skd_describe_folder(&call->daemon->keeping, result);
    skd_call_answer(call, result);
}

void skd_handle_session_info(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live != NULL)
        skd_call_answer(call, skd_describe_wholly(call->daemon, live));
}

/* Whether the revision that a tool holds is one of this session's: without its instance only where
 * the tool misses nothing. */
static bool holds_ours(const struct skd_live *live, const struct skd_session_params *params)
{
    if (!params->has_revision)
        return false;
    return params->instance != NULL ? strcmp(params->instance, live->session->instance) == 0
                                    : params->revision == live->durable_revision;
}

void skd_handle_session_attach(struct skd_call *call)
{
    const struct skd_session_params *params = &call->request.params.session;
    struct skd_live *live = skd_call_find_session(call, params->session);
    struct skd_listener_of_session *listener;
    struct skd_error error;
    if (live == NULL)
        return;
    bool is_new = skd_listener_find(live, call->connection_id) == NULL;
    if (skd_listener_attach(live, call->connection_id, &listener, &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    if (is_new)
        skd_presence_changed(call->daemon, live);
    listener->presence_told = live->presence_changes;
    bool follows = skd_updates_follow(live, listener, holds_ours(live, params), params->revision);
    cJSON *result = cJSON_CreateObject();
    cJSON_AddStringToObject(result, "session", live->name);
    cJSON_AddStringToObject(result, "instance", live->session->instance);
    cJSON_AddNumberToObject(result, "revision", (double)live->durable_revision);
    cJSON_AddBoolToObject(result, "resync", !follows);
    cJSON_AddNumberToObject(result, "connection", (double)call->connection_id);
    cJSON_AddItemToObject(result, "present", skd_presence_describe(call->daemon, live));
    struct skd_daemon *daemon = call->daemon;
    skd_call_answer(call, result);
    skd_updates_flush(daemon, live);
}

void skd_handle_session_detach(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live == NULL)
        return;
    if (skd_listener_detach(live, call->connection_id))
        skd_presence_changed(call->daemon, live);
    skd_call_answer(call, cJSON_CreateObject());
}
