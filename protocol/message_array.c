/* Arrays out of a message: a view into the tail, or plain JSON made into one; see message.h.
 *
 * Stage: frame -> request. Thread: any. A view costs nothing; JSON costs one allocation, whose size
 * is that of a list that was received, so it is bounded by the limit of the JSON part.
 */
#include "protocol/message.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* From here on a double rounds to an infinite float. It is above FLT_MAX, which nine digits write
 * as a number that is a little larger. */
static const double F32_LIMIT = 0x1.ffffffp127;

/* What the sentences of an error are made from. */
struct place {
    const char *method;
    const char *name;
};

static enum skd_status fail_form(struct place place, size_t row_width, struct skd_error *error)
{
    if (row_width == 0)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "%s: %s is not a flat list of numbers, nor {\"buffer\": i}", place.method,
                        place.name);
    return skd_fail(error, SKD_BAD_PARAMS,
                    "%s: %s is not a list of rows of %zu numbers, nor {\"buffer\": i}",
                    place.method, place.name, row_width);
}

/* A matrix may also be written as its four rows. */
static size_t inner_width(size_t row_width)
{
    return row_width == 16 ? 4 : 0;
}

static size_t product_after_first(const struct skd_buffer *buffer)
{
    size_t product = 1;
    for (int i = 1; i < buffer->dimensions; i++)
        product *= (size_t)buffer->shape[i];
    return product;
}

static enum skd_status view_buffer(const struct skd_message *message, const cJSON *index,
                                   struct place place, size_t row_width, struct skd_array *array,
                                   struct skd_error *error)
{
    double number = cJSON_IsNumber(index) ? index->valuedouble : -1;
    if (!(number >= 0 && number < message->buffer_count) || floor(number) != number)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "%s: %s names a buffer that is not one of the message's %d", place.method,
                        place.name, message->buffer_count);
    const struct skd_buffer *buffer = &message->buffers[(int)number];
    if (buffer->dtype != array->dtype)
        return skd_fail(error, SKD_BAD_PARAMS, "%s: %s is a buffer of %s; send %s", place.method,
                        place.name, skd_dtype_name(buffer->dtype), skd_dtype_name(array->dtype));
    bool fits;
    if (buffer->dimensions == 1)
        fits = row_width == 0 || buffer->count % row_width == 0;
    else
        fits = row_width > 0 && product_after_first(buffer) == row_width;
    if (!fits)
        return fail_form(place, row_width, error);
    array->count = buffer->count;
    array->rows = row_width == 0 ? buffer->count : buffer->count / row_width;
    array->data = buffer->data;
    return SKD_OK;
}

/* The smallest and largest value of a dtype of whole numbers. */
static void whole_range(enum skd_dtype dtype, double *low, double *high)
{
    *low = 0;
    switch (dtype) {
    case SKD_U8:
        *high = UINT8_MAX;
        break;
    case SKD_U16:
        *high = UINT16_MAX;
        break;
    case SKD_U32:
        *high = UINT32_MAX;
        break;
    default:
        *low = INT32_MIN;
        *high = INT32_MAX;
        break;
    }
}

/* Writes element `index`; the caller has checked that it fits. */
static void store(enum skd_dtype dtype, void *data, size_t index, double value)
{
    switch (dtype) {
    case SKD_U8:
        ((uint8_t *)data)[index] = (uint8_t)value;
        break;
    case SKD_U16:
        ((uint16_t *)data)[index] = (uint16_t)value;
        break;
    case SKD_U32:
        ((uint32_t *)data)[index] = (uint32_t)value;
        break;
    case SKD_I32:
        ((int32_t *)data)[index] = (int32_t)value;
        break;
    case SKD_F32:
        ((float *)data)[index] = (float)value;
        break;
    default:
        ((double *)data)[index] = value;
        break;
    }
}

/* An array while it is filled from JSON. */
struct filling {
    struct place place;
    enum skd_dtype dtype;
    size_t row_width;
    size_t capacity;
    size_t count;
    void *data;
};

static enum skd_status fill_number(struct filling *filling, const cJSON *item,
                                   struct skd_error *error)
{
    const struct place *place = &filling->place;
    bool is_float = filling->dtype == SKD_F32 || filling->dtype == SKD_F64;
    if (!cJSON_IsNumber(item) && !(is_float && cJSON_IsNull(item)))
        return fail_form(*place, filling->row_width, error);
    /* null is how a number that is not finite is written. */
    double value = cJSON_IsNull(item) ? (double)NAN : item->valuedouble;
    if (is_float) {
        double limit = filling->dtype == SKD_F32 ? F32_LIMIT : (double)INFINITY;
        if (!(fabs(value) < limit))
            return skd_fail(error, SKD_NOT_FINITE, "%s: %s: number %zu is not finite as %s",
                            place->method, place->name, filling->count,
                            skd_dtype_name(filling->dtype));
    } else {
        double low, high;
        whole_range(filling->dtype, &low, &high);
        if (!(value >= low && value <= high) || floor(value) != value)
            return skd_fail(error, SKD_BAD_PARAMS,
                            "%s: %s: number %zu is %.17g, and not a whole number of %.0f to %.0f",
                            place->method, place->name, filling->count, value, low, high);
    }
    if (filling->count == filling->capacity)
        return fail_form(*place, filling->row_width, error);
    store(filling->dtype, filling->data, filling->count++, value);
    return SKD_OK;
}

/* One row: `width` numbers, or lists of `inner` numbers each. */
static enum skd_status fill_row(struct filling *filling, const cJSON *row, size_t width,
                                size_t inner, struct skd_error *error)
{
    size_t before = filling->count;
    if (!cJSON_IsArray(row))
        return fail_form(filling->place, filling->row_width, error);
    bool is_nested = inner > 0 && cJSON_IsArray(row->child);
    const cJSON *item;
    cJSON_ArrayForEach(item, row)
    {
        enum skd_status status = is_nested ? fill_row(filling, item, inner, 0, error)
                                           : fill_number(filling, item, error);
        if (status != SKD_OK)
            return status;
    }
    if (filling->count - before != width)
        return fail_form(filling->place, filling->row_width, error);
    return SKD_OK;
}

/* The array from plain JSON into memory of its own. Rows and loose numbers are not mixed. */
static enum skd_status convert_list(const cJSON *list, struct place place, size_t row_width,
                                    struct skd_array *array, void **owned, struct skd_error *error)
{
    bool has_rows = row_width > 0 && cJSON_IsArray(list->child);
    size_t length = (size_t)cJSON_GetArraySize(list);
    struct filling filling = {.place = place,
                              .dtype = array->dtype,
                              .row_width = row_width,
                              .capacity = has_rows ? length * row_width : length};
    enum skd_status status;
    /* At least one byte, so that an empty list differs from none. */
    size_t bytes = filling.capacity * skd_dtype_bytes(array->dtype);
    filling.data = malloc(bytes == 0 ? 1 : bytes);
    if (filling.data == NULL)
        return skd_fail_memory(error, place.name);
    if (!has_rows) {
        status = fill_row(&filling, list, length, 0, error);
        if (status == SKD_OK && row_width > 0 && length % row_width != 0)
            status = fail_form(place, row_width, error);
        if (status != SKD_OK)
            goto fail;
    } else {
        const cJSON *row;
        cJSON_ArrayForEach(row, list)
        {
            status = fill_row(&filling, row, row_width, inner_width(row_width), error);
            if (status != SKD_OK)
                goto fail;
        }
    }
    array->count = filling.count;
    array->rows = row_width == 0 ? filling.count : filling.count / row_width;
    array->data = filling.data;
    *owned = filling.data;
    return SKD_OK;
fail:
    free(filling.data);
    return status;
}

enum skd_status skd_message_array(const struct skd_message *message, const cJSON *object,
                                  const char *name, enum skd_dtype dtype, size_t row_width,
                                  struct skd_array *array, void **owned, struct skd_error *error)
{
    struct place place = {message->method != NULL ? message->method : "the answer", name};
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, name);
    *array = (struct skd_array){.dtype = dtype};
    *owned = NULL;
    if (item == NULL)
        return SKD_OK;
    if (cJSON_IsArray(item))
        return convert_list(item, place, row_width, array, owned, error);
    const cJSON *index = cJSON_GetObjectItemCaseSensitive(item, "buffer");
    if (!cJSON_IsObject(item) || index == NULL)
        return fail_form(place, row_width, error);
    return view_buffer(message, index, place, row_width, array, error);
}
