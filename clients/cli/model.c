/* See model.h. */
#include "clients/cli/model.h"

#include "clients/cli/cli.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum {
    PROCESSES = 4096, /* that are told apart in sequences */
    TRIES_MAX = 8,    /* of one request, which may be what the daemon dies of */
};

cJSON *skd_session_body(const char *session)
{
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", session);
    return body;
}

/* Milliseconds of the clock, and below them the process: they rise, and two processes of a
 * terminal, whose ids are near each other, do not choose the same. Below 2^53 until 2039; as text,
 * because cJSON rounds what it prints of a number of more than 15 digits. */
void skd_add_sequence(cJSON *body)
{
    static int64_t last;
    struct timespec now;
    char digits[24];
    clock_gettime(CLOCK_REALTIME, &now);
    int64_t ms = (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
    int64_t next = ms * PROCESSES + getpid() % PROCESSES;
    last = next > last ? next : last + PROCESSES;
    (void)snprintf(digits, sizeof digits, "%lld", (long long)last);
    cJSON_AddRawToObject(body, "sequence", digits);
}

/* Connects anew, and makes sure that nothing that was answered is gone. */
static enum skd_status come_back(struct skd_model *model, struct skd_error *error)
{
    struct skd_message info = {0};
    skd_cli_say("the connection to skind broke off; connecting again");
    enum skd_status status = skd_cli_reconnect(model->link, error);
    if (status == SKD_OK)
        status = skd_link_call(model->link, "session.info", skd_session_body(model->session), NULL,
                               0, &info, error);
    if (status == SKD_OK && strcmp(skd_json_text(info.result, "instance"),
                                   skd_json_text(model->info.result, "instance")) != 0)
        status = skd_fail(error, SKD_DAMAGED,
                          "skind ended, and session \"%s\" came back at revision %.0f without its "
                          "last changes (durability %s)",
                          model->session, skd_json_number(info.result, "revision"),
                          skd_json_text(info.result, "durability"));
    skd_message_finish(&info);
    return status;
}

enum skd_status skd_model_call(struct skd_model *model, const char *method, cJSON *body,
                               const struct skd_array_out *arrays, int array_count,
                               struct skd_message *answer, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (int tries = 1;; tries++) {
        status = skd_link_call(model->link, method, cJSON_Duplicate(body, true), arrays,
                               array_count, answer, error);
        bool is_again = status == SKD_SHUTTING_DOWN && skd_link_is_lost(model->link);
        while (is_again && tries < TRIES_MAX && status == SKD_SHUTTING_DOWN) {
            status = come_back(model, error);
            tries++;
        }
        if (!is_again || status != SKD_OK)
            break;
        skd_message_finish(answer);
    }
    cJSON_Delete(body);
    return status;
}

enum skd_status skd_session_export(struct skd_model *model, const char *path,
                                   struct skd_message *answer, struct skd_error *error)
{
    cJSON *body = skd_session_body(model->session);
    cJSON_AddStringToObject(body, "path", path);
    return skd_model_call(model, "session.export", body, NULL, 0, answer, error);
}

void skd_fetched_finish(struct skd_fetched *fetched)
{
    skd_message_finish(&fetched->message);
    free(fetched->owned);
    *fetched = (struct skd_fetched){0};
}

/* Finds an array in the answer; it must have this many rows. */
static enum skd_status read_array(const struct skd_message *answer, const char *name,
                                  enum skd_dtype dtype, size_t width, size_t rows,
                                  struct skd_array *array, void **owned, struct skd_error *error)
{
    enum skd_status status =
        skd_message_array(answer, answer->result, name, dtype, width, array, owned, error);
    if (status == SKD_OK && array->rows != rows)
        status = skd_fail(error, SKD_INTERNAL, "skind sent %zu rows of %s where %zu were expected",
                          array->rows, name, rows);
    return status;
}

enum skd_status skd_model_open(struct skd_model *model, struct skd_link *link, const char *session,
                               struct skd_error *error)
{
    *model = (struct skd_model){.link = link};
    (void)snprintf(model->session, sizeof model->session, "%s", session);
    enum skd_status status = skd_link_call(link, "session.info", skd_session_body(session), NULL, 0,
                                           &model->info, error);
    if (status != SKD_OK)
        return status;
    const cJSON *info = model->info.result;
    model->vertex_count = (size_t)skd_json_number(info, "vertices");
    model->bone_count = (size_t)cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(info, "bones"));
    model->length = skd_json_number(info, "length");
    return SKD_OK;
}

void skd_model_close(struct skd_model *model)
{
    free(model->triangles_owned);
    free(model->joints_owned);
    skd_fetched_finish(&model->rest);
    skd_fetched_finish(&model->weights);
    skd_message_finish(&model->info);
    *model = (struct skd_model){0};
}

enum skd_status skd_change_call(struct skd_link *link, const char *session, const char *method,
                                cJSON *body, const struct skd_array_out *arrays, int array_count,
                                struct skd_message *answer, struct skd_error *error)
{
    struct skd_model model;
    *answer = (struct skd_message){0};
    enum skd_status status = skd_model_open(&model, link, session, error);
    if (status == SKD_OK) {
        skd_add_sequence(body);
        status = skd_model_call(&model, method, body, arrays, array_count, answer, error);
    } else {
        cJSON_Delete(body);
    }
    skd_model_close(&model);
    return status;
}

enum skd_status skd_model_fetch_mesh(struct skd_model *model, struct skd_error *error)
{
    struct skd_fetched *rest = &model->rest;
    if (rest->array.data != NULL)
        return SKD_OK;
    enum skd_status status = skd_model_call(model, "mesh.get", skd_session_body(model->session),
                                            NULL, 0, &rest->message, error);
    if (status == SKD_OK)
        status = skd_message_array(&rest->message, rest->message.result, "triangles", SKD_U32, 3,
                                   &model->triangles, &model->triangles_owned, error);
    const uint32_t *corners = model->triangles.data;
    for (size_t i = 0; status == SKD_OK && i < model->triangles.count; i++) {
        if (corners[i] >= model->vertex_count)
            status = skd_fail(error, SKD_INTERNAL, "skind sent a triangle with vertex %u of %zu",
                              corners[i], model->vertex_count);
    }
    if (status == SKD_OK)
        status = read_array(&rest->message, "positions", SKD_F32, 3, model->vertex_count,
                            &rest->array, &rest->owned, error);
    return status;
}

enum skd_status skd_model_fetch_weights(struct skd_model *model, const uint32_t *vertices,
                                        size_t count, struct skd_error *error)
{
    const struct skd_array_out named = {"vertices", SKD_U32, count, 0, vertices};
    struct skd_fetched *weights = &model->weights;
    if (weights->array.data != NULL)
        return SKD_OK;
    enum skd_status status = skd_model_call(model, "weights.get", skd_session_body(model->session),
                                            &named, vertices != NULL, &weights->message, error);
    if (status != SKD_OK)
        return status;
    size_t slots = (size_t)skd_json_number(weights->message.result, "influences");
    if (slots < 1 || slots > UINT8_MAX)
        return skd_fail(error, SKD_INTERNAL, "skind sent weights of %zu influences", slots);
    model->slots = slots;
    model->weight_rows = vertices != NULL ? count : model->vertex_count;
    status = read_array(&weights->message, "joints", SKD_U16, slots, model->weight_rows,
                        &model->joints, &model->joints_owned, error);
    if (status == SKD_OK)
        status = read_array(&weights->message, "weights", SKD_F32, slots, model->weight_rows,
                            &weights->array, &weights->owned, error);
    return status;
}

struct skd_weights skd_model_weights(const struct skd_model *model)
{
    return (struct skd_weights){.vertex_count = model->weight_rows,
                                .slots = model->slots,
                                .joints = model->joints.data,
                                .weights = model->weights.array.data};
}

enum skd_status skd_model_find_bone(const struct skd_model *model, const char *name, int *bone,
                                    int *parent, struct skd_error *error)
{
    const cJSON *bones = cJSON_GetObjectItemCaseSensitive(model->info.result, "bones"), *item;
    *bone = 0;
    cJSON_ArrayForEach(item, bones)
    {
        if (strcmp(skd_json_text(item, "name"), name) == 0) {
            *parent = (int)skd_json_number(item, "parent");
            return SKD_OK;
        }
        (*bone)++;
    }
    return skd_fail(error, SKD_NO_BONE,
                    "session \"%s\" has no bone \"%.100s\" (skinctl info names its %zu bones)",
                    model->session, name, model->bone_count);
}

bool skd_model_has_pose(const struct skd_model *model, const char *pose)
{
    const cJSON *poses = cJSON_GetObjectItemCaseSensitive(model->info.result, "poses"), *item;
    cJSON_ArrayForEach(item, poses)
    {
        if (cJSON_IsString(item) && strcmp(item->valuestring, pose) == 0)
            return true;
    }
    return strcmp(pose, "rest") == 0;
}

bool skd_model_has_clip(const struct skd_model *model, const char *clip)
{
    const cJSON *clips = cJSON_GetObjectItemCaseSensitive(model->info.result, "clips"), *item;
    cJSON_ArrayForEach(item, clips)
    {
        if (strcmp(skd_json_text(item, "name"), clip) == 0)
            return true;
    }
    return false;
}

enum skd_status skd_model_evaluate(struct skd_model *model, const char *pose,
                                   const uint32_t *vertices, size_t count,
                                   struct skd_fetched *positions, struct skd_error *error)
{
    const struct skd_array_out named = {"vertices", SKD_U32, count, 0, vertices};
    *positions = (struct skd_fetched){0};
    cJSON *body = skd_session_body(model->session);
    cJSON_AddStringToObject(body, "pose", pose);
    enum skd_status status = skd_model_call(model, "pose.evaluate", body, &named, vertices != NULL,
                                            &positions->message, error);
    if (status != SKD_OK)
        return status;
    return read_array(&positions->message, "positions", SKD_F32, 3,
                      vertices != NULL ? count : model->vertex_count, &positions->array,
                      &positions->owned, error);
}

enum skd_status skd_default_output(const struct skd_model *model, char path[SKD_PATH_BYTES_MAX],
                                   struct skd_error *error)
{
    const char *source = skd_json_text(model->info.result, "source");
    const char *slash = strrchr(source, '/');
    const char *stem = slash != NULL ? slash + 1 : source;
    const char *dot = strrchr(stem, '.');
    char name[SKD_PATH_BYTES_MAX];
    if (dot == NULL)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "session \"%s\" was not made from a file; say where to write with "
                        "--output",
                        model->session);
    (void)snprintf(name, sizeof name, "%.*s-skind%s", (int)(dot - stem), stem, dot);
    return skd_path_absolute(name, path, error);
}
