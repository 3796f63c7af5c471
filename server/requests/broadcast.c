/* See broadcast.h. */
#include "requests/broadcast.h"

static void send_to_mode(struct skd_daemon *daemon, enum skd_wire_mode mode,
                         struct skd_outgoing *outgoing)
{
    struct skd_connection *connection, *next;
    HASH_ITER(hh, daemon->connections, connection, next)
    {
        if (connection->greeted && skd_connection_mode(connection) == mode)
            skd_connection_send(connection, outgoing);
    }
}

void skd_broadcast(struct skd_daemon *daemon, const char *method, cJSON *body)
{
    static const enum skd_wire_mode modes[] = {SKD_WIRE_FRAMES, SKD_WIRE_LINES};
    for (size_t i = 0; i < 2; i++) {
        struct skd_encoded encoded;
        struct skd_error error;
        if (skd_encode_notification(modes[i], method, cJSON_Duplicate(body, true), NULL, 0,
                                    &encoded, &error) != SKD_OK)
            continue;
        struct skd_outgoing *outgoing = skd_outgoing_create(&encoded, NULL, NULL);
        if (outgoing == NULL)
            continue;
        send_to_mode(daemon, modes[i], outgoing);
        skd_outgoing_release(outgoing);
    }
    cJSON_Delete(body);
}
