/* See call.h. */
#include "requests/call.h"

#include "base/log.h"
#include "protocol/json_memory.h"
#include "requests/connections.h"
#include "requests/live.h"

#include <stdlib.h>
#include <string.h>
#include <utlist.h>

struct skd_call *skd_call_create_own(struct skd_daemon *daemon)
{
    struct skd_call *call = calloc(1, sizeof *call);
    if (call == NULL)
        return NULL;
    call->daemon = daemon;
    call->work.data = call;
    DL_APPEND(daemon->calls, call);
    return call;
}

struct skd_call *skd_call_create(struct skd_daemon *daemon, struct skd_connection *connection,
                                 struct skd_request *request)
{
    struct skd_call *call = skd_call_create_own(daemon);
    if (call == NULL)
        return NULL;
    call->connection_id = connection->id;
    call->mode = skd_connection_mode(connection);
    call->author = connection->author;
    call->request = *request;
    call->arrived_ns = uv_hrtime();
    if (request->message.id.kind != SKD_ID_NONE)
        skd_connection_asked(connection);
    return call;
}

struct skd_connection *skd_call_connection(const struct skd_call *call)
{
    return skd_connection_find(call->daemon, call->connection_id);
}

void skd_call_send(struct skd_call *call, struct skd_encoded *encoded, void (*release)(void *owner),
                   void *owner)
{
    struct skd_connection *connection = skd_call_connection(call);
    struct skd_outgoing *outgoing = skd_outgoing_create(encoded, release, owner);
    if (outgoing == NULL) {
        if (connection != NULL)
            skd_connection_close(connection);
        return;
    }
    if (connection != NULL)
        skd_connection_send(connection, outgoing);
    skd_outgoing_release(outgoing);
}

/* Passes the turn on, frees the call, and lets its connection ask for more. */
static void end(struct skd_call *call)
{
    struct skd_connection *connection = skd_call_connection(call);
    struct skd_live *live = call->live;
    bool counted = call->request.message.id.kind != SKD_ID_NONE;
    DL_DELETE(call->daemon->calls, call);
    if (call->dismiss != NULL)
        call->dismiss(call);
    cJSON_Delete(call->reply.body);
    skd_request_finish(&call->request);
    free(call->answer);
    if (connection != NULL && counted)
        skd_connection_answered(connection);
    if (live != NULL && live->running == call)
        skd_live_pass_turn(live);
    free(call);
}

void skd_call_fail(struct skd_call *call, const struct skd_error *error)
{
    struct skd_encoded encoded;
    struct skd_error trouble;
    const struct skd_request_id *id = &call->request.message.id;
    struct skd_connection *connection;
    if (id->kind == SKD_ID_NONE)
        skd_log(SKD_LOG_DEBUG, "connection %llu: notification refused: %s",
                (unsigned long long)call->connection_id, error->text);
    else if (skd_encode_error(call->mode, id, error, &encoded, &trouble) == SKD_OK)
        skd_call_send(call, &encoded, NULL, NULL);
    else if ((connection = skd_call_connection(call)) != NULL)
        skd_connection_close(connection); /* rather than leave it waiting for an answer */
    end(call);
}

void skd_call_answer(struct skd_call *call, cJSON *body)
{
    struct skd_encoded encoded;
    struct skd_error error;
    const struct skd_request_id *id = &call->request.message.id;
    if (id->kind == SKD_ID_NONE) {
        cJSON_Delete(body);
        end(call);
    } else if (skd_encode_answer(call->mode, id, body, NULL, 0, &encoded, &error) != SKD_OK) {
        skd_call_fail(call, &error);
    } else {
        skd_call_send(call, &encoded, NULL, NULL);
        end(call);
    }
}

bool skd_call_prepare(struct skd_call *call, cJSON *body)
{
    struct skd_error error;
    if (skd_encode_answer(call->mode, &call->request.message.id, body, NULL, 0, &call->encoded,
                          &error) == SKD_OK)
        return true;
    skd_call_fail(call, &error);
    return false;
}

void skd_call_answer_prepared(struct skd_call *call)
{
    if (call->request.message.id.kind == SKD_ID_NONE)
        skd_encoded_finish(&call->encoded);
    else
        skd_call_send(call, &call->encoded, NULL, NULL);
    end(call);
}

/* What a call read of its session may be of a revision that still waits for the disk, and nobody
 * hears of that: were the daemon to die, another change would get its number. */
static bool reads_ahead(const struct skd_call *call)
{
    return call->live != NULL && call->live->session != NULL && call->revision == 0 &&
           call->live->durable_revision < call->live->session->revision;
}

void skd_call_finish(struct skd_call *call)
{
    if (call->status != SKD_OK) {
        if (call->reply.release != NULL)
            call->reply.release(call->reply.owner);
        skd_call_fail(call, &call->error);
        return;
    }
    if (reads_ahead(call)) {
        call->revision = call->live->session->revision;
        DL_APPEND2(call->live->awaiting, call, turn_prev, turn_next);
        skd_call_pass_turn(call);
        return;
    }
    skd_call_send(call, &call->encoded, call->reply.release, call->reply.owner);
    end(call);
}

void skd_call_end_awaiting(struct skd_live *live)
{
    struct skd_call *call;
    while ((call = live->awaiting) != NULL && call->revision <= live->durable_revision) {
        DL_DELETE2(live->awaiting, call, turn_prev, turn_next);
        skd_call_finish(call);
    }
}

static void work_in_worker(uv_work_t *work)
{
    struct skd_call *call = work->data;
    struct skd_reply *reply = &call->reply;
    (void)skd_json_memory_ran_out(); /* what an earlier call of this thread lacked */
    call->status = call->run(call, &call->error);
    if (call->status == SKD_OK && reply->body == NULL && skd_json_memory_ran_out())
        call->status = skd_fail_memory(&call->error, "an answer");
    if (call->status != SKD_OK || reply->body == NULL)
        return;
    if (call->request.sequence > 0 &&
        (call->answer = cJSON_PrintUnformatted(reply->body)) == NULL) {
        cJSON_Delete(reply->body);
        reply->body = NULL;
        call->status = skd_fail_memory(&call->error, "an answer");
        return;
    }
    call->status =
        skd_encode_answer(call->mode, &call->request.message.id, reply->body, reply->arrays,
                          reply->array_count, &call->encoded, &call->error);
    reply->body = NULL;
    if (call->status == SKD_OK && call->apply != NULL)
        call->apply(call);
}

static void work_done(uv_work_t *work, int status)
{
    struct skd_call *call = work->data;
    SKD_ASSERT(status == 0);
    call->done(call);
}

void skd_call_work(struct skd_call *call,
                   enum skd_status (*run)(struct skd_call *call, struct skd_error *error),
                   void (*done)(struct skd_call *call))
{
    call->run = run;
    call->done = done != NULL ? done : skd_call_finish;
    int result = uv_queue_work(call->daemon->loop, &call->work, work_in_worker, work_done);
    SKD_ASSERT(result == 0);
}

void skd_call_pass_turn(struct skd_call *call)
{
    if (call->live->running == call)
        skd_live_pass_turn(call->live);
}

struct skd_live *skd_call_find_session(struct skd_call *call, const char *name)
{
    struct skd_error error;
    struct skd_live *live = skd_live_find(call->daemon, name, &error);
    if (live == NULL)
        skd_call_fail(call, &error);
    return live;
}

void skd_call_take_turn(struct skd_call *call, struct skd_live *live,
                        void (*begin)(struct skd_call *call))
{
    call->live = live;
    call->begin = begin;
    skd_live_queue(live, call);
}

void skd_call_cancelled(const struct skd_call *call, struct skd_error *error)
{
    switch (call->why) {
    case SKD_SHUTTING_DOWN:
        (void)skd_fail(error, SKD_SHUTTING_DOWN, "skind is stopping; nothing was changed");
        break;
    case SKD_NO_SESSION:
        (void)skd_fail(error, SKD_NO_SESSION, "session \"%s\" was closed before this was done",
                       call->live != NULL ? call->live->name : "");
        break;
    default:
        (void)skd_fail(error, SKD_CANCELLED, "%s was cancelled; nothing was changed",
                       skd_request_method_name(call->request.method));
    }
}

void skd_call_cancel(struct skd_call *call, enum skd_status why)
{
    if (!atomic_load(&call->cancelled)) {
        call->why = why;
        atomic_store(&call->cancelled, true);
    }
    if (call->queued) {
        struct skd_error error;
        skd_live_unqueue(call->live, call);
        skd_call_cancelled(call, &error);
        skd_call_fail(call, &error);
    }
}
