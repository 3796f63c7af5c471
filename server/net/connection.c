/* See connection.h. */
#include "net/connection.h"

#include <stdlib.h>
#include <string.h>

enum { LINGER_MS = 2000 };

/* Reading stops while more than this waits to be written. */
static const size_t BACKLOG_BYTES = (size_t)16 << 20;

struct write_request {
    uv_write_t uv;
    struct skd_connection *connection;
    struct skd_outgoing *outgoing;
    uv_buf_t buffers[1 + 2 * SKD_ARRAYS_MAX];
};

static void read_more(struct skd_connection *connection);

static void on_handle_closed(uv_handle_t *handle)
{
    struct skd_connection *connection = handle->data;
    if (--connection->open_handles > 0)
        return;
    skd_reader_finish(&connection->reader);
    free(connection);
}

struct skd_connection *skd_connection_accept(uv_stream_t *listening, uint64_t id,
                                             const struct skd_connection_events *events)
{
    struct skd_connection *connection = calloc(1, sizeof *connection);
    if (connection == NULL)
        return NULL;
    connection->id = id;
    connection->events = *events;
    connection->pipe.data = connection;
    connection->linger.data = connection;
    skd_reader_init(&connection->reader);
    uv_pipe_init(listening->loop, &connection->pipe, 0);
    uv_timer_init(listening->loop, &connection->linger);
    connection->open_handles = 2;
    if (uv_accept(listening, (uv_stream_t *)&connection->pipe) == 0)
        return connection;
    connection->closing = true;
    uv_close((uv_handle_t *)&connection->pipe, on_handle_closed);
    uv_close((uv_handle_t *)&connection->linger, on_handle_closed);
    return NULL;
}

void skd_connection_close(struct skd_connection *connection)
{
    if (connection->closing)
        return;
    connection->closing = true;
    connection->events.closed(connection->events.user, connection);
    uv_close((uv_handle_t *)&connection->pipe, on_handle_closed);
    uv_close((uv_handle_t *)&connection->linger, on_handle_closed);
}

size_t skd_connection_backlog(const struct skd_connection *connection)
{
    return uv_stream_get_write_queue_size((const uv_stream_t *)&connection->pipe);
}

/* Closes a connection that has nothing left to say: draining, or the peer's end was reached and
 * all of its requests are answered. */
static void close_if_done(struct skd_connection *connection)
{
    bool done = connection->draining || (connection->ended && connection->unanswered == 0);
    if (done && !connection->closing && skd_connection_backlog(connection) == 0)
        skd_connection_close(connection);
}

static void on_linger(uv_timer_t *timer)
{
    skd_connection_close(timer->data);
}

void skd_connection_drain(struct skd_connection *connection)
{
    if (connection->closing || connection->draining)
        return;
    connection->draining = true;
    uv_read_stop((uv_stream_t *)&connection->pipe);
    uv_timer_start(&connection->linger, on_linger, LINGER_MS, 0);
    close_if_done(connection);
}

static void break_off(struct skd_connection *connection, const struct skd_error *error)
{
    connection->events.broken(connection->events.user, connection, error);
    skd_connection_drain(connection);
}

static void on_space(uv_handle_t *handle, size_t suggested, uv_buf_t *buffer)
{
    struct skd_connection *connection = handle->data;
    unsigned char *space;
    size_t space_bytes;
    (void)suggested;
    *buffer = uv_buf_init(NULL, 0); /* on_read gets UV_ENOBUFS; libuv wants the stream alive here */
    if (skd_reader_space(&connection->reader, &space, &space_bytes, NULL) != SKD_OK)
        return;
    /* libuv's lengths are unsigned int on some systems. */
    size_t most = (size_t)1 << 30;
    *buffer = uv_buf_init((char *)space, (unsigned)(space_bytes < most ? space_bytes : most));
}

static void on_read(uv_stream_t *stream, ssize_t bytes, const uv_buf_t *buffer)
{
    struct skd_connection *connection = stream->data;
    struct skd_error error;
    (void)buffer;
    if (bytes == 0 || connection->draining)
        return;
    if (bytes == UV_ENOBUFS) {
        (void)skd_fail_memory(&error, "what was sent");
        break_off(connection, &error);
    } else if (bytes == UV_EOF) {
        connection->ended = true;
        uv_read_stop(stream);
        close_if_done(connection);
    } else if (bytes < 0) {
        skd_connection_close(connection);
    } else if (skd_reader_advance(&connection->reader, (size_t)bytes, &error) != SKD_OK) {
        break_off(connection, &error);
    } else {
        read_more(connection);
    }
}

/* Hands out the frames that are whole, then reads on, unless something holds it. A frame that is
 * answered at once may end a hold, which comes back here: the flag makes that a round of this loop
 * and not a deeper stack. */
static void read_more(struct skd_connection *connection)
{
    struct skd_frame frame;
    uv_stream_t *stream = (uv_stream_t *)&connection->pipe;
    if (connection->handing_out)
        return;
    connection->handing_out = true;
    while (connection->holds == 0 && !connection->closing && !connection->draining &&
           skd_reader_take(&connection->reader, &frame))
        connection->events.frame(connection->events.user, connection, &frame);
    connection->handing_out = false;
    if (connection->closing || connection->draining || connection->ended)
        return;
    if (connection->holds != 0)
        uv_read_stop(stream);
    else
        uv_read_start(stream, on_space, on_read);
}

void skd_connection_start(struct skd_connection *connection)
{
    read_more(connection);
}

enum skd_wire_mode skd_connection_mode(const struct skd_connection *connection)
{
    return connection->reader.mode;
}

void skd_connection_hold(struct skd_connection *connection, enum skd_hold hold)
{
    connection->holds |= (unsigned)hold;
}

void skd_connection_unhold(struct skd_connection *connection, enum skd_hold hold)
{
    if ((connection->holds & (unsigned)hold) == 0)
        return;
    connection->holds &= ~(unsigned)hold;
    if (connection->holds == 0)
        read_more(connection);
}

void skd_connection_asked(struct skd_connection *connection)
{
    if (++connection->unanswered >= SKD_REQUESTS_MAX)
        skd_connection_hold(connection, SKD_HOLD_UNANSWERED);
}

void skd_connection_answered(struct skd_connection *connection)
{
    SKD_ASSERT(connection->unanswered > 0);
    connection->unanswered--;
    skd_connection_unhold(connection, SKD_HOLD_UNANSWERED);
    close_if_done(connection);
}

static void on_written(uv_write_t *uv, int status)
{
    struct write_request *request = (struct write_request *)uv;
    struct skd_connection *connection = request->connection;
    skd_outgoing_release(request->outgoing);
    free(request);
    if (connection->closing)
        return;
    if (status < 0) {
        skd_connection_close(connection);
        return;
    }
    if (skd_connection_backlog(connection) <= BACKLOG_BYTES)
        skd_connection_unhold(connection, SKD_HOLD_WRITES);
    if (!connection->closing)
        close_if_done(connection);
}

void skd_connection_send(struct skd_connection *connection, struct skd_outgoing *outgoing)
{
    if (connection->closing)
        return;
    struct write_request *request = malloc(sizeof *request);
    if (request == NULL) {
        skd_connection_close(connection);
        return;
    }
    const struct skd_encoded *encoded = &outgoing->encoded;
    unsigned count = 0;
    request->connection = connection;
    request->outgoing = skd_outgoing_hold(outgoing);
    request->buffers[count++] = uv_buf_init((char *)encoded->head, (unsigned)encoded->head_bytes);
    for (int i = 0; i < encoded->piece_count; i++) {
        const struct skd_piece *piece = &encoded->pieces[i];
        /* uv_buf_t has no const; libuv only reads what it writes out. */
        if (piece->bytes > 0)
            request->buffers[count++] = uv_buf_init((char *)piece->data, (unsigned)piece->bytes);
        if (piece->padding > 0)
            request->buffers[count++] = uv_buf_init((char *)skd_zeros, (unsigned)piece->padding);
    }
    if (uv_write(&request->uv, (uv_stream_t *)&connection->pipe, request->buffers, count,
                 on_written) != 0) {
        skd_outgoing_release(request->outgoing);
        free(request);
        skd_connection_close(connection);
        return;
    }
    if (skd_connection_backlog(connection) > BACKLOG_BYTES)
        skd_connection_hold(connection, SKD_HOLD_WRITES);
}
