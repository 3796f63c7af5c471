/* One client's stream: bytes to frames, messages to bytes, and nothing of what they mean.
 *
 * Stage: bytes in -> frame, reply -> bytes out. Thread: the loop.
 * Owns the pipe, the reader and the queue of writes. It frees itself in libuv's close callback;
 * others know it by its id, which is never used again.
 *
 * Reading stops while any hold is set: too many unanswered requests, too much not yet written, or
 * a request that a worker is still parsing. So a peer is slowed down instead of filling memory.
 */
#ifndef SKD_NET_CONNECTION_H
#define SKD_NET_CONNECTION_H

#include "base/hash.h"
#include "net/outgoing.h"
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
    /* The connection is going away; its memory goes with it after the call. */
    void (*closed)(void *user, struct skd_connection *connection);
};

enum skd_hold { SKD_HOLD_UNANSWERED = 1, SKD_HOLD_WRITES = 2, SKD_HOLD_PARSING = 4 };

struct skd_connection {
    uint64_t id;
    UT_hash_handle hh;                          /* the daemon's table, by id */
    bool greeted;                               /* hello was answered */
    char client[SKD_CLIENT_NAME_BYTES_MAX + 1]; /* as hello named it */
    /* The rest is net/connection.c's. */
    uv_pipe_t pipe;
    uv_timer_t linger;
    struct skd_connection_events events;
    struct skd_frame_reader reader;
    unsigned holds;
    int unanswered;
    int open_handles;
    bool handing_out; /* read_more is at it */
    bool draining;    /* closes when all is written */
    bool ended;       /* the peer sends no more; it may still listen */
    bool closing;
};

/* Accepts from the listening pipe. NULL when there is no memory or the peer is gone already. */
struct skd_connection *skd_connection_accept(uv_stream_t *listening, uint64_t id,
                                             const struct skd_connection_events *events);

/* Begins to read; frames arrive from now on. */
void skd_connection_start(struct skd_connection *connection);

enum skd_wire_mode skd_connection_mode(const struct skd_connection *connection);

/* Queues a message, keeping a reference of its own. Dropped silently when closing. */
void skd_connection_send(struct skd_connection *connection, struct skd_outgoing *outgoing);

/* A request that expects an answer came in, or its answer was sent. */
void skd_connection_asked(struct skd_connection *connection);
void skd_connection_answered(struct skd_connection *connection);

void skd_connection_hold(struct skd_connection *connection, enum skd_hold hold);
void skd_connection_unhold(struct skd_connection *connection, enum skd_hold hold);

/* Bytes that wait to be written. */
size_t skd_connection_backlog(const struct skd_connection *connection);

/* Reads no more, writes what is queued (for two seconds at most), then closes. */
void skd_connection_drain(struct skd_connection *connection);
/* Closes now. */
void skd_connection_close(struct skd_connection *connection);

#endif
