/* hello, ping, cancel, stats, shutdown: what needs no rig session and is answered at once.
 *
 * Stage: request -> reply. Thread: the loop.
 */
#include "requests/handlers.h"

#include "base/log.h"
#include "net/tcp.h"
#include "requests/claim.h"
#include "requests/memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <utlist.h>

/* Features by name; a client asks for these and not for a version. */
static const char *const capabilities[] = {
    "lines",         "session.file",      "session.arrays", "influences.8",  "method.exact",
    "method.thesis", "constraint.affine", "locks",          "stroke.stream", "history",
    "export",        "updates",           "pose.bend",      "weights.set",   "pins",
    "guards",        "stiffness.auto",    "smoothing",      "mix",           "mirror",
    "prune",         "residuals",         "slots.evidence", "reduce",        "refit",
    "residual.rest", "residual.shape",    "sequence",       "presence",      "claims",
    "history.own",   "updates.catch_up",  "durability",     "session.save",
};

static void add_limits(const struct skd_daemon *daemon, cJSON *result)
{
    cJSON *limits = cJSON_AddObjectToObject(result, "limits");
    cJSON_AddNumberToObject(limits, "total_bytes", (double)daemon->memory.total_bytes);
    cJSON_AddNumberToObject(limits, "session_bytes", (double)daemon->memory.session_bytes);
    cJSON_AddNumberToObject(limits, "history_bytes", (double)SKD_HISTORY_BYTES_LIMIT);
    cJSON_AddNumberToObject(limits, "claim_bytes", (double)SKD_CLAIM_BYTES_MAX);
    cJSON_AddNumberToObject(limits, "sequences", SKD_REMEMBERED_ANSWERS_MAX);
    cJSON_AddNumberToObject(limits, "sequence_clients", SKD_REMEMBERED_CLIENTS_MAX);
    cJSON_AddNumberToObject(limits, "frame_bytes", (double)SKD_FRAME_BYTES_MAX);
    cJSON_AddNumberToObject(limits, "json_bytes", SKD_JSON_BYTES_MAX);
    cJSON_AddNumberToObject(limits, "line_bytes", SKD_LINE_BYTES_MAX);
    cJSON_AddNumberToObject(limits, "json_nesting", SKD_JSON_NESTING_MAX);
    cJSON_AddNumberToObject(limits, "buffers", SKD_BUFFERS_MAX);
    cJSON_AddNumberToObject(limits, "vertices", (double)SKD_VERTICES_MAX);
    cJSON_AddNumberToObject(limits, "bones", SKD_BONES_MAX);
    cJSON_AddNumberToObject(limits, "sessions", SKD_SESSIONS_MAX);
    cJSON_AddNumberToObject(limits, "poses", SKD_POSES_MAX);
    cJSON_AddNumberToObject(limits, "target_poses", SKD_TARGET_POSES_MAX);
    cJSON_AddNumberToObject(limits, "guard_poses", SKD_GUARD_COUNT_MAX);
    cJSON_AddNumberToObject(limits, "refit_rounds", SKD_REFIT_ROUNDS_MAX);
    cJSON_AddNumberToObject(limits, "connections", SKD_CONNECTIONS_MAX);
    cJSON_AddNumberToObject(limits, "requests", SKD_REQUESTS_MAX);
}

void skd_handle_hello(struct skd_call *call)
{
    const struct skd_hello_params *params = &call->request.params.hello;
    struct skd_connection *connection = skd_call_connection(call);
    if (params->protocol_min > SKD_PROTOCOL_MAX || params->protocol_max < SKD_PROTOCOL_MIN) {
        struct skd_error error;
        (void)skd_fail(&error, SKD_VERSION,
                       "this skind speaks protocol %d to %d and the client %d to %d; update %s",
                       SKD_PROTOCOL_MIN, SKD_PROTOCOL_MAX, params->protocol_min,
                       params->protocol_max,
                       params->protocol_min > SKD_PROTOCOL_MAX ? "skind" : "the client");
        skd_call_fail(call, &error);
        return;
    }
    if (connection != NULL && connection->token != NULL &&
        !skd_token_matches(connection->token, params->token)) {
        struct skd_error error;
        (void)skd_fail(&error, SKD_BAD_TOKEN, "%s",
                       params->token == NULL ? "hello over TCP has to show the daemon's token"
                                             : "this is not the daemon's token");
        skd_log(SKD_LOG_WARNING, "connection %llu is refused: %s",
                (unsigned long long)connection->id, error.text);
        skd_call_fail(call, &error);
        skd_connection_drain(connection);
        return;
    }
    if (connection != NULL) {
        skd_connection_greet(connection);
        struct skd_author *author = &connection->author;
        (void)snprintf(author->client, sizeof author->client, "%s", params->client_name);
        (void)snprintf(author->user, sizeof author->user, "%s", params->client_user);
        if (params->client_id != NULL)
            (void)snprintf(author->id, sizeof author->id, "%s", params->client_id);
        (void)snprintf(connection->version, sizeof connection->version, "%s",
                       params->client_version);
    }
    cJSON *result = cJSON_CreateObject();
    cJSON_AddNumberToObject(result, "protocol", SKD_PROTOCOL_MAX);
    cJSON *server = cJSON_AddObjectToObject(result, "server");
    cJSON_AddStringToObject(server, "name", "skind");
    cJSON_AddStringToObject(server, "version", SKIND_VERSION);
    cJSON_AddNumberToObject(server, "pid", (double)getpid());
    cJSON_AddItemToObject(
        result, "capabilities",
        cJSON_CreateStringArray(capabilities, sizeof capabilities / sizeof *capabilities));
    add_limits(call->daemon, result);
    skd_call_answer(call, result);
}

void skd_handle_ping(struct skd_call *call)
{
    skd_call_answer(call, cJSON_CreateObject());
}

static bool same_id(const struct skd_request_id *a, const struct skd_request_id *b)
{
    if (a->kind != b->kind)
        return false;
    return a->kind == SKD_ID_NUMBER ? a->number == b->number : strcmp(a->text, b->text) == 0;
}

void skd_handle_cancel(struct skd_call *call)
{
    const struct skd_request_id *target = &call->request.params.cancel.target;
    struct skd_call *other, *next;
    DL_FOREACH_SAFE(call->daemon->calls, other, next)
    {
        if (other != call && other->connection_id == call->connection_id &&
            same_id(&other->request.message.id, target)) {
            skd_call_cancel(other, SKD_CANCELLED);
            break;
        }
    }
    skd_call_answer(call, cJSON_CreateObject());
}

void skd_handle_stats(struct skd_call *call)
{
    const struct skd_daemon *daemon = call->daemon;
    cJSON *result = cJSON_CreateObject();
    cJSON_AddNumberToObject(result, "uptime_s", (double)(uv_hrtime() - daemon->started_ns) * 1e-9);
    cJSON_AddNumberToObject(result, "connections", HASH_COUNT(daemon->connections));
    cJSON_AddNumberToObject(result, "sessions", HASH_COUNT(daemon->sessions));
    cJSON_AddNumberToObject(result, "workers", daemon->worker_count);
    cJSON_AddNumberToObject(result, "bytes", (double)skd_memory_used(daemon));
    cJSON *requests = cJSON_AddObjectToObject(result, "requests");
    for (int method = 0; method < SKD_REQUEST_METHOD_COUNT; method++) {
        if (daemon->stats.requests[method] > 0)
            cJSON_AddNumberToObject(requests,
                                    skd_request_method_name((enum skd_request_method)method),
                                    (double)daemon->stats.requests[method]);
    }
    cJSON_AddNumberToObject(result, "vertices_solved", (double)daemon->stats.vertices_solved);
    cJSON_AddNumberToObject(result, "solve_ms", (double)daemon->stats.solve_ns * 1e-6);
    skd_call_answer(call, result);
}

void skd_handle_shutdown(struct skd_call *call)
{
    struct skd_daemon *daemon = call->daemon;
    skd_log(SKD_LOG_INFO, "%s asks for a shutdown",
            call->author.client[0] != '\0' ? call->author.client : "a client");
    skd_call_answer(call, cJSON_CreateObject());
    daemon->stop(daemon, "a client asked for a shutdown");
}
