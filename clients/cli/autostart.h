/* Finds the daemon, or starts it: one daemon, however many clients ask at the same time.
 *
 * Thread: one. Owns nothing after it returns; the daemon runs detached in a session of its own.
 */
#ifndef SKD_CLI_AUTOSTART_H
#define SKD_CLI_AUTOSTART_H

#include "clients/cli/link.h"

#include "base/paths.h"

enum { SKD_NO_PORT = -1 };

struct skd_start {
    const char *path;  /* of the socket */
    const char *state; /* the folder of its sessions; NULL: the daemon's own choice */
    int tcp_port;      /* to listen on as well; 0: any; SKD_NO_PORT */
    int workers;       /* 0: the daemon's own choice */
    int idle_exit_s;   /* 0: never */
    bool started;      /* out: it was not running */
};

/* Connects to the daemon at start->path and starts it when none runs: $SKIND_BIN, else the skind
 * beside this program, else the one on PATH. It may take its time to read its sessions: as long as
 * it lives, a minute at most. Its talk goes to skind.log in the socket's folder.
 * Errors: SKD_FILE_IO when it cannot be started, with the last of what it said. */
SKD_MUST_CHECK enum skd_status skd_autostart(struct skd_link *link, struct skd_start *start,
                                             struct skd_error *error);

#endif
