/* See door.h. */
#include "door.h"

#include "base/log.h"
#include "requests/handlers.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

/* Descriptors that clients leave for the files of rigs and sessions, and how long to wait for one
 * when even the reserve is gone. */
enum { FILE_DESCRIPTORS = 64, OUT_OF_DESCRIPTORS_MS = 10 };

/* ---- those that are turned away ------------------------------------------------------------ */

static void refuse(struct skd_connection *connection, const struct skd_error *error)
{
    const struct skd_request_id none = {.kind = SKD_ID_NONE};
    skd_log(SKD_LOG_WARNING, "connection %llu is refused: %s", (unsigned long long)connection->id,
            error->text);
    skd_route_refuse(connection, &none, error);
    skd_connection_drain(connection);
}

static void hang_up(struct skd_entrance *entrance);

static void on_spare_closed(uv_handle_t *handle)
{
    struct skd_entrance *entrance = handle->data;
    bool again = entrance->next_waits;
    entrance->spare_closing = entrance->next_waits = false;
    if (again && !uv_is_closing((uv_handle_t *)entrance->listening))
        hang_up(entrance);
}

/* libuv looks at no other client before this one was accepted. */
static void hang_up(struct skd_entrance *entrance)
{
    uv_loop_t *loop = entrance->listening->loop;
    if (entrance->spare_closing) {
        entrance->next_waits = true;
        return;
    }
    if (entrance->listening->type == UV_TCP)
        uv_tcp_init(loop, &entrance->spare.tcp);
    else
        uv_pipe_init(loop, &entrance->spare.pipe, 0);
    entrance->spare.handle.data = entrance;
    (void)uv_accept(entrance->listening, &entrance->spare.stream); /* or it is gone already */
    entrance->spare_closing = true;
    uv_close(&entrance->spare.handle, on_spare_closed);
}

/* No descriptor for a client that waits, and libuv had none to give up: it would try again at once
 * and for ever. */
static void make_room(struct skd_door *door, int status)
{
    skd_log(SKD_LOG_WARNING, "a client could not be accepted: %s", uv_strerror(status));
    if (status != UV_EMFILE && status != UV_ENFILE)
        return;
    if (door->reserve >= 0)
        close(door->reserve);
    else
        uv_sleep(OUT_OF_DESCRIPTORS_MS);
    door->reserve = -1;
}

static void keep_reserve(struct skd_door *door)
{
    if (door->reserve < 0)
        door->reserve = open("/dev/null", O_RDONLY | O_CLOEXEC);
}

/* ---- those that come in -------------------------------------------------------------------- */

/* The kernel says who is at the other end of a Unix socket. */
static enum skd_status check_user(int descriptor, struct skd_error *error)
{
    struct ucred peer;
    socklen_t bytes = sizeof peer;
    if (getsockopt(descriptor, SOL_SOCKET, SO_PEERCRED, &peer, &bytes) != 0)
        return skd_fail(error, SKD_FILE_IO, "it cannot be seen who connects: %s", strerror(errno));
    if (peer.uid != geteuid())
        return skd_fail(error, SKD_FILE_IO,
                        "this skind serves user %ld, and user %ld connects; start one of your own",
                        (long)geteuid(), (long)peer.uid);
    return SKD_OK;
}

static enum skd_status check(const struct skd_entrance *entrance,
                             const struct skd_connection *connection, struct skd_error *error)
{
    const struct skd_door *door = entrance->door;
    uv_os_fd_t descriptor = -1;
    (void)uv_fileno(&connection->peer.handle, &descriptor);
    /* A new descriptor is the lowest that is free, so its number tells how many are taken. */
    if (descriptor > door->descriptor_max)
        return skd_fail(error, SKD_BUSY, "%d descriptors are in use, and the rest is for files",
                        descriptor);
    if (HASH_COUNT(door->daemon->connections) > SKD_CONNECTIONS_MAX)
        return skd_fail(error, SKD_BUSY, "%d connections are open, which is the limit",
                        SKD_CONNECTIONS_MAX);
    return entrance->token == NULL ? check_user(descriptor, error) : SKD_OK;
}

static void on_client(uv_stream_t *stream, int status)
{
    struct skd_entrance *entrance = stream->data;
    struct skd_door *door = entrance->door;
    struct skd_daemon *daemon = door->daemon;
    struct skd_error error;
    if (status < 0) {
        make_room(door, status);
        return;
    }
    struct skd_connection *connection =
        skd_connection_accept(&door->net, stream, ++door->next_connection_id);
    if (connection == NULL) {
        hang_up(entrance);
        return;
    }
    connection->token = entrance->token;
    HASH_ADD(hh, daemon->connections, id, sizeof connection->id, connection);
    if (!skd_hash_added(connection))
        skd_connection_close(connection);
    else if (check(entrance, connection, &error) != SKD_OK)
        refuse(connection, &error);
    else
        skd_connection_start(connection);
    keep_reserve(door);
}

/* SKD_CONNECTIONS_MAX connections and the files are more than the usual 1024. */
static int allow_descriptors(void)
{
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0)
        return INT_MAX;
    limit.rlim_cur = limit.rlim_max;
    (void)setrlimit(RLIMIT_NOFILE, &limit);
    (void)getrlimit(RLIMIT_NOFILE, &limit);
    return limit.rlim_cur < INT_MAX ? (int)limit.rlim_cur - FILE_DESCRIPTORS : INT_MAX;
}

static void set_entrance(struct skd_entrance *entrance, struct skd_door *door, void *listening,
                         const char *token)
{
    *entrance = (struct skd_entrance){.door = door, .listening = listening, .token = token};
    entrance->listening->data = entrance;
}

enum skd_status skd_door_open(struct skd_door *door, struct skd_daemon *daemon, const char *path,
                              int tcp_port, struct skd_error *error)
{
    door->daemon = daemon;
    door->descriptor_max = allow_descriptors();
    door->reserve = -1;
    keep_reserve(door);
    set_entrance(&door->by_path, door, &door->listener.pipe, NULL);
    enum skd_status status =
        skd_listener_open(&door->listener, daemon->loop, path, on_client, error);
    if (status == SKD_OK && tcp_port >= 0) {
        set_entrance(&door->by_port, door, &door->tcp.handle, door->tcp.token);
        status = skd_tcp_open(&door->tcp, daemon->loop, tcp_port, path, on_client, error);
        door->tcp_open = status == SKD_OK;
        if (status != SKD_OK)
            skd_listener_close(&door->listener);
    }
    if (status != SKD_OK && door->reserve >= 0)
        close(door->reserve);
    return status;
}

void skd_door_close(struct skd_door *door)
{
    if (door->tcp_open)
        skd_tcp_close(&door->tcp);
    skd_listener_close(&door->listener);
    if (door->reserve >= 0)
        close(door->reserve);
    door->tcp_open = false;
    door->reserve = -1;
}
