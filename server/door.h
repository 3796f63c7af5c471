/* Who comes in: clients are accepted here, or told why not.
 *
 * Stage: before bytes come in. Thread: the loop.
 * Owns the sockets that are listened on. A client that cannot be served for lack of descriptors or
 * memory is turned away and does not keep the next one from being looked at.
 */
#ifndef SKD_DOOR_H
#define SKD_DOOR_H

#include "net/listener.h"
#include "net/tcp.h"
#include "requests/state.h"

struct skd_door;

/* One of the sockets. */
struct skd_entrance {
    struct skd_door *door;
    uv_stream_t *listening;
    const char *token; /* that clients have to show; NULL: the socket says who they are */
    /* Takes those that there is no memory to serve, to hang up on them. */
    union {
        uv_handle_t handle;
        uv_stream_t stream;
        uv_pipe_t pipe;
        uv_tcp_t tcp;
    } spare;
    bool spare_closing;
    bool next_waits; /* for the spare */
};

struct skd_door {
    struct skd_daemon *daemon;
    struct skd_net net; /* events and stall_ms are the daemon's to set */
    struct skd_listener listener;
    struct skd_tcp tcp;
    bool tcp_open;
    struct skd_entrance by_path, by_port;
    uint64_t next_connection_id;
    int descriptor_max; /* of a client's; those above are left for files */
    int reserve;        /* a descriptor to give up when there is none left; -1: gone */
};

/* Listens on the socket's path and, unless tcp_port is negative, on a port (0: any) of 127.0.0.1.
 * Errors: those of skd_listener_open and skd_tcp_open. */
SKD_MUST_CHECK enum skd_status skd_door_open(struct skd_door *door, struct skd_daemon *daemon,
                                             const char *path, int tcp_port,
                                             struct skd_error *error);

/* Nobody comes in any more; those inside stay. */
void skd_door_close(struct skd_door *door);

#endif
