/* session.claim: a tool says what it works on, so that two artists see each other before they
 * collide. A claim tells others and stops nobody.
 *
 * Stage: request -> reply. Thread: the loop, and a worker that makes the claim.
 */
#include "requests/handlers.h"

#include "requests/claim.h"
#include "requests/listeners.h"
#include "requests/live.h"
#include "requests/presence.h"

#include <stdlib.h>

struct claiming {
    struct skd_claim *claim;
    uint64_t number; /* of the listener's requests */
};

/* Thread: a worker. */
static enum skd_status make(struct skd_call *call, struct skd_error *error)
{
    struct claiming *claiming = call->state;
    enum skd_status status = skd_claim_create(
        call->live->session, &call->request.params.session_claim, &claiming->claim, error);
    if (status != SKD_OK)
        return status;
    cJSON *body = call->reply.body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", call->live->name);
    cJSON_AddNumberToObject(body, "vertices", (double)claiming->claim->vertex_count);
    return SKD_OK;
}

static enum skd_status put(struct skd_call *call, struct skd_listener_of_session *listener,
                           struct skd_error *error)
{
    struct claiming *claiming = call->state;
    struct skd_claim *claim = claiming->claim;
    struct skd_live *live = call->live;
    bool claims = claim->bone_count > 0 || claim->vertex_count > 0;
    size_t before = listener->claim != NULL ? listener->claim->bytes : 0;
    if (claims && live->claim_bytes - before + claim->bytes > SKD_CLAIM_BYTES_MAX)
        return skd_fail(
            error, SKD_TOO_LARGE,
            "the claims of session \"%s\" take %zu MiB, which is the limit; claim bones",
            live->name, SKD_CLAIM_BYTES_MAX >> 20);
    if (claiming->number < listener->claim_asked)
        return SKD_OK; /* a later one has come meanwhile, and is to hold */
    skd_claim_drop(live, listener);
    if (claims) {
        listener->claim = skd_claim_hold(claim);
        live->claim_bytes += claim->bytes;
    }
    listener->claim_change = ++live->claim_changes;
    skd_presence_changed(call->daemon, live);
    return SKD_OK;
}

static enum skd_status fail_detached(const struct skd_call *call, struct skd_error *error)
{
    return skd_fail(error, SKD_BAD_PARAMS, "session.claim: attach to session \"%s\" first",
                    call->request.params.session_claim.session);
}

static void made(struct skd_call *call)
{
    struct skd_live *live = call->live; /* held */
    struct skd_listener_of_session *listener = skd_listener_find(live, call->connection_id);
    enum skd_status status = call->status;
    if (status == SKD_OK)
        status = listener != NULL ? put(call, listener, &call->error)
                                  : fail_detached(call, &call->error);
    if (status != SKD_OK && call->status == SKD_OK) {
        skd_encoded_finish(&call->encoded);
        skd_call_fail(call, &call->error);
    } else {
        skd_call_finish(call);
    }
    skd_live_release(live);
}

static void dismiss(struct skd_call *call)
{
    struct claiming *claiming = call->state;
    skd_claim_release(claiming->claim);
    free(claiming);
}

void skd_handle_session_claim(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session_claim.session);
    struct skd_error error;
    if (live == NULL)
        return;
    struct skd_listener_of_session *listener = skd_listener_find(live, call->connection_id);
    struct claiming *claiming = listener != NULL ? calloc(1, sizeof *claiming) : NULL;
    if (claiming == NULL) {
        (void)(listener == NULL ? fail_detached(call, &error)
                                : skd_fail_memory(&error, "a request"));
        skd_call_fail(call, &error);
        return;
    }
    claiming->number = ++listener->claim_asked;
    call->state = claiming;
    call->dismiss = dismiss;
    call->live = live;
    skd_live_hold(live);
    skd_call_work(call, make, made);
}
