/* See elements.h. */
#include "rig/elements.h"

#include "rig/rig.h"

#include <stdlib.h>
#include <string.h>

/* Elements without bytes behind them cost nothing in the file, so they need a limit of their own.
 */
#define ELEMENTS_MAX SKD_KEY_VALUES_MAX

size_t skd_component_bytes(int component)
{
    switch (component) {
    case SKD_GLTF_BYTE:
    case SKD_GLTF_UNSIGNED_BYTE:
        return 1;
    case SKD_GLTF_SHORT:
    case SKD_GLTF_UNSIGNED_SHORT:
        return 2;
    case SKD_GLTF_UNSIGNED_INT:
    case SKD_GLTF_FLOAT:
        return 4;
    default:
        return 0;
    }
}

/* A run of elements as a file describes it. */
struct run {
    int32_t view;
    size_t offset; /* in the view */
    size_t count;
    size_t element_bytes;
};

/* Checks that the run lies inside its view and the view inside its buffer. */
static enum skd_status locate(const struct skd_gltf_container *container, const struct run *run,
                              const char *what, struct skd_elements *elements,
                              struct skd_error *error)
{
    const struct skd_gltf_document *document = container->document;
    if (run->view < 0 || (size_t)run->view >= document->view_count)
        return skd_fail(error, SKD_BAD_RIG, "%s lies in buffer view %d, which is not there", what,
                        run->view);
    const struct skd_gltf_view *view = &document->views[run->view];
    if (view->buffer < 0 || (size_t)view->buffer >= container->buffer_count)
        return skd_fail(error, SKD_BAD_RIG, "%s lies in buffer %d, which is not there", what,
                        view->buffer);
    const struct skd_gltf_buffer *buffer = &container->buffers[view->buffer];
    const size_t stride = view->stride != 0 ? view->stride : run->element_bytes;
    const size_t room = view->bytes - run->offset; /* used when offset is inside */
    if (view->offset > buffer->size || view->bytes > buffer->size - view->offset ||
        run->offset > view->bytes || stride < run->element_bytes ||
        (run->count > 0 &&
         (room < run->element_bytes || run->count - 1 > (room - run->element_bytes) / stride)))
        return skd_fail(error, SKD_BAD_RIG, "%s reaches beyond its buffer; the file is damaged",
                        what);
    elements->bytes = buffer->bytes + view->offset + run->offset;
    elements->stride = stride;
    return SKD_OK;
}

/* Little-endian, as glTF is and as all machines that skind runs on are. */
static uint32_t read_unsigned(const uint8_t *bytes, int component)
{
    uint32_t wide;
    uint16_t narrow;
    switch (component) {
    case SKD_GLTF_UNSIGNED_BYTE:
        return *bytes;
    case SKD_GLTF_UNSIGNED_SHORT:
        memcpy(&narrow, bytes, sizeof narrow);
        return narrow;
    default:
        memcpy(&wide, bytes, sizeof wide);
        return wide;
    }
}

/* Puts the sparse elements over the base, which is whole in elements->owned. */
static enum skd_status overlay_sparse(const struct skd_gltf_container *container,
                                      const struct skd_gltf_accessor *accessor, const char *what,
                                      struct skd_elements *elements, struct skd_error *error)
{
    const size_t element_bytes = elements->stride, count = accessor->sparse_count;
    const int type = accessor->index_component;
    const struct run index_run = {accessor->index_view, accessor->index_offset, count,
                                  skd_component_bytes(type)};
    const struct run value_run = {accessor->value_view, accessor->value_offset, count,
                                  element_bytes};
    struct skd_elements indexes = {0}, values = {0};
    if (count > elements->count ||
        (type != SKD_GLTF_UNSIGNED_BYTE && type != SKD_GLTF_UNSIGNED_SHORT &&
         type != SKD_GLTF_UNSIGNED_INT))
        return skd_fail(error, SKD_BAD_RIG, "%s has a sparse part that makes no sense", what);
    enum skd_status status = locate(container, &index_run, what, &indexes, error);
    if (status == SKD_OK)
        status = locate(container, &value_run, what, &values, error);
    for (size_t i = 0; status == SKD_OK && i < count; i++) {
        const uint32_t at = read_unsigned(indexes.bytes + i * indexes.stride, type);
        if (at >= elements->count)
            return skd_fail(error, SKD_BAD_RIG, "%s has a sparse index %u of %zu", what, at,
                            elements->count);
        memcpy(elements->owned + at * element_bytes, values.bytes + i * values.stride,
               element_bytes);
    }
    return status;
}

/* A copy of the accessor's base, or zeros, with the sparse elements in place. */
static enum skd_status make_whole(const struct skd_gltf_container *container,
                                  const struct skd_gltf_accessor *accessor, const char *what,
                                  struct skd_elements *elements, struct skd_error *error)
{
    const size_t element_bytes = (size_t)elements->width * skd_component_bytes(elements->component);
    if (elements->count > ELEMENTS_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "%s has %zu elements, more than %zu", what,
                        elements->count, ELEMENTS_MAX);
    elements->owned = calloc(elements->count + 1, element_bytes);
    if (elements->owned == NULL)
        return skd_fail_memory(error, what);
    for (size_t i = 0; elements->bytes != NULL && i < elements->count; i++)
        memcpy(elements->owned + i * element_bytes, elements->bytes + i * elements->stride,
               element_bytes);
    elements->bytes = elements->owned;
    elements->stride = element_bytes;
    return accessor->is_sparse ? overlay_sparse(container, accessor, what, elements, error)
                               : SKD_OK;
}

enum skd_status skd_elements_open(const struct skd_gltf_container *container, int32_t index,
                                  int width, const char *what, struct skd_elements *elements,
                                  struct skd_error *error)
{
    const struct skd_gltf_document *document = container->document;
    *elements = (struct skd_elements){0};
    if (index < 0 || (size_t)index >= document->accessor_count)
        return skd_fail(error, SKD_BAD_RIG, "%s is accessor %d, which is not there", what, index);
    const struct skd_gltf_accessor *accessor = &document->accessors[index];
    const size_t element_bytes = (size_t)width * skd_component_bytes(accessor->component);
    if (accessor->width != width || element_bytes == 0)
        return skd_fail(error, SKD_BAD_RIG, "%s (accessor %d) has the wrong type", what, index);
    elements->count = accessor->count;
    elements->width = width;
    elements->component = accessor->component;
    elements->is_normalized = accessor->is_normalized;
    enum skd_status status = SKD_OK;
    const struct run run = {accessor->view, accessor->offset, accessor->count, element_bytes};
    if (accessor->view != -1)
        status = locate(container, &run, what, elements, error);
    if (status == SKD_OK && (accessor->view == -1 || accessor->is_sparse))
        status = make_whole(container, accessor, what, elements, error);
    if (status != SKD_OK)
        skd_elements_close(elements);
    return status;
}

void skd_elements_close(struct skd_elements *elements)
{
    free(elements->owned);
    *elements = (struct skd_elements){0};
}

/* Reads a run of `type` into out, number by number, as `convert(value)`. Elements without gaps are
 * one long element. */
#define READ_RUN(type, convert)                                                                    \
    {                                                                                              \
        const bool has_gaps = stride != width * sizeof(type);                                      \
        const size_t runs = has_gaps ? count : 1, length = has_gaps ? width : width * count;       \
        for (size_t e = 0; e < runs; e++, from += stride)                                          \
            for (size_t i = 0; i < length; i++) {                                                  \
                type value;                                                                        \
                memcpy(&value, from + i * sizeof value, sizeof value);                             \
                *out++ = convert(value);                                                           \
            }                                                                                      \
    }

#define AS_FLOAT(value) ((float)(value))
#define AS_UNIT8(value) ((float)(value) / 255.0f)
#define AS_UNIT16(value) ((float)(value) / 65535.0f)
#define AS_SIGNED8(value) ((value) < -127 ? -1.0f : (float)(value) / 127.0f)
#define AS_SIGNED16(value) ((value) < -32767 ? -1.0f : (float)(value) / 32767.0f)
#define AS_INTEGER(value) ((uint32_t)(value))

void skd_elements_floats(const struct skd_elements *elements, size_t first, size_t count,
                         float *out)
{
    const size_t width = (size_t)elements->width, stride = elements->stride;
    const uint8_t *from = elements->bytes + first * stride;
    switch (elements->component * 2 + elements->is_normalized) {
    case SKD_GLTF_BYTE * 2:
        READ_RUN(int8_t, AS_FLOAT)
        break;
    case SKD_GLTF_BYTE * 2 + 1:
        READ_RUN(int8_t, AS_SIGNED8)
        break;
    case SKD_GLTF_UNSIGNED_BYTE * 2:
        READ_RUN(uint8_t, AS_FLOAT)
        break;
    case SKD_GLTF_UNSIGNED_BYTE * 2 + 1:
        READ_RUN(uint8_t, AS_UNIT8)
        break;
    case SKD_GLTF_SHORT * 2:
        READ_RUN(int16_t, AS_FLOAT)
        break;
    case SKD_GLTF_SHORT * 2 + 1:
        READ_RUN(int16_t, AS_SIGNED16)
        break;
    case SKD_GLTF_UNSIGNED_SHORT * 2:
        READ_RUN(uint16_t, AS_FLOAT)
        break;
    case SKD_GLTF_UNSIGNED_SHORT * 2 + 1:
        READ_RUN(uint16_t, AS_UNIT16)
        break;
    case SKD_GLTF_FLOAT * 2:
    case SKD_GLTF_FLOAT * 2 + 1:
        READ_RUN(float, AS_FLOAT)
        break;
    default:
        READ_RUN(uint32_t, AS_FLOAT)
    }
}

void skd_elements_integers(const struct skd_elements *elements, size_t first, size_t count,
                           uint32_t *out)
{
    const size_t width = (size_t)elements->width, stride = elements->stride;
    const uint8_t *from = elements->bytes + first * stride;
    switch (elements->component) {
    case SKD_GLTF_UNSIGNED_BYTE:
        READ_RUN(uint8_t, AS_INTEGER)
        break;
    case SKD_GLTF_UNSIGNED_SHORT:
        READ_RUN(uint16_t, AS_INTEGER)
        break;
    default:
        READ_RUN(uint32_t, AS_INTEGER)
    }
}
