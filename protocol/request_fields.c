/* See request_fields.h. One small function a kind; each writes its value or a sentence. */
#include "protocol/request_fields.h"

#include "base/utf8.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { QUOTED_BYTES = 80 };

static const double COUNTER_MAX = 9007199254740992.0; /* 2^53 */

/* What a row is read with. */
struct reading {
    struct skd_request *request;
    const char *method;
    struct skd_error *error;
};

static void *place(const struct reading *reading, size_t offset)
{
    return (char *)&reading->request->params + offset;
}

static enum skd_status fail(const struct reading *reading, const struct skd_field *field,
                            const char *what)
{
    return skd_fail(reading->error, SKD_BAD_PARAMS, "%s: %s %s", reading->method, field->name,
                    what);
}

static void keep(struct skd_request *request, void *memory)
{
    if (memory == NULL)
        return;
    SKD_ASSERT(request->owned_count < (int)(sizeof request->owned / sizeof request->owned[0]));
    request->owned[request->owned_count++] = memory;
}

static enum skd_status read_text(const struct reading *reading, const struct skd_field *field,
                                 const cJSON *item)
{
    if (!cJSON_IsString(item))
        return fail(reading, field, "is not a string");
    size_t bytes = strlen(item->valuestring);
    if ((double)bytes < field->low || (double)bytes > field->high)
        return skd_fail(reading->error, SKD_BAD_PARAMS,
                        "%s: %s has %zu bytes; it may have %.0f to %.0f", reading->method,
                        field->name, bytes, field->low, field->high);
    *(const char **)place(reading, field->offset) = item->valuestring;
    return SKD_OK;
}

static enum skd_status read_session(const struct reading *reading, const struct skd_field *field,
                                    const cJSON *item)
{
    static const char allowed[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    enum skd_status status = read_text(reading, field, item);
    if (status != SKD_OK)
        return status;
    const char *name = item->valuestring;
    if (name[0] == '.' || name[strspn(name, allowed)] != '\0')
        return skd_fail(reading->error, SKD_BAD_PARAMS,
                        "%s: %s is \"%.*s\"; it is made of letters, digits, '.', "
                        "'_' and '-', and does not begin with '.'",
                        reading->method, field->name, skd_utf8_quote(name, QUOTED_BYTES), name);
    return SKD_OK;
}

static enum skd_status read_path(const struct reading *reading, const struct skd_field *field,
                                 const cJSON *item)
{
    enum skd_status status = read_text(reading, field, item);
    if (status == SKD_OK && item->valuestring[0] != '/')
        return fail(reading, field, "is not an absolute path; begin it with '/'");
    return status;
}

static enum skd_status read_flag(const struct reading *reading, const struct skd_field *field,
                                 const cJSON *item)
{
    if (!cJSON_IsBool(item))
        return fail(reading, field, "is neither true nor false");
    *(bool *)place(reading, field->offset) = cJSON_IsTrue(item);
    return SKD_OK;
}

static enum skd_status read_range(const struct reading *reading, const struct skd_field *field,
                                  const cJSON *item)
{
    if (!cJSON_IsNumber(item))
        return fail(reading, field, "is not a number");
    double value = item->valuedouble;
    if (!isfinite(value))
        return skd_fail(reading->error, SKD_NOT_FINITE, "%s: %s is not finite", reading->method,
                        field->name);
    if (value >= field->low && value <= field->high)
        return SKD_OK;
    if (field->high >= COUNTER_MAX)
        return skd_fail(reading->error, SKD_BAD_PARAMS, "%s: %s is %g; it must %s %.0f",
                        reading->method, field->name, value,
                        field->low > 0 ? "be above" : "not be below", floor(field->low));
    return skd_fail(reading->error, SKD_BAD_PARAMS, "%s: %s is %g; it may be %.0f to %.0f",
                    reading->method, field->name, value, field->low, field->high);
}

static enum skd_status read_whole(const struct reading *reading, const struct skd_field *field,
                                  const cJSON *item)
{
    enum skd_status status = read_range(reading, field, item);
    if (status != SKD_OK)
        return status;
    double value = item->valuedouble;
    if (floor(value) != value)
        return fail(reading, field, "is not a whole number");
    if (field->kind == SKD_FIELD_COUNTER)
        *(uint64_t *)place(reading, field->offset) = (uint64_t)value;
    else
        *(int *)place(reading, field->offset) = (int)value;
    return SKD_OK;
}

static enum skd_status read_number(const struct reading *reading, const struct skd_field *field,
                                   const cJSON *item)
{
    enum skd_status status = read_range(reading, field, item);
    if (status == SKD_OK)
        *(double *)place(reading, field->offset) = item->valuedouble;
    return status;
}

static enum skd_status read_word(const struct reading *reading, const struct skd_field *field,
                                 const cJSON *item)
{
    char known[QUOTED_BYTES] = "";
    for (int i = 0; field->words[i] != NULL; i++) {
        if (cJSON_IsString(item) && strcmp(item->valuestring, field->words[i]) == 0) {
            memcpy(place(reading, field->offset), &i, sizeof i); /* an int or an enum */
            return SKD_OK;
        }
        strncat(known, i == 0 ? "" : ", ", sizeof known - strlen(known) - 1);
        strncat(known, field->words[i], sizeof known - strlen(known) - 1);
    }
    return skd_fail(reading->error, SKD_BAD_PARAMS, "%s: %s is not one of %s", reading->method,
                    field->name, known);
}

static enum skd_status read_id(const struct reading *reading, const struct skd_field *field,
                               const cJSON *item)
{
    if (!skd_message_read_id(item, place(reading, field->offset)))
        return fail(reading, field, "is not the id of a request");
    return SKD_OK;
}

/* The width of an array's rows as they were sent; 0 for a flat list, and for what is no array at
 * all: skd_message_array says so. */
static size_t sent_width(const struct skd_message *message, const cJSON *item)
{
    if (cJSON_IsArray(item))
        return cJSON_IsArray(item->child) ? (size_t)cJSON_GetArraySize(item->child) : 0;
    const cJSON *index = cJSON_GetObjectItemCaseSensitive(item, "buffer");
    double number = cJSON_IsNumber(index) ? index->valuedouble : -1;
    if (!(number >= 0 && number < message->buffer_count))
        return 0;
    const struct skd_buffer *buffer = &message->buffers[(int)number];
    return buffer->dimensions == 2 ? (size_t)buffer->shape[1] : 0;
}

static enum skd_status read_array(const struct reading *reading, const struct skd_field *field,
                                  const cJSON *object)
{
    const struct skd_message *message = &reading->request->message;
    size_t row_width = field->row_width;
    void *owned;
    if (row_width == SKD_ROW_OF_SLOTS) {
        const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, field->name);
        row_width = sent_width(message, item);
        bool is_rows = cJSON_IsArray(item) && cJSON_IsArray(item->child);
        if (row_width != 4 && row_width != 8 && (row_width != 0 || is_rows))
            return fail(reading, field, "has neither rows of 4 nor rows of 8 numbers");
    }
    enum skd_status status =
        skd_message_array(message, object, field->name, field->dtype, row_width,
                          place(reading, field->offset), &owned, reading->error);
    keep(reading->request, owned);
    return status;
}

static enum skd_status read_names(const struct reading *reading, const struct skd_field *field,
                                  const cJSON *item)
{
    if (!cJSON_IsArray(item))
        return fail(reading, field, "is not a list of strings");
    size_t count = (size_t)cJSON_GetArraySize(item);
    if (field->high > 0 && ((double)count < field->low || (double)count > field->high))
        return skd_fail(reading->error, SKD_BAD_PARAMS,
                        "%s: %s has %zu names; it may have %.0f to %.0f", reading->method,
                        field->name, count, field->low, field->high);
    const char **names = malloc((count + 1) * sizeof *names);
    if (names == NULL)
        return skd_fail_memory(reading->error, field->name);
    keep(reading->request, names);
    size_t used = 0;
    const cJSON *name;
    cJSON_ArrayForEach(name, item)
    {
        if (!cJSON_IsString(name))
            return fail(reading, field, "is not a list of strings");
        names[used++] = name->valuestring;
    }
    *(const char ***)place(reading, field->offset) = names;
    *(size_t *)place(reading, field->count_offset) = count;
    return SKD_OK;
}

static void write_fallback(const struct reading *reading, const struct skd_field *field)
{
    switch (field->kind) {
    case SKD_FIELD_FLAG:
        *(bool *)place(reading, field->offset) = field->fallback > 0;
        break;
    case SKD_FIELD_NUMBER:
        *(double *)place(reading, field->offset) = field->fallback;
        break;
    case SKD_FIELD_WHOLE:
    case SKD_FIELD_WORD: {
        int value = (int)field->fallback;
        memcpy(place(reading, field->offset), &value, sizeof value);
        break;
    }
    default: /* the rest is NULL, 0 or empty, which it is already */
        break;
    }
}

static enum skd_status read_field(const struct reading *reading, const struct skd_field *field,
                                  const cJSON *object, const cJSON *item)
{
    switch (field->kind) {
    case SKD_FIELD_TEXT:
        return read_text(reading, field, item);
    case SKD_FIELD_SESSION:
        return read_session(reading, field, item);
    case SKD_FIELD_PATH:
        return read_path(reading, field, item);
    case SKD_FIELD_FLAG:
        return read_flag(reading, field, item);
    case SKD_FIELD_WHOLE:
    case SKD_FIELD_COUNTER:
        return read_whole(reading, field, item);
    case SKD_FIELD_NUMBER:
        return read_number(reading, field, item);
    case SKD_FIELD_WORD:
        return read_word(reading, field, item);
    case SKD_FIELD_ID:
        return read_id(reading, field, item);
    case SKD_FIELD_ARRAY:
        return read_array(reading, field, object);
    case SKD_FIELD_NAMES:
        return read_names(reading, field, item);
    case SKD_FIELD_OBJECT:
        if (!cJSON_IsObject(item))
            return fail(reading, field, "is not an object");
        return skd_fields_read(reading->request, item, field->members, reading->error);
    }
    return SKD_OK;
}

enum skd_status skd_fields_read(struct skd_request *request, const cJSON *object,
                                const struct skd_field *fields, struct skd_error *error)
{
    struct reading reading = {request, skd_request_method_name(request->method), error};
    for (const struct skd_field *field = fields; field->name != NULL; field++) {
        const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, field->name);
        if (item == NULL) {
            if (field->is_required)
                return fail(&reading, field, "is missing");
            write_fallback(&reading, field);
            continue;
        }
        enum skd_status status = read_field(&reading, field, object, item);
        if (status != SKD_OK)
            return status;
        if (field->given_offset != 0)
            *(bool *)place(&reading, field->given_offset) = true;
    }
    return SKD_OK;
}
