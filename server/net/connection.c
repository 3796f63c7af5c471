/* See connection.h. */
#include "net/connection.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

enum { LINGER_MS = 2000, LOOKS_PER_STALL = 4 };

/* Reading stops while more than this waits to be written. */
static const size_t BACKLOG_BYTES = (size_t)4 << 20;

static void read_more(struct skd_connection *connection);
static void on_written(void *user, int status);
static void on_room(void *user);

static void on_handle_closed(uv_handle_t *handle)
{
    struct skd_connection *connection = handle->data;
    if (--connection->open_handles > 0)
        return;
    skd_reader_finish(&connection->reader);
    free(connection);
}

static void close_handles(struct skd_connection *connection)
{
    connection->closing = true;
    uv_close(&connection->peer.handle, on_handle_closed);
    uv_close((uv_handle_t *)&connection->timer, on_handle_closed);
}

/* For who gives none in hello: one that nobody had, not even with an earlier daemon, whose sessions
 * still know who did what. */
static void make_client_id(struct skd_connection *connection)
{
    uint64_t number;
    ssize_t got = getrandom(&number, sizeof number, 0); /* eight bytes come whole or not at all */
    SKD_ASSERT(got == (ssize_t)sizeof number);
    (void)snprintf(connection->author.id, sizeof connection->author.id, "c%llu-%016llx",
                   (unsigned long long)connection->id, (unsigned long long)number);
}

struct skd_connection *skd_connection_accept(struct skd_net *net, uv_stream_t *listening,
                                             uint64_t id)
{
    struct skd_connection *connection = calloc(1, sizeof *connection);
    if (connection == NULL)
        return NULL;
    connection->id = id;
    make_client_id(connection);
    connection->net = net;
    connection->share.user = connection->queue.user = connection;
    connection->share.granted = on_room;
    connection->queue.written = on_written;
    connection->queue.stream = &connection->peer.stream;
    skd_reader_init(&connection->reader);
    if (listening->type == UV_TCP)
        uv_tcp_init(listening->loop, &connection->peer.tcp);
    else
        uv_pipe_init(listening->loop, &connection->peer.pipe, 0);
    uv_timer_init(listening->loop, &connection->timer);
    connection->peer.handle.data = connection->timer.data = connection;
    connection->open_handles = 2;
    if (uv_accept(listening, &connection->peer.stream) == 0) {
        if (listening->type == UV_TCP)
            uv_tcp_nodelay(&connection->peer.tcp, 1);
        return connection;
    }
    close_handles(connection);
    return NULL;
}

static uint64_t now_ms(const struct skd_connection *connection)
{
    return uv_now(connection->timer.loop);
}

static void give_room(struct skd_connection *connection)
{
    skd_room_give(&connection->net->room, &connection->share, now_ms(connection));
}

void skd_connection_close(struct skd_connection *connection)
{
    struct skd_net *net = connection->net;
    if (connection->closing)
        return;
    connection->closing = true;
    net->events.closed(net->events.user, connection);
    skd_send_queue_drop(&connection->queue);
    give_room(connection);
    close_handles(connection);
}

bool skd_connection_idle(const struct skd_connection *connection)
{
    return !connection->closing && !connection->draining &&
           skd_send_queue_bytes(&connection->queue) == 0;
}

bool skd_connection_full(const struct skd_connection *connection)
{
    return !connection->closing && !connection->draining &&
           skd_send_queue_bytes(&connection->queue) > BACKLOG_BYTES;
}

/* Closes a connection that has nothing left to say: draining, or the peer's end was reached and
 * all of its requests are answered. */
static void close_if_done(struct skd_connection *connection)
{
    bool done = connection->draining || (connection->ended && connection->unanswered == 0);
    if (done && !connection->closing && skd_send_queue_bytes(&connection->queue) == 0)
        skd_connection_close(connection);
}

static void on_linger(uv_timer_t *timer)
{
    skd_connection_close(timer->data);
}

static void drain(struct skd_connection *connection, uint64_t linger_ms)
{
    if (connection->closing || connection->draining)
        return;
    connection->draining = true;
    uv_read_stop(&connection->peer.stream);
    give_room(connection);
    uv_timer_start(&connection->timer, on_linger, linger_ms, 0);
    close_if_done(connection);
}

void skd_connection_drain(struct skd_connection *connection)
{
    drain(connection, LINGER_MS);
}

static void break_off(struct skd_connection *connection, const struct skd_error *error)
{
    const struct skd_connection_events *events = &connection->net->events;
    events->broken(events->user, connection, error);
    skd_connection_drain(connection);
}

/* ---- who stands still --------------------------------------------------------------------- */

/* The peer reads nothing: what waits goes, what is half written is finished, and one last message
 * tells why. It has as long again to read that. */
static void drop_stalled(struct skd_connection *connection)
{
    const struct skd_connection_events *events = &connection->net->events;
    skd_send_queue_drop(&connection->queue);
    events->stalled(events->user, connection);
    connection->deaf = true;
    drain(connection, connection->net->stall_ms);
}

/* Somebody waits for room while another has begun a message and sends no more of it. */
static void free_room(struct skd_connection *connection)
{
    const struct skd_net *net = connection->net;
    struct skd_room_share *stuck = skd_room_stuck(&net->room, now_ms(connection), net->stall_ms);
    struct skd_error error;
    if (stuck == NULL)
        return;
    (void)skd_fail(&error, SKD_BUSY,
                   "nothing came of a large message for %llu s, and others wait for its room",
                   (unsigned long long)(net->stall_ms / 1000));
    break_off(stuck->user, &error);
}

static void on_look(uv_timer_t *timer)
{
    struct skd_connection *connection = timer->data;
    const bool waits_for_room = (connection->holds & SKD_HOLD_ROOM) != 0;
    const bool writes = skd_send_queue_bytes(&connection->queue) > 0;
    const size_t unread = skd_send_queue_unread(&connection->queue);
    if (!writes || unread < connection->unread_seen)
        connection->looks_in_vain = 0;
    else
        connection->looks_in_vain++;
    connection->unread_seen = unread;
    if (waits_for_room)
        free_room(connection);
    if (connection->looks_in_vain >= LOOKS_PER_STALL)
        drop_stalled(connection);
    else if (!writes && !waits_for_room)
        uv_timer_stop(timer);
}

/* Looks at the connection now and then until nothing waits. Looks are counted and not time: where
 * this process stood still for long itself, its clients did not. */
static void look_after(struct skd_connection *connection)
{
    const uint64_t every_ms = connection->net->stall_ms / LOOKS_PER_STALL;
    if (connection->draining || uv_is_active((uv_handle_t *)&connection->timer))
        return;
    connection->looks_in_vain = 0;
    connection->unread_seen = 0;
    uv_timer_start(&connection->timer, on_look, every_ms, every_ms);
}

/* ---- in ----------------------------------------------------------------------------------- */

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

static void on_room(void *user)
{
    skd_connection_unhold(user, SKD_HOLD_ROOM);
}

/* A large message asks for room as soon as its size is known. */
static void mind_room(struct skd_connection *connection)
{
    const size_t bytes = skd_reader_announced(&connection->reader);
    connection->share.fed_ms = now_ms(connection);
    if (bytes <= SKD_ROOM_FREE_BYTES || connection->share.bytes > 0 ||
        skd_room_take(&connection->net->room, &connection->share, bytes, now_ms(connection)))
        return;
    skd_connection_hold(connection, SKD_HOLD_ROOM);
    look_after(connection);
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
        mind_room(connection);
        read_more(connection);
    }
}

/* Hands out the frames that are whole, then reads on, unless something holds it. A frame that is
 * answered at once may end a hold, which comes back here: the flag makes that a round of this loop
 * and not a deeper stack. */
static void read_more(struct skd_connection *connection)
{
    struct skd_frame frame;
    const struct skd_connection_events *events = &connection->net->events;
    uv_stream_t *stream = &connection->peer.stream;
    if (connection->handing_out)
        return;
    connection->handing_out = true;
    while (connection->holds == 0 && !connection->closing && !connection->draining &&
           skd_reader_take(&connection->reader, &frame)) {
        give_room(connection);
        events->frame(events->user, connection, &frame);
    }
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
    skd_reader_limit(&connection->reader, SKD_HELLO_BYTES_MAX);
    read_more(connection);
}

void skd_connection_greet(struct skd_connection *connection)
{
    connection->greeted = true;
    skd_reader_limit(&connection->reader, 0);
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

/* ---- out ---------------------------------------------------------------------------------- */

static void on_written(void *user, int status)
{
    struct skd_connection *connection = user;
    const struct skd_connection_events *events = &connection->net->events;
    if (connection->closing)
        return;
    if (status < 0) {
        skd_connection_close(connection);
        return;
    }
    connection->looks_in_vain = 0;
    if (!skd_connection_full(connection))
        skd_connection_unhold(connection, SKD_HOLD_WRITES);
    if (skd_connection_idle(connection))
        events->drained(events->user, connection);
    if (!connection->closing)
        close_if_done(connection);
}

void skd_connection_send(struct skd_connection *connection, struct skd_outgoing *outgoing)
{
    if (connection->closing || connection->deaf)
        return;
    if (!skd_send_queue_push(&connection->queue, outgoing)) {
        skd_connection_close(connection);
        return;
    }
    if (skd_send_queue_bytes(&connection->queue) > 0)
        look_after(connection);
    if (skd_connection_full(connection))
        skd_connection_hold(connection, SKD_HOLD_WRITES);
}
