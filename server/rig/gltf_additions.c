/* See gltf_additions.h. */
#include "rig/gltf_additions.h"

#include "rig/elements.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 4, ARRAY_BUFFER = 34962 };

void skd_gltf_find_bounds(const float *elements, size_t count, float *bounds)
{
    for (size_t i = 0; i < 3; i++)
        bounds[i] = bounds[3 + i] = elements[i];
    for (size_t i = 3; i < 3 * count; i++) {
        bounds[i % 3] = fminf(bounds[i % 3], elements[i]);
        bounds[3 + i % 3] = fmaxf(bounds[3 + i % 3], elements[i]);
    }
}

enum skd_status skd_gltf_additions_init(struct skd_gltf_additions *additions,
                                        const struct skd_gltf_container *container,
                                        struct skd_error *error)
{
    *additions = (struct skd_gltf_additions){.container = container};
    additions->views = open_memstream(&additions->view_text, &additions->view_bytes);
    additions->accessors = open_memstream(&additions->accessor_text, &additions->accessor_bytes);
    if (additions->views == NULL || additions->accessors == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    return SKD_OK;
}

/* Makes the tail longer by `bytes` zeroed ones that begin at a multiple of 4 in the buffer. */
static enum skd_status grow_tail(struct skd_gltf_additions *additions, size_t bytes, size_t *offset,
                                 struct skd_error *error)
{
    if (additions->container->buffer_count == 0)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "the file has no buffer to put numbers into; export it again from the "
                        "program that made it");
    const size_t old_bytes = additions->container->buffers[0].size;
    const size_t end = old_bytes + additions->tail_bytes;
    const size_t start = additions->tail_bytes + (ALIGNMENT - end % ALIGNMENT) % ALIGNMENT;
    if (start > SKD_FILE_BYTES_MAX - old_bytes || bytes > SKD_FILE_BYTES_MAX - old_bytes - start)
        return skd_fail(error, SKD_TOO_LARGE,
                        "with its changes the file would have more than %zu bytes",
                        SKD_FILE_BYTES_MAX);
    if (start + bytes > additions->tail_capacity) {
        const size_t capacity = (start + bytes) * 3 / 2 + 64;
        uint8_t *tail = realloc(additions->tail, capacity);
        if (tail == NULL)
            return skd_fail_memory(error, "what is added to a glTF file");
        additions->tail = tail;
        additions->tail_capacity = capacity;
    }
    memset(additions->tail + additions->tail_bytes, 0, start + bytes - additions->tail_bytes);
    additions->tail_bytes = start + bytes;
    *offset = start;
    return SKD_OK;
}

static enum skd_status add_view(struct skd_gltf_additions *additions, size_t bytes,
                                bool is_vertex_data, size_t *view, size_t *offset,
                                struct skd_error *error)
{
    const enum skd_status status = grow_tail(additions, bytes, offset, error);
    if (status != SKD_OK)
        return status;
    fprintf(additions->views, "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu",
            additions->view_count > 0 ? "," : "", additions->container->buffers[0].size + *offset,
            bytes);
    if (is_vertex_data)
        fprintf(additions->views, ",\"target\":%d", (int)ARRAY_BUFFER);
    fputs("}", additions->views);
    *view = additions->container->document->view_count + additions->view_count++;
    return SKD_OK;
}

/* Begins an accessor, which the caller goes on with ("bufferView":... or nothing). */
static int32_t begin_accessor(struct skd_gltf_additions *additions)
{
    fputs(additions->accessor_count > 0 ? ",{" : "{", additions->accessors);
    return (int32_t)(additions->container->document->accessor_count + additions->accessor_count++);
}

static void describe(struct skd_gltf_additions *additions, const struct skd_gltf_addition *addition)
{
    static const char *const types[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    FILE *text = additions->accessors;
    fprintf(text, "\"componentType\":%d,\"count\":%zu,\"type\":\"%s\"", addition->component,
            addition->count, types[addition->width]);
    if (addition->is_normalized)
        fputs(",\"normalized\":true", text);
    const float *bounds = addition->bounds;
    if (bounds != NULL)
        fprintf(text, ",\"min\":[%.17g,%.17g,%.17g],\"max\":[%.17g,%.17g,%.17g]", (double)bounds[0],
                (double)bounds[1], (double)bounds[2], (double)bounds[3], (double)bounds[4],
                (double)bounds[5]);
}

enum skd_status skd_gltf_add_elements(struct skd_gltf_additions *additions,
                                      const struct skd_gltf_addition *addition, int32_t *accessor,
                                      size_t *offset, struct skd_error *error)
{
    size_t view = 0;
    const size_t bytes =
        addition->count * (size_t)addition->width * skd_component_bytes(addition->component);
    const enum skd_status status =
        add_view(additions, bytes, addition->is_vertex_data, &view, offset, error);
    if (status != SKD_OK)
        return status;
    *accessor = begin_accessor(additions);
    fprintf(additions->accessors, "\"bufferView\":%zu,", view);
    describe(additions, addition);
    fputs("}", additions->accessors);
    return SKD_OK;
}

enum skd_status skd_gltf_add_sparse(struct skd_gltf_additions *additions,
                                    const struct skd_gltf_addition *addition, size_t value_count,
                                    const uint32_t *indices, const float *values, int32_t *accessor,
                                    struct skd_error *error)
{
    const size_t value_bytes = value_count * 3 * sizeof *values;
    const size_t index_bytes = value_count * sizeof *indices;
    size_t index_view = 0, value_view = 0, offset = 0;
    enum skd_status status = add_view(additions, index_bytes, false, &index_view, &offset, error);
    if (status != SKD_OK)
        return status;
    memcpy(additions->tail + offset, indices, index_bytes);
    status = add_view(additions, value_bytes, false, &value_view, &offset, error);
    if (status != SKD_OK)
        return status;
    memcpy(additions->tail + offset, values, value_bytes);
    *accessor = begin_accessor(additions);
    describe(additions, addition);
    fprintf(additions->accessors,
            ",\"sparse\":{\"count\":%zu,\"indices\":{\"bufferView\":%zu,\"componentType\":%d},"
            "\"values\":{\"bufferView\":%zu}}}",
            value_count, index_view, (int)SKD_GLTF_UNSIGNED_INT, value_view);
    return SKD_OK;
}

int32_t skd_gltf_add_zeros(struct skd_gltf_additions *additions,
                           const struct skd_gltf_addition *addition)
{
    const int32_t accessor = begin_accessor(additions);
    describe(additions, addition);
    fputs("}", additions->accessors);
    return accessor;
}

/* The elements of a top-level array grow by `elements`. */
static void grow_array(struct skd_json_edits *edits, struct skd_json root, const char *name,
                       const char *elements)
{
    struct skd_json array;
    if (*elements == '\0')
        return;
    if (skd_json_member(root, name, &array))
        skd_json_append(edits, array, elements);
    else
        skd_json_replace(edits, (struct skd_json){root.start + 1, root.start + 1}, "\"%s\":[%s],",
                         name, elements);
}

static bool close_text(FILE **text)
{
    FILE *file = *text;
    *text = NULL;
    if (file == NULL)
        return false;
    const bool is_whole = ferror(file) == 0;
    return fclose(file) == 0 && is_whole;
}

enum skd_status skd_gltf_additions_json(struct skd_gltf_additions *additions,
                                        struct skd_json_edits *edits, struct skd_error *error)
{
    const struct skd_gltf_container *container = additions->container;
    struct skd_json length;
    if (!close_text(&additions->views) || !close_text(&additions->accessors))
        return skd_fail_memory(error, "the JSON of a glTF file");
    grow_array(edits, container->json, "bufferViews", additions->view_text);
    grow_array(edits, container->json, "accessors", additions->accessor_text);
    if (additions->tail_bytes > 0 && skd_gltf_buffer_member(container, 0, "byteLength", &length))
        skd_json_replace(edits, length, "%zu", container->buffers[0].size + additions->tail_bytes);
    return SKD_OK;
}

void skd_gltf_additions_finish(struct skd_gltf_additions *additions)
{
    (void)close_text(&additions->views);
    (void)close_text(&additions->accessors);
    free(additions->view_text);
    free(additions->accessor_text);
    free(additions->tail);
    *additions = (struct skd_gltf_additions){0};
}

bool skd_gltf_buffer_member(const struct skd_gltf_container *container, size_t index,
                            const char *name, struct skd_json *value)
{
    struct skd_json buffers, key, buffer = {NULL, NULL};
    if (!skd_json_member(container->json, "buffers", &buffers))
        return false;
    for (size_t i = 0; i <= index; i++)
        if (!skd_json_next(&buffers, &key, &buffer))
            return false;
    return skd_json_member(buffer, name, value);
}
