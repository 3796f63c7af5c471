/* A frame's JSON and its buffers, checked in form; see message.h. Arrays are read out of it by
 * message_array.c. */
#include "protocol/message.h"

#include "protocol/json_check.h"
#include "protocol/json_memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double WHOLE_MAX = 9007199254740992.0; /* 2^53: whole doubles up to here are exact */

static const struct {
    const char *name;
    size_t bytes;
} dtypes[SKD_DTYPE_COUNT] = {
    [SKD_U8] = {"u8", 1},   [SKD_U16] = {"u16", 2}, [SKD_U32] = {"u32", 4},
    [SKD_I32] = {"i32", 4}, [SKD_F32] = {"f32", 4}, [SKD_F64] = {"f64", 8},
};

/* Where an array without elements points; a peer's tail may have no byte at all. */
static const double nothing[1];

size_t skd_dtype_bytes(enum skd_dtype dtype)
{
    return dtypes[dtype].bytes;
}

const char *skd_dtype_name(enum skd_dtype dtype)
{
    return dtypes[dtype].name;
}

/* A whole number of 0 to 2^53. */
static bool read_whole(const cJSON *item, uint64_t *value)
{
    if (!cJSON_IsNumber(item))
        return false;
    double number = item->valuedouble;
    if (!(number >= 0 && number <= WHOLE_MAX) || floor(number) != number)
        return false;
    *value = (uint64_t)number;
    return true;
}

bool skd_message_read_id(const cJSON *item, struct skd_request_id *id)
{
    *id = (struct skd_request_id){0};
    if (cJSON_IsNumber(item)) {
        double number = item->valuedouble;
        if (!(fabs(number) <= WHOLE_MAX) || floor(number) != number)
            return false;
        id->kind = SKD_ID_NUMBER;
        id->number = (int64_t)number;
        return true;
    }
    if (!cJSON_IsString(item) || strlen(item->valuestring) > SKD_ID_BYTES_MAX)
        return false;
    id->kind = SKD_ID_TEXT;
    memcpy(id->text, item->valuestring, strlen(item->valuestring) + 1);
    return true;
}

static enum skd_status read_dtype(const cJSON *item, int index, struct skd_buffer *buffer,
                                  struct skd_error *error)
{
    if (cJSON_IsString(item))
        for (int i = 0; i < SKD_DTYPE_COUNT; i++)
            if (strcmp(item->valuestring, dtypes[i].name) == 0) {
                buffer->dtype = (enum skd_dtype)i;
                return SKD_OK;
            }
    return skd_fail(error, SKD_BAD_REQUEST,
                    "buffers[%d]: dtype is not one of u8, u16, u32, i32, f32, f64", index);
}

static enum skd_status read_shape(const cJSON *item, int index, struct skd_buffer *buffer,
                                  struct skd_error *error)
{
    uint64_t count = 1;
    int dimensions = cJSON_IsArray(item) ? cJSON_GetArraySize(item) : 0;
    if (dimensions < 1 || dimensions > 4)
        return skd_fail(error, SKD_BAD_REQUEST, "buffers[%d]: shape is not a list of 1 to 4 sizes",
                        index);
    buffer->dimensions = 0;
    const cJSON *size;
    cJSON_ArrayForEach(size, item)
    {
        uint64_t *extent = &buffer->shape[buffer->dimensions++];
        if (!read_whole(size, extent) || __builtin_mul_overflow(count, *extent, &count) ||
            count > (uint64_t)WHOLE_MAX)
            return skd_fail(error, SKD_BAD_REQUEST,
                            "buffers[%d]: shape holds no size, or the sizes are too large", index);
    }
    buffer->count = (size_t)count;
    return SKD_OK;
}

static enum skd_status read_buffer(struct skd_message *message, const cJSON *item, int index,
                                   struct skd_error *error)
{
    struct skd_buffer *buffer = &message->buffers[index];
    uint64_t offset;
    if (!cJSON_IsObject(item))
        return skd_fail(error, SKD_BAD_REQUEST, "buffers[%d] is not an object", index);
    enum skd_status status =
        read_dtype(cJSON_GetObjectItemCaseSensitive(item, "dtype"), index, buffer, error);
    if (status == SKD_OK)
        status = read_shape(cJSON_GetObjectItemCaseSensitive(item, "shape"), index, buffer, error);
    if (status != SKD_OK)
        return status;
    if (!read_whole(cJSON_GetObjectItemCaseSensitive(item, "offset"), &offset) || offset % 8 != 0)
        return skd_fail(error, SKD_BAD_REQUEST, "buffers[%d]: offset is not a multiple of 8",
                        index);
    /* count is at most 2^53, so its bytes do not overflow. */
    size_t bytes = buffer->count * skd_dtype_bytes(buffer->dtype);
    size_t tail_bytes = message->frame.tail_bytes;
    if (bytes > tail_bytes || offset > tail_bytes - bytes)
        return skd_fail(error, SKD_BAD_REQUEST,
                        "buffers[%d]: %zu bytes from %llu on do not lie within the tail of %zu",
                        index, bytes, (unsigned long long)offset, tail_bytes);
    buffer->data = bytes == 0 ? (const void *)nothing : message->frame.tail + offset;
    return SKD_OK;
}

static enum skd_status read_buffers(struct skd_message *message, struct skd_error *error)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(message->json, "buffers");
    if (list == NULL)
        return SKD_OK;
    if (!cJSON_IsArray(list))
        return skd_fail(error, SKD_BAD_REQUEST, "buffers is not a list");
    int count = cJSON_GetArraySize(list);
    if (count > SKD_BUFFERS_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "a message has %d buffers, and the limit is %d",
                        count, SKD_BUFFERS_MAX);
    const cJSON *item;
    cJSON_ArrayForEach(item, list)
    {
        enum skd_status status = read_buffer(message, item, message->buffer_count, error);
        if (status != SKD_OK)
            return status;
        message->buffer_count++;
    }
    return SKD_OK;
}

/* An object among the members, or NULL when it is not there. */
static enum skd_status read_object(const struct skd_message *message, const char *name,
                                   const cJSON **object, struct skd_error *error)
{
    *object = cJSON_GetObjectItemCaseSensitive(message->json, name);
    if (*object != NULL && !cJSON_IsObject(*object))
        return skd_fail(error, SKD_BAD_REQUEST, "%s is not an object", name);
    return SKD_OK;
}

/* A request or notification has a method; an answer has a result or an error, and an id. */
static enum skd_status read_members(struct skd_message *message, struct skd_error *error)
{
    const cJSON *id = cJSON_GetObjectItemCaseSensitive(message->json, "id");
    const cJSON *version = cJSON_GetObjectItemCaseSensitive(message->json, "jsonrpc");
    const cJSON *method = cJSON_GetObjectItemCaseSensitive(message->json, "method");
    bool id_is_good = id == NULL || skd_message_read_id(id, &message->id);
    if (!cJSON_IsString(version) || strcmp(version->valuestring, "2.0") != 0)
        return skd_fail(error, SKD_BAD_REQUEST, "jsonrpc is not \"2.0\"");
    if (method != NULL && !cJSON_IsString(method))
        return skd_fail(error, SKD_BAD_REQUEST, "method is not a string");
    enum skd_status status = read_object(message, "params", &message->params, error);
    if (status == SKD_OK)
        status = read_object(message, "result", &message->result, error);
    if (status == SKD_OK)
        status = read_object(message, "error", &message->error, error);
    if (status != SKD_OK)
        return status;
    if ((method != NULL) + (message->result != NULL) + (message->error != NULL) != 1)
        return skd_fail(error, SKD_BAD_REQUEST, "a message has a method, or a result, or an error");
    /* Only an error may belong to no request: one whose id could not be read. */
    bool answers_nothing = message->error != NULL && cJSON_IsNull(id);
    if (!id_is_good && !answers_nothing)
        return skd_fail(error, SKD_BAD_REQUEST,
                        "id is not a whole number within 2^53, nor a string of at most %d bytes",
                        SKD_ID_BYTES_MAX);
    if (id == NULL && method == NULL)
        return skd_fail(error, SKD_BAD_REQUEST, "an answer has no id");
    message->method = method == NULL ? NULL : method->valuestring;
    return SKD_OK;
}

enum skd_status skd_message_parse(struct skd_frame *frame, struct skd_message *message,
                                  struct skd_error *error)
{
    *message = (struct skd_message){.frame = *frame};
    *frame = (struct skd_frame){0};
    const char *json = message->frame.json;
    size_t bytes = message->frame.json_bytes;
    if (bytes > SKD_JSON_BYTES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "%zu bytes of JSON, and the limit is %u", bytes,
                        SKD_JSON_BYTES_MAX);
    enum skd_status status = skd_json_check(json, bytes, error);
    if (status != SKD_OK)
        return status;
    /* cJSON notes the place of an error in a global, which threads write and nobody reads. */
    message->json = cJSON_ParseWithLengthOpts(json, bytes, NULL, false);
    if (message->json == NULL) {
        (void)skd_json_memory_ran_out(); /* told by the status */
        return skd_fail_memory(error, "a message's JSON");
    }
    if (!cJSON_IsObject(message->json))
        return skd_fail(error, SKD_BAD_REQUEST, "a message is one JSON object");
    status = read_members(message, error);
    return status == SKD_OK ? read_buffers(message, error) : status;
}

void skd_message_finish(struct skd_message *message)
{
    cJSON_Delete(message->json);
    free(message->frame.block);
    *message = (struct skd_message){0};
}
