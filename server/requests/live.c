/* See live.h. */
#include "requests/live.h"

#include "requests/call.h"

#include <stdlib.h>
#include <string.h>
#include <utlist.h>

enum skd_status skd_live_reserve(struct skd_daemon *daemon, const char *name,
                                 struct skd_live **result, struct skd_error *error)
{
    struct skd_live *live;
    HASH_FIND_STR(daemon->sessions, name, live);
    if (live != NULL)
        return skd_fail(error, SKD_NAME_TAKEN, "a session is named \"%s\" already", name);
    if (HASH_COUNT(daemon->sessions) >= SKD_SESSIONS_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "%d sessions are open, which is the limit; close one first",
                        SKD_SESSIONS_MAX);
    live = calloc(1, sizeof *live);
    if (live == NULL)
        return skd_fail_memory(error, "a session");
    memcpy(live->name, name, strlen(name) + 1);
    HASH_ADD_STR(daemon->sessions, name, live);
    if (!skd_hash_added(live)) {
        free(live);
        return skd_fail_memory(error, "a session");
    }
    *result = live;
    return SKD_OK;
}

struct skd_live *skd_live_find(struct skd_daemon *daemon, const char *name, struct skd_error *error)
{
    struct skd_live *live;
    HASH_FIND_STR(daemon->sessions, name, live);
    if (live == NULL) {
        (void)skd_fail(error, SKD_NO_SESSION, "no session \"%s\" is open", name);
    } else if (live->session == NULL) {
        (void)skd_fail(error, SKD_BUSY, "session \"%s\" is still being loaded", name);
        live = NULL;
    }
    return live;
}

static void destroy_if_left(struct skd_live *live)
{
    if (!live->closed || live->running != NULL || live->serving)
        return;
    skd_session_destroy(live->session);
    free(live);
}

/* Gives the session to the next call that waits. A call may end within its begin (nothing to undo),
 * which comes back here: the flag makes that a round of this loop and not a deeper stack. */
static void serve(struct skd_live *live)
{
    if (live->serving)
        return;
    live->serving = true;
    while (live->running == NULL && live->waiting != NULL) {
        live->running = live->waiting;
        skd_live_unqueue(live, live->running);
        live->running->begin(live->running);
    }
    live->serving = false;
    destroy_if_left(live);
}

void skd_live_retire(struct skd_daemon *daemon, struct skd_live *live)
{
    HASH_DEL(daemon->sessions, live);
}

void skd_live_dismiss(struct skd_live *live)
{
    struct skd_listener_of_session *listener, *next;
    LL_FOREACH_SAFE(live->listeners, listener, next)
    {
        LL_DELETE(live->listeners, listener);
        free(listener);
    }
    live->closed = true;
    destroy_if_left(live);
}

void skd_live_queue(struct skd_live *live, struct skd_call *call)
{
    DL_APPEND2(live->waiting, call, turn_prev, turn_next);
    serve(live);
}

void skd_live_unqueue(struct skd_live *live, struct skd_call *call)
{
    DL_DELETE2(live->waiting, call, turn_prev, turn_next);
}

void skd_live_pass_turn(struct skd_live *live)
{
    live->running = NULL;
    serve(live);
}

enum skd_status skd_live_attach(struct skd_live *live, uint64_t connection_id,
                                struct skd_error *error)
{
    struct skd_listener_of_session *listener;
    LL_SEARCH_SCALAR(live->listeners, listener, connection_id, connection_id);
    if (listener != NULL)
        return SKD_OK;
    listener = calloc(1, sizeof *listener);
    if (listener == NULL)
        return skd_fail_memory(error, "another listener");
    listener->connection_id = connection_id;
    LL_PREPEND(live->listeners, listener);
    return SKD_OK;
}

void skd_live_detach(struct skd_live *live, uint64_t connection_id)
{
    struct skd_listener_of_session *listener;
    LL_SEARCH_SCALAR(live->listeners, listener, connection_id, connection_id);
    if (listener == NULL)
        return;
    LL_DELETE(live->listeners, listener);
    free(listener);
}

int skd_live_listener_count(const struct skd_live *live)
{
    int count;
    struct skd_listener_of_session *listener;
    LL_COUNT(live->listeners, listener, count);
    return count;
}
