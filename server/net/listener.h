/* The place where clients find the daemon: a Unix socket that one daemon owns at a time.
 *
 * Stage: before bytes come in. Thread: the loop.
 *
 *     <folder>/             mode 0700, ours; made when it is not there
 *     <folder>/NAME         the socket, mode 0600
 *     <folder>/NAME.lock    held (flock) by the daemon that serves NAME; holds its pid
 *
 * Whoever holds the lock may replace a socket that a dead daemon left behind.
 */
#ifndef SKD_NET_LISTENER_H
#define SKD_NET_LISTENER_H

#include "base/error.h"
#include "base/paths.h"

#include <uv.h>

struct skd_listener {
    char path[SKD_SOCKET_PATH_BYTES];
    int lock;
    uv_pipe_t pipe;
};

/* Takes the lock, binds and listens. on_client is libuv's connection callback; pipe.data is the
 * caller's. Errors: SKD_BUSY (another daemon serves this socket), SKD_FILE_IO (the folder or the
 * socket: not ours, open to others, a symlink). */
SKD_MUST_CHECK enum skd_status skd_listener_open(struct skd_listener *listener, uv_loop_t *loop,
                                                 const char *path, uv_connection_cb on_client,
                                                 struct skd_error *error);

/* Stops listening, removes the socket and lets the lock go. */
void skd_listener_close(struct skd_listener *listener);

#endif
