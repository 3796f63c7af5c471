/* session.export: the session as a file.
 *
 * Stage: job -> reply. Thread: a worker, in the session's turn.
 */
#include "requests/handlers.h"

#include "requests/commit.h"
#include "rig/gltf.h"

#include <stdlib.h>
#include <string.h>

/* The corrective shapes as the exporter wants them: lists of the caller's to free. */
struct shapes {
    size_t count;
    struct skd_export_shape items[SKD_TARGET_POSES_MAX];
};

static void finish(struct shapes *shapes)
{
    for (size_t i = 0; i < shapes->count; i++) {
        free((void *)shapes->items[i].vertices);
        free((void *)shapes->items[i].offsets);
    }
    free(shapes);
}

static enum skd_status collect(const struct skd_sheets *sheets, struct shapes *shapes,
                               struct skd_error *error)
{
    for (size_t i = 0; i < sheets->count; i++) {
        const struct skd_sheet *sheet = sheets->items[i];
        if (sheet->used == 0)
            continue;
        uint32_t *vertices = malloc(sheet->used * sizeof *vertices);
        float *offsets = malloc(sheet->used * SKD_SHAPE_NUMBERS * sizeof *offsets);
        shapes->items[shapes->count++] = (struct skd_export_shape){.name = sheet->pose->name,
                                                                   .count = sheet->used,
                                                                   .vertices = vertices,
                                                                   .offsets = offsets};
        if (vertices == NULL || offsets == NULL)
            return skd_fail_memory(error, "the corrective shapes");
        skd_sheet_list(sheets, sheet, vertices);
        for (size_t k = 0; k < sheet->used; k++)
            memcpy(offsets + SKD_SHAPE_NUMBERS * k, skd_sheet_row(sheets, sheet, vertices[k]),
                   SKD_SHAPE_NUMBERS * sizeof *offsets);
    }
    return SKD_OK;
}

static enum skd_status export_file(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session *session = call->live->session;
    const char *path = call->request.params.session.path;
    struct skd_gltf_export_report report;
    struct shapes *shapes = calloc(1, sizeof *shapes);
    if (shapes == NULL)
        return skd_fail_memory(error, "the corrective shapes");
    enum skd_status status = collect(&session->shapes, shapes, error);
    const struct skd_gltf_content content = {
        .slot_count = session->slot_count,
        .joints = session->joints,
        .weights = session->weights,
        .rest = session->rest != session->rig->mesh.rest ? session->rest : NULL,
        .shape_count = shapes->count,
        .shapes = shapes->items,
    };
    if (status == SKD_OK)
        status = skd_gltf_export(session->rig, &content, path, &report, error);
    finish(shapes);
    if (status != SKD_OK)
        return status;
    call->reply.body = cJSON_CreateObject();
    cJSON_AddStringToObject(call->reply.body, "path", path);
    cJSON_AddNumberToObject(call->reply.body, "bytes", (double)report.bytes);
    cJSON_AddNumberToObject(call->reply.body, "revision", (double)session->revision);
    cJSON_AddNumberToObject(call->reply.body, "accessors", (double)report.accessors);
    cJSON_AddNumberToObject(call->reply.body, "largest_rounding", report.largest_rounding);
    return SKD_OK;
}

static void exported(struct skd_call *call)
{
    struct skd_session *session = call->live->session;
    if (call->status != SKD_OK) {
        skd_call_finish(call);
        return;
    }
    session->exported = session->revision;
    skd_commit_record(call, skd_record_create_exported(session->revision));
}

static void begin(struct skd_call *call)
{
    skd_call_work(call, export_file, exported);
}

void skd_handle_session_export(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live != NULL)
        skd_call_take_turn(call, live, begin);
}
