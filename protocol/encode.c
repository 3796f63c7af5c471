/* Messages to bytes; see encode.h.
 *
 * All memory comes from cJSON's hooks, so that a test can make every allocation fail. A line's
 * arrays are written as text into one growing buffer each, which then hangs in the JSON tree as
 * raw text: no tree node a number.
 */
#include "protocol/encode.h"

#include "protocol/errors.h"
#include "protocol/json_memory.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { NUMBER_TEXT_BYTES = 32 }; /* the longest number, its comma and a NUL */

const unsigned char skd_zeros[8];

/* JSON text in the making. */
struct text {
    char *data;
    size_t bytes;
    size_t capacity;
};

static enum skd_status fail_size(struct skd_error *error)
{
    return skd_fail(error, SKD_TOO_LARGE,
                    "the answer is larger than a message may be (%llu MiB, %u MiB of JSON in a "
                    "frame); ask for fewer vertices",
                    (unsigned long long)(SKD_FRAME_BYTES_MAX >> 20), SKD_JSON_BYTES_MAX >> 20);
}

/* Adds an item, which may be NULL for no memory and is taken over also on failure. */
static bool add(cJSON *object, const char *name, cJSON *item)
{
    if (item != NULL && cJSON_AddItemToObject(object, name, item))
        return true;
    cJSON_Delete(item);
    return false;
}

bool skd_add_id(cJSON *object, const char *name, const struct skd_request_id *id)
{
    char digits[NUMBER_TEXT_BYTES];
    switch (id->kind) {
    case SKD_ID_NUMBER:
        /* cJSON's own numbers lose the last bits of large ones. */
        (void)snprintf(digits, sizeof digits, "%" PRId64, id->number);
        return add(object, name, cJSON_CreateRaw(digits));
    case SKD_ID_TEXT:
        return add(object, name, cJSON_CreateString(id->text));
    default:
        return add(object, name, cJSON_CreateNull());
    }
}

/* Room for `more` bytes. The capacity doubles, so the copies stay linear. */
static enum skd_status text_reserve(struct text *text, size_t more, struct skd_error *error)
{
    if (text->bytes + more <= text->capacity)
        return SKD_OK;
    if (text->bytes + more > SKD_FRAME_BYTES_MAX)
        return fail_size(error);
    size_t capacity = text->capacity == 0 ? 1024 : 2 * text->capacity;
    char *data = cJSON_malloc(capacity);
    if (data == NULL)
        return skd_fail_memory(error, "a line");
    if (text->bytes > 0)
        memcpy(data, text->data, text->bytes);
    cJSON_free(text->data);
    text->data = data;
    text->capacity = capacity;
    return SKD_OK;
}

/* Writes one number, with as many digits as bring the same bits back, or null. */
static int print_number(char out[NUMBER_TEXT_BYTES], enum skd_dtype dtype, const void *data,
                        size_t index)
{
    double value;
    int digits;
    switch (dtype) {
    case SKD_U8:
        return snprintf(out, NUMBER_TEXT_BYTES, "%u", ((const uint8_t *)data)[index]);
    case SKD_U16:
        return snprintf(out, NUMBER_TEXT_BYTES, "%u", ((const uint16_t *)data)[index]);
    case SKD_U32:
        return snprintf(out, NUMBER_TEXT_BYTES, "%" PRIu32, ((const uint32_t *)data)[index]);
    case SKD_I32:
        return snprintf(out, NUMBER_TEXT_BYTES, "%" PRId32, ((const int32_t *)data)[index]);
    case SKD_F32:
        value = (double)((const float *)data)[index];
        digits = 9;
        break;
    default:
        value = ((const double *)data)[index];
        digits = 17;
        break;
    }
    if (!isfinite(value))
        return snprintf(out, NUMBER_TEXT_BYTES, "null");
    if (fpclassify(value) == FP_ZERO && signbit(value)) /* readers take "-0" for a whole number */
        return snprintf(out, NUMBER_TEXT_BYTES, "-0.0");
    return snprintf(out, NUMBER_TEXT_BYTES, "%.*g", digits, value);
}

/* [1,2,3] or [[1,2,3],[4,5,6]] */
static enum skd_status write_array(struct text *text, const struct skd_array_out *array,
                                   struct skd_error *error)
{
    bool is_flat = array->columns == 0;
    size_t columns = is_flat ? 1 : array->columns;
    size_t count;
    /* A number takes a digit and a comma at least; what cannot fit is not begun. */
    if (__builtin_mul_overflow(array->rows, columns, &count) || count > SKD_FRAME_BYTES_MAX / 2)
        return fail_size(error);
    enum skd_status status = text_reserve(text, 3, error);
    if (status != SKD_OK)
        return status;
    text->data[text->bytes++] = '[';
    for (size_t row = 0; row < array->rows; row++) {
        if (!is_flat)
            text->data[text->bytes++] = '[';
        for (size_t column = 0; column < columns; column++) {
            /* also for the brackets and commas that follow */
            status = text_reserve(text, NUMBER_TEXT_BYTES + 4, error);
            if (status != SKD_OK)
                return status;
            text->bytes += (size_t)print_number(text->data + text->bytes, array->dtype, array->data,
                                                row * columns + column);
            if (column + 1 < columns)
                text->data[text->bytes++] = ',';
        }
        if (!is_flat)
            text->data[text->bytes++] = ']';
        if (row + 1 < array->rows)
            text->data[text->bytes++] = ',';
    }
    text->data[text->bytes++] = ']';
    text->data[text->bytes++] = '\0';
    return SKD_OK;
}

static enum skd_status add_inline(cJSON *body, const struct skd_array_out *arrays, int array_count,
                                  struct skd_error *error)
{
    for (int i = 0; i < array_count; i++) {
        struct text text = {0};
        enum skd_status status = write_array(&text, &arrays[i], error);
        cJSON *item = status == SKD_OK ? cJSON_CreateNull() : NULL;
        if (item == NULL) {
            cJSON_free(text.data);
            return status != SKD_OK ? status : skd_fail_memory(error, "an answer");
        }
        /* cJSON_CreateRaw would copy the text; the node's strings are cJSON_malloc's. */
        item->type = cJSON_Raw;
        item->valuestring = text.data;
        if (!add(body, arrays[i].name, item))
            return skd_fail_memory(error, "an answer");
    }
    return SKD_OK;
}

/* {"dtype": "f32", "shape": [rows, columns], "offset": offset}, or NULL. */
static cJSON *make_descriptor(const struct skd_array_out *array, size_t offset)
{
    const double shape[2] = {(double)array->rows, (double)array->columns};
    cJSON *descriptor = cJSON_CreateObject();
    bool is_made = add(descriptor, "dtype", cJSON_CreateString(skd_dtype_name(array->dtype)));
    is_made &= add(descriptor, "shape", cJSON_CreateDoubleArray(shape, array->columns > 0 ? 2 : 1));
    is_made &= add(descriptor, "offset", cJSON_CreateNumber((double)offset));
    if (is_made)
        return descriptor;
    cJSON_Delete(descriptor);
    return NULL;
}

static bool add_reference(cJSON *body, const char *name, int index)
{
    cJSON *reference = cJSON_CreateObject();
    if (add(reference, "buffer", cJSON_CreateNumber(index)))
        return add(body, name, reference);
    cJSON_Delete(reference);
    return false;
}

/* Lays the arrays out behind each other, refers to them in the body and lists them in the
 * envelope. *tail_bytes is what they take, padding included. */
static enum skd_status add_buffers(cJSON *envelope, cJSON *body, const struct skd_array_out *arrays,
                                   int array_count, struct skd_encoded *encoded, size_t *tail_bytes,
                                   struct skd_error *error)
{
    cJSON *list = cJSON_CreateArray();
    *tail_bytes = 0;
    for (int i = 0; i < array_count; i++) {
        const struct skd_array_out *array = &arrays[i];
        size_t bytes;
        if (__builtin_mul_overflow(array->rows, array->columns > 0 ? array->columns : 1, &bytes) ||
            __builtin_mul_overflow(bytes, skd_dtype_bytes(array->dtype), &bytes) ||
            bytes > SKD_FRAME_BYTES_MAX - *tail_bytes) {
            cJSON_Delete(list);
            return fail_size(error);
        }
        cJSON *descriptor = make_descriptor(array, *tail_bytes);
        if (!add_reference(body, array->name, i) || !cJSON_AddItemToArray(list, descriptor)) {
            cJSON_Delete(descriptor);
            cJSON_Delete(list);
            return skd_fail_memory(error, "an answer");
        }
        if (bytes == 0)
            continue;
        size_t padding = (8 - bytes % 8) % 8;
        encoded->pieces[encoded->piece_count++] = (struct skd_piece){array->data, bytes, padding};
        *tail_bytes += bytes + padding;
    }
    return add(envelope, "buffers", list) ? SKD_OK : skd_fail_memory(error, "an answer");
}

/* The head of a frame: header, JSON, padding. */
static enum skd_status make_frame_head(const cJSON *envelope, size_t tail_bytes,
                                       struct skd_encoded *encoded, struct skd_error *error)
{
    char *json = cJSON_PrintUnformatted(envelope);
    if (json == NULL)
        return skd_fail_memory(error, "an answer");
    enum skd_status status = SKD_OK;
    size_t json_bytes = strlen(json);
    if (json_bytes > SKD_JSON_BYTES_MAX ||
        tail_bytes > SKD_FRAME_BYTES_MAX - skd_frame_tail_offset((uint32_t)json_bytes)) {
        status = fail_size(error);
        goto done;
    }
    size_t head_bytes = skd_frame_tail_offset((uint32_t)json_bytes);
    encoded->head = cJSON_malloc(head_bytes);
    if (encoded->head == NULL) {
        status = skd_fail_memory(error, "an answer");
        goto done;
    }
    encoded->head_bytes = head_bytes;
    skd_frame_header(encoded->head, (uint32_t)json_bytes, tail_bytes);
    memcpy(encoded->head + SKD_FRAME_HEADER_BYTES, json, json_bytes);
    size_t written = SKD_FRAME_HEADER_BYTES + json_bytes;
    memset(encoded->head + written, 0, head_bytes - written);
done:
    cJSON_free(json);
    return status;
}

static enum skd_status make_line(const cJSON *envelope, struct skd_encoded *encoded,
                                 struct skd_error *error)
{
    char *json = cJSON_PrintUnformatted(envelope);
    if (json == NULL)
        return skd_fail_memory(error, "an answer");
    size_t json_bytes = strlen(json);
    if (json_bytes + 1 > SKD_FRAME_BYTES_MAX) {
        cJSON_free(json);
        return fail_size(error);
    }
    json[json_bytes] = '\n'; /* in the place of the NUL */
    encoded->head = (unsigned char *)json;
    encoded->head_bytes = json_bytes + 1;
    return SKD_OK;
}

/* A message's members before its body. */
struct envelope {
    const struct skd_request_id *id; /* NULL: none */
    const char *method;              /* NULL: none */
    const char *body_name;
};

static cJSON *make_envelope(const struct envelope *members)
{
    cJSON *envelope = cJSON_CreateObject();
    bool is_made = add(envelope, "jsonrpc", cJSON_CreateString("2.0"));
    if (members->id != NULL)
        is_made &= skd_add_id(envelope, "id", members->id);
    if (members->method != NULL)
        is_made &= add(envelope, "method", cJSON_CreateString(members->method));
    if (is_made)
        return envelope;
    cJSON_Delete(envelope);
    return NULL;
}

/* What all kinds of message share. Takes the body over. */
static enum skd_status encode(enum skd_wire_mode mode, const struct envelope *members, cJSON *body,
                              const struct skd_array_out *arrays, int array_count,
                              struct skd_encoded *encoded, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    size_t tail_bytes = 0;
    SKD_ASSERT(array_count >= 0 && array_count <= SKD_ARRAYS_MAX);
    *encoded = (struct skd_encoded){0};
    if (skd_json_memory_ran_out()) { /* the body may lack members */
        cJSON_Delete(body);
        return skd_fail_memory(error, "an answer");
    }
    cJSON *envelope = make_envelope(members);
    if (body == NULL)
        body = cJSON_CreateObject();
    if (!add(envelope, members->body_name, body)) {
        cJSON_Delete(envelope);
        return skd_fail_memory(error, "an answer");
    }
    if (mode != SKD_WIRE_FRAMES)
        status = add_inline(body, arrays, array_count, error);
    else if (array_count > 0)
        status = add_buffers(envelope, body, arrays, array_count, encoded, &tail_bytes, error);
    if (status == SKD_OK)
        status = mode == SKD_WIRE_FRAMES ? make_frame_head(envelope, tail_bytes, encoded, error)
                                         : make_line(envelope, encoded, error);
    cJSON_Delete(envelope);
    if (status != SKD_OK) {
        *encoded = (struct skd_encoded){0};
        (void)skd_json_memory_ran_out(); /* told by the status */
    }
    return status;
}

void skd_encoded_finish(struct skd_encoded *encoded)
{
    cJSON_free(encoded->head);
    *encoded = (struct skd_encoded){0};
}

enum skd_status skd_encode_answer(enum skd_wire_mode mode, const struct skd_request_id *id,
                                  cJSON *body, const struct skd_array_out *arrays, int array_count,
                                  struct skd_encoded *encoded, struct skd_error *error)
{
    struct envelope members = {.id = id, .body_name = "result"};
    return encode(mode, &members, body, arrays, array_count, encoded, error);
}

enum skd_status skd_encode_notification(enum skd_wire_mode mode, const char *method, cJSON *body,
                                        const struct skd_array_out *arrays, int array_count,
                                        struct skd_encoded *encoded, struct skd_error *error)
{
    struct envelope members = {.method = method, .body_name = "params"};
    return encode(mode, &members, body, arrays, array_count, encoded, error);
}

enum skd_status skd_encode_request(enum skd_wire_mode mode, int64_t id, const char *method,
                                   cJSON *body, const struct skd_array_out *arrays, int array_count,
                                   struct skd_encoded *encoded, struct skd_error *error)
{
    struct skd_request_id request_id = {.kind = SKD_ID_NUMBER, .number = id};
    struct envelope members = {.id = &request_id, .method = method, .body_name = "params"};
    return encode(mode, &members, body, arrays, array_count, encoded, error);
}

static cJSON *make_error(const struct skd_error *failure)
{
    const struct skd_error_entry *entry = skd_error_entry(failure->status);
    cJSON *body = cJSON_CreateObject();
    cJSON *data = cJSON_CreateObject();
    bool is_made = add(body, "code", cJSON_CreateNumber(entry->number));
    is_made &= add(body, "message", cJSON_CreateString(failure->text));
    is_made &= add(data, "name", cJSON_CreateString(entry->name));
    is_made &= add(data, "retryable", cJSON_CreateBool(entry->retryable));
    is_made &= add(data, "hint", cJSON_CreateString(entry->hint));
    is_made &= add(body, "data", data);
    if (is_made)
        return body;
    cJSON_Delete(body);
    return NULL;
}

enum skd_status skd_encode_error(enum skd_wire_mode mode, const struct skd_request_id *id,
                                 const struct skd_error *failure, struct skd_encoded *encoded,
                                 struct skd_error *error)
{
    struct envelope members = {.id = id, .body_name = "error"};
    (void)skd_json_memory_ran_out(); /* what could not be answered whole is told by this error */
    cJSON *body = make_error(failure);
    *encoded = (struct skd_encoded){0};
    if (body == NULL)
        return skd_fail_memory(error, "an answer");
    return encode(mode, &members, body, NULL, 0, encoded, error);
}
