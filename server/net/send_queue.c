/* See send_queue.h. */
#include "net/send_queue.h"

#include <linux/sockios.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <utlist.h>

struct skd_waiting_message {
    struct skd_waiting_message *prev, *next;
    struct skd_outgoing *outgoing;
    size_t bytes;
};

static size_t message_bytes(const struct skd_encoded *encoded)
{
    size_t bytes = encoded->head_bytes;
    for (int i = 0; i < encoded->piece_count; i++)
        bytes += encoded->pieces[i].bytes + encoded->pieces[i].padding;
    return bytes;
}

static void on_written(uv_write_t *write, int status);

/* Begins to write a message whose reference is the queue's; on failure it is the caller's again. */
static int begin(struct skd_send_queue *queue, struct skd_outgoing *outgoing)
{
    const struct skd_encoded *encoded = &outgoing->encoded;
    unsigned count = 0;
    queue->buffers[count++] = uv_buf_init((char *)encoded->head, (unsigned)encoded->head_bytes);
    for (int i = 0; i < encoded->piece_count; i++) {
        const struct skd_piece *piece = &encoded->pieces[i];
        /* uv_buf_t has no const; libuv only reads what it writes out. */
        if (piece->bytes > 0)
            queue->buffers[count++] = uv_buf_init((char *)piece->data, (unsigned)piece->bytes);
        if (piece->padding > 0)
            queue->buffers[count++] = uv_buf_init((char *)skd_zeros, (unsigned)piece->padding);
    }
    queue->write.data = queue;
    int result = uv_write(&queue->write, queue->stream, queue->buffers, count, on_written);
    if (result == 0)
        queue->writing = outgoing;
    return result;
}

/* Takes the oldest waiting message out, with its reference. NULL: none. */
static struct skd_outgoing *take_first(struct skd_send_queue *queue)
{
    struct skd_waiting_message *first = queue->waiting;
    if (first == NULL)
        return NULL;
    struct skd_outgoing *outgoing = first->outgoing;
    DL_DELETE(queue->waiting, first);
    queue->waiting_bytes -= first->bytes;
    free(first);
    return outgoing;
}

static void on_written(uv_write_t *write, int status)
{
    struct skd_send_queue *queue = write->data;
    skd_outgoing_release(queue->writing);
    queue->writing = NULL;
    struct skd_outgoing *next = status == 0 ? take_first(queue) : NULL;
    if (next != NULL)
        status = begin(queue, next);
    if (status != 0) {
        skd_outgoing_release(next);
        skd_send_queue_drop(queue);
    }
    queue->written(queue->user, status);
}

bool skd_send_queue_push(struct skd_send_queue *queue, struct skd_outgoing *outgoing)
{
    if (queue->writing == NULL) {
        if (begin(queue, outgoing) != 0)
            return false;
        (void)skd_outgoing_hold(outgoing);
        return true;
    }
    struct skd_waiting_message *message = malloc(sizeof *message);
    if (message == NULL)
        return false;
    message->outgoing = skd_outgoing_hold(outgoing);
    message->bytes = message_bytes(&outgoing->encoded);
    queue->waiting_bytes += message->bytes;
    DL_APPEND(queue->waiting, message);
    return true;
}

void skd_send_queue_drop(struct skd_send_queue *queue)
{
    struct skd_outgoing *outgoing;
    while ((outgoing = take_first(queue)) != NULL)
        skd_outgoing_release(outgoing);
}

size_t skd_send_queue_bytes(const struct skd_send_queue *queue)
{
    return queue->waiting_bytes + uv_stream_get_write_queue_size(queue->stream);
}

size_t skd_send_queue_unread(const struct skd_send_queue *queue)
{
    uv_os_fd_t descriptor;
    int kept = 0;
    if (uv_fileno((const uv_handle_t *)queue->stream, &descriptor) != 0 ||
        ioctl(descriptor, SIOCOUTQ, &kept) != 0)
        kept = 0;
    return uv_stream_get_write_queue_size(queue->stream) + (size_t)kept;
}
