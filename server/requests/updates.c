/* See updates.h. */
#include "requests/updates.h"

#include "base/log.h"
#include "protocol/json_memory.h"
#include "requests/listeners.h"
#include "requests/live.h"
#include "requests/merging.h"
#include "requests/presence.h"

#include <stdlib.h>
#include <string.h>

/* What is made for one message holds no more memory than this; a larger change goes out straight
 * from its step. */
static const size_t MERGED_BYTES_MAX = (size_t)3 << 20;

/* Spelling out more than this in a line helps nobody. */
static const size_t LINE_ROWS_MAX = 16384;

/* One message to all listeners that were told up to the same revision. */
struct update {
    uv_work_t work;
    struct skd_daemon *daemon;
    struct skd_live *live; /* held */
    uint64_t number;
    enum skd_wire_mode mode;
    char instance[SKD_INSTANCE_BYTES + 1];
    uint64_t since;
    uint64_t revision;
    bool resync;
    bool merges; /* arrays of several steps */
    size_t rows; /* at most */
    struct skd_merged *merged;
    struct skd_encoded encoded;
    enum skd_status status;
    struct skd_error error;
    size_t change_count;
    struct skd_change changes[]; /* [change_count] held; where they are not told, the last one */
};

/* ---- the message ---------------------------------------------------------------------------- */

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

static int merged_arrays(const struct skd_merged *merged,
                         struct skd_array_out arrays[SKD_STEP_ARRAYS])
{
    size_t count = merged->count, slots = (size_t)merged->slot_count;
    int used = 0;
    arrays[used++] = (struct skd_array_out){"vertices", SKD_U32, count, 0, merged->vertices};
    arrays[used++] = (struct skd_array_out){"weights", SKD_F32, count, slots, merged->weights};
    if (merged->joints != NULL)
        arrays[used++] = (struct skd_array_out){"joints", SKD_U16, count, slots, merged->joints};
    if (merged->rest != NULL)
        arrays[used++] = (struct skd_array_out){"rest", SKD_F32, count, 3, merged->rest};
    if (merged->offsets != NULL)
        arrays[used++] =
            (struct skd_array_out){"offsets", SKD_F32, count, SKD_SHAPE_NUMBERS, merged->offsets};
    return used;
}

/* The change whose arrays go out: the last that tells vertices, else the last. */
static const struct skd_change *telling(const struct update *update)
{
    for (size_t i = update->change_count; i-- > 0;)
        if (update->changes[i].step->count > 0)
            return &update->changes[i];
    return &update->changes[update->change_count - 1];
}

static void add_changes(cJSON *body, const struct update *update)
{
    cJSON *list = cJSON_AddArrayToObject(body, "changes");
    for (size_t i = 0; i < update->change_count; i++) {
        const struct skd_change *change = &update->changes[i];
        cJSON *item = cJSON_CreateObject();
        cJSON_AddNumberToObject(item, "revision", (double)change->revision);
        cJSON_AddStringToObject(item, "cause", change->cause);
        cJSON_AddStringToObject(item, "client", change->author.client);
        cJSON_AddStringToObject(item, "user", change->author.user);
        cJSON_AddItemToArray(list, item);
    }
}

static cJSON *describe(const struct update *update)
{
    const struct skd_change *last = &update->changes[update->change_count - 1];
    const struct skd_change *told = telling(update);
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", update->live->name);
    cJSON_AddStringToObject(body, "instance", update->instance);
    cJSON_AddNumberToObject(body, "since", (double)update->since);
    cJSON_AddNumberToObject(body, "revision", (double)update->revision);
    cJSON_AddStringToObject(body, "cause", last->cause);
    cJSON_AddStringToObject(body, "client", last->author.client);
    cJSON_AddStringToObject(body, "user", last->author.user);
    cJSON_AddNumberToObject(body, "influences", last->step->slot_count);
    if (update->change_count > 1)
        add_changes(body, update);
    if (update->resync)
        cJSON_AddTrueToObject(body, "resync");
    else if (told->shape != NULL)
        cJSON_AddStringToObject(body, "shape", told->shape->name);
    return body;
}

/* Thread: a worker, or the loop where there is nothing to merge or spell out. */
static void encode(struct update *update)
{
    struct skd_array_out arrays[SKD_STEP_ARRAYS];
    const struct skd_change *told = telling(update);
    int count = 0;
    update->status = SKD_OK;
    if (update->merges)
        update->status = skd_merge(update->changes, update->change_count,
                                   update->live->session->rig->mesh.vertex_count, update->rows,
                                   &update->merged, &update->error);
    if (update->status != SKD_OK)
        return;
    if (update->merged != NULL)
        count = merged_arrays(update->merged, arrays);
    else if (!update->resync)
        count = skd_step_arrays(told->step, told->undo, 0, told->step->count, arrays);
    update->status = skd_encode_notification(update->mode, "session.update", describe(update),
                                             arrays, count, &update->encoded, &update->error);
}

/* ---- from the ring to the listeners --------------------------------------------------------- */

/* What fetching the weights anew would bring. */
static size_t snapshot_bytes(const struct skd_session *session)
{
    size_t slots = (size_t)session->slot_count;
    return session->rig->mesh.vertex_count * slots * (sizeof(float) + sizeof(uint16_t));
}

/* The next run. False, `resync`: where the ring does not reach back, where a message would be too
 * long, and where what waits is too much to be merged and more than everything would be. */
static bool pick_run(struct skd_live *live, uint64_t told, enum skd_wire_mode mode,
                     struct skd_run *first)
{
    size_t rows_max = mode == SKD_WIRE_FRAMES ? SIZE_MAX : LINE_ROWS_MAX;
    size_t bytes = 0;
    if (skd_changes_find(&live->changes, told + 1) == NULL)
        return false;
    *first = skd_run_take(live, told, MERGED_BYTES_MAX, rows_max);
    if (first->rows > rows_max || first->rows * first->row_bytes > SKD_FRAME_BYTES_MAX / 2)
        return false;
    struct skd_run run = *first;
    while (run.last < live->durable_revision) {
        run = skd_run_take(live, run.last, MERGED_BYTES_MAX, rows_max);
        bytes += run.rows * run.row_bytes;
    }
    return bytes <= MERGED_BYTES_MAX || bytes <= snapshot_bytes(live->session);
}

static void destroy(struct update *update)
{
    for (size_t i = 0; i < update->change_count; i++)
        skd_change_release(&update->changes[i]);
    skd_merged_destroy(update->merged);
    skd_encoded_finish(&update->encoded);
    skd_live_release(update->live);
    free(update);
}

/* NULL: no memory. */
static struct update *create(struct skd_daemon *daemon, struct skd_live *live, uint64_t told,
                             enum skd_wire_mode mode)
{
    struct skd_run run;
    bool resync = !pick_run(live, told, mode, &run);
    if (resync)
        run = (struct skd_run){.last = live->durable_revision};
    uint64_t revision = run.last;
    size_t count = resync ? 1 : (size_t)(revision - told);
    struct update *update = calloc(1, sizeof *update + count * sizeof update->changes[0]);
    if (update == NULL)
        return NULL;
    skd_live_hold(live);
    update->work.data = update;
    update->daemon = daemon;
    update->live = live;
    update->number = ++daemon->updates_made;
    update->mode = mode;
    memcpy(update->instance, live->session->instance, sizeof update->instance);
    update->since = told;
    update->revision = revision;
    update->resync = resync;
    update->merges = run.sources > 1;
    update->rows = run.rows;
    update->change_count = count;
    for (size_t i = 0; i < count; i++)
        update->changes[i] =
            skd_change_copy(skd_changes_nearest(&live->changes, revision - count + 1 + i));
    return update;
}

static void release_merged(void *merged)
{
    skd_merged_destroy(merged);
}

static void release_step(void *step)
{
    skd_step_release(step);
}

/* The message with what its arrays lie in. */
static struct skd_outgoing *wrap(struct update *update)
{
    struct skd_merged *merged = update->merged;
    update->merged = NULL;
    if (merged != NULL)
        return skd_outgoing_create(&update->encoded, release_merged, merged);
    return skd_outgoing_create(&update->encoded, release_step,
                               skd_step_hold(telling(update)->step));
}

/* Sends it to those that it was made for and that wait for it still (attaching anew, a listener may
 * have said that it has something else), or hangs up on them where there was no memory for it:
 * they come back and say what they have. A connection that closes takes its listener with it, hence
 * the copy of `next`. */
static void deliver(struct update *update)
{
    struct skd_live *live = update->live;
    struct skd_listener_of_session *listener, *next;
    struct skd_outgoing *outgoing = update->status == SKD_OK ? wrap(update) : NULL;
    if (update->status != SKD_OK)
        skd_log(SKD_LOG_ERROR, "session \"%s\": an update was not sent: %s", live->name,
                update->error.text);
    HASH_ITER(hh, live->listeners, listener, next)
    {
        struct skd_connection *connection = skd_listener_connection(update->daemon, listener);
        if (listener->making != update->number)
            continue;
        listener->making = 0;
        listener->told = update->revision;
        if (connection != NULL && outgoing != NULL)
            skd_connection_send(connection, outgoing);
        else if (connection != NULL)
            skd_connection_close(connection);
    }
    skd_outgoing_release(outgoing);
}

static void encode_in_worker(uv_work_t *work)
{
    (void)skd_json_memory_ran_out(); /* what an earlier message of this thread lacked */
    encode(work->data);
}

static void encoded(uv_work_t *work, int status)
{
    struct update *update = work->data;
    struct skd_daemon *daemon = update->daemon;
    struct skd_live *live = update->live;
    SKD_ASSERT(status == 0);
    /* Listeners may have drained meanwhile, and will not do so again by themselves. */
    deliver(update);
    if (!live->closed)
        skd_updates_flush(daemon, live);
    destroy(update);
}

/* Its message is written and it is not being made one. */
static bool is_ready(const struct skd_daemon *daemon,
                     const struct skd_listener_of_session *listener)
{
    struct skd_connection *connection = skd_listener_connection(daemon, listener);
    return connection != NULL && listener->making == 0 && skd_connection_idle(connection);
}

/* Starts the next message of a listener that is behind, for all others who wait for the same. */
static void tell(struct skd_daemon *daemon, struct skd_live *live,
                 const struct skd_listener_of_session *first)
{
    struct skd_connection *connection = skd_listener_connection(daemon, first);
    enum skd_wire_mode mode = skd_connection_mode(connection);
    uint64_t told = first->told;
    struct update *update = create(daemon, live, told, mode);
    struct skd_listener_of_session *listener;
    if (update == NULL) {
        skd_connection_close(connection);
        return;
    }
    for (listener = live->listeners; listener != NULL; listener = listener->hh.next) {
        if (listener->told == told && is_ready(daemon, listener) &&
            skd_connection_mode(skd_listener_connection(daemon, listener)) == mode)
            listener->making = update->number;
    }
    bool spells = mode != SKD_WIRE_FRAMES && update->rows > 0 && !update->resync;
    if (update->merges || spells) {
        int result = uv_queue_work(daemon->loop, &update->work, encode_in_worker, encoded);
        SKD_ASSERT(result == 0);
        return;
    }
    encode(update);
    deliver(update);
    destroy(update);
}

/* Whose answer tells a change, and who has all before it, is told nothing. */
static void settle(struct skd_live *live)
{
    while (live->settled_revision < live->durable_revision) {
        struct skd_listener_of_session *listener;
        uint64_t revision = ++live->settled_revision;
        const struct skd_change *change = skd_changes_find(&live->changes, revision);
        if (change == NULL || change->knower == 0)
            continue;
        listener = skd_listener_find(live, change->knower);
        if (listener != NULL && listener->told + 1 == revision)
            listener->told = revision;
    }
}

static struct skd_listener_of_session *find_behind(const struct skd_daemon *daemon,
                                                   const struct skd_live *live)
{
    struct skd_listener_of_session *listener;
    for (listener = live->listeners; listener != NULL; listener = listener->hh.next) {
        if (listener->told < live->durable_revision && is_ready(daemon, listener))
            return listener;
    }
    return NULL;
}

void skd_updates_flush(struct skd_daemon *daemon, struct skd_live *live)
{
    struct skd_listener_of_session *listener;
    settle(live);
    while ((listener = find_behind(daemon, live)) != NULL)
        tell(daemon, live, listener);
}

void skd_updates_drained(struct skd_daemon *daemon, const struct skd_connection *connection)
{
    struct skd_live *live, *next;
    HASH_ITER(hh, daemon->sessions, live, next)
    {
        struct skd_listener_of_session *listener;
        listener = skd_listener_find(live, connection->id);
        if (listener == NULL || !is_ready(daemon, listener))
            continue;
        if (listener->told < live->durable_revision)
            tell(daemon, live, listener);
        else
            skd_presence_tell(daemon, live, listener);
    }
}

bool skd_updates_follow(struct skd_live *live, struct skd_listener_of_session *listener,
                        bool has_revision, uint64_t revision)
{
    uint64_t newest = live->durable_revision;
    bool reached = has_revision && revision <= newest &&
                   (revision == newest || skd_changes_find(&live->changes, revision + 1) != NULL);
    listener->making = 0;
    listener->told = reached ? revision : newest;
    return reached;
}

/* ---- the end -------------------------------------------------------------------------------- */

static void send_to_mode(struct skd_daemon *daemon, struct skd_live *live, enum skd_wire_mode mode,
                         struct skd_outgoing *outgoing)
{
    struct skd_listener_of_session *listener, *next;
    HASH_ITER(hh, live->listeners, listener, next)
    {
        struct skd_connection *connection = skd_listener_connection(daemon, listener);
        if (connection != NULL && skd_connection_mode(connection) == mode)
            skd_connection_send(connection, outgoing);
    }
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
        send_to_mode(daemon, live, modes[i], outgoing);
        skd_outgoing_release(outgoing);
    }
}
