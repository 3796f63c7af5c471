/* The daemon: the one place that sees the whole line from bytes to bytes.
 *
 * Thread: the loop, which owns everything here. Workers see only what a call lends them.
 *
 *     connection -> frame -> request -> call -> (a session's turn) -> work -> answer -> connection
 *     net/                   protocol/  requests/call.h                        requests/answer
 */
#ifndef SKD_DAEMON_H
#define SKD_DAEMON_H

#include "net/connection.h"
#include "net/listener.h"
#include "protocol/request.h"
#include "session/session.h"

struct skd_call;

struct skd_daemon_options {
    const char *socket_path; /* NULL: the default of base/paths.h */
    int worker_count;        /* 0: one a core */
    unsigned idle_exit_s;    /* 0: never */
};

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
    uv_loop_t loop;
    struct skd_daemon_options options;
    struct skd_listener listener;
    uv_signal_t signals[2];
    uv_timer_t idle_timer;
    uint64_t started_ns;
    uint64_t idle_since_ns;
    uint64_t next_connection_id;
    struct skd_connection *connections; /* by id */
    struct skd_live *sessions;          /* by name */
    struct skd_call *calls;             /* all that are not answered yet */
    struct skd_stats stats;
    bool stopping;
};

/* Serves until a signal, a shutdown request or idleness ends it; then answers or cancels what is
 * under way and frees everything. Errors: those of skd_listener_open. */
SKD_MUST_CHECK enum skd_status skd_daemon_run(struct skd_daemon *daemon,
                                              const struct skd_daemon_options *options,
                                              struct skd_error *error);

/* Begins to stop. The loop ends when the last connection is gone. */
void skd_daemon_stop(struct skd_daemon *daemon, const char *reason);

#endif
