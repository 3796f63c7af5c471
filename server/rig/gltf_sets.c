/* See gltf_sets.h. */
#include "rig/gltf_sets.h"

#include <stdio.h>
#include <string.h>

_Static_assert(SKD_SETS_MAX * 4 == SKD_INFLUENCES_MAX, "a set is four influences");

static enum skd_status open_set(const struct skd_gltf_container *container,
                                const struct skd_part *part, int32_t accessor, const char *kind,
                                int set, struct skd_elements *elements, struct skd_error *error)
{
    char what[96];
    (void)snprintf(what, sizeof what, "%s_%d of mesh %d, primitive %d", kind, set, part->mesh,
                   part->primitive);
    if (accessor < 0)
        return skd_fail(error, SKD_BAD_RIG, "%s is missing; JOINTS_n and WEIGHTS_n go in pairs",
                        what);
    const enum skd_status status = skd_elements_open(container, accessor, 4, what, elements, error);
    if (status == SKD_OK && elements->count != part->vertex_count)
        return skd_fail(error, SKD_BAD_RIG, "%s has %zu elements for %zu vertices", what,
                        elements->count, part->vertex_count);
    return status;
}

static enum skd_status check_types(const struct skd_elements *joints,
                                   const struct skd_elements *weights, const struct skd_part *part,
                                   struct skd_error *error)
{
    if (joints->component != SKD_GLTF_UNSIGNED_BYTE && joints->component != SKD_GLTF_UNSIGNED_SHORT)
        return skd_fail(error, SKD_BAD_RIG,
                        "mesh %d, primitive %d: JOINTS_n must be unsigned bytes or shorts",
                        part->mesh, part->primitive);
    if (weights->component != SKD_GLTF_UNSIGNED_BYTE &&
        weights->component != SKD_GLTF_UNSIGNED_SHORT && weights->component != SKD_GLTF_FLOAT)
        return skd_fail(error, SKD_BAD_RIG,
                        "mesh %d, primitive %d: WEIGHTS_n must be floats, unsigned bytes or shorts",
                        part->mesh, part->primitive);
    return SKD_OK;
}

static uint16_t find_root(const struct skd_skeleton *skeleton, uint16_t skin)
{
    int bone = 0;
    while (skeleton->skins[bone] != skin || skeleton->parents[bone] >= 0)
        bone++;
    return (uint16_t)bone;
}

enum skd_status skd_gltf_sets_open(const struct skd_gltf_container *container,
                                   const struct skd_gltf_source *source, const struct skd_rig *rig,
                                   const struct skd_part *part, struct skd_gltf_sets *sets,
                                   struct skd_error *error)
{
    const struct skd_gltf_primitive *primitive =
        &container->document->meshes[part->mesh].primitives[part->primitive];
    const uint32_t *first = &source->skin_joints[part->skin];
    sets->vertex_count = part->vertex_count;
    sets->count = 0;
    sets->joint_count = first[1] - first[0];
    sets->bones = source->bone_of_joint + first[0];
    sets->root = find_root(&rig->skeleton, part->skin);
    sets->read_first = sets->read_end = 0;
    enum skd_status status = SKD_OK;
    for (int set = 0; status == SKD_OK && set < primitive->set_count; set++) {
        sets->count = set + 1;
        /* Both are closed, also when one was never opened. */
        sets->joints[set] = sets->weights[set] = (struct skd_elements){0};
        status = open_set(container, part, primitive->joints[set], "JOINTS", set,
                          &sets->joints[set], error);
        if (status == SKD_OK)
            status = open_set(container, part, primitive->weights[set], "WEIGHTS", set,
                              &sets->weights[set], error);
        if (status == SKD_OK)
            status = check_types(&sets->joints[set], &sets->weights[set], part, error);
        sets->weights[set].is_normalized = true; /* integers mean nothing else here */
    }
    if (status != SKD_OK)
        skd_gltf_sets_close(sets);
    return status;
}

void skd_gltf_sets_close(struct skd_gltf_sets *sets)
{
    for (int set = 0; set < sets->count; set++) {
        skd_elements_close(&sets->joints[set]);
        skd_elements_close(&sets->weights[set]);
    }
    sets->count = 0;
}

/* Where the vertex's row stands among those that were read. */
static size_t read_ahead(struct skd_gltf_sets *sets, size_t vertex)
{
    if (vertex < sets->read_first || vertex >= sets->read_end) {
        const size_t left = sets->vertex_count - vertex;
        const size_t count = left < SKD_ROWS_AHEAD ? left : SKD_ROWS_AHEAD;
        for (int set = 0; set < sets->count; set++) {
            skd_elements_integers(&sets->joints[set], vertex, count, sets->read_joints[set][0]);
            skd_elements_floats(&sets->weights[set], vertex, count, sets->read_weights[set][0]);
        }
        sets->read_first = vertex;
        sets->read_end = vertex + count;
    }
    return vertex - sets->read_first;
}

void skd_gltf_sets_raw_row(struct skd_gltf_sets *sets, size_t vertex, uint32_t *joints,
                           float *weights)
{
    const size_t at = read_ahead(sets, vertex);
    for (int set = 0; set < sets->count; set++) {
        memcpy(joints + set * 4, sets->read_joints[set][at], 4 * sizeof *joints);
        memcpy(weights + set * 4, sets->read_weights[set][at], 4 * sizeof *weights);
    }
}

int skd_gltf_sets_row(struct skd_gltf_sets *sets, size_t vertex, struct skd_influence *row,
                      size_t *notes)
{
    const size_t at = read_ahead(sets, vertex);
    int count = 0;
    for (int set = 0; set < sets->count; set++) {
        const uint32_t *joints = sets->read_joints[set][at];
        const float *weights = sets->read_weights[set][at];
        for (int i = 0; i < 4; i++) {
            if (weights[i] == 0)
                continue;
            if (joints[i] >= sets->joint_count)
                return -1;
            row[count++] = (struct skd_influence){sets->bones[joints[i]], weights[i]};
        }
    }
    return skd_influences_mend(row, count, sets->root, notes);
}
