/* Where a daemon is met: one rule for the server and for every client that starts it.
 *
 * Thread: any. Nothing is created or opened here.
 */
#ifndef SKD_BASE_PATHS_H
#define SKD_BASE_PATHS_H

#include "base/error.h"

#include <stddef.h>

enum { SKD_SOCKET_PATH_BYTES = 108 }; /* sun_path, its NUL included */

/* Writes the socket's path: `chosen` if not NULL, else $SKIND_SOCKET, else
 * $XDG_RUNTIME_DIR/skind/skind.sock, else /tmp/skind-<uid>/skind.sock.
 * Errors: SKD_BAD_PARAMS when it does not fit a Unix socket address or is not absolute. */
SKD_MUST_CHECK enum skd_status skd_socket_path(const char *chosen, char path[SKD_SOCKET_PATH_BYTES],
                                               struct skd_error *error);

enum { SKD_STATE_PATH_BYTES = 4096 };

/* Where the daemon of a socket keeps its sessions: `chosen` if not NULL, else $SKIND_STATE, else a
 * folder of $XDG_STATE_HOME/skind or ~/.local/state/skind: "default" for the user's own socket,
 * and for any other its path with '%' for '/'. Errors: SKD_BAD_PARAMS when it is not absolute, too
 * long, or there is no home. */
SKD_MUST_CHECK enum skd_status skd_state_folder(const char *socket_path, const char *chosen,
                                                char folder[SKD_STATE_PATH_BYTES],
                                                struct skd_error *error);

#endif
