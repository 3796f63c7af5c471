/* One client's stream: bytes to frames, messages to bytes, and nothing of what they mean.
 *
 * Stage: bytes in -> frame, reply -> bytes out. Thread: the loop.
 * Owns the stream, the reader and the queue of what is to be written. It frees itself in libuv's
 * close callback; others know it by its id, which is never used again.
 *
 * Reading stops while any hold is set: too many unanswered requests, too much not yet written, a
 * request that a worker is still parsing, or no room for the message that comes. So a peer is
 * slowed down instead of filling memory. One that reads nothing for as long as it may is told so,
 * and dropped.
 */
#ifndef SKD_NET_CONNECTION_H
#define SKD_NET_CONNECTION_H

#include "base/hash.h"
#include "net/room.h"
#include "net/send_queue.h"
#include "protocol/author.h"
#include "protocol/frame.h"
#include "protocol/limits.h"

#include <uv.h>

struct skd_connection;

struct skd_connection_events {
    void *user;
    /* A whole frame came; its block is now the receiver's. */
    void (*frame)(void *user, struct skd_connection *connection, struct skd_frame *frame);
    /* What comes cannot be followed; the connection closes once this was answered. */
    void (*broken)(void *user, struct skd_connection *connection, const struct skd_error *error);
    /* It has read nothing for too long, and what waited for it is dropped; what is sent from within
     * this call is its last message. */
    void (*stalled)(void *user, struct skd_connection *connection);
    /* All that was to be written is. */
    void (*drained)(void *user, struct skd_connection *connection);
    /* The connection is going away; its memory goes with it after the call. */
    void (*closed)(void *user, struct skd_connection *connection);
};

/* What all connections of a daemon share; outlives them. */
struct skd_net {
    struct skd_connection_events events;
    uint64_t stall_ms; /* how long a peer may read nothing of what waits for it */
    struct skd_room room;
};

enum skd_hold {
    SKD_HOLD_UNANSWERED = 1,
    SKD_HOLD_WRITES = 2,
    SKD_HOLD_PARSING = 4,
    SKD_HOLD_ROOM = 8,
};

struct skd_connection {
    uint64_t id;
    UT_hash_handle hh;        /* the daemon's table, by id */
    bool greeted;             /* hello was answered */
    struct skd_author author; /* as hello named it; its id else from `id` */
    char version[SKD_CLIENT_NAME_BYTES_MAX + 1];
    const char *token; /* that hello has to show; NULL: none */
    /* The rest is net/connection.c's. */
    struct skd_net *net;
    union {
        uv_handle_t handle;
        uv_stream_t stream;
        uv_pipe_t pipe;
        uv_tcp_t tcp;
    } peer;
    uv_timer_t timer; /* looks whether the peer stands still; draining: how long that may take */
    struct skd_frame_reader reader;
    struct skd_room_share share;
    struct skd_send_queue queue;
    size_t unread_seen; /* of what was sent, when it was looked at last */
    int looks_in_vain;  /* since the peer had read something, or nothing waited */
    unsigned holds;
    int unanswered;
    int open_handles;
    bool handing_out; /* read_more is at it */
    bool draining;    /* closes when all is written */
    bool deaf;        /* its last message is queued */
    bool ended;       /* the peer sends no more; it may still listen */
    bool closing;
};

/* Whether nothing waits to be written. */
bool skd_connection_idle(const struct skd_connection *connection);

/* Whether so much waits to be written that no more should be made for it. */
bool skd_connection_full(const struct skd_connection *connection);

/* Accepts from a listening pipe or TCP socket. NULL when there is no memory (then the client still
 * waits to be accepted) or the client is gone already. */
struct skd_connection *skd_connection_accept(struct skd_net *net, uv_stream_t *listening,
                                             uint64_t id);

/* Begins to read; frames arrive from now on, and small ones only until the peer was greeted. */
void skd_connection_start(struct skd_connection *connection);
void skd_connection_greet(struct skd_connection *connection);

enum skd_wire_mode skd_connection_mode(const struct skd_connection *connection);

/* Queues a message, keeping a reference of its own. Dropped silently when closing, or after the
 * last one to a peer that stalled. */
void skd_connection_send(struct skd_connection *connection, struct skd_outgoing *outgoing);

/* A request that expects an answer came in, or its answer was sent. */
void skd_connection_asked(struct skd_connection *connection);
void skd_connection_answered(struct skd_connection *connection);

void skd_connection_hold(struct skd_connection *connection, enum skd_hold hold);
void skd_connection_unhold(struct skd_connection *connection, enum skd_hold hold);

/* Reads no more, writes what is queued (for two seconds at most), then closes. */
void skd_connection_drain(struct skd_connection *connection);
/* Closes now. */
void skd_connection_close(struct skd_connection *connection);

#endif
