/* See gltf.h: a rig's source with other weights, rest positions and shapes.
 *
 * The source is read again and compared with its digest, what to write where is planned
 * (gltf_plan.h), elements are written into the buffers in memory or behind them
 * (gltf_additions.h), the JSON is edited where numbers moved (json_edit.h), and all is put together
 * from slices.
 */
#include "rig/gltf.h"

#include "rig/gltf_companions.h"
#include "rig/gltf_patch.h"
#include "rig/gltf_plan.h"
#include "rig/gltf_rest.h"
#include "rig/gltf_shapes.h"
#include "rig/json_edit.h"
#include "rig/uri.h"
#include "rig/weight_rows.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* Reads the file's row, which may have fewer sets than are to be written. */
static void read_file_row(struct skd_gltf_sets *sets, size_t vertex, int set_count,
                          struct skd_file_row *row)
{
    *row = (struct skd_file_row){.count = set_count * 4};
    skd_gltf_sets_raw_row(sets, vertex, row->joints, row->weights);
    for (int i = 0; i < row->count; i++)
        row->bones[i] = i < sets->count * 4 && row->joints[i] < sets->joint_count
                            ? sets->bones[row->joints[i]]
                            : -1;
}

static void store(uint8_t *to, int component, uint32_t value)
{
    if (component == SKD_GLTF_UNSIGNED_BYTE)
        *to = (uint8_t)value;
    else
        memcpy(to, &(uint16_t){(uint16_t)value}, sizeof(uint16_t));
}

/* Steps of the coarsest type among the sets, which all others can hold; 0: all are float. */
static uint32_t steps_of(const struct skd_part_plan *plan)
{
    uint32_t steps = 0;
    for (int set = 0; set < plan->set_count; set++) {
        if (plan->weights[set].component == SKD_GLTF_UNSIGNED_BYTE)
            return UINT8_MAX;
        if (plan->weights[set].component == SKD_GLTF_UNSIGNED_SHORT)
            steps = UINT16_MAX;
    }
    return steps;
}

/* Stores a row's joints and weights; numerators[] are multiples of 1/steps. */
static void store_row(const struct skd_part_plan *plan, size_t vertex,
                      const struct skd_file_row *row, uint32_t steps, const uint32_t *numerators)
{
    for (int i = 0; i < row->count; i++) {
        const struct skd_gltf_target *joints = &plan->joints[i / 4];
        const struct skd_gltf_target *weights = &plan->weights[i / 4];
        const size_t slot = (size_t)(i % 4);
        store(joints->bytes + vertex * joints->stride +
                  slot * skd_component_bytes(joints->component),
              joints->component, row->joints[i]);
        uint8_t *to = weights->bytes + vertex * weights->stride +
                      slot * skd_component_bytes(weights->component);
        if (weights->component == SKD_GLTF_FLOAT)
            memcpy(to, &row->weights[i], sizeof row->weights[i]);
        else if (weights->component == SKD_GLTF_UNSIGNED_BYTE)
            store(to, weights->component, numerators[i]);
        else
            store(to, weights->component, numerators[i] * (UINT16_MAX / steps));
    }
}

/* A row that stays is carried into new accessors as it is, component by component. */
static void carry_row(const struct skd_part_plan *plan, const struct skd_gltf_sets *sets,
                      size_t vertex, const struct skd_file_row *row)
{
    for (int set = 0; set < sets->count; set++) {
        const struct skd_gltf_target *joints = &plan->joints[set], *weights = &plan->weights[set];
        for (size_t i = 0; joints->is_new && i < 4; i++)
            store(joints->bytes + vertex * joints->stride +
                      i * skd_component_bytes(joints->component),
                  joints->component, row->joints[set * 4 + (int)i]);
        if (weights->is_new)
            memcpy(weights->bytes + vertex * weights->stride,
                   sets->weights[set].bytes + vertex * sets->weights[set].stride,
                   4 * skd_component_bytes(weights->component));
    }
}

static enum skd_status write_rows(const struct skd_rig *rig,
                                  const struct skd_gltf_container *container,
                                  const struct skd_gltf_content *wanted,
                                  const struct skd_part *part, const struct skd_part_plan *plan,
                                  struct skd_gltf_export_report *report, struct skd_error *error)
{
    struct skd_gltf_sets sets;
    const enum skd_status status =
        skd_gltf_sets_open(container, rig->source, rig, part, &sets, error);
    if (status != SKD_OK)
        return status;
    const uint32_t steps = steps_of(plan);
    for (size_t v = 0; v < part->vertex_count; v++) {
        struct skd_influence influences[SKD_INFLUENCES_MAX];
        struct skd_file_row row;
        uint32_t numerators[SKD_INFLUENCES_MAX];
        const int count = skd_wanted_row(wanted, part->first_vertex + v, influences);
        read_file_row(&sets, v, plan->set_count, &row);
        if (skd_row_is_kept(&sets, v, influences, count)) {
            carry_row(plan, &sets, v, &row);
            continue;
        }
        skd_row_place(&row, influences, count, rig->source->joint_of_bone);
        if (steps != 0) {
            const double change = skd_row_quantise(&row, steps, numerators);
            report->largest_rounding =
                change > report->largest_rounding ? change : report->largest_rounding;
        }
        store_row(plan, v, &row, steps, numerators);
    }
    skd_gltf_sets_close(&sets);
    return SKD_OK;
}

/* Everything that is in memory while a file is written. */
struct export
{
    const struct skd_rig *rig;
    struct skd_gltf_container container;
    struct skd_gltf_claims claims;
    struct skd_part_plan *plans;
    struct skd_gltf_patch patch;
    struct skd_outputs outputs;
    struct skd_companions companions;
    bool *is_written; /* [buffers] goes into a file of its own, anew */
};

static enum skd_status write_weights(struct export *export, const struct skd_gltf_content *wanted,
                                     struct skd_gltf_export_report *report, struct skd_error *error)
{
    const struct skd_mesh *mesh = &export->rig->mesh;
    enum skd_status status = skd_gltf_plan(export->rig, &export->container, &export->claims, wanted,
                                           export->plans, error);
    if (status == SKD_OK)
        status = skd_gltf_patch_make_room(&export->patch, &export->container, mesh, export->plans,
                                          error);
    for (size_t p = 0; status == SKD_OK && p < mesh->part_count; p++) {
        if (!export->plans[p].is_changed || export->plans[p].leader != p)
            continue;
        report->accessors += 2 * (size_t) export->plans[p].set_count;
        status = write_rows(export->rig, &export->container, wanted, &mesh->parts[p],
                            &export->plans[p], report, error);
    }
    if (status == SKD_OK)
        status =
            skd_gltf_patch_json(&export->patch, &export->container, mesh, export->plans, error);
    return status;
}

/* Everything that goes into the buffers and the JSON. */
static enum skd_status write_content(struct export *export, const struct skd_gltf_content *content,
                                     struct skd_gltf_export_report *report, struct skd_error *error)
{
    struct skd_gltf_patch *patch = &export->patch;
    enum skd_status status = skd_gltf_patch_init(patch, &export->container, error);
    if (status == SKD_OK)
        status = skd_gltf_claims_find(&export->container, &export->claims, error);
    if (status == SKD_OK)
        status = write_weights(export, content, report, error);
    if (status == SKD_OK)
        status = skd_gltf_rest_write(export->rig, &export->container, &export->claims, content,
                                     patch, report, error);
    if (status == SKD_OK)
        status =
            skd_gltf_shapes_write(export->rig, &export->container, content, patch, report, error);
    return status == SKD_OK ? skd_gltf_patch_close(patch, error) : status;
}

/* Puts buffers that changed back where they came from: a data URI, or a file beside the target. */
static enum skd_status write_buffers(struct export *export, struct skd_error *error)
{
    for (size_t i = 0; i < export->container.buffer_count; i++) {
        const struct skd_gltf_buffer *buffer = &export->container.buffers[i];
        const struct skd_slice tail = skd_gltf_patch_tail(&export->patch, i);
        if (!export->patch.is_dirty[i] || buffer->storage == SKD_BUFFER_CHUNK)
            continue;
        if (buffer->storage == SKD_BUFFER_DATA_URI) {
            skd_gltf_patch_data_uri(&export->patch, &export->container, i);
            continue;
        }
        char *path = skd_companions_name(&export->companions, i);
        if (path == NULL)
            return skd_fail_memory(error, "a path");
        /* What lies behind byteLength in the old file stays there unless the buffer grows. */
        const struct skd_slice slices[] = {
            {buffer->bytes, tail.count > 0 ? buffer->size : buffer->stored}, tail};
        const enum skd_status status = skd_outputs_add(&export->outputs, path, slices, 2, error);
        if (status == SKD_OK && strcmp(path, export->rig->source->externals[i].path) != 0)
            skd_gltf_patch_uri(&export->patch, &export->container, i, path);
        free(path);
        if (status != SKD_OK)
            return status;
        export->is_written[i] = true;
    }
    return SKD_OK;
}

static enum skd_status write_files(struct export *export, struct skd_error *error)
{
    enum skd_status status = write_buffers(export, error);
    if (status == SKD_OK)
        status =
            skd_companions_copy(&export->companions, &export->container, export->is_written, error);
    if (status == SKD_OK)
        status = skd_gltf_patch_write(&export->patch, &export->container, &export->outputs,
                                      export->companions.name, error);
    if (status == SKD_OK)
        status = skd_outputs_commit(&export->outputs, error);
    return status;
}

static enum skd_status check_target(const struct skd_gltf_container *container, const char *path,
                                    struct skd_error *error)
{
    const char *ending = container->is_glb ? ".glb" : ".gltf";
    const char *dot = strrchr(path, '.');
    if (dot != NULL && strcasecmp(dot, ending) == 0)
        return SKD_OK;
    return skd_fail(error, SKD_UNSUPPORTED,
                    "\"%s\" must end in %s, as the character that was loaded is one", path, ending);
}

/* The rig says of each of its parts which primitive it came from. It was parsed in another process,
 * or long ago (rig_image.h), so that is held against the file, and so is where POSITION lies; sets
 * are checked when they are opened. */
static enum skd_status check_parts(const struct skd_rig *rig,
                                   const struct skd_gltf_container *container,
                                   struct skd_error *error)
{
    const struct skd_gltf_document *document = container->document;
    for (size_t p = 0; p < rig->mesh.part_count; p++) {
        const struct skd_part *part = &rig->mesh.parts[p];
        const size_t mesh = (size_t)part->mesh, primitive = (size_t)part->primitive;
        struct skd_elements positions = {0};
        bool is_good = mesh < document->mesh_count &&
                       primitive < document->meshes[mesh].primitive_count &&
                       skd_gltf_find_part(&rig->mesh, mesh, primitive) == p;
        if (is_good) {
            const struct skd_gltf_primitive *from = &document->meshes[mesh].primitives[primitive];
            is_good = from->set_count > 0 && from->set_count <= SKD_SETS_MAX &&
                      skd_elements_open(container, from->position, 3, "POSITION", &positions,
                                        NULL) == SKD_OK &&
                      positions.count == part->vertex_count;
            skd_elements_close(&positions);
        }
        if (!is_good)
            return skd_fail(
                error, SKD_SOURCE_CHANGED,
                "\"%s\" does not have part %zu of the character that was loaded from it",
                rig->source->path, p);
    }
    return SKD_OK;
}

enum skd_status skd_gltf_export(const struct skd_rig *rig, const struct skd_gltf_content *content,
                                const char *path, struct skd_gltf_export_report *report,
                                struct skd_error *error)
{
    struct export export = {.rig = rig, .outputs.folder_fd = -1};
    const char *name = NULL;
    *report = (struct skd_gltf_export_report){0};
    if (rig->source == NULL)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "this rig did not come from a file; load a glTF file to write one");
    enum skd_status status = skd_gltf_container_read(rig->source, &export.container, error);
    if (status != SKD_OK)
        return status;
    status = check_parts(rig, &export.container, error);
    export.plans = calloc(rig->mesh.part_count + 1, sizeof *export.plans);
    export.is_written = calloc(export.container.buffer_count + 1, sizeof *export.is_written);
    if (status == SKD_OK && (export.plans == NULL || export.is_written == NULL))
        status = skd_fail_memory(error, "the plan of an export");
    if (status == SKD_OK)
        status = check_target(&export.container, path, error);
    if (status == SKD_OK)
        status = write_content(&export, content, report, error);
    if (status == SKD_OK)
        status = skd_outputs_open(path, &export.outputs, &name, error);
    if (status == SKD_OK) {
        skd_companions_init(&export.companions, rig->source, &export.outputs, name);
        status = write_files(&export, error);
    }
    report->bytes = export.outputs.bytes;
    skd_outputs_finish(&export.outputs);
    skd_gltf_patch_finish(&export.patch);
    skd_gltf_claims_finish(&export.claims);
    free(export.plans);
    free(export.is_written);
    skd_gltf_container_finish(&export.container);
    return status;
}
