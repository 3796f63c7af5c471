/* See updates.h. */
#include "requests/updates.h"

#include "base/log.h"

#include <utlist.h>

static const size_t UNREAD_BYTES_MAX = (size_t)64 << 20;

/* Spelling out more than this would keep the session from its next stroke. */
enum { LINE_VERTICES_MAX = 16384 };

static struct skd_connection *find(const struct skd_daemon *daemon, uint64_t id)
{
    struct skd_connection *connection;
    HASH_FIND(hh, daemon->connections, &id, sizeof id, connection);
    return connection;
}

int skd_step_arrays(const struct skd_step *step, bool undo, size_t first, size_t count,
                    struct skd_array_out arrays[SKD_STEP_ARRAYS])
{
    size_t slots = (size_t)step->slot_count;
    const float *weights = undo ? step->before : step->after;
    const uint16_t *joints = undo ? step->joints_before : step->joints_after;
    const float *rest = undo ? step->rest_before : step->rest_after;
    int used = 0;
    arrays[used++] = (struct skd_array_out){"vertices", SKD_U32, count, 0, step->vertices + first};
    arrays[used++] =
        (struct skd_array_out){"weights", SKD_F32, count, slots, weights + first * slots};
    if (joints != NULL)
        arrays[used++] =
            (struct skd_array_out){"joints", SKD_U16, count, slots, joints + first * slots};
    if (rest != NULL)
        arrays[used++] = (struct skd_array_out){"rest", SKD_F32, count, 3, rest + 3 * first};
    if (step->shape != NULL) {
        const float *offsets = undo ? step->shape->before : step->shape->after;
        arrays[used++] = (struct skd_array_out){"offsets", SKD_F32, count, SKD_SHAPE_NUMBERS,
                                                offsets + SKD_SHAPE_NUMBERS * first};
    }
    return used;
}

enum skd_status skd_update_encode(enum skd_wire_mode mode, const struct skd_update *update,
                                  struct skd_encoded *encoded, struct skd_error *error)
{
    const struct skd_step *step = update->step;
    bool whole = !update->brief && (mode == SKD_WIRE_FRAMES || step->count <= LINE_VERTICES_MAX);
    struct skd_array_out arrays[SKD_STEP_ARRAYS];
    int count = whole ? skd_step_arrays(step, update->undo, 0, step->count, arrays) : 0;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", update->session);
    cJSON_AddNumberToObject(body, "revision", (double)update->revision);
    cJSON_AddStringToObject(body, "cause", update->cause);
    cJSON_AddStringToObject(body, "client", update->client);
    cJSON_AddNumberToObject(body, "influences", step->slot_count);
    if (!whole)
        cJSON_AddTrueToObject(body, "resync");
    else if (step->shape != NULL)
        cJSON_AddStringToObject(body, "shape", step->shape->sheet->pose->name);
    return skd_encode_notification(mode, "session.update", body, arrays, count, encoded, error);
}

bool skd_updates_want_line(const struct skd_daemon *daemon, const struct skd_live *live,
                           uint64_t but)
{
    struct skd_listener_of_session *listener;
    LL_FOREACH(live->listeners, listener)
    {
        struct skd_connection *connection = find(daemon, listener->connection_id);
        if (connection != NULL && listener->connection_id != but &&
            skd_connection_mode(connection) == SKD_WIRE_LINES)
            return true;
    }
    return false;
}

static void release_step(void *step)
{
    skd_step_release(step);
}

/* Sends one message to every listener of a mode. A connection that closes on the way takes itself
 * out of the list, hence the copy of `next`. */
static void send_to_mode(struct skd_daemon *daemon, struct skd_live *live, enum skd_wire_mode mode,
                         struct skd_outgoing *outgoing, uint64_t but)
{
    struct skd_listener_of_session *listener, *next;
    LL_FOREACH_SAFE(live->listeners, listener, next)
    {
        struct skd_connection *connection = find(daemon, listener->connection_id);
        if (connection == NULL || listener->connection_id == but ||
            skd_connection_mode(connection) != mode)
            continue;
        if (skd_connection_backlog(connection) > UNREAD_BYTES_MAX) {
            skd_log(SKD_LOG_WARNING, "connection %llu does not read its updates and was dropped",
                    (unsigned long long)connection->id);
            skd_connection_close(connection);
            continue;
        }
        skd_connection_send(connection, outgoing);
    }
}

static enum skd_status encode_or_log(enum skd_wire_mode mode, const struct skd_update *update,
                                     struct skd_encoded *encoded)
{
    struct skd_error error;
    enum skd_status status = skd_update_encode(mode, update, encoded, &error);
    if (status != SKD_OK)
        skd_log(SKD_LOG_ERROR, "session \"%s\": an update was not sent: %s", update->session,
                error.text);
    return status;
}

/* A listener may attach while a worker finishes the change, after it was asked whether anybody
 * wants a line. */
static void send_lines(struct skd_daemon *daemon, struct skd_live *live,
                       const struct skd_update *update, uint64_t but, struct skd_encoded *line)
{
    struct skd_update brief = *update;
    brief.brief = true;
    if (line->head == NULL && (!skd_updates_want_line(daemon, live, but) ||
                               encode_or_log(SKD_WIRE_LINES, &brief, line) != SKD_OK))
        return;
    struct skd_outgoing *outgoing = skd_outgoing_create(line, NULL, NULL);
    if (outgoing == NULL)
        return;
    send_to_mode(daemon, live, SKD_WIRE_LINES, outgoing, but);
    skd_outgoing_release(outgoing);
}

void skd_updates_send(struct skd_daemon *daemon, struct skd_live *live,
                      const struct skd_update *update, uint64_t but, struct skd_encoded *line)
{
    struct skd_encoded frame;
    send_lines(daemon, live, update, but, line);
    if (live->listeners == NULL || encode_or_log(SKD_WIRE_FRAMES, update, &frame) != SKD_OK)
        return;
    struct skd_outgoing *outgoing =
        skd_outgoing_create(&frame, release_step, skd_step_hold(update->step));
    if (outgoing == NULL)
        return;
    send_to_mode(daemon, live, SKD_WIRE_FRAMES, outgoing, but);
    skd_outgoing_release(outgoing);
}

void skd_updates_closed(struct skd_daemon *daemon, struct skd_live *live, const char *reason)
{
    static const enum skd_wire_mode modes[] = {SKD_WIRE_FRAMES, SKD_WIRE_LINES};
    for (size_t i = 0; live->listeners != NULL && i < 2; i++) {
        struct skd_encoded encoded;
        struct skd_error error;
        cJSON *body = cJSON_CreateObject();
        cJSON_AddStringToObject(body, "session", live->name);
        cJSON_AddStringToObject(body, "reason", reason);
        if (skd_encode_notification(modes[i], "session.closed", body, NULL, 0, &encoded, &error) !=
            SKD_OK)
            continue;
        struct skd_outgoing *outgoing = skd_outgoing_create(&encoded, NULL, NULL);
        if (outgoing == NULL)
            continue;
        send_to_mode(daemon, live, modes[i], outgoing, 0);
        skd_outgoing_release(outgoing);
    }
}
