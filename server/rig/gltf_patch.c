/* See gltf_patch.h. */
#include "rig/gltf_patch.h"

#include "rig/uri.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 4, GLB_HEADER = 12, CHUNK_HEADER = 8, ARRAY_BUFFER = 34962 };

#define CHUNK_JSON 0x4E4F534Au
#define CHUNK_BIN 0x004E4942u

static size_t padding_of(size_t bytes)
{
    return (ALIGNMENT - bytes % ALIGNMENT) % ALIGNMENT;
}

static void note_target(struct skd_gltf_patch *patch, const struct skd_gltf_document *document,
                        struct skd_gltf_target *target, size_t vertex_count, bool is_weights)
{
    if (target->is_new)
        patch->additions[patch->addition_count++] =
            (struct skd_gltf_addition){target, vertex_count, is_weights};
    else
        patch->is_dirty[document->views[document->accessors[target->accessor].view].buffer] = true;
}

/* Lists the targets that are new, and marks the buffers of those that are not. */
static enum skd_status list_targets(struct skd_gltf_patch *patch,
                                    const struct skd_gltf_container *container,
                                    const struct skd_mesh *mesh, struct skd_part_plan *plans,
                                    struct skd_error *error)
{
    size_t most = 1;
    for (size_t p = 0; p < mesh->part_count; p++)
        most += 2 * (size_t)plans[p].set_count;
    patch->additions = calloc(most, sizeof *patch->additions);
    patch->is_dirty = calloc(container->buffer_count + 1, sizeof *patch->is_dirty);
    if (patch->additions == NULL || patch->is_dirty == NULL)
        return skd_fail_memory(error, "buffers");
    for (size_t p = 0; p < mesh->part_count; p++)
        for (int set = 0; set < plans[p].set_count; set++) {
            const size_t count = mesh->parts[p].vertex_count;
            note_target(patch, container->document, &plans[p].joints[set], count, false);
            note_target(patch, container->document, &plans[p].weights[set], count, true);
        }
    return SKD_OK;
}

static size_t addition_bytes(const struct skd_gltf_addition *addition)
{
    return addition->vertex_count * 4 * skd_component_bytes(addition->target->component);
}

enum skd_status skd_gltf_patch_make_room(struct skd_gltf_patch *patch,
                                         const struct skd_gltf_container *container,
                                         const struct skd_mesh *mesh, struct skd_part_plan *plans,
                                         struct skd_error *error)
{
    const enum skd_status status = list_targets(patch, container, mesh, plans, error);
    if (status != SKD_OK || patch->addition_count == 0)
        return status;
    if (container->buffer_count == 0)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "the file has no buffer to put weights into; export it again from the "
                        "program that made it");
    const size_t old_bytes = container->buffers[0].size, padding = padding_of(old_bytes);
    patch->tail_bytes = padding;
    for (size_t i = 0; i < patch->addition_count; i++)
        patch->tail_bytes += addition_bytes(&patch->additions[i]);
    if (patch->tail_bytes > SKD_FILE_BYTES_MAX - old_bytes)
        return skd_fail(error, SKD_TOO_LARGE,
                        "with the new weights the file would have more than %zu bytes",
                        SKD_FILE_BYTES_MAX);
    patch->tail = calloc(1, patch->tail_bytes);
    if (patch->tail == NULL)
        return skd_fail_memory(error, "new weights");
    patch->is_dirty[0] = true;
    uint8_t *next = patch->tail + padding;
    for (size_t i = 0; i < patch->addition_count; i++) {
        struct skd_gltf_target *target = patch->additions[i].target;
        target->accessor = (int32_t)(container->document->accessor_count + i);
        target->stride = 4 * skd_component_bytes(target->component);
        target->bytes = next;
        next += addition_bytes(&patch->additions[i]);
    }
    return SKD_OK;
}

/* The elements of a top-level array grow by `elements`. */
static void grow_array(struct skd_gltf_patch *patch, struct skd_json root, const char *name,
                       const char *elements)
{
    struct skd_json array;
    if (skd_json_member(root, name, &array))
        skd_json_append(&patch->edits, array, elements);
    else
        skd_json_replace(&patch->edits, (struct skd_json){root.start + 1, root.start + 1},
                         "\"%s\":[%s],", name, elements);
}

static enum skd_status add_accessors(struct skd_gltf_patch *patch,
                                     const struct skd_gltf_container *container,
                                     struct skd_error *error)
{
    char *views = NULL, *accessors = NULL;
    size_t view_bytes = 0, accessor_bytes = 0;
    FILE *view_text = open_memstream(&views, &view_bytes);
    FILE *accessor_text = open_memstream(&accessors, &accessor_bytes);
    for (size_t i = 0; view_text != NULL && accessor_text != NULL && i < patch->addition_count;
         i++) {
        const struct skd_gltf_addition *addition = &patch->additions[i];
        const struct skd_gltf_target *target = addition->target;
        fprintf(view_text, "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,\"target\":%d}",
                i > 0 ? "," : "",
                container->buffers[0].size + (size_t)(target->bytes - patch->tail),
                addition_bytes(addition), (int)ARRAY_BUFFER);
        fprintf(accessor_text,
                "%s{\"bufferView\":%zu,\"componentType\":%d,\"count\":%zu,\"type\":\"VEC4\"%s}",
                i > 0 ? "," : "", container->document->view_count + i, target->component,
                addition->vertex_count,
                addition->is_weights && target->component != SKD_GLTF_FLOAT ? ",\"normalized\":true"
                                                                            : "");
    }
    bool has_failed = view_text == NULL || fclose(view_text) != 0;
    has_failed |= accessor_text == NULL || fclose(accessor_text) != 0;
    if (!has_failed) {
        grow_array(patch, container->json, "bufferViews", views);
        grow_array(patch, container->json, "accessors", accessors);
    }
    free(views);
    free(accessors);
    return has_failed ? skd_fail_memory(error, "the JSON of a glTF file") : SKD_OK;
}

static void set_attribute(struct skd_gltf_patch *patch, struct skd_json attributes,
                          const char *kind, int set, const struct skd_gltf_target *target)
{
    char name[32], number[16];
    struct skd_json old;
    if (!target->is_new)
        return;
    (void)snprintf(name, sizeof name, "%s_%d", kind, set);
    (void)snprintf(number, sizeof number, "%d", target->accessor);
    if (skd_json_member(attributes, name, &old))
        skd_json_replace(&patch->edits, old, "%s", number);
    else
        skd_json_add(&patch->edits, attributes, name, number);
}

/* Primitives name the new accessors. */
static enum skd_status set_attributes(struct skd_gltf_patch *patch,
                                      const struct skd_gltf_container *container,
                                      const struct skd_mesh *skinned,
                                      const struct skd_part_plan *plans, struct skd_error *error)
{
    struct skd_json meshes, primitives, attributes;
    if (!skd_json_member(container->json, "meshes", &meshes))
        return SKD_OK;
    size_t mesh_count = 0;
    struct skd_json *mesh_list = skd_json_elements(meshes, &mesh_count);
    if (mesh_list == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    for (size_t p = 0; p < skinned->part_count; p++) {
        const struct skd_part *part = &skinned->parts[p];
        const struct skd_part_plan *plan = &plans[plans[p].leader];
        size_t count = 0;
        if (plan->set_count == 0 ||
            !skd_json_member(mesh_list[part->mesh], "primitives", &primitives))
            continue;
        struct skd_json *list = skd_json_elements(primitives, &count);
        if (list == NULL) {
            free(mesh_list);
            return skd_fail_memory(error, "the JSON of a glTF file");
        }
        if (skd_json_member(list[part->primitive], "attributes", &attributes))
            for (int set = 0; set < plan->set_count; set++) {
                set_attribute(patch, attributes, "JOINTS", set, &plan->joints[set]);
                set_attribute(patch, attributes, "WEIGHTS", set, &plan->weights[set]);
            }
        free(list);
    }
    free(mesh_list);
    return SKD_OK;
}

static double stored_value(const struct skd_gltf_target *target, size_t vertex, size_t slot)
{
    const uint8_t *from =
        target->bytes + vertex * target->stride + slot * skd_component_bytes(target->component);
    uint16_t whole;
    float real;
    switch (target->component) {
    case SKD_GLTF_UNSIGNED_BYTE:
        return *from;
    case SKD_GLTF_UNSIGNED_SHORT:
        memcpy(&whole, from, sizeof whole);
        return whole;
    default:
        memcpy(&real, from, sizeof real);
        return (double)real;
    }
}

/* min and max of an accessor that was written over; as long as they hold, their text stays. */
static void set_bounds(struct skd_gltf_patch *patch, struct skd_json accessor,
                       const struct skd_gltf_target *target, size_t vertex_count)
{
    static const char *const names[] = {"min", "max"};
    double bounds[2][4];
    for (size_t slot = 0; slot < 4; slot++) {
        bounds[0][slot] = INFINITY;
        bounds[1][slot] = -INFINITY;
        for (size_t v = 0; v < vertex_count; v++) {
            const double value = stored_value(target, v, slot);
            bounds[0][slot] = fmin(bounds[0][slot], value);
            bounds[1][slot] = fmax(bounds[1][slot], value);
        }
    }
    for (int i = 0; i < 2; i++) {
        struct skd_json list, key, number;
        if (!skd_json_member(accessor, names[i], &list))
            continue;
        struct skd_json at = list;
        bool holds = skd_json_count(list) == 4;
        for (size_t slot = 0; holds && skd_json_next(&at, &key, &number); slot++)
            holds = strtof(number.start, NULL) == (float)bounds[i][slot];
        if (!holds)
            skd_json_replace(&patch->edits, list, "[%.17g,%.17g,%.17g,%.17g]", bounds[i][0],
                             bounds[i][1], bounds[i][2], bounds[i][3]);
    }
}

static enum skd_status update_bounds(struct skd_gltf_patch *patch,
                                     const struct skd_gltf_container *container,
                                     const struct skd_mesh *mesh, const struct skd_part_plan *plans,
                                     struct skd_error *error)
{
    const struct skd_gltf_accessor *accessors = container->document->accessors;
    struct skd_json array;
    size_t count = 0;
    if (!skd_json_member(container->json, "accessors", &array))
        return SKD_OK;
    struct skd_json *list = skd_json_elements(array, &count);
    if (list == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    for (size_t p = 0; p < mesh->part_count; p++)
        for (int set = 0; set < plans[p].set_count; set++) {
            const struct skd_gltf_target *both[] = {&plans[p].joints[set], &plans[p].weights[set]};
            for (int i = 0; i < 2; i++)
                if (!both[i]->is_new && accessors[both[i]->accessor].has_bounds)
                    set_bounds(patch, list[both[i]->accessor], both[i],
                               mesh->parts[p].vertex_count);
        }
    free(list);
    return SKD_OK;
}

/* The member of buffer `index`. */
static bool find_in_buffer(const struct skd_gltf_container *container, size_t index,
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

enum skd_status skd_gltf_patch_json(struct skd_gltf_patch *patch,
                                    const struct skd_gltf_container *container,
                                    const struct skd_mesh *mesh, const struct skd_part_plan *plans,
                                    struct skd_error *error)
{
    struct skd_json length;
    enum skd_status status = update_bounds(patch, container, mesh, plans, error);
    if (status != SKD_OK || patch->addition_count == 0)
        return status;
    status = add_accessors(patch, container, error);
    if (status == SKD_OK)
        status = set_attributes(patch, container, mesh, plans, error);
    if (status == SKD_OK && find_in_buffer(container, 0, "byteLength", &length))
        skd_json_replace(&patch->edits, length, "%zu",
                         container->buffers[0].size + patch->tail_bytes);
    return status;
}

struct skd_slice skd_gltf_patch_tail(const struct skd_gltf_patch *patch, size_t index)
{
    return index == 0 ? (struct skd_slice){patch->tail, patch->tail_bytes}
                      : (struct skd_slice){NULL, 0};
}

void skd_gltf_patch_data_uri(struct skd_gltf_patch *patch,
                             const struct skd_gltf_container *container, size_t index)
{
    const struct skd_gltf_buffer *buffer = &container->buffers[index];
    const struct skd_slice tail = skd_gltf_patch_tail(patch, index);
    const size_t own = tail.count > 0 ? buffer->size : buffer->stored;
    struct skd_json uri;
    if (!find_in_buffer(container, index, "uri", &uri))
        return;
    uint8_t *bytes = malloc(own + tail.count + 1);
    char *text = NULL;
    if (bytes != NULL) {
        memcpy(bytes, buffer->bytes, own);
        if (tail.count > 0)
            memcpy(bytes + own, tail.bytes, tail.count);
        text = skd_uri_encode_base64(bytes, own + tail.count);
        free(bytes);
    }
    /* What stands before the comma stays, escapes and all. */
    const char *comma = memchr(uri.start, ',', (size_t)(uri.end - uri.start));
    if (text == NULL)
        patch->edits.has_failed = true;
    else if (comma != NULL)
        skd_json_replace(&patch->edits, (struct skd_json){comma + 1, uri.end}, "%s\"", text);
    else
        skd_json_replace(&patch->edits, uri, "\"data:application/octet-stream;base64,%s\"", text);
    free(text);
}

void skd_gltf_patch_uri(struct skd_gltf_patch *patch, const struct skd_gltf_container *container,
                        size_t index, const char *path)
{
    struct skd_json uri;
    char *text = skd_uri_from_name(path);
    if (text == NULL)
        patch->edits.has_failed = true;
    else if (find_in_buffer(container, index, "uri", &uri))
        skd_json_replace(&patch->edits, uri, "\"%s\"", text);
    free(text);
}

static void put_u32(uint8_t *bytes, size_t value)
{
    for (int i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(value >> (8 * i));
}

/* A GLB with a JSON or BIN chunk of another size. */
static enum skd_status write_glb(struct skd_gltf_patch *patch,
                                 const struct skd_gltf_container *container, struct skd_slice json,
                                 struct skd_outputs *outputs, const char *name,
                                 struct skd_error *error)
{
    static const char spaces[ALIGNMENT] = "    ", zeros[ALIGNMENT];
    uint8_t head[GLB_HEADER + CHUNK_HEADER], bin_head[CHUNK_HEADER];
    const bool grows = container->bin != NULL && patch->tail_bytes > 0 &&
                       container->buffers[0].storage == SKD_BUFFER_CHUNK;
    const size_t bin = grows ? container->buffers[0].size : container->bin_bytes;
    const size_t tail = grows ? patch->tail_bytes : 0;
    const size_t rest = container->glb_bytes - container->chunks_end;
    const struct skd_slice slices[] = {
        {head, sizeof head},
        json,
        {spaces, padding_of(json.count)},
        {bin_head, container->bin != NULL ? sizeof bin_head : 0},
        {container->bin, bin},
        {patch->tail, tail},
        {zeros, padding_of(bin + tail)},
        {container->file + container->chunks_end, rest},
    };
    size_t total = 0;
    for (size_t i = 0; i < sizeof slices / sizeof *slices; i++)
        total += slices[i].count;
    if (total > UINT32_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "with the new weights the .glb would have more than 4 GiB");
    memcpy(head, "glTF", 4);
    put_u32(head + 4, 2);
    put_u32(head + 8, total);
    put_u32(head + 12, json.count + padding_of(json.count));
    put_u32(head + 16, CHUNK_JSON);
    put_u32(bin_head, bin + tail + padding_of(bin + tail));
    put_u32(bin_head + 4, CHUNK_BIN);
    return skd_outputs_add(outputs, name, slices, sizeof slices / sizeof *slices, error);
}

enum skd_status skd_gltf_patch_write(struct skd_gltf_patch *patch,
                                     const struct skd_gltf_container *container,
                                     struct skd_outputs *outputs, const char *name,
                                     struct skd_error *error)
{
    const char *text = (const char *)container->file;
    struct skd_json old = {text, text + container->file_bytes};
    struct skd_slice slice = {container->file, container->file_bytes};
    if (patch->edits.count == 0 && !patch->edits.has_failed)
        return skd_outputs_add(outputs, name, &slice, 1, error);
    if (container->is_glb)
        old = (struct skd_json){text + container->json_offset, container->json.end};
    char *edited = skd_json_apply(&patch->edits, old, &slice.count);
    if (edited == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    slice.bytes = edited;
    const enum skd_status status = container->is_glb
                                       ? write_glb(patch, container, slice, outputs, name, error)
                                       : skd_outputs_add(outputs, name, &slice, 1, error);
    free(edited);
    return status;
}

void skd_gltf_patch_finish(struct skd_gltf_patch *patch)
{
    skd_json_edits_finish(&patch->edits);
    free(patch->additions);
    free(patch->tail);
    free(patch->is_dirty);
    *patch = (struct skd_gltf_patch){0};
}
