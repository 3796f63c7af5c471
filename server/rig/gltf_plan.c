/* See gltf_plan.h. */
#include "rig/gltf_plan.h"

#include <stdlib.h>
#include <string.h>

int skd_wanted_row(const struct skd_gltf_content *wanted, size_t vertex, struct skd_influence *row)
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
                                    const struct skd_gltf_content *wanted,
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
                     const struct skd_gltf_content *wanted, size_t a, size_t b)
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

static void plan_targets(const struct skd_rig *rig, const struct skd_gltf_container *container,
                         const struct skd_gltf_claims *claims, const size_t *leaders, size_t part,
                         struct skd_part_plan *plan)
{
    const struct skd_gltf_document *document = container->document;
    const struct skd_gltf_primitive *primitive = primitive_of(document, &rig->mesh.parts[part]);
    const int needed = (plan->most + 3) / 4;
    plan->set_count = needed > primitive->set_count ? needed : primitive->set_count;
    for (int set = 0; set < plan->set_count; set++) {
        const bool is_there = set < primitive->set_count;
        const int32_t joints = is_there ? primitive->joints[set] : -1;
        const int32_t weights = is_there ? primitive->weights[set] : -1;
        const struct skd_gltf_accessor *like =
            &document->accessors[primitive->joints[is_there ? set : 0]];
        plan->joints[set] = skd_gltf_choose_target(
            container, joints, 4,
            plan->highest > UINT8_MAX ? SKD_GLTF_UNSIGNED_SHORT : like->component,
            skd_gltf_is_own(claims, rig, document, leaders, part, joints));
        like = &document->accessors[primitive->weights[is_there ? set : 0]];
        plan->weights[set] =
            skd_gltf_choose_target(container, weights, 4, like->component,
                                   skd_gltf_is_own(claims, rig, document, leaders, part, weights));
    }
}

enum skd_status skd_gltf_plan(const struct skd_rig *rig, const struct skd_gltf_container *container,
                              const struct skd_gltf_claims *claims,
                              const struct skd_gltf_content *wanted, struct skd_part_plan *plans,
                              struct skd_error *error)
{
    const size_t count = rig->mesh.part_count;
    for (size_t p = 0; p < count; p++) {
        const enum skd_status status =
            compare_rows(rig, container, wanted, &rig->mesh.parts[p], &plans[p], error);
        if (status != SKD_OK)
            return status;
    }
    size_t *leaders = malloc((count + 1) * sizeof *leaders);
    if (leaders == NULL)
        return skd_fail_memory(error, "the plan of an export");
    for (size_t p = 0; p < count; p++) {
        leaders[p] = p;
        for (size_t q = 0; q < p && leaders[p] == p; q++)
            if (leaders[q] == q && do_agree(rig, container->document, wanted, q, p))
                leaders[p] = q;
        plans[p].leader = leaders[p];
    }
    for (size_t p = 0; p < count; p++)
        if (plans[p].is_changed && leaders[p] == p)
            plan_targets(rig, container, claims, leaders, p, &plans[p]);
    free(leaders);
    return SKD_OK;
}
