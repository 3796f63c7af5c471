/* What the loop owns and the handlers work on: connections, open sessions, calls.
 *
 * Stage: all from the request to the reply. Thread: the loop. Workers see only what a call lends
 * them.
 */
#ifndef SKD_REQUESTS_STATE_H
#define SKD_REQUESTS_STATE_H

#include "net/connection.h"
#include "protocol/request.h"
#include "session/session.h"

struct skd_call;

/* A connection that wants to hear of a session's changes. */
struct skd_listener_of_session {
    uint64_t connection_id;
    struct skd_listener_of_session *next;
};

/* A rig session that is open in this daemon, and who takes turns on it. */
struct skd_live {
    char name[SKD_SESSION_NAME_BYTES_MAX + 1];
    UT_hash_handle hh;
    struct skd_session *session; /* NULL while it is being loaded */
    bool closed;                 /* goes when its running call ends */
    struct skd_call *running;    /* the call whose turn it is */
    struct skd_call *waiting;    /* list */
    bool serving;                /* requests/live.c is handing the turn out */
    struct skd_listener_of_session *listeners;
};

struct skd_stats {
    uint64_t requests[SKD_REQUEST_METHOD_COUNT];
    uint64_t vertices_solved;
    uint64_t solve_ns;
};

struct skd_daemon {
    uv_loop_t *loop;
    int worker_count;
    uint64_t started_ns;
    struct skd_connection *connections; /* by id */
    struct skd_live *sessions;          /* by name */
    struct skd_call *calls;             /* all that are not answered yet */
    struct skd_stats stats;
    bool stopping;
    /* Begins to stop; daemon.c's. */
    void (*stop)(struct skd_daemon *daemon, const char *reason);
};

#endif
