/* See claims.h. */
#include "requests/claims.h"

#include "requests/claim.h"
#include "requests/listeners.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A line that names more vertices leaves them out: session.presence tells how many there are. */
enum { LINE_VERTICES_MAX = 16384 };

/* The oldest change of another's claim that the listener was not told; those before it came only
 * as far as they still hold. */
static const struct skd_listener_of_session *
find_untold(const struct skd_live *live, const struct skd_listener_of_session *listener)
{
    const struct skd_listener_of_session *other, *oldest = NULL;
    for (other = live->listeners; other != NULL; other = other->hh.next) {
        bool concerns = other->claim != NULL || other->claim_change > listener->claims_at_attach;
        if (other != listener && concerns && other->claim_change > listener->claims_told &&
            (oldest == NULL || other->claim_change < oldest->claim_change))
            oldest = other;
    }
    return oldest;
}

bool skd_claims_tell(struct skd_daemon *daemon, const struct skd_live *live,
                     struct skd_listener_of_session *listener)
{
    static const uint32_t none[1];
    struct skd_connection *to = skd_listener_connection(daemon, listener);
    if (listener->claims_told == live->claim_changes || to == NULL)
        return false;
    const struct skd_listener_of_session *other = find_untold(live, listener);
    if (other == NULL) {
        listener->claims_told = live->claim_changes;
        return false;
    }
    struct skd_connection *whose = skd_listener_connection(daemon, other);
    struct skd_claim *claim = other->claim;
    size_t count = claim != NULL ? claim->vertex_count : 0;
    const struct skd_array_out array = {"vertices", SKD_U32, count, 0,
                                        count > 0 ? claim->vertices : none};
    bool told = skd_connection_mode(to) == SKD_WIRE_FRAMES || count <= LINE_VERTICES_MAX;
    struct skd_encoded encoded;
    struct skd_error error;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", live->name);
    cJSON_AddNumberToObject(body, "connection", (double)other->connection_id);
    cJSON_AddStringToObject(body, "client", whose != NULL ? whose->author.client : "");
    cJSON_AddStringToObject(body, "user", whose != NULL ? whose->author.user : "");
    skd_claim_add_bones(body, live, claim);
    if (skd_encode_notification(skd_connection_mode(to), "session.claims", body, &array, told,
                                &encoded, &error) != SKD_OK)
        return false;
    struct skd_outgoing *outgoing =
        skd_outgoing_create(&encoded, claim != NULL ? skd_claim_release : NULL,
                            claim != NULL ? skd_claim_hold(claim) : NULL);
    if (outgoing == NULL)
        return false;
    listener->claims_told = other->claim_change;
    skd_connection_send(to, outgoing);
    skd_outgoing_release(outgoing);
    return true;
}

/* ---- a stroke that runs into them ----------------------------------------------------------- */

struct skd_claims_seen {
    size_t count;
    struct seen_claim {
        struct skd_claim *claim; /* held */
        char who[SKD_AUTHOR_TEXT_BYTES];
    } items[];
};

/* Another tool: not the same one on an older connection either. */
static bool is_other(const struct skd_call *call, const struct skd_connection *connection)
{
    return connection != NULL && connection->id != call->connection_id &&
           strcmp(connection->author.id, call->author.id) != 0;
}

struct skd_claims_seen *skd_claims_look(const struct skd_call *call)
{
    const struct skd_live *live = call->live;
    const struct skd_listener_of_session *listener;
    size_t most = 0;
    if (live->claim_bytes == 0)
        return NULL;
    for (listener = live->listeners; listener != NULL; listener = listener->hh.next) {
        most += listener->claim != NULL;
    }
    struct skd_claims_seen *seen = calloc(1, sizeof *seen + most * sizeof seen->items[0]);
    if (seen == NULL)
        return NULL;
    for (listener = live->listeners; listener != NULL; listener = listener->hh.next) {
        const struct skd_connection *connection = skd_listener_connection(call->daemon, listener);
        if (listener->claim == NULL || !is_other(call, connection))
            continue;
        struct seen_claim *item = &seen->items[seen->count++];
        item->claim = skd_claim_hold(listener->claim);
        (void)skd_author_text(&connection->author, item->who);
    }
    return seen;
}

void skd_claims_forget(struct skd_claims_seen *seen)
{
    if (seen == NULL)
        return;
    for (size_t i = 0; i < seen->count; i++)
        skd_claim_release(seen->items[i].claim);
    free(seen);
}

/* The bone with the largest weight; of equals the first. */
static uint16_t heaviest_bone(const struct skd_session *session, const struct skd_step *step,
                              size_t item)
{
    size_t slots = (size_t)step->slot_count;
    const float *weights = step->before + item * slots;
    const uint16_t *joints = step->joints_before != NULL
                                 ? step->joints_before + item * slots
                                 : session->joints + step->vertices[item] * slots;
    size_t heaviest = 0;
    for (size_t slot = 1; slot < slots; slot++) {
        if (weights[slot] > weights[heaviest])
            heaviest = slot;
    }
    return joints[heaviest];
}

void skd_claims_warn(const struct skd_claims_seen *seen, const struct skd_session *session,
                     const struct skd_step *step, cJSON *warnings)
{
    size_t count = 0, owners = 0;
    const char *who = NULL;
    if (seen == NULL)
        return;
    for (size_t i = 0; i < step->count; i++) {
        uint16_t bone = heaviest_bone(session, step, i);
        size_t of = 0;
        while (of < seen->count &&
               !skd_claim_covers(seen->items[of].claim, step->vertices[i], bone))
            of++;
        if (of == seen->count)
            continue;
        count++;
        owners += who != seen->items[of].who;
        who = seen->items[of].who;
    }
    if (count == 0)
        return;
    char text[256];
    (void)snprintf(text, sizeof text, "%zu of these vertices %s claimed by %s%s", count,
                   count == 1 ? "is" : "are", who, owners > 1 ? " and others" : "");
    cJSON *item = cJSON_CreateObject();
    cJSON_AddStringToObject(item, "name", "claimed");
    cJSON_AddNumberToObject(item, "count", (double)count);
    cJSON_AddStringToObject(item, "text", text);
    cJSON_AddItemToArray(warnings, item);
}
