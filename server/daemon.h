/* The daemon: the one place that sees the whole line from bytes to bytes.
 *
 * Thread: the loop.
 *
 *     connection -> frame -> request -> call -> (a session's turn) -> work -> answer -> connection
 *     net/                   protocol/  requests/call.h                        protocol/encode.h
 */
#ifndef SKD_DAEMON_H
#define SKD_DAEMON_H

#include "base/error.h"

struct skd_daemon_options {
    const char *socket_path; /* NULL: the default of base/paths.h */
    int worker_count;        /* 0: one a core */
    unsigned idle_exit_s;    /* 0: never */
};

/* Serves until a signal, a shutdown request or idleness ends it; then answers or cancels what is
 * under way and frees everything. Once a process. Errors: those of skd_listener_open. */
SKD_MUST_CHECK enum skd_status skd_daemon_run(const struct skd_daemon_options *options,
                                              struct skd_error *error);

#endif
