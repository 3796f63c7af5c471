/* See gltf_shapes.h: the targets and their elements. */
#include "rig/gltf_shapes.h"

#include "rig/gltf_claims.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Memory for the offsets of one primitive. */
struct scratch {
    float *offsets; /* [vertices][3] */
    float *others;  /* the same of a primitive to compare with */
    uint32_t *indices;
    float *values;
    int32_t *made; /* [primitives][shapes] accessors */
};

/* A primitive that gets targets. */
struct receiver {
    size_t mesh;
    size_t primitive;
    const struct skd_part *part; /* NULL: not skinned */
    size_t vertex_count;
    struct skd_json json;
    int32_t zeros; /* accessor of POSITION that are all zero; -1: not made yet */
};

static const struct skd_part *part_of_vertex(const struct skd_mesh *mesh, size_t vertex)
{
    size_t low = 0, high = mesh->part_count;
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (mesh->parts[middle].first_vertex <= vertex)
            low = middle;
        else
            high = middle;
    }
    return &mesh->parts[low];
}

/* Which meshes the shape needs. */
static enum skd_status use_shape(struct skd_gltf_shaping *shaping, size_t s,
                                 struct skd_error *error)
{
    const struct skd_export_shape *shape = &shaping->content->shapes[s];
    const struct skd_mesh *mesh = &shaping->rig->mesh;
    bool *is_used = shaping->is_used + s * shaping->mesh_count;
    for (size_t i = 0; i < shape->count; i++) {
        const float *offset = shape->offsets + 3 * i;
        if (shape->vertices[i] >= mesh->vertex_count)
            return skd_fail(error, SKD_BAD_INDEX, "shape \"%s\" has vertex %u of %zu", shape->name,
                            shape->vertices[i], mesh->vertex_count);
        if (!isfinite(offset[0]) || !isfinite(offset[1]) || !isfinite(offset[2]))
            return skd_fail(error, SKD_NOT_FINITE,
                            "shape \"%s\": the offset of vertex %u is not finite", shape->name,
                            shape->vertices[i]);
        is_used[part_of_vertex(mesh, shape->vertices[i])->mesh] = true;
    }
    for (size_t m = 0; m < shaping->mesh_count; m++)
        shaping->growths[m].added += is_used[m];
    return SKD_OK;
}

/* How many targets a primitive has; false when they are no list of objects, to which nothing can be
 * added. */
static bool count_targets(struct skd_json primitive, size_t *count)
{
    struct skd_json targets, key, target;
    *count = 0;
    if (!skd_json_member(primitive, "targets", &targets))
        return true;
    if (*targets.start != '[')
        return false;
    while (skd_json_next(&targets, &key, &target)) {
        if (*target.start != '{')
            return false;
        ++*count;
    }
    return true;
}

/* Counts the mesh's own targets. */
static enum skd_status check_mesh(struct skd_gltf_shaping *shaping, size_t m,
                                  struct skd_error *error)
{
    const struct skd_gltf_document *document = shaping->container->document;
    const struct skd_gltf_mesh *mesh = &document->meshes[m];
    for (size_t p = 0; p < mesh->primitive_count; p++) {
        struct skd_json primitive;
        const int32_t position = mesh->primitives[p].position;
        size_t count = 0;
        if (position < 0 || (size_t)position >= document->accessor_count)
            return skd_fail(error, SKD_UNSUPPORTED,
                            "mesh %zu, primitive %zu has no POSITION, so the mesh cannot have "
                            "morph targets; remove the primitive or the shape",
                            m, p);
        if (!skd_gltf_primitive_json(shaping->meshes, m, p, &primitive) ||
            !count_targets(primitive, &count))
            return skd_fail(error, SKD_UNSUPPORTED,
                            "the morph targets of mesh %zu, primitive %zu are no list of objects; "
                            "mend the file before a shape is added",
                            m, p);
        if (p == 0)
            shaping->growths[m].old_count = count;
        if (count != shaping->growths[m].old_count)
            return skd_fail(error, SKD_UNSUPPORTED,
                            "mesh %zu has %zu morph targets on primitive 0 and %zu on primitive "
                            "%zu, which glTF does not allow; mend it before a shape is added",
                            m, shaping->growths[m].old_count, count, p);
    }
    return SKD_OK;
}

/* The shape's offsets of a part, zero where it has none; returns how many are not zero. */
static size_t gather(const struct skd_export_shape *shape, const struct skd_part *part,
                     float *offsets)
{
    size_t count = 0;
    memset(offsets, 0, part->vertex_count * 3 * sizeof *offsets);
    for (size_t i = 0; i < shape->count; i++)
        if (shape->vertices[i] >= part->first_vertex &&
            shape->vertices[i] - part->first_vertex < part->vertex_count)
            memcpy(offsets + 3 * (shape->vertices[i] - part->first_vertex), shape->offsets + 3 * i,
                   3 * sizeof *offsets);
    for (size_t v = 0; v < part->vertex_count; v++)
        count += offsets[3 * v] != 0 || offsets[3 * v + 1] != 0 || offsets[3 * v + 2] != 0;
    return count;
}

static int32_t zeros_of(const struct skd_gltf_shaping *shaping, struct receiver *receiver)
{
    static const float bounds[6];
    const struct skd_gltf_addition addition = {.component = SKD_GLTF_FLOAT,
                                               .width = 3,
                                               .is_vertex_data = true,
                                               .count = receiver->vertex_count,
                                               .bounds = bounds};
    if (receiver->zeros < 0)
        receiver->zeros = skd_gltf_add_zeros(&shaping->patch->additions, &addition);
    return receiver->zeros;
}

/* Adds scratch->offsets as an accessor: sparse when at most half of them are something. */
static enum skd_status add_offsets(const struct skd_gltf_shaping *shaping, size_t vertex_count,
                                   size_t count, struct scratch *scratch, int32_t *accessor,
                                   struct skd_error *error)
{
    struct skd_gltf_additions *additions = &shaping->patch->additions;
    const float *offsets = scratch->offsets;
    float bounds[6];
    size_t found = 0, at = 0;
    skd_gltf_find_bounds(offsets, vertex_count, bounds);
    const struct skd_gltf_addition addition = {.component = SKD_GLTF_FLOAT,
                                               .width = 3,
                                               .is_vertex_data = true,
                                               .count = vertex_count,
                                               .bounds = bounds};
    if (count > vertex_count / 2) {
        const enum skd_status status =
            skd_gltf_add_elements(additions, &addition, accessor, &at, error);
        if (status == SKD_OK)
            memcpy(additions->tail + at, offsets, vertex_count * 3 * sizeof *offsets);
        return status;
    }
    for (size_t v = 0; v < vertex_count; v++)
        if (offsets[3 * v] != 0 || offsets[3 * v + 1] != 0 || offsets[3 * v + 2] != 0) {
            scratch->indices[found] = (uint32_t)v;
            memcpy(scratch->values + 3 * found++, offsets + 3 * v, 3 * sizeof *offsets);
        }
    return skd_gltf_add_sparse(additions, &addition, found, scratch->indices, scratch->values,
                               accessor, error);
}

/* An earlier primitive of the mesh on the same POSITION, or the primitive itself. */
static size_t find_earlier(const struct skd_gltf_mesh *mesh, size_t primitive)
{
    size_t q = 0;
    while (mesh->primitives[q].position != mesh->primitives[primitive].position)
        q++;
    return q;
}

/* The accessor of one shape on one primitive. */
static enum skd_status make_target(const struct skd_gltf_shaping *shaping,
                                   struct receiver *receiver, size_t s, struct scratch *scratch,
                                   struct skd_error *error)
{
    const struct skd_gltf_mesh *mesh = &shaping->container->document->meshes[receiver->mesh];
    const struct skd_mesh *skinned = &shaping->rig->mesh;
    const struct skd_export_shape *shape = &shaping->content->shapes[s];
    const size_t shape_count = shaping->content->shape_count;
    const size_t earlier = find_earlier(mesh, receiver->primitive);
    int32_t *accessor = &scratch->made[receiver->primitive * shape_count + s];
    const size_t count =
        receiver->part != NULL ? gather(shape, receiver->part, scratch->offsets) : 0;
    if (count == 0) {
        *accessor = zeros_of(shaping, receiver);
        return SKD_OK;
    }
    const size_t other = skd_gltf_find_part(skinned, receiver->mesh, earlier);
    if (earlier != receiver->primitive && other < skinned->part_count) {
        (void)gather(shape, &skinned->parts[other], scratch->others);
        if (memcmp(scratch->offsets, scratch->others,
                   receiver->vertex_count * 3 * sizeof *scratch->offsets) == 0) {
            *accessor = scratch->made[earlier * shape_count + s];
            return SKD_OK;
        }
    }
    return add_offsets(shaping, receiver->vertex_count, count, scratch, accessor, error);
}

/* ,"NORMAL":n... of zeros for what else the file's targets have: programs take what is missing in
 * one target and there in another for something that it is not. The same for POSITION in targets
 * of the file that have none. */
static void add_missing(const struct skd_gltf_shaping *shaping, struct receiver *receiver,
                        FILE *text)
{
    const struct skd_gltf_document *document = shaping->container->document;
    struct skd_json targets, key, target, name, value;
    if (!skd_json_member(receiver->json, "targets", &targets))
        return;
    for (bool is_first = true; skd_json_next(&targets, &key, &target); is_first = false) {
        char number[16];
        if (!skd_json_member(target, "POSITION", &value)) {
            (void)snprintf(number, sizeof number, "%d", zeros_of(shaping, receiver));
            skd_json_add(&shaping->patch->edits, target, "POSITION", number);
        }
        while (is_first && skd_json_next(&target, &name, &value)) {
            const long like = strtol(value.start, NULL, 10);
            if (strncmp(name.start, "\"POSITION\"", 10) == 0 || like < 0 ||
                (size_t)like >= document->accessor_count || document->accessors[like].width < 2 ||
                document->accessors[like].width > 4)
                continue;
            const struct skd_gltf_addition addition = {.component = SKD_GLTF_FLOAT,
                                                       .width = document->accessors[like].width,
                                                       .is_vertex_data = true,
                                                       .count = receiver->vertex_count};
            fprintf(text, ",%.*s:%d", (int)(name.end - name.start), name.start,
                    skd_gltf_add_zeros(&shaping->patch->additions, &addition));
        }
    }
}

/* The primitive's "targets" grow. */
static enum skd_status write_targets(const struct skd_gltf_shaping *shaping,
                                     struct receiver *receiver, struct scratch *scratch,
                                     struct skd_error *error)
{
    char *others = NULL, *list = NULL;
    size_t other_bytes = 0, list_bytes = 0;
    enum skd_status status = SKD_OK;
    FILE *text = open_memstream(&others, &other_bytes);
    if (text != NULL)
        add_missing(shaping, receiver, text);
    bool has_failed = text == NULL || fclose(text) != 0;
    text = open_memstream(&list, &list_bytes);
    has_failed |= text == NULL;
    const char *comma = "";
    for (size_t s = 0; !has_failed && status == SKD_OK && s < shaping->content->shape_count; s++) {
        if (!shaping->is_used[s * shaping->mesh_count + receiver->mesh])
            continue;
        status = make_target(shaping, receiver, s, scratch, error);
        fprintf(text, "%s{\"POSITION\":%d%s}", comma,
                scratch->made[receiver->primitive * shaping->content->shape_count + s], others);
        comma = ",";
    }
    has_failed |= text != NULL && fclose(text) != 0;
    struct skd_json targets;
    char *array = NULL;
    if (!has_failed && skd_json_member(receiver->json, "targets", &targets))
        skd_json_append(&shaping->patch->edits, targets, list);
    else if (!has_failed && asprintf(&array, "[%s]", list) >= 0)
        skd_json_add(&shaping->patch->edits, receiver->json, "targets", array);
    else
        has_failed = true;
    free(array);
    free(list);
    free(others);
    return has_failed && status == SKD_OK ? skd_fail_memory(error, "morph targets") : status;
}

static enum skd_status write_mesh(const struct skd_gltf_shaping *shaping, size_t m,
                                  struct skd_error *error)
{
    const struct skd_gltf_document *document = shaping->container->document;
    const struct skd_mesh *skinned = &shaping->rig->mesh;
    const size_t primitive_count = document->meshes[m].primitive_count;
    enum skd_status status = SKD_OK;
    size_t most = 0;
    for (size_t p = 0; p < skinned->part_count; p++)
        if ((size_t)skinned->parts[p].mesh == m && skinned->parts[p].vertex_count > most)
            most = skinned->parts[p].vertex_count;
    struct scratch scratch = {
        .offsets = malloc((most + 1) * 3 * sizeof *scratch.offsets),
        .others = malloc((most + 1) * 3 * sizeof *scratch.others),
        .indices = malloc((most / 2 + 1) * sizeof *scratch.indices),
        .values = malloc((most / 2 + 1) * 3 * sizeof *scratch.values),
        .made = calloc(primitive_count * shaping->content->shape_count + 1, sizeof *scratch.made)};
    if (scratch.offsets == NULL || scratch.others == NULL || scratch.indices == NULL ||
        scratch.values == NULL || scratch.made == NULL)
        status = skd_fail_memory(error, "morph targets");
    for (size_t p = 0; status == SKD_OK && p < primitive_count; p++) {
        const size_t part = skd_gltf_find_part(skinned, m, p);
        struct receiver receiver = {
            .mesh = m,
            .primitive = p,
            .part = part < skinned->part_count ? &skinned->parts[part] : NULL,
            .vertex_count = document->accessors[document->meshes[m].primitives[p].position].count,
            .zeros = -1};
        if (skd_gltf_primitive_json(shaping->meshes, m, p, &receiver.json))
            status = write_targets(shaping, &receiver, &scratch, error);
    }
    free(scratch.offsets);
    free(scratch.others);
    free(scratch.indices);
    free(scratch.values);
    free(scratch.made);
    return status;
}

enum skd_status
skd_gltf_shapes_write(const struct skd_rig *rig, const struct skd_gltf_container *container,
                      const struct skd_gltf_content *content, struct skd_gltf_patch *patch,
                      struct skd_gltf_export_report *report, struct skd_error *error)
{
    struct skd_gltf_shaping shaping = {
        .rig = rig, .container = container, .content = content, .patch = patch};
    if (content->shape_count == 0)
        return SKD_OK;
    shaping.meshes = skd_json_member_elements(container->json, "meshes", &shaping.mesh_count);
    shaping.growths = calloc(shaping.mesh_count + 1, sizeof *shaping.growths);
    shaping.is_used = calloc(content->shape_count * shaping.mesh_count + 1, sizeof(bool));
    enum skd_status status = SKD_OK;
    if (shaping.meshes == NULL || shaping.growths == NULL || shaping.is_used == NULL)
        status = skd_fail_memory(error, "morph targets");
    for (size_t s = 0; status == SKD_OK && s < content->shape_count; s++)
        status = use_shape(&shaping, s, error);
    for (size_t m = 0; status == SKD_OK && m < shaping.mesh_count; m++) {
        if (shaping.growths[m].added == 0)
            continue;
        report->targets += shaping.growths[m].added;
        status = check_mesh(&shaping, m, error);
        if (status == SKD_OK)
            status = write_mesh(&shaping, m, error);
    }
    if (status == SKD_OK)
        status = skd_gltf_shape_names_write(&shaping, error);
    if (status == SKD_OK)
        status = skd_gltf_shape_clips_write(&shaping, error);
    free(shaping.meshes);
    free(shaping.growths);
    free(shaping.is_used);
    return status;
}
