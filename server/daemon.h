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

#include <stddef.h>

struct skd_daemon_options {
    const char *socket_path;   /* NULL: the default of base/paths.h */
    const char *state_folder;  /* likewise */
    int worker_count;          /* 0: one a core */
    unsigned idle_exit_s;      /* 0: never */
    unsigned stall_timeout_s;  /* how long a client may read nothing of what waits for it */
    size_t memory_mib;         /* of all sessions; 0: three quarters of the machine's */
    size_t session_memory_mib; /* of one; 0: half of the machine's */
    int tcp_port;              /* of 127.0.0.1; 0: any; -1: none */
};

/* Serves until a signal, a shutdown request or idleness ends it; then answers or cancels what is
 * under way and frees everything. Once a process. Errors: those of skd_listener_open and
 * skd_keeping_start. */
SKD_MUST_CHECK enum skd_status skd_daemon_run(const struct skd_daemon_options *options,
                                              struct skd_error *error);

#endif
