/* See listeners.h. */
#include "requests/listeners.h"

#include "requests/claim.h"
#include "requests/connections.h"

#include <stdlib.h>
#include <time.h>

struct skd_listener_of_session *skd_listener_find(const struct skd_live *live,
                                                  uint64_t connection_id)
{
    struct skd_listener_of_session *listener;
    HASH_FIND(hh, live->listeners, &connection_id, sizeof connection_id, listener);
    return listener;
}

struct skd_connection *skd_listener_connection(const struct skd_daemon *daemon,
                                               const struct skd_listener_of_session *listener)
{
    return skd_connection_find(daemon, listener->connection_id);
}

enum skd_status skd_listener_attach(struct skd_live *live, uint64_t connection_id,
                                    struct skd_listener_of_session **result,
                                    struct skd_error *error)
{
    struct skd_listener_of_session *listener = skd_listener_find(live, connection_id);
    *result = listener;
    if (listener != NULL)
        return SKD_OK;
    listener = *result = calloc(1, sizeof *listener);
    if (listener == NULL)
        return skd_fail_memory(error, "another listener");
    listener->connection_id = connection_id;
    listener->since_s = (int64_t)time(NULL);
    listener->claims_at_attach = live->claim_changes;
    HASH_ADD(hh, live->listeners, connection_id, sizeof listener->connection_id, listener);
    if (skd_hash_added(listener))
        return SKD_OK;
    free(listener);
    return skd_fail_memory(error, "another listener");
}

static void remove_listener(struct skd_live *live, struct skd_listener_of_session *listener)
{
    HASH_DEL(live->listeners, listener);
    skd_claim_drop(live, listener);
    free(listener);
}

bool skd_listener_detach(struct skd_live *live, uint64_t connection_id)
{
    struct skd_listener_of_session *listener = skd_listener_find(live, connection_id);
    if (listener != NULL)
        remove_listener(live, listener);
    return listener != NULL;
}

void skd_listeners_forget(struct skd_live *live)
{
    struct skd_listener_of_session *listener, *next;
    HASH_ITER(hh, live->listeners, listener, next)
    remove_listener(live, listener);
}

int skd_listener_count(const struct skd_live *live)
{
    return (int)HASH_COUNT(live->listeners);
}
