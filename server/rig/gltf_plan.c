/* See gltf_plan.h. */
#include "rig/gltf_plan.h"

#include <stdlib.h>
#include <string.h>

/* Bytes of a buffer that something in the file stands on. */
struct claim {
    int32_t accessor; /* -1: not an accessor's own elements */
    int32_t buffer;
    size_t start;
    size_t end;
    size_t stride; /* 0: every byte from start to end */
    size_t element_bytes;
};

struct claims {
    size_t count;
    size_t capacity;
    struct claim *items;
    bool has_failed;
};

static void add_claim(struct claims *claims, struct claim claim)
{
    if (claims->count == claims->capacity) {
        const size_t capacity = claims->capacity * 2 + 64;
        struct claim *items = realloc(claims->items, capacity * sizeof *items);
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
                       struct claims *claims)
{
    char *end = NULL;
    const long index = strtol(number, &end, 10);
    if (end == number || index < 0 || (size_t)index >= document->view_count)
        return;
    const struct skd_gltf_view *view = &document->views[index];
    add_claim(claims, (struct claim){.accessor = -1,
                                     .buffer = view->buffer,
                                     .start = view->offset,
                                     .end = view->offset + view->bytes});
}

/* Claims the view of every "bufferView" below `value`: images, sparse parts, extensions. At depth 0
 * the object's own one is left out. */
static void claim_nested(const struct skd_gltf_document *document, struct skd_json value, int depth,
                         struct claims *claims)
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
                           struct claims *claims)
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
    add_claim(claims, (struct claim){.accessor = (int32_t)index,
                                     .buffer = view->buffer,
                                     .start = start,
                                     .end = end,
                                     .stride = stride,
                                     .element_bytes = element_bytes});
}

static void find_claims(const struct skd_gltf_container *container, struct claims *claims)
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

static bool do_overlap(const struct claim *a, const struct claim *b)
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

int skd_wanted_row(const struct skd_new_weights *wanted, size_t vertex, struct skd_influence *row)
{
    const size_t first = vertex * (size_t)wanted->slot_count;
    int count = 0;
    for (size_t k = first; k < first + (size_t)wanted->slot_count; k++) {
        if (wanted->joints[k] == SKD_SLOT_EMPTY || wanted->weights[k] == 0)
            continue;
        if (!(wanted->weights[k] > 0))
            return -1;
        row[count++] = (struct skd_influence){wanted->joints[k], wanted->weights[k]};
    }
    return count;
}

static bool are_rows_equal(const struct skd_influence *a, int a_count,
                           const struct skd_influence *b, int b_count)
{
    for (int i = 0; i < a_count; i++) {
        int k = 0;
        while (k < b_count && b[k].bone != a[i].bone)
            k++;
        if (k == b_count || b[k].weight != a[i].weight)
            return false;
    }
    return a_count == b_count;
}

bool skd_row_is_kept(struct skd_gltf_sets *sets, size_t vertex, const struct skd_influence *wanted,
                     int wanted_count)
{
    struct skd_influence row[SKD_INFLUENCES_MAX];
    size_t notes[SKD_NOTE_COUNT] = {0};
    const int count = skd_gltf_sets_row(sets, vertex, row, notes);
    if (count < 0 || !are_rows_equal(row, count, wanted, wanted_count))
        return false;
    for (int note = 0; note < SKD_NOTE_COUNT; note++)
        if (notes[note] != 0)
            return false;
    return true;
}

/* What the part's rows need. */
static enum skd_status compare_rows(const struct skd_rig *rig,
                                    const struct skd_gltf_container *container,
                                    const struct skd_new_weights *wanted,
                                    const struct skd_part *part, struct skd_part_plan *plan,
                                    struct skd_error *error)
{
    struct skd_gltf_sets sets;
    enum skd_status status = skd_gltf_sets_open(container, rig->source, rig, part, &sets, error);
    if (status != SKD_OK)
        return status;
    for (size_t v = 0; v < part->vertex_count; v++) {
        struct skd_influence row[SKD_INFLUENCES_MAX];
        const int count = skd_wanted_row(wanted, part->first_vertex + v, row);
        if (count < 0) {
            status = skd_fail(error, SKD_UNSUPPORTED,
                              "vertex %zu has a negative weight, which glTF does not allow; solve "
                              "it with the constraint \"simplex\" before export",
                              part->first_vertex + v);
            break;
        }
        if (skd_row_is_kept(&sets, v, row, count))
            continue;
        plan->is_changed = true;
        plan->most = count > plan->most ? count : plan->most;
        for (int i = 0; i < count; i++) {
            const uint32_t joint = rig->source->joint_of_bone[row[i].bone];
            plan->highest = joint > plan->highest ? joint : plan->highest;
        }
    }
    skd_gltf_sets_close(&sets);
    return status;
}

static const struct skd_gltf_primitive *primitive_of(const struct skd_gltf_document *document,
                                                     const struct skd_part *part)
{
    return &document->meshes[part->mesh].primitives[part->primitive];
}

static bool do_agree(const struct skd_rig *rig, const struct skd_gltf_document *document,
                     const struct skd_new_weights *wanted, size_t a, size_t b)
{
    const struct skd_part *first = &rig->mesh.parts[a], *second = &rig->mesh.parts[b];
    const struct skd_gltf_primitive *x = primitive_of(document, first);
    const struct skd_gltf_primitive *y = primitive_of(document, second);
    if (first->skin != second->skin || first->vertex_count != second->vertex_count ||
        x->set_count != y->set_count || memcmp(x->joints, y->joints, sizeof x->joints) != 0 ||
        memcmp(x->weights, y->weights, sizeof x->weights) != 0)
        return false;
    for (size_t v = 0; v < first->vertex_count; v++) {
        struct skd_influence row[SKD_INFLUENCES_MAX], other[SKD_INFLUENCES_MAX];
        const int count = skd_wanted_row(wanted, first->first_vertex + v, row);
        const int other_count = skd_wanted_row(wanted, second->first_vertex + v, other);
        if (!are_rows_equal(row, count, other, other_count))
            return false;
    }
    return true;
}

/* The part that a primitive became, or part_count. */
static size_t find_part(const struct skd_mesh *mesh, size_t mesh_index, size_t primitive)
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
                           const struct skd_part_plan *plans, size_t part, int32_t accessor)
{
    int known = 0;
    for (size_t m = 0; m < document->mesh_count; m++)
        for (size_t p = 0; p < document->meshes[m].primitive_count; p++) {
            const int uses = count_uses(&document->meshes[m].primitives[p], accessor);
            if (uses == 0)
                continue;
            const size_t user = find_part(&rig->mesh, m, p);
            if (uses > 1 || user == rig->mesh.part_count ||
                plans[user].leader != plans[part].leader)
                return true;
            known += uses;
        }
    return known != document->accessors[accessor].use_count;
}

static bool is_alone(const struct claims *claims, int32_t accessor)
{
    const struct claim *own = NULL;
    for (size_t i = 0; own == NULL && i < claims->count; i++)
        if (claims->items[i].accessor == accessor)
            own = &claims->items[i];
    for (size_t i = 0; own != NULL && i < claims->count; i++)
        if (claims->items[i].accessor != accessor && do_overlap(own, &claims->items[i]))
            return false;
    return own != NULL;
}

/* In place, or a new accessor of the type that is needed. */
static void choose_target(const struct skd_gltf_container *container, int32_t accessor,
                          int component, bool may_overwrite, struct skd_gltf_target *target)
{
    const struct skd_gltf_document *document = container->document;
    *target =
        (struct skd_gltf_target){.is_new = true, .accessor = accessor, .component = component};
    if (accessor < 0 || !may_overwrite)
        return;
    const struct skd_gltf_accessor *from = &document->accessors[accessor];
    if (from->view < 0 || from->is_sparse || from->component != component)
        return;
    const struct skd_gltf_view *view = &document->views[from->view];
    target->is_new = false;
    target->bytes = container->buffers[view->buffer].bytes + view->offset + from->offset;
    target->stride = view->stride != 0 ? view->stride : 4 * skd_component_bytes(from->component);
}

static void plan_targets(const struct skd_rig *rig, const struct skd_gltf_container *container,
                         const struct claims *claims, struct skd_part_plan *plans, size_t part)
{
    const struct skd_gltf_document *document = container->document;
    const struct skd_gltf_primitive *primitive = primitive_of(document, &rig->mesh.parts[part]);
    struct skd_part_plan *plan = &plans[part];
    const int needed = (plan->most + 3) / 4;
    plan->set_count = needed > primitive->set_count ? needed : primitive->set_count;
    for (int set = 0; set < plan->set_count; set++) {
        const bool is_there = set < primitive->set_count;
        const int32_t joints = is_there ? primitive->joints[set] : -1;
        const int32_t weights = is_there ? primitive->weights[set] : -1;
        const struct skd_gltf_accessor *like =
            &document->accessors[primitive->joints[is_there ? set : 0]];
        choose_target(container, joints,
                      plan->highest > UINT8_MAX ? SKD_GLTF_UNSIGNED_SHORT : like->component,
                      is_there && is_alone(claims, joints) &&
                          !has_other_user(rig, document, plans, part, joints),
                      &plan->joints[set]);
        like = &document->accessors[primitive->weights[is_there ? set : 0]];
        choose_target(container, weights, like->component,
                      is_there && is_alone(claims, weights) &&
                          !has_other_user(rig, document, plans, part, weights),
                      &plan->weights[set]);
    }
}

enum skd_status skd_gltf_plan(const struct skd_rig *rig, const struct skd_gltf_container *container,
                              const struct skd_new_weights *wanted, struct skd_part_plan *plans,
                              struct skd_error *error)
{
    const size_t count = rig->mesh.part_count;
    struct claims claims = {0};
    for (size_t p = 0; p < count; p++) {
        const enum skd_status status =
            compare_rows(rig, container, wanted, &rig->mesh.parts[p], &plans[p], error);
        if (status != SKD_OK)
            return status;
        plans[p].leader = p;
        for (size_t q = 0; q < p && plans[p].leader == p; q++)
            if (plans[q].leader == q && do_agree(rig, container->document, wanted, q, p))
                plans[p].leader = q;
    }
    find_claims(container, &claims);
    for (size_t p = 0; !claims.has_failed && p < count; p++)
        if (plans[p].is_changed && plans[p].leader == p)
            plan_targets(rig, container, &claims, plans, p);
    free(claims.items);
    return claims.has_failed ? skd_fail_memory(error, "the plan of an export") : SKD_OK;
}
