/* See presence.h. */
#include "requests/presence.h"

#include "requests/claim.h"
#include "requests/claims.h"
#include "requests/listeners.h"

#include <stdlib.h>

/* How long changes are gathered: longer where many are to be told. */
enum { GATHER_MS = 30 };

static void add_one(cJSON *list, const struct skd_daemon *daemon, const struct skd_live *live,
                    const struct skd_listener_of_session *listener)
{
    const struct skd_connection *connection = skd_listener_connection(daemon, listener);
    if (connection == NULL)
        return;
    cJSON *item = cJSON_CreateObject();
    cJSON_AddNumberToObject(item, "connection", (double)connection->id);
    cJSON_AddStringToObject(item, "client", connection->author.client);
    cJSON_AddStringToObject(item, "user", connection->author.user);
    cJSON_AddStringToObject(item, "version", connection->version);
    cJSON_AddNumberToObject(item, "since", (double)listener->since_s);
    cJSON_AddItemToObject(item, "claim", skd_claim_describe(live, listener));
    cJSON_AddItemToArray(list, item);
}

cJSON *skd_presence_describe(const struct skd_daemon *daemon, const struct skd_live *live)
{
    const struct skd_listener_of_session *listener;
    cJSON *list = cJSON_CreateArray();
    for (listener = live->listeners; listener != NULL; listener = listener->hh.next) {
        add_one(list, daemon, live, listener);
    }
    return list;
}

/* NULL: no memory. */
static struct skd_outgoing *make_message(const struct skd_daemon *daemon,
                                         const struct skd_live *live, enum skd_wire_mode mode)
{
    struct skd_encoded encoded;
    struct skd_error error;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", live->name);
    cJSON_AddItemToObject(body, "present", skd_presence_describe(daemon, live));
    if (skd_encode_notification(mode, "session.presence", body, NULL, 0, &encoded, &error) !=
        SKD_OK)
        return NULL;
    return skd_outgoing_create(&encoded, NULL, NULL);
}

static void send_to(struct skd_live *live, struct skd_listener_of_session *listener,
                    struct skd_connection *connection, struct skd_outgoing *outgoing)
{
    if (outgoing == NULL)
        return;
    listener->presence_told = live->presence_changes;
    skd_connection_send(connection, outgoing);
}

void skd_presence_tell(struct skd_daemon *daemon, struct skd_live *live,
                       struct skd_listener_of_session *listener)
{
    struct skd_connection *connection = skd_listener_connection(daemon, listener);
    if (listener->presence_told >= live->presence_due) {
        (void)skd_claims_tell(daemon, live, listener);
        return;
    }
    struct skd_outgoing *outgoing = make_message(daemon, live, skd_connection_mode(connection));
    send_to(live, listener, connection, outgoing);
    skd_outgoing_release(outgoing);
}

static bool may_be_told(const struct skd_daemon *daemon, const struct skd_live *live,
                        const struct skd_listener_of_session *listener)
{
    const struct skd_connection *connection = skd_listener_connection(daemon, listener);
    return connection != NULL && listener->making == 0 &&
           listener->told == live->durable_revision && skd_connection_idle(connection);
}

/* One message for all who speak alike. A connection that closes on the way takes its listener with
 * it, hence the copy of `next`. */
static void tell_all(struct skd_daemon *daemon, struct skd_live *live)
{
    struct skd_outgoing *frame = make_message(daemon, live, SKD_WIRE_FRAMES);
    struct skd_outgoing *line = make_message(daemon, live, SKD_WIRE_LINES);
    struct skd_listener_of_session *listener, *next;
    HASH_ITER(hh, live->listeners, listener, next)
    {
        struct skd_connection *connection = skd_listener_connection(daemon, listener);
        if (!may_be_told(daemon, live, listener))
            continue;
        bool frames = skd_connection_mode(connection) == SKD_WIRE_FRAMES;
        if (listener->presence_told < live->presence_due)
            send_to(live, listener, connection, frames ? frame : line);
        else
            (void)skd_claims_tell(daemon, live, listener);
    }
    skd_outgoing_release(frame);
    skd_outgoing_release(line);
}

static void on_closed(uv_handle_t *timer)
{
    free(timer);
}

static void on_gathered(uv_timer_t *timer)
{
    struct skd_daemon *daemon = timer->data;
    struct skd_live *live, *next;
    daemon->presence = NULL;
    uv_close((uv_handle_t *)timer, on_closed);
    HASH_ITER(hh, daemon->sessions, live, next)
    {
        if (live->presence_due == live->presence_changes)
            continue;
        live->presence_due = live->presence_changes;
        tell_all(daemon, live);
    }
}

void skd_presence_changed(struct skd_daemon *daemon, struct skd_live *live)
{
    unsigned listeners = (unsigned)skd_listener_count(live);
    live->presence_changes++;
    if (daemon->presence != NULL || listeners == 0 || daemon->stopping)
        return;
    daemon->presence = malloc(sizeof *daemon->presence);
    if (daemon->presence == NULL)
        return; /* the next change tells this one too */
    uv_timer_init(daemon->loop, daemon->presence);
    daemon->presence->data = daemon;
    uv_timer_start(daemon->presence, on_gathered, GATHER_MS + listeners, 0);
}

void skd_presence_leave(struct skd_daemon *daemon, const struct skd_connection *connection)
{
    struct skd_live *live, *next;
    HASH_ITER(hh, daemon->sessions, live, next)
    {
        if (skd_listener_detach(live, connection->id))
            skd_presence_changed(daemon, live);
    }
}
