/* See claims.h. */
#include "requests/claims.h"

#include "requests/handlers.h"
#include "requests/live.h"
#include "requests/presence.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A line that names more vertices leaves them out: session.presence tells how many there are. */
enum { LINE_VERTICES_MAX = 16384 };

struct skd_claim {
    int references; /* the loop's */
    size_t bytes;
    int bone_count;
    uint16_t *bones;  /* [bone_count] rising */
    uint8_t *is_bone; /* [bones of the rig] */
    size_t vertex_count;
    uint32_t *vertices; /* [vertex_count] rising */
    uint8_t *bits;      /* the same, a bit a vertex of the rig; NULL where there are none */
};

static struct skd_claim *hold(struct skd_claim *claim)
{
    claim->references++;
    return claim;
}

static void release(struct skd_claim *claim)
{
    if (claim == NULL || --claim->references > 0)
        return;
    free(claim->bones);
    free(claim->is_bone);
    free(claim->vertices);
    free(claim->bits);
    free(claim);
}

static void release_claim(void *claim)
{
    release(claim);
}

static bool has_bit(const uint8_t *bits, uint32_t vertex)
{
    return (bits[vertex >> 3] >> (vertex & 7) & 1) != 0;
}

/* ---- making one ----------------------------------------------------------------------------- */

struct claiming {
    struct skd_claim *claim;
    uint64_t number; /* of the listener's requests */
};

static enum skd_status take_bones(struct skd_claim *claim, const struct skd_skeleton *skeleton,
                                  const struct skd_session_claim_params *params,
                                  struct skd_error *error)
{
    claim->is_bone = calloc((size_t)skeleton->bone_count, 1);
    claim->bones = calloc((size_t)skeleton->bone_count, sizeof *claim->bones);
    if (claim->is_bone == NULL || claim->bones == NULL)
        return skd_fail_memory(error, "a claim");
    for (size_t i = 0; i < params->bone_count; i++) {
        bool found = false;
        for (int bone = 0; bone < skeleton->bone_count; bone++) {
            if (strcmp(skeleton->names[bone], params->bones[i]) == 0)
                claim->is_bone[bone] = 1, found = true;
        }
        if (!found)
            return skd_fail(error, SKD_NO_BONE,
                            "bones names \"%s\", which is no bone of session "
                            "\"%s\"",
                            params->bones[i], params->session);
    }
    for (int bone = 0; bone < skeleton->bone_count; bone++) {
        if (claim->is_bone[bone] != 0)
            claim->bones[claim->bone_count++] = (uint16_t)bone;
    }
    claim->bytes += (size_t)skeleton->bone_count * (1 + sizeof *claim->bones);
    return SKD_OK;
}

static enum skd_status take_vertices(struct skd_claim *claim, const struct skd_session *session,
                                     const struct skd_array *named, struct skd_error *error)
{
    const uint32_t *vertices = named->data;
    size_t all = session->rig->mesh.vertex_count;
    if (named->count == 0)
        return SKD_OK;
    enum skd_status status = skd_session_check_vertices(session, vertices, named->count, error);
    if (status != SKD_OK)
        return status;
    claim->bits = calloc(all / 8 + 1, 1);
    if (claim->bits == NULL)
        return skd_fail_memory(error, "a claim");
    for (size_t i = 0; i < named->count; i++) {
        uint8_t bit = (uint8_t)(1U << (vertices[i] & 7));
        claim->vertex_count += (claim->bits[vertices[i] >> 3] & bit) == 0;
        claim->bits[vertices[i] >> 3] |= bit;
    }
    claim->vertices = malloc(claim->vertex_count * sizeof *claim->vertices);
    if (claim->vertices == NULL)
        return skd_fail_memory(error, "a claim");
    size_t count = 0;
    for (uint32_t vertex = 0; vertex < all; vertex++) {
        if (has_bit(claim->bits, vertex))
            claim->vertices[count++] = vertex;
    }
    claim->bytes += all / 8 + 1 + count * sizeof *claim->vertices;
    return SKD_OK;
}

/* Thread: a worker. The rig never changes, so this needs no turn. */
static enum skd_status make(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session_claim_params *params = &call->request.params.session_claim;
    const struct skd_session *session = call->live->session;
    struct claiming *claiming = call->state;
    struct skd_claim *claim = calloc(1, sizeof *claim);
    if (claim == NULL)
        return skd_fail_memory(error, "a claim");
    claim->references = 1;
    claim->bytes = sizeof *claim;
    claiming->claim = claim;
    enum skd_status status = take_bones(claim, &session->rig->skeleton, params, error);
    if (status == SKD_OK)
        status = take_vertices(claim, session, &params->vertices, error);
    if (status != SKD_OK)
        return status;
    cJSON *body = call->reply.body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", call->live->name);
    cJSON_AddNumberToObject(body, "vertices", (double)claim->vertex_count);
    return SKD_OK;
}

void skd_claim_drop(struct skd_live *live, struct skd_listener_of_session *listener)
{
    if (listener->claim == NULL)
        return;
    live->claim_bytes -= listener->claim->bytes;
    release(listener->claim);
    listener->claim = NULL;
}

static enum skd_status put(struct skd_call *call, struct skd_listener_of_session *listener,
                           struct skd_error *error)
{
    struct claiming *claiming = call->state;
    struct skd_claim *claim = claiming->claim;
    struct skd_live *live = call->live;
    bool claims = claim->bone_count > 0 || claim->vertex_count > 0;
    size_t before = listener->claim != NULL ? listener->claim->bytes : 0;
    if (claims && live->claim_bytes - before + claim->bytes > SKD_CLAIM_BYTES_MAX)
        return skd_fail(
            error, SKD_TOO_LARGE,
            "the claims of session \"%s\" take %zu MiB, which is the limit; claim bones",
            live->name, SKD_CLAIM_BYTES_MAX >> 20);
    if (claiming->number < listener->claim_asked)
        return SKD_OK; /* a later one has come meanwhile, and is to hold */
    skd_claim_drop(live, listener);
    if (claims) {
        listener->claim = hold(claim);
        live->claim_bytes += claim->bytes;
    }
    listener->claim_change = ++live->claim_changes;
    skd_presence_changed(call->daemon, live);
    return SKD_OK;
}

static enum skd_status fail_detached(const struct skd_call *call, struct skd_error *error)
{
    return skd_fail(error, SKD_BAD_PARAMS, "session.claim: attach to session \"%s\" first",
                    call->request.params.session_claim.session);
}

static void made(struct skd_call *call)
{
    struct skd_live *live = call->live; /* held */
    struct skd_listener_of_session *listener = skd_live_listener(live, call->connection_id);
    enum skd_status status = call->status;
    if (status == SKD_OK)
        status = listener != NULL ? put(call, listener, &call->error)
                                  : fail_detached(call, &call->error);
    if (status != SKD_OK && call->status == SKD_OK) {
        skd_encoded_finish(&call->encoded);
        skd_call_fail(call, &call->error);
    } else {
        skd_call_finish(call);
    }
    skd_live_release(live);
}

static void dismiss(struct skd_call *call)
{
    struct claiming *claiming = call->state;
    release(claiming->claim);
    free(claiming);
}

void skd_handle_session_claim(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session_claim.session);
    struct skd_error error;
    if (live == NULL)
        return;
    struct skd_listener_of_session *listener = skd_live_listener(live, call->connection_id);
    struct claiming *claiming = listener != NULL ? calloc(1, sizeof *claiming) : NULL;
    if (claiming == NULL) {
        (void)(listener == NULL ? fail_detached(call, &error)
                                : skd_fail_memory(&error, "a request"));
        skd_call_fail(call, &error);
        return;
    }
    claiming->number = ++listener->claim_asked;
    call->state = claiming;
    call->dismiss = dismiss;
    call->live = live;
    skd_live_hold(live);
    skd_call_work(call, make, made);
}

/* ---- telling them --------------------------------------------------------------------------- */

static void add_bones(cJSON *object, const struct skd_live *live, const struct skd_claim *claim)
{
    cJSON *bones = cJSON_AddArrayToObject(object, "bones");
    for (int i = 0; claim != NULL && i < claim->bone_count; i++)
        cJSON_AddItemToArray(
            bones, cJSON_CreateString(live->session->rig->skeleton.names[claim->bones[i]]));
}

cJSON *skd_claim_describe(const struct skd_live *live,
                          const struct skd_listener_of_session *listener)
{
    const struct skd_claim *claim = listener->claim;
    cJSON *object = cJSON_CreateObject();
    add_bones(object, live, claim);
    cJSON_AddNumberToObject(object, "vertices", claim != NULL ? (double)claim->vertex_count : 0);
    return object;
}

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
    cJSON_AddStringToObject(body, "client", whose != NULL ? whose->client : "");
    cJSON_AddStringToObject(body, "user", whose != NULL ? whose->user : "");
    add_bones(body, live, claim);
    if (skd_encode_notification(skd_connection_mode(to), "session.claims", body, &array, told,
                                &encoded, &error) != SKD_OK)
        return false;
    struct skd_outgoing *outgoing = skd_outgoing_create(
        &encoded, claim != NULL ? release_claim : NULL, claim != NULL ? hold(claim) : NULL);
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
        char who[2 * SKD_CLIENT_NAME_BYTES_MAX + 8];
    } items[];
};

/* Another tool: not the same one on an older connection either. */
static bool is_other(const struct skd_call *call, const struct skd_connection *connection)
{
    return connection != NULL && connection->id != call->connection_id &&
           strcmp(connection->client_id, call->client_id) != 0;
}

static void name_tool(const struct skd_connection *connection, char *who, size_t bytes)
{
    const char *client = connection->client[0] != '\0' ? connection->client : "another tool";
    if (connection->user[0] != '\0')
        (void)snprintf(who, bytes, "%s (%s)", connection->user, client);
    else
        (void)snprintf(who, bytes, "%s", client);
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
        item->claim = hold(listener->claim);
        name_tool(connection, item->who, sizeof item->who);
    }
    return seen;
}

void skd_claims_forget(struct skd_claims_seen *seen)
{
    if (seen == NULL)
        return;
    for (size_t i = 0; i < seen->count; i++)
        release(seen->items[i].claim);
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

static bool covers(const struct skd_claim *claim, uint32_t vertex, uint16_t bone)
{
    return (claim->bits != NULL && has_bit(claim->bits, vertex)) ||
           (bone != SKD_SLOT_EMPTY && claim->is_bone[bone] != 0);
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
        while (of < seen->count && !covers(seen->items[of].claim, step->vertices[i], bone))
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
