/* From a frame to its handler.
 *
 * Stage: frame -> request. Thread: the loop; a request with a large JSON part is decoded by a
 * worker while its connection is not read, so that its requests stay in order.
 */
#include "requests/handlers.h"

#include "protocol/json_memory.h"
#include "requests/connections.h"

#include <stdlib.h>

/* JSON of up to this size is parsed on the loop thread: some 0.1 ms. */
enum { JSON_BYTES_ON_LOOP = 16 * 1024 };

static void (*const handlers[SKD_REQUEST_METHOD_COUNT])(struct skd_call *call) = {
    [SKD_REQUEST_HELLO] = skd_handle_hello,
    [SKD_REQUEST_PING] = skd_handle_ping,
    [SKD_REQUEST_CANCEL] = skd_handle_cancel,
    [SKD_REQUEST_SESSION_CREATE] = skd_handle_session_create,
    [SKD_REQUEST_SESSION_LIST] = skd_handle_session_list,
    [SKD_REQUEST_SESSION_INFO] = skd_handle_session_info,
    [SKD_REQUEST_SESSION_ATTACH] = skd_handle_session_attach,
    [SKD_REQUEST_SESSION_DETACH] = skd_handle_session_detach,
    [SKD_REQUEST_SESSION_CLOSE] = skd_handle_session_close,
    [SKD_REQUEST_SESSION_EXPORT] = skd_handle_session_export,
    [SKD_REQUEST_SESSION_SET] = skd_handle_session_set,
    [SKD_REQUEST_SESSION_SAVE] = skd_handle_session_save,
    [SKD_REQUEST_SESSION_OPEN] = skd_handle_session_open,
    [SKD_REQUEST_SESSION_FORK] = skd_handle_session_fork,
    [SKD_REQUEST_SESSION_DELETE] = skd_handle_session_delete,
    [SKD_REQUEST_SESSION_VERIFY] = skd_handle_session_verify,
    [SKD_REQUEST_SESSION_CLAIM] = skd_handle_session_claim,
    [SKD_REQUEST_MESH_GET] = skd_handle_mesh_get,
    [SKD_REQUEST_POSE_SET] = skd_handle_pose_set,
    [SKD_REQUEST_POSE_EVALUATE] = skd_handle_pose_evaluate,
    [SKD_REQUEST_STROKE_APPLY] = skd_handle_stroke_apply,
    [SKD_REQUEST_PINS_LIST] = skd_handle_pins_list,
    [SKD_REQUEST_PINS_GET] = skd_handle_pins_get,
    [SKD_REQUEST_PINS_WEIGH] = skd_handle_pins_weigh,
    [SKD_REQUEST_PINS_CLEAR] = skd_handle_pins_clear,
    [SKD_REQUEST_PINS_SOLVE] = skd_handle_pins_solve,
    [SKD_REQUEST_GUARD_SET] = skd_handle_guard_set,
    [SKD_REQUEST_GUARD_GET] = skd_handle_guard_get,
    [SKD_REQUEST_SHAPES_LIST] = skd_handle_shapes_list,
    [SKD_REQUEST_SHAPES_GET] = skd_handle_shapes_get,
    [SKD_REQUEST_SESSION_REFIT] = skd_handle_session_refit,
    [SKD_REQUEST_WEIGHTS_GET] = skd_handle_weights_get,
    [SKD_REQUEST_WEIGHTS_SET] = skd_handle_weights_set,
    [SKD_REQUEST_WEIGHTS_MIRROR] = skd_handle_weights_mirror,
    [SKD_REQUEST_WEIGHTS_PRUNE] = skd_handle_weights_prune,
    [SKD_REQUEST_WEIGHTS_REDUCE] = skd_handle_weights_reduce,
    [SKD_REQUEST_HISTORY_UNDO] = skd_handle_history_undo,
    [SKD_REQUEST_HISTORY_REDO] = skd_handle_history_redo,
    [SKD_REQUEST_STATS] = skd_handle_stats,
    [SKD_REQUEST_SHUTDOWN] = skd_handle_shutdown,
};

void skd_route_refuse(struct skd_connection *connection, const struct skd_request_id *id,
                      const struct skd_error *failure)
{
    struct skd_encoded encoded;
    struct skd_error error;
    struct skd_outgoing *outgoing = NULL;
    if (skd_encode_error(skd_connection_mode(connection), id, failure, &encoded, &error) == SKD_OK)
        outgoing = skd_outgoing_create(&encoded, NULL, NULL);
    if (outgoing == NULL) { /* no memory: hanging up is an answer too */
        skd_connection_close(connection);
        return;
    }
    skd_connection_send(connection, outgoing);
    skd_outgoing_release(outgoing);
}

/* A request was decoded, or could not be. */
static void dispatch(struct skd_daemon *daemon, struct skd_connection *connection,
                     struct skd_request *request, enum skd_status status, struct skd_error *error)
{
    if (status == SKD_OK && daemon->stopping)
        status = skd_fail(error, SKD_SHUTTING_DOWN, "skind is stopping");
    if (status == SKD_OK && !connection->greeted && request->method != SKD_REQUEST_HELLO)
        status = skd_fail(error, SKD_HELLO_FIRST, "send hello before %s",
                          skd_request_method_name(request->method));
    struct skd_call *call = NULL;
    if (status == SKD_OK) {
        call = skd_call_create(daemon, connection, request);
        if (call == NULL)
            status = skd_fail_memory(error, "another request");
    }
    if (status != SKD_OK) {
        /* What was not even a request is answered with id null; a refused notification is not. */
        if (request->message.id.kind != SKD_ID_NONE || request->message.method == NULL)
            skd_route_refuse(connection, &request->message.id, error);
        skd_request_finish(request);
        return;
    }
    daemon->stats.requests[call->request.method]++;
    (void)skd_json_memory_ran_out(); /* what an earlier call lacked */
    handlers[call->request.method](call);
}

struct parsing {
    uv_work_t work;
    struct skd_daemon *daemon;
    uint64_t connection_id;
    struct skd_frame frame;
    struct skd_request request;
    enum skd_status status;
    struct skd_error error;
};

static void parse_in_worker(uv_work_t *work)
{
    struct parsing *parsing = work->data;
    parsing->status = skd_request_decode(&parsing->frame, &parsing->request, &parsing->error);
}

static void parse_done(uv_work_t *work, int status)
{
    struct parsing *parsing = work->data;
    struct skd_connection *connection =
        skd_connection_find(parsing->daemon, parsing->connection_id);
    SKD_ASSERT(status == 0);
    if (connection == NULL) {
        skd_request_finish(&parsing->request);
    } else {
        dispatch(parsing->daemon, connection, &parsing->request, parsing->status, &parsing->error);
        skd_connection_unhold(connection, SKD_HOLD_PARSING);
    }
    free(parsing);
}

static bool parse_later(struct skd_daemon *daemon, struct skd_connection *connection,
                        struct skd_frame *frame)
{
    struct parsing *parsing = calloc(1, sizeof *parsing);
    if (parsing == NULL)
        return false;
    parsing->work.data = parsing;
    parsing->daemon = daemon;
    parsing->connection_id = connection->id;
    parsing->frame = *frame;
    skd_connection_hold(connection, SKD_HOLD_PARSING);
    int result = uv_queue_work(daemon->loop, &parsing->work, parse_in_worker, parse_done);
    SKD_ASSERT(result == 0);
    return true;
}

void skd_route_frame(struct skd_daemon *daemon, struct skd_connection *connection,
                     struct skd_frame *frame)
{
    if (frame->json_bytes > JSON_BYTES_ON_LOOP && parse_later(daemon, connection, frame))
        return;
    struct skd_request request = {0};
    struct skd_error error;
    enum skd_status status = skd_request_decode(frame, &request, &error);
    dispatch(daemon, connection, &request, status, &error);
}
