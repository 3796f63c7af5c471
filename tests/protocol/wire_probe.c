/* The C side of the wire behind stdin and stdout, for tests of other languages' sides.
 *
 *     wire_probe          decodes each request and answers with what it read: {"method", "values"}
 *                         and the arrays, all as the daemon's handlers would see them
 *     wire_probe echo     answers with the request's own params, buffers as buffers
 *
 * Answers come in the mode in which it was spoken to. A stream that cannot be followed is answered
 * like the daemon does, and ends it with status 1.
 */
#include "protocol/encode.h"
#include "protocol/request.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* What an answer is made of. */
struct answer {
    cJSON *body;
    struct skd_array_out arrays[SKD_ARRAYS_MAX];
    int array_count;
};

static void write_all(const void *data, size_t bytes)
{
    for (const char *at = data; bytes > 0;) {
        ssize_t written = write(STDOUT_FILENO, at, bytes);
        if (written < 0)
            exit(2);
        at += written;
        bytes -= (size_t)written;
    }
}

static void send_encoded(struct skd_encoded *encoded)
{
    write_all(encoded->head, encoded->head_bytes);
    for (int i = 0; i < encoded->piece_count; i++) {
        write_all(encoded->pieces[i].data, encoded->pieces[i].bytes);
        write_all(skd_zeros, encoded->pieces[i].padding);
    }
    skd_encoded_finish(encoded);
}

static void send_error(enum skd_wire_mode mode, const struct skd_request_id *id,
                       const struct skd_error *failure)
{
    struct skd_encoded encoded;
    struct skd_error error;
    if (skd_encode_error(mode, id, failure, &encoded, &error) != SKD_OK)
        exit(2);
    send_encoded(&encoded);
}

static void add_array(struct answer *answer, const char *name, const struct skd_array *array)
{
    if (array->data == NULL)
        return;
    SKD_ASSERT(answer->array_count < SKD_ARRAYS_MAX);
    size_t columns =
        array->rows == 0 || array->rows == array->count ? 0 : array->count / array->rows;
    answer->arrays[answer->array_count++] =
        (struct skd_array_out){name, array->dtype, array->rows, columns, array->data};
}

static void add_text(struct answer *answer, const char *name, const char *text)
{
    if (text != NULL)
        cJSON_AddStringToObject(answer->body, name, text);
}

static void add_number(struct answer *answer, const char *name, double number)
{
    cJSON_AddNumberToObject(answer->body, name, number);
}

static void add_names(struct answer *answer, const char *name, const char *const *names,
                      size_t count)
{
    if (names != NULL)
        cJSON_AddItemToObject(answer->body, name, cJSON_CreateStringArray(names, (int)count));
}

static void tell_create(struct answer *answer, const struct skd_session_create_params *params)
{
    add_text(answer, "name", params->name);
    add_text(answer, "file", params->file);
    add_number(answer, "influences", params->influences);
    add_text(answer, "fill", skd_fill_words[params->fill]);
    add_number(answer, "reduce", params->reduce);
    add_names(answer, "names", (const char *const *)params->bone_names, params->bone_name_count);
    add_array(answer, "positions", &params->positions);
    add_array(answer, "triangles", &params->triangles);
    add_array(answer, "parents", &params->bone_parents);
    add_array(answer, "binds", &params->bone_binds);
    add_array(answer, "influence_offsets", &params->influence_offsets);
    add_array(answer, "influence_joints", &params->influence_joints);
    add_array(answer, "influence_weights", &params->influence_weights);
}

static void tell_stroke(struct answer *answer, const struct skd_stroke_params *params)
{
    add_text(answer, "session", params->session);
    add_text(answer, "pose", params->pose);
    cJSON_AddBoolToObject(answer->body, "stream", params->stream);
    add_text(answer, "method", skd_method_words[params->method]);
    add_text(answer, "constraint", skd_constraint_words[params->constraint]);
    add_number(answer, "stiffness", params->stiffness);
    add_number(answer, "thesis_k", params->thesis_k);
    add_number(answer, "thesis_h", params->thesis_h);
    add_names(answer, "locked_bones", (const char *const *)params->locked_bones,
              params->locked_bone_count);
    add_array(answer, "vertices", &params->vertices);
    add_array(answer, "positions", &params->positions);
    add_array(answer, "locked_vertices", &params->locked_vertices);
}

static void tell(struct answer *answer, const struct skd_request *request)
{
    switch (request->method) {
    case SKD_REQUEST_HELLO:
        add_number(answer, "min", request->params.hello.protocol_min);
        add_number(answer, "max", request->params.hello.protocol_max);
        add_text(answer, "name", request->params.hello.client_name);
        add_text(answer, "version", request->params.hello.client_version);
        break;
    case SKD_REQUEST_SESSION_CREATE:
        tell_create(answer, &request->params.session_create);
        break;
    case SKD_REQUEST_POSE_SET:
        add_text(answer, "clip", request->params.pose_set.clip);
        if (!isnan(request->params.pose_set.time))
            add_number(answer, "time", request->params.pose_set.time);
        add_array(answer, "matrices", &request->params.pose_set.matrices);
        break;
    case SKD_REQUEST_POSE_EVALUATE:
        add_array(answer, "vertices", &request->params.shown.vertices);
        break;
    case SKD_REQUEST_WEIGHTS_GET:
        add_array(answer, "vertices", &request->params.shown.vertices);
        break;
    case SKD_REQUEST_STROKE_APPLY:
        tell_stroke(answer, &request->params.stroke);
        break;
    default:
        break;
    }
}

static void send_answer(enum skd_wire_mode mode, const struct skd_request_id *id,
                        struct answer *answer)
{
    struct skd_encoded encoded;
    struct skd_error error;
    enum skd_status status = skd_encode_answer(mode, id, answer->body, answer->arrays,
                                               answer->array_count, &encoded, &error);
    if (status != SKD_OK)
        send_error(mode, id, &error);
    else
        send_encoded(&encoded);
}

static void decode(enum skd_wire_mode mode, struct skd_frame *frame)
{
    struct skd_request request;
    struct skd_error error;
    if (skd_request_decode(frame, &request, &error) != SKD_OK) {
        send_error(mode, &request.message.id, &error);
    } else {
        struct answer answer = {.body = cJSON_CreateObject()};
        tell(&answer, &request);
        send_answer(mode, &request.message.id, &answer);
    }
    skd_request_finish(&request);
}

/* One member of params: a buffer as the array that it is, the rest as it stands. */
static void echo_member(struct answer *answer, const struct skd_message *message,
                        const cJSON *member)
{
    const cJSON *index = cJSON_GetObjectItemCaseSensitive(member, "buffer");
    if (index == NULL || index->valueint >= message->buffer_count) {
        cJSON_AddItemToObject(answer->body, member->string, cJSON_Duplicate(member, true));
        return;
    }
    const struct skd_buffer *buffer = &message->buffers[index->valueint];
    size_t columns = 0;
    for (int i = 1; i < buffer->dimensions; i++)
        columns = (columns == 0 ? 1 : columns) * (size_t)buffer->shape[i];
    SKD_ASSERT(answer->array_count < SKD_ARRAYS_MAX);
    answer->arrays[answer->array_count++] = (struct skd_array_out){
        member->string, buffer->dtype, (size_t)buffer->shape[0], columns, buffer->data};
}

static void echo(enum skd_wire_mode mode, struct skd_frame *frame)
{
    struct skd_message message;
    struct skd_error error;
    if (skd_message_parse(frame, &message, &error) != SKD_OK) {
        send_error(mode, &message.id, &error);
    } else {
        struct answer answer = {.body = cJSON_CreateObject()};
        const cJSON *member;
        cJSON_ArrayForEach(member, message.params) echo_member(&answer, &message, member);
        send_answer(mode, &message.id, &answer);
    }
    skd_message_finish(&message);
}

int main(int argument_count, char **arguments)
{
    bool is_echo = argument_count > 1 && strcmp(arguments[1], "echo") == 0;
    struct skd_frame_reader reader;
    struct skd_error error = {0};
    skd_reader_init(&reader);
    while (error.status == SKD_OK) {
        unsigned char *space;
        size_t space_bytes;
        struct skd_frame frame;
        if (skd_reader_space(&reader, &space, &space_bytes, &error) != SKD_OK)
            break;
        ssize_t bytes = read(STDIN_FILENO, space, space_bytes);
        if (bytes <= 0)
            break;
        if (skd_reader_advance(&reader, (size_t)bytes, &error) != SKD_OK)
            break;
        while (skd_reader_take(&reader, &frame))
            (is_echo ? echo : decode)(reader.mode, &frame);
    }
    if (error.status != SKD_OK)
        send_error(reader.mode, &(struct skd_request_id){.kind = SKD_ID_NONE}, &error);
    skd_reader_finish(&reader);
    return error.status == SKD_OK ? 0 : 1;
}
