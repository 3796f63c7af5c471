/* Messages on their way to one peer, in order, one of them being written.
 *
 * Stage: reply -> bytes out. Thread: the loop.
 * Owns a reference to each message. What was not begun can be dropped whole, so that a peer that
 * reads again after that still finds messages and not pieces of them.
 */
#ifndef SKD_NET_SEND_QUEUE_H
#define SKD_NET_SEND_QUEUE_H

#include "net/outgoing.h"

#include <uv.h>

struct skd_waiting_message;

struct skd_send_queue {
    uv_stream_t *stream;
    void *user;
    /* A message was written, or the stream is broken or closed (status < 0). */
    void (*written)(void *user, int status);
    /* The rest is net/send_queue.c's. */
    struct skd_waiting_message *waiting; /* list, oldest first */
    size_t waiting_bytes;
    struct skd_outgoing *writing; /* NULL: none */
    uv_write_t write;
    uv_buf_t buffers[1 + 2 * SKD_ARRAYS_MAX];
};

/* Keeps a reference of its own. False: no memory, or the stream is broken; nothing was queued. */
SKD_MUST_CHECK bool skd_send_queue_push(struct skd_send_queue *queue,
                                        struct skd_outgoing *outgoing);

/* Forgets all that was not begun. */
void skd_send_queue_drop(struct skd_send_queue *queue);

/* Bytes that are not written yet. */
size_t skd_send_queue_bytes(const struct skd_send_queue *queue);

/* Of the message that is being written, and of what the kernel keeps for the peer, the bytes that
 * it has not read: what shows that it reads at all. The kernel takes more only when much of what it
 * keeps was read. */
size_t skd_send_queue_unread(const struct skd_send_queue *queue);

#endif
