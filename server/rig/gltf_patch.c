/* See gltf_patch.h. */
#include "rig/gltf_patch.h"

#include "rig/uri.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 4, GLB_HEADER = 12, CHUNK_HEADER = 8 };

#define CHUNK_JSON 0x4E4F534Au
#define CHUNK_BIN 0x004E4942u

static size_t padding_of(size_t bytes)
{
    return (ALIGNMENT - bytes % ALIGNMENT) % ALIGNMENT;
}

enum skd_status skd_gltf_patch_init(struct skd_gltf_patch *patch,
                                    const struct skd_gltf_container *container,
                                    struct skd_error *error)
{
    patch->is_dirty = calloc(container->buffer_count + 1, sizeof *patch->is_dirty);
    if (patch->is_dirty == NULL)
        return skd_fail_memory(error, "buffers");
    return skd_gltf_additions_init(&patch->additions, container, error);
}

void skd_gltf_patch_touch(struct skd_gltf_patch *patch, const struct skd_gltf_document *document,
                          const struct skd_gltf_target *target)
{
    patch->is_dirty[document->views[document->accessors[target->accessor].view].buffer] = true;
}

static enum skd_status make_room(struct skd_gltf_patch *patch,
                                 const struct skd_gltf_document *document,
                                 struct skd_gltf_target *target, size_t vertex_count,
                                 bool is_weights, struct skd_error *error)
{
    if (!target->is_new) {
        skd_gltf_patch_touch(patch, document, target);
        return SKD_OK;
    }
    const struct skd_gltf_addition addition = {.component = target->component,
                                               .width = 4,
                                               .is_normalized = is_weights &&
                                                                target->component != SKD_GLTF_FLOAT,
                                               .is_vertex_data = true,
                                               .count = vertex_count};
    target->stride = 4 * skd_component_bytes(target->component);
    return skd_gltf_add_elements(&patch->additions, &addition, &target->accessor, &target->offset,
                                 error);
}

enum skd_status skd_gltf_patch_make_room(struct skd_gltf_patch *patch,
                                         const struct skd_gltf_container *container,
                                         const struct skd_mesh *mesh, struct skd_part_plan *plans,
                                         struct skd_error *error)
{
    const struct skd_gltf_document *document = container->document;
    enum skd_status status = SKD_OK;
    for (size_t p = 0; p < mesh->part_count; p++)
        for (int set = 0; set < plans[p].set_count; set++) {
            const size_t count = mesh->parts[p].vertex_count;
            status = make_room(patch, document, &plans[p].joints[set], count, false, error);
            if (status == SKD_OK)
                status = make_room(patch, document, &plans[p].weights[set], count, true, error);
            if (status != SKD_OK)
                return status;
        }
    for (size_t p = 0; p < mesh->part_count; p++)
        for (int set = 0; set < plans[p].set_count; set++) {
            struct skd_gltf_target *joints = &plans[p].joints[set];
            struct skd_gltf_target *weights = &plans[p].weights[set];
            if (joints->is_new)
                joints->bytes = patch->additions.tail + joints->offset;
            if (weights->is_new)
                weights->bytes = patch->additions.tail + weights->offset;
        }
    return SKD_OK;
}

void skd_gltf_patch_attribute(struct skd_gltf_patch *patch, struct skd_json attributes,
                              const char *name, int32_t accessor)
{
    char number[16];
    struct skd_json old;
    (void)snprintf(number, sizeof number, "%d", accessor);
    if (skd_json_member(attributes, name, &old))
        skd_json_replace(&patch->edits, old, "%s", number);
    else
        skd_json_add(&patch->edits, attributes, name, number);
}

static void set_attribute(struct skd_gltf_patch *patch, struct skd_json attributes,
                          const char *kind, int set, const struct skd_gltf_target *target)
{
    char name[32];
    (void)snprintf(name, sizeof name, "%s_%d", kind, set);
    if (target->is_new)
        skd_gltf_patch_attribute(patch, attributes, name, target->accessor);
}

bool skd_gltf_primitive_json(const struct skd_json *meshes, size_t mesh, size_t primitive,
                             struct skd_json *value)
{
    struct skd_json list, key;
    if (!skd_json_member(meshes[mesh], "primitives", &list))
        return false;
    for (size_t i = 0; i <= primitive; i++)
        if (!skd_json_next(&list, &key, value))
            return false;
    return true;
}

/* Primitives name the new accessors. */
static enum skd_status set_attributes(struct skd_gltf_patch *patch,
                                      const struct skd_gltf_container *container,
                                      const struct skd_mesh *skinned,
                                      const struct skd_part_plan *plans, struct skd_error *error)
{
    size_t count = 0;
    struct skd_json *meshes = skd_json_member_elements(container->json, "meshes", &count);
    if (meshes == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    for (size_t p = 0; p < skinned->part_count; p++) {
        const struct skd_part *part = &skinned->parts[p];
        const struct skd_part_plan *plan = &plans[plans[p].leader];
        struct skd_json primitive, attributes;
        if (plan->set_count == 0 ||
            !skd_gltf_primitive_json(meshes, (size_t)part->mesh, (size_t)part->primitive,
                                     &primitive) ||
            !skd_json_member(primitive, "attributes", &attributes))
            continue;
        for (int set = 0; set < plan->set_count; set++) {
            set_attribute(patch, attributes, "JOINTS", set, &plan->joints[set]);
            set_attribute(patch, attributes, "WEIGHTS", set, &plan->weights[set]);
        }
    }
    free(meshes);
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

void skd_gltf_patch_bounds(struct skd_gltf_patch *patch, struct skd_json accessor,
                           const struct skd_gltf_target *target, size_t width, size_t count)
{
    static const char *const names[] = {"min", "max"};
    double bounds[2][4];
    for (size_t slot = 0; slot < width; slot++) {
        bounds[0][slot] = INFINITY;
        bounds[1][slot] = -INFINITY;
        for (size_t v = 0; v < count; v++) {
            const double value = stored_value(target, v, slot);
            bounds[0][slot] = fmin(bounds[0][slot], value);
            bounds[1][slot] = fmax(bounds[1][slot], value);
        }
    }
    for (int i = 0; i < 2; i++) {
        struct skd_json list, key, number;
        char text[4 * 32] = "", *end = text;
        if (!skd_json_member(accessor, names[i], &list))
            continue;
        struct skd_json at = list;
        bool holds = skd_json_count(list) == width;
        for (size_t slot = 0; holds && skd_json_next(&at, &key, &number); slot++)
            holds = strtof(number.start, NULL) == (float)bounds[i][slot];
        for (size_t slot = 0; slot < width; slot++)
            end += sprintf(end, "%s%.17g", slot > 0 ? "," : "", bounds[i][slot]);
        if (!holds)
            skd_json_replace(&patch->edits, list, "[%s]", text);
    }
}

static enum skd_status update_bounds(struct skd_gltf_patch *patch,
                                     const struct skd_gltf_container *container,
                                     const struct skd_mesh *mesh, const struct skd_part_plan *plans,
                                     struct skd_error *error)
{
    const struct skd_gltf_accessor *accessors = container->document->accessors;
    size_t count = 0;
    struct skd_json *list = skd_json_member_elements(container->json, "accessors", &count);
    if (list == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    for (size_t p = 0; p < mesh->part_count; p++)
        for (int set = 0; set < plans[p].set_count; set++) {
            const struct skd_gltf_target *both[] = {&plans[p].joints[set], &plans[p].weights[set]};
            for (int i = 0; i < 2; i++)
                if (!both[i]->is_new && accessors[both[i]->accessor].has_bounds)
                    skd_gltf_patch_bounds(patch, list[both[i]->accessor], both[i], 4,
                                          mesh->parts[p].vertex_count);
        }
    free(list);
    return SKD_OK;
}

enum skd_status skd_gltf_patch_json(struct skd_gltf_patch *patch,
                                    const struct skd_gltf_container *container,
                                    const struct skd_mesh *mesh, const struct skd_part_plan *plans,
                                    struct skd_error *error)
{
    const enum skd_status status = update_bounds(patch, container, mesh, plans, error);
    return status == SKD_OK ? set_attributes(patch, container, mesh, plans, error) : status;
}

enum skd_status skd_gltf_patch_close(struct skd_gltf_patch *patch, struct skd_error *error)
{
    if (patch->additions.accessor_count == 0)
        return SKD_OK;
    if (patch->additions.tail_bytes > 0)
        patch->is_dirty[0] = true;
    return skd_gltf_additions_json(&patch->additions, &patch->edits, error);
}

struct skd_slice skd_gltf_patch_tail(const struct skd_gltf_patch *patch, size_t index)
{
    return index == 0 ? (struct skd_slice){patch->additions.tail, patch->additions.tail_bytes}
                      : (struct skd_slice){NULL, 0};
}

void skd_gltf_patch_data_uri(struct skd_gltf_patch *patch,
                             const struct skd_gltf_container *container, size_t index)
{
    const struct skd_gltf_buffer *buffer = &container->buffers[index];
    const struct skd_slice tail = skd_gltf_patch_tail(patch, index);
    const size_t own = tail.count > 0 ? buffer->size : buffer->stored;
    struct skd_json uri;
    if (!skd_gltf_buffer_member(container, index, "uri", &uri))
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
    else if (skd_gltf_buffer_member(container, index, "uri", &uri))
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
    const bool grows = container->bin != NULL && patch->additions.tail_bytes > 0 &&
                       container->buffers[0].storage == SKD_BUFFER_CHUNK;
    const size_t bin = grows ? container->buffers[0].size : container->bin_bytes;
    const size_t tail = grows ? patch->additions.tail_bytes : 0;
    const size_t rest = container->glb_bytes - container->chunks_end;
    const struct skd_slice slices[] = {
        {head, sizeof head},
        json,
        {spaces, padding_of(json.count)},
        {bin_head, container->bin != NULL ? sizeof bin_head : 0},
        {container->bin, bin},
        {patch->additions.tail, tail},
        {zeros, padding_of(bin + tail)},
        {container->file + container->chunks_end, rest},
    };
    size_t total = 0;
    for (size_t i = 0; i < sizeof slices / sizeof *slices; i++)
        total += slices[i].count;
    if (total > UINT32_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "with its changes the .glb would have more than 4 GiB");
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
    skd_gltf_additions_finish(&patch->additions);
    free(patch->is_dirty);
    *patch = (struct skd_gltf_patch){0};
}
