/* pins.list, pins.get, shapes.list, shapes.get: what a session holds pose by pose.
 *
 * Stage: job -> reply. Thread: the loop looks poses up by name, a worker reads the sheets; both in
 * the session's turn.
 */
#include "requests/handlers.h"

#include <stdlib.h>
#include <string.h>

/* The sheets of one kind that have rows, and which of them belong to what their pose's name stands
 * for now. */
struct layers {
    const struct skd_sheets *sheets;
    size_t count;
    const struct skd_sheet *used[SKD_TARGET_POSES_MAX];
    bool is_current[SKD_TARGET_POSES_MAX];
};

static void look_up(const struct skd_session *session, struct layers *layers)
{
    size_t bytes = (size_t)session->rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof(double);
    for (size_t i = 0; i < layers->sheets->count; i++) {
        const struct skd_sheet *sheet = layers->sheets->items[i];
        if (sheet->used == 0)
            continue;
        const struct skd_pose *named = skd_poses_find(&session->poses, sheet->pose->name);
        SKD_ASSERT(layers->count < SKD_TARGET_POSES_MAX);
        layers->used[layers->count] = sheet;
        layers->is_current[layers->count++] =
            named != NULL && memcmp(named->matrices, sheet->pose->matrices, bytes) == 0;
    }
}

static double mean_weight(const struct skd_sheets *sheets, const struct skd_sheet *sheet)
{
    double sum = 0.0;
    for (size_t v = 0; v < sheets->vertex_count; v++) {
        const float *row = skd_sheet_row(sheets, sheet, (uint32_t)v);
        sum += row != NULL ? (double)row[3] : 0.0;
    }
    return sum / (double)sheet->used;
}

static cJSON *describe(const struct layers *layers, bool has_weight)
{
    const struct skd_sheets *sheets = layers->sheets;
    cJSON *list = cJSON_CreateArray();
    for (size_t i = 0; i < layers->count; i++) {
        const struct skd_sheet *sheet = layers->used[i];
        cJSON *item = cJSON_CreateObject();
        cJSON_AddStringToObject(item, "pose", sheet->pose->name);
        cJSON_AddNumberToObject(item, "vertices", (double)sheet->used);
        if (has_weight)
            cJSON_AddNumberToObject(item, "weight", mean_weight(sheets, sheet));
        cJSON_AddBoolToObject(item, "current", layers->is_current[i]);
        cJSON_AddItemToArray(list, item);
    }
    return list;
}

static enum skd_status list_pins(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session *session = call->live->session;
    (void)error;
    call->reply.body = cJSON_CreateObject();
    cJSON_AddNumberToObject(call->reply.body, "revision", (double)session->revision);
    cJSON_AddItemToObject(call->reply.body, "pins", describe(call->state, true));
    return SKD_OK;
}

static enum skd_status list_shapes(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session *session = call->live->session;
    (void)error;
    call->reply.body = cJSON_CreateObject();
    cJSON_AddNumberToObject(call->reply.body, "revision", (double)session->revision);
    cJSON_AddItemToObject(call->reply.body, "shapes", describe(call->state, false));
    cJSON_AddNumberToObject(call->reply.body, "rest_moved",
                            (double)skd_session_count_moved(session));
    return SKD_OK;
}

/* The sheet of a pose's name: that of its present matrices, or else the first of the name. */
static const struct skd_sheet *find(const struct layers *layers, const char *name)
{
    const struct skd_sheet *found = NULL;
    for (size_t i = 0; i < layers->count; i++) {
        const struct skd_sheet *sheet = layers->used[i];
        if (strcmp(sheet->pose->name, name) != 0)
            continue;
        if (layers->is_current[i])
            return sheet;
        found = found != NULL ? found : sheet;
    }
    return found;
}

/* One block: vertices, then their rows taken apart: three numbers a vertex, and what follows. */
static enum skd_status get(struct skd_call *call, const char *numbers_name, struct skd_error *error)
{
    const struct skd_session *session = call->live->session;
    const struct layers *layers = call->state;
    const struct skd_sheets *sheets = layers->sheets;
    const struct skd_sheet *sheet = find(layers, call->request.params.pins.pose);
    struct skd_reply *reply = &call->reply;
    size_t count = sheet != NULL ? sheet->used : 0;
    uint32_t *vertices = malloc(count * (sizeof *vertices + 4 * sizeof(float)) + 1);
    if (vertices == NULL)
        return skd_fail_memory(error, "the targets");
    float *numbers = (float *)(vertices + count), *weights = numbers + 3 * count;
    if (sheet != NULL)
        skd_sheet_list(sheets, sheet, vertices);
    for (size_t i = 0; i < count; i++) {
        const float *row = skd_sheet_row(sheets, sheet, vertices[i]);
        memcpy(numbers + 3 * i, row, 3 * sizeof *row);
        weights[i] = sheets->width > 3 ? row[3] : 0.0f;
    }
    reply->body = cJSON_CreateObject();
    cJSON_AddNumberToObject(reply->body, "revision", (double)session->revision);
    reply->arrays[0] = (struct skd_array_out){"vertices", SKD_U32, count, 0, vertices};
    reply->arrays[1] = (struct skd_array_out){numbers_name, SKD_F32, count, 3, numbers};
    reply->arrays[2] = (struct skd_array_out){"weights", SKD_F32, count, 0, weights};
    reply->array_count = sheets->width > 3 ? 3 : 2;
    reply->owner = vertices;
    reply->release = free;
    return SKD_OK;
}

static enum skd_status get_pins(struct skd_call *call, struct skd_error *error)
{
    return get(call, "positions", error);
}

static enum skd_status get_shape(struct skd_call *call, struct skd_error *error)
{
    return get(call, "offsets", error);
}

/* What each of the methods reads, and how it answers. */
static const struct {
    bool of_shapes;
    enum skd_status (*run)(struct skd_call *call, struct skd_error *error);
} methods[SKD_REQUEST_METHOD_COUNT] = {
    [SKD_REQUEST_PINS_LIST] = {false, list_pins},
    [SKD_REQUEST_PINS_GET] = {false, get_pins},
    [SKD_REQUEST_SHAPES_LIST] = {true, list_shapes},
    [SKD_REQUEST_SHAPES_GET] = {true, get_shape},
};

static void begin(struct skd_call *call)
{
    const struct skd_session *session = call->live->session;
    struct layers *layers = call->state;
    bool of_shapes = methods[call->request.method].of_shapes;
    layers->sheets = of_shapes ? &session->shapes : &session->pins;
    look_up(session, layers);
    skd_call_work(call, methods[call->request.method].run, NULL);
}

static void dismiss(struct skd_call *call)
{
    free(call->state);
}

static void take_turn(struct skd_call *call, const char *name)
{
    struct skd_live *live = skd_call_find_session(call, name);
    if (live == NULL)
        return;
    call->state = calloc(1, sizeof(struct layers));
    call->dismiss = dismiss;
    if (call->state == NULL) {
        struct skd_error error;
        (void)skd_fail_memory(&error, "a request");
        skd_call_fail(call, &error);
        return;
    }
    skd_call_take_turn(call, live, begin);
}

void skd_handle_pins_list(struct skd_call *call)
{
    take_turn(call, call->request.params.session.session);
}

void skd_handle_pins_get(struct skd_call *call)
{
    take_turn(call, call->request.params.pins.session);
}

void skd_handle_shapes_list(struct skd_call *call)
{
    take_turn(call, call->request.params.session.session);
}

void skd_handle_shapes_get(struct skd_call *call)
{
    take_turn(call, call->request.params.pins.session);
}
