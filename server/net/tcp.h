/* A port of 127.0.0.1, for tools that cannot use the Unix socket.
 *
 * Stage: before bytes come in. Thread: the loop.
 *
 *     <socket>.token        mode 0600: 64 hexadecimal digits, and on the next line the port
 *
 * A port is open to every user of the machine, so clients show the token in hello. It is new at
 * each start, and its file is removed at the end.
 */
#ifndef SKD_NET_TCP_H
#define SKD_NET_TCP_H

#include "base/error.h"
#include "base/paths.h"
#include "protocol/limits.h"

#include <stdbool.h>
#include <uv.h>

struct skd_tcp {
    uv_tcp_t handle; /* its data is the caller's */
    int port;
    char token[SKD_TOKEN_DIGITS + 1];
    char token_path[SKD_SOCKET_PATH_BYTES + 8];
};

/* Listens on the port (0: any that is free) and writes the token beside the socket, whose lock is
 * held. Errors: SKD_FILE_IO. */
SKD_MUST_CHECK enum skd_status skd_tcp_open(struct skd_tcp *tcp, uv_loop_t *loop, int port,
                                            const char *socket_path, uv_connection_cb on_client,
                                            struct skd_error *error);

/* Stops listening and removes the token's file. */
void skd_tcp_close(struct skd_tcp *tcp);

/* Whether the text is the token (NULL: it is not), in a time that does not tell how much of it is
 * right. */
bool skd_token_matches(const char *token, const char *text);

#endif
