/* See gltf_claims.h. */
#include "rig/gltf_claims.h"

#include "rig/elements.h"

#include <stdlib.h>
#include <string.h>

static void add_claim(struct skd_gltf_claims *claims, struct skd_gltf_claim claim)
{
    if (claims->count == claims->capacity) {
        const size_t capacity = claims->capacity * 2 + 64;
        struct skd_gltf_claim *items = realloc(claims->items, capacity * sizeof *items);
        if (items == NULL) {
            claims->has_failed = true;
            return;
        }
        claims->items = items;
        claims->capacity = capacity;
    }
    claims->items[claims->count++] = claim;
}

static void claim_view(const struct skd_gltf_document *document, const char *number,
                       struct skd_gltf_claims *claims)
{
    char *end = NULL;
    const long index = strtol(number, &end, 10);
    if (end == number || index < 0 || (size_t)index >= document->view_count)
        return;
    const struct skd_gltf_view *view = &document->views[index];
    add_claim(claims, (struct skd_gltf_claim){.accessor = -1,
                                              .buffer = view->buffer,
                                              .start = view->offset,
                                              .end = view->offset + view->bytes});
}

/* Claims the view of every "bufferView" below `value`: images, sparse parts, extensions. At depth 0
 * the object's own one is left out. */
static void claim_nested(const struct skd_gltf_document *document, struct skd_json value, int depth,
                         struct skd_gltf_claims *claims)
{
    static const char name[] = "\"bufferView\"";
    struct skd_json key, item;
    while (skd_json_next(&value, &key, &item)) {
        const bool is_view = (size_t)(key.end - key.start) == sizeof name - 1 &&
                             memcmp(key.start, name, sizeof name - 1) == 0;
        if (is_view && depth > 0)
            claim_view(document, item.start, claims);
        else if (*item.start == '{' || *item.start == '[')
            claim_nested(document, item, depth + 1, claims);
    }
}

static void claim_accessor(const struct skd_gltf_document *document, size_t index,
                           struct skd_gltf_claims *claims)
{
    const struct skd_gltf_accessor *accessor = &document->accessors[index];
    if (accessor->view < 0 || (size_t)accessor->view >= document->view_count ||
        accessor->count == 0)
        return;
    const struct skd_gltf_view *view = &document->views[accessor->view];
    const size_t element_bytes = (size_t)accessor->width * skd_component_bytes(accessor->component);
    const size_t start = view->offset + accessor->offset;
    const size_t stride = view->stride != 0 ? view->stride : element_bytes;
    size_t end = 0;
    if (__builtin_mul_overflow(accessor->count - 1, stride, &end) ||
        __builtin_add_overflow(end, start + element_bytes, &end))
        end = SIZE_MAX;
    add_claim(claims, (struct skd_gltf_claim){.accessor = (int32_t)index,
                                              .buffer = view->buffer,
                                              .start = start,
                                              .end = end,
                                              .stride = stride,
                                              .element_bytes = element_bytes});
}

static void claim_all(const struct skd_gltf_container *container, struct skd_gltf_claims *claims)
{
    const struct skd_gltf_document *document = container->document;
    struct skd_json root = container->json, key, value, list, item;
    for (size_t a = 0; a < document->accessor_count; a++)
        claim_accessor(document, a, claims);
    if (skd_json_member(root, "accessors", &list))
        while (skd_json_next(&list, &key, &item))
            claim_nested(document, item, 0, claims);
    while (skd_json_next(&root, &key, &value))
        if (strncmp(key.start, "\"accessors\"", 11) != 0 &&
            strncmp(key.start, "\"bufferViews\"", 13) != 0 &&
            strncmp(key.start, "\"buffers\"", 9) != 0)
            claim_nested(document, value, 1, claims);
}

enum skd_status skd_gltf_claims_find(const struct skd_gltf_container *container,
                                     struct skd_gltf_claims *claims, struct skd_error *error)
{
    claim_all(container, claims);
    return claims->has_failed ? skd_fail_memory(error, "the plan of an export") : SKD_OK;
}

void skd_gltf_claims_finish(struct skd_gltf_claims *claims)
{
    free(claims->items);
    *claims = (struct skd_gltf_claims){0};
}

static bool do_overlap(const struct skd_gltf_claim *a, const struct skd_gltf_claim *b)
{
    if (a->buffer != b->buffer || a->start >= b->end || b->start >= a->end)
        return false;
    if (a->stride == 0 || a->stride != b->stride)
        return true;
    /* Interleaved: b's elements begin this far into a's steps. */
    const size_t shift = b->start >= a->start
                             ? (b->start - a->start) % a->stride
                             : (a->stride - (a->start - b->start) % a->stride) % a->stride;
    return shift < a->element_bytes || shift + b->element_bytes > a->stride;
}

size_t skd_gltf_find_part(const struct skd_mesh *mesh, size_t mesh_index, size_t primitive)
{
    size_t p = 0;
    while (p < mesh->part_count && ((size_t)mesh->parts[p].mesh != mesh_index ||
                                    (size_t)mesh->parts[p].primitive != primitive))
        p++;
    return p;
}

/* In how many of its roles a primitive uses an accessor. */
static int count_uses(const struct skd_gltf_primitive *primitive, int32_t accessor)
{
    const int sets = primitive->set_count < SKD_SETS_MAX ? primitive->set_count : SKD_SETS_MAX;
    int uses = (primitive->position == accessor) + (primitive->indices == accessor);
    for (int set = 0; set < sets; set++)
        uses += (primitive->joints[set] == accessor) + (primitive->weights[set] == accessor);
    return uses;
}

/* True when the accessor has a user that does not want the same rows as the part's group, or a use
 * of another kind. */
static bool has_other_user(const struct skd_rig *rig, const struct skd_gltf_document *document,
                           const size_t *leaders, size_t part, int32_t accessor)
{
    int known = 0;
    for (size_t m = 0; m < document->mesh_count; m++)
        for (size_t p = 0; p < document->meshes[m].primitive_count; p++) {
            const int uses = count_uses(&document->meshes[m].primitives[p], accessor);
            if (uses == 0)
                continue;
            const size_t user = skd_gltf_find_part(&rig->mesh, m, p);
            if (uses > 1 || user == rig->mesh.part_count || leaders[user] != leaders[part])
                return true;
            known += uses;
        }
    return known != document->accessors[accessor].use_count;
}

static bool is_alone(const struct skd_gltf_claims *claims, int32_t accessor)
{
    const struct skd_gltf_claim *own = NULL;
    for (size_t i = 0; own == NULL && i < claims->count; i++)
        if (claims->items[i].accessor == accessor)
            own = &claims->items[i];
    for (size_t i = 0; own != NULL && i < claims->count; i++)
        if (claims->items[i].accessor != accessor && do_overlap(own, &claims->items[i]))
            return false;
    return own != NULL;
}

bool skd_gltf_is_own(const struct skd_gltf_claims *claims, const struct skd_rig *rig,
                     const struct skd_gltf_document *document, const size_t *leaders, size_t part,
                     int32_t accessor)
{
    return accessor >= 0 && is_alone(claims, accessor) &&
           !has_other_user(rig, document, leaders, part, accessor);
}

struct skd_gltf_target skd_gltf_choose_target(const struct skd_gltf_container *container,
                                              int32_t accessor, int width, int component,
                                              bool may_overwrite)
{
    const struct skd_gltf_document *document = container->document;
    struct skd_gltf_target target = {.is_new = true, .accessor = accessor, .component = component};
    if (accessor < 0 || !may_overwrite)
        return target;
    const struct skd_gltf_accessor *from = &document->accessors[accessor];
    if (from->view < 0 || from->is_sparse || from->component != component)
        return target;
    const struct skd_gltf_view *view = &document->views[from->view];
    target.is_new = false;
    target.bytes = container->buffers[view->buffer].bytes + view->offset + from->offset;
    target.stride =
        view->stride != 0 ? view->stride : (size_t)width * skd_component_bytes(from->component);
    return target;
}
