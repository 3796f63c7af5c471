/* See live.h. */
#include "requests/live.h"

#include "requests/connections.h"
#include "requests/listeners.h"

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
    live->daemon = daemon;
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
    if (!live->closed || live->running != NULL || live->serving || live->holds > 0)
        return;
    skd_changes_finish(&live->changes);
    skd_session_destroy(live->session);
    free(live);
}

/* The next call that can have the session: one whose client does not read its answers waits until
 * it does, and with it all that the same client asks for. */
static struct skd_call *next_call(const struct skd_live *live)
{
    struct skd_call *call;
    if (live->running != NULL)
        return NULL;
    DL_FOREACH2(live->waiting, call, turn_next)
    {
        const struct skd_connection *connection =
            skd_connection_find(call->daemon, call->connection_id);
        if (connection == NULL || !skd_connection_full(connection))
            return call;
    }
    return NULL;
}

/* Gives the session to the next call that waits. A call may end within its begin (nothing to undo),
 * which comes back here: the flag makes that a round of this loop and not a deeper stack. */
static void serve(struct skd_live *live)
{
    struct skd_call *next;
    if (live->serving)
        return;
    live->serving = true;
    while ((next = next_call(live)) != NULL) {
        live->running = next;
        skd_live_unqueue(live, live->running);
        if (live->renews)
            skd_session_new_instance(live->session->instance);
        live->renews = false;
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
    skd_listeners_forget(live);
    live->closed = true;
    destroy_if_left(live);
}

void skd_live_hold(struct skd_live *live)
{
    live->holds++;
}

void skd_live_release(struct skd_live *live)
{
    SKD_ASSERT(live->holds > 0);
    live->holds--;
    destroy_if_left(live);
}

void skd_live_queue(struct skd_live *live, struct skd_call *call)
{
    DL_APPEND2(live->waiting, call, turn_prev, turn_next);
    call->queued = true;
    serve(live);
}

void skd_live_unqueue(struct skd_live *live, struct skd_call *call)
{
    DL_DELETE2(live->waiting, call, turn_prev, turn_next);
    call->queued = false;
}

void skd_live_pass_turn(struct skd_live *live)
{
    live->running = NULL;
    serve(live);
}

void skd_live_resume(struct skd_daemon *daemon)
{
    struct skd_live *live = daemon->sessions;
    /* From the first one again after each: what is answered may open and close others. */
    while (live != NULL) {
        const bool ready = !live->serving && next_call(live) != NULL;
        if (ready)
            serve(live);
        live = ready ? daemon->sessions : live->hh.next;
    }
}
