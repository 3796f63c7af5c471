/* See daemon.h. Start, accept, stop; what a request means is requests/'s. */
#include "daemon.h"

#include "base/log.h"
#include "door.h"
#include "memory_reserve.h"
#include "protocol/json_memory.h"
#include "requests/call.h"
#include "requests/close.h"
#include "requests/handlers.h"
#include "requests/keeping.h"
#include "requests/live.h"
#include "requests/memory.h"
#include "requests/presence.h"
#include "requests/recovering.h"
#include "requests/rewriting.h"
#include "requests/updates.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <utlist.h>

enum { IDLE_CHECK_MS = 500 };

/* What the handlers work on, and what only this file knows of. */
struct server {
    struct skd_daemon daemon; /* first: a pointer to it is one to the server */
    uv_loop_t loop;
    struct skd_door door;
    uv_signal_t signals[2];
    uv_timer_t timer; /* looks for idleness; later waits for the last call */
    unsigned idle_exit_s;
    uint64_t idle_since_ns;
    bool said_bye;
};

static void on_frame(void *user, struct skd_connection *connection, struct skd_frame *frame)
{
    struct skd_daemon *daemon = user;
    skd_route_frame(daemon, connection, frame);
}

static void on_broken(void *user, struct skd_connection *connection, const struct skd_error *error)
{
    const struct skd_request_id none = {.kind = SKD_ID_NONE};
    (void)user;
    skd_log(SKD_LOG_WARNING, "connection %llu is closed: %s", (unsigned long long)connection->id,
            error->text);
    skd_route_refuse(connection, &none, error);
}

static void on_drained(void *user, struct skd_connection *connection)
{
    skd_updates_drained(user, connection);
    skd_live_resume(user);
}

/* Its calls go on: what a client had sent whole is done, though nobody hears the answer. */
static void on_closed(void *user, struct skd_connection *connection)
{
    struct skd_daemon *daemon = user;
    if (skd_hash_added(connection))
        HASH_DEL(daemon->connections, connection);
    skd_presence_leave(daemon, connection);
    skd_live_resume(daemon);
    skd_log(SKD_LOG_DEBUG, "connection %llu is gone", (unsigned long long)connection->id);
}

static void say_bye(struct skd_connection *connection, const char *reason)
{
    struct skd_encoded encoded;
    struct skd_error error;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "reason", reason);
    if (skd_encode_notification(skd_connection_mode(connection), "bye", body, NULL, 0, &encoded,
                                &error) == SKD_OK) {
        struct skd_outgoing *outgoing = skd_outgoing_create(&encoded, NULL, NULL);
        if (outgoing != NULL)
            skd_connection_send(connection, outgoing);
        skd_outgoing_release(outgoing);
    }
}

static void on_stalled(void *user, struct skd_connection *connection)
{
    const struct server *server = user;
    char reason[128];
    (void)snprintf(reason, sizeof reason,
                   "you read nothing for %llu s; connect again to get what you missed",
                   (unsigned long long)(server->door.net.stall_ms / 1000));
    skd_log(SKD_LOG_WARNING, "connection %llu (%s) is dropped: it reads nothing",
            (unsigned long long)connection->id, connection->author.client);
    say_bye(connection, reason);
}

/* The first call that was not told to stop yet. Cancelling may end other calls as well, so the
 * list is looked at anew each time. */
static struct skd_call *next_to_cancel(const struct skd_daemon *daemon)
{
    struct skd_call *call;
    DL_FOREACH(daemon->calls, call)
    {
        if (!atomic_load(&call->cancelled))
            return call;
    }
    return NULL;
}

/* Once the last call has ended its answer is queued, and the connections can go; after the last of
 * them the loop ends. */
static void on_stopping(uv_timer_t *timer)
{
    struct server *server = timer->data;
    struct skd_daemon *daemon = &server->daemon;
    struct skd_connection *connection, *next;
    if (daemon->calls != NULL)
        return;
    if (!server->said_bye) {
        HASH_ITER(hh, daemon->connections, connection, next)
        {
            say_bye(connection, "skind is stopping");
            skd_connection_drain(connection);
        }
        server->said_bye = true;
    }
    if (daemon->connections != NULL)
        return;
    uv_close((uv_handle_t *)timer, NULL);
    uv_stop(daemon->loop); /* the journal would keep the loop waiting for its next record */
}

static void stop(struct skd_daemon *daemon, const char *reason)
{
    struct server *server = (struct server *)daemon;
    struct skd_call *call;
    if (daemon->stopping)
        return;
    daemon->stopping = true;
    skd_log(SKD_LOG_INFO, "stopping: %s", reason);
    skd_door_close(&server->door);
    uv_close((uv_handle_t *)&server->signals[0], NULL);
    uv_close((uv_handle_t *)&server->signals[1], NULL);
    /* Told once is enough: a second signal must not cut off what is being finished. */
    signal(SIGTERM, SIG_IGN);
    signal(SIGINT, SIG_IGN);
    while ((call = next_to_cancel(daemon)) != NULL)
        skd_call_cancel(call, SKD_SHUTTING_DOWN);
    /* Workers may still have calls: look every few milliseconds until they are back. */
    uv_timer_start(&server->timer, on_stopping, 0, 5);
}

static void on_signal(uv_signal_t *signal, int number)
{
    stop(signal->data, number == SIGINT ? "interrupted" : "told to stop by a signal");
}

static void watch_signal(struct server *server, uv_signal_t *signal, int number)
{
    uv_signal_init(&server->loop, signal);
    signal->data = &server->daemon;
    uv_signal_start(signal, on_signal, number);
}

/* Idle: nobody connected, nothing under way, and every session is on the disk or holds nothing that
 * was not exported. */
static bool is_idle(const struct skd_daemon *daemon)
{
    const struct skd_live *live, *next;
    if (daemon->connections != NULL || daemon->calls != NULL)
        return false;
    HASH_ITER(hh, daemon->sessions, live, next)
    {
        if (live->session == NULL ||
            (live->journal == NULL && live->session->revision != live->session->exported))
            return false;
    }
    return true;
}

static void on_idle_check(uv_timer_t *timer)
{
    struct server *server = timer->data;
    uint64_t now = uv_hrtime();
    if (!is_idle(&server->daemon))
        server->idle_since_ns = now;
    else if (now - server->idle_since_ns >= (uint64_t)server->idle_exit_s * 1000000000)
        stop(&server->daemon, "idle for as long as it was told");
}

static void close_sessions(struct skd_daemon *daemon)
{
    struct skd_live *live, *next;
    HASH_ITER(hh, daemon->sessions, live, next)
    skd_session_close(daemon, live, SKD_KEEPING_STAYS, "skind is stopping");
}

static void do_nothing(uv_work_t *work)
{
    (void)work;
}

/* libuv starts its threads with the first work, and ends the process when it cannot: that must be
 * while nobody has anything to lose. */
static void start_workers(struct server *server)
{
    uv_work_t work;
    int result = uv_queue_work(&server->loop, &work, do_nothing, NULL);
    SKD_ASSERT(result == 0);
    uv_run(&server->loop, UV_RUN_DEFAULT);
}

/* The state as it is before the first client; libuv's pool is the worker pool and reads its size
 * from the environment when it first starts. */
static void set_up(struct server *server, const struct skd_daemon_options *options)
{
    struct skd_daemon *daemon = &server->daemon;
    char workers[16];
    skd_memory_reserve_start();
    skd_json_memory_watch();
    *server = (struct server){.idle_exit_s = options->idle_exit_s};
    server->door.net = (struct skd_net){
        .events = {server, on_frame, on_broken, on_stalled, on_drained, on_closed},
        .stall_ms = (uint64_t)options->stall_timeout_s * 1000,
    };
    daemon->loop = daemon->importer.loop = &server->loop;
    skd_memory_set_limits(daemon, options->memory_mib << 20, options->session_memory_mib << 20);
    daemon->stop = stop;
    daemon->started_ns = server->idle_since_ns = uv_hrtime();
    daemon->worker_count =
        options->worker_count > 0 ? options->worker_count : (int)uv_available_parallelism();
    (void)snprintf(workers, sizeof workers, "%d", daemon->worker_count);
    setenv("UV_THREADPOOL_SIZE", workers, 1);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGCHLD, SIG_DFL); /* ignored by whoever started us, ends of imports would be lost */
    signal(SIGXFSZ, SIG_IGN); /* a file that may not grow is an error of its write */
    uv_loop_init(&server->loop);
    start_workers(server);
}

/* From the first client to the last. */
static void serve(struct server *server)
{
    watch_signal(server, &server->signals[0], SIGTERM);
    watch_signal(server, &server->signals[1], SIGINT);
    uv_timer_init(&server->loop, &server->timer);
    server->timer.data = server;
    if (server->idle_exit_s > 0)
        uv_timer_start(&server->timer, on_idle_check, IDLE_CHECK_MS, IDLE_CHECK_MS);
    if (server->door.tcp_open)
        skd_log(SKD_LOG_INFO, "listening on port %d of 127.0.0.1, the token is in %s",
                server->door.tcp.port, server->door.tcp.token_path);
    skd_log(SKD_LOG_INFO, "listening on %s with %d workers", server->door.listener.path,
            server->daemon.worker_count);
    uv_run(&server->loop, UV_RUN_DEFAULT);
    close_sessions(&server->daemon);
    skd_keeping_stop(&server->daemon);
    skd_log(SKD_LOG_INFO, "stopped");
}

enum skd_status skd_daemon_run(const struct skd_daemon_options *options, struct skd_error *error)
{
    static struct server server;
    char path[SKD_SOCKET_PATH_BYTES], state[SKD_STATE_PATH_BYTES];
    enum skd_status status = skd_socket_path(options->socket_path, path, error);
    if (status == SKD_OK)
        status = skd_state_folder(path, options->state_folder, state, error);
    if (status != SKD_OK)
        return status;
    set_up(&server, options);
    /* Who connects from here on is served once the kept sessions are open. */
    status = skd_door_open(&server.door, &server.daemon, path, options->tcp_port, error);
    if (status == SKD_OK) {
        status = skd_keeping_start(&server.daemon, state, error);
        if (status == SKD_OK) {
            skd_rewriting_watch(&server.daemon);
            skd_recover_sessions(&server.daemon);
            serve(&server);
        } else
            skd_door_close(&server.door);
    }
    uv_run(&server.loop, UV_RUN_DEFAULT); /* the last close callbacks */
    int left = uv_loop_close(&server.loop);
    SKD_ASSERT(left == 0);
    uv_library_shutdown();
    return status;
}
