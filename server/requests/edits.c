/* weights.set, weights.mirror, weights.prune, weights.reduce, pins.weigh, pins.clear: what each
 * asks for, in the session's words.
 *
 * Stage: request -> job. Thread: a worker, but for the finding of poses (edit.h).
 */
#include "requests/handlers.h"

#include "requests/edit.h"
#include "session/mirror.h"
#include "session/pin_edit.h"
#include "session/prune.h"
#include "session/reduction.h"
#include "session/setting.h"

#include <stdlib.h>

static struct skd_edit_scope scope_of(const struct skd_call *call, const struct skd_array *vertices,
                                      bool given)
{
    return (struct skd_edit_scope){
        .vertices = vertices->data,
        .count = vertices->count,
        .all = !given,
        .cancelled = &call->cancelled,
    };
}

/* ---- weights.set --------------------------------------------------------------------------- */

static enum skd_status find_shape(struct skd_call *call, const struct skd_session *session,
                                  struct skd_edit *edit, struct skd_error *error)
{
    const char *shape = call->request.params.weights_set.shape;
    edit->most = call->request.params.weights_set.vertices.count;
    return skd_named_poses_find(session, &shape, shape != NULL, &edit->poses, error);
}

static enum skd_status claim_shape(struct skd_session *session, struct skd_edit *edit,
                                   struct skd_error *error)
{
    if (edit->poses.count == 0)
        return SKD_OK;
    return skd_session_need_sheet(session, &session->shapes, edit->poses.items[0], &edit->shape,
                                  error);
}

static enum skd_status set(struct skd_call *call, struct skd_edit *edit, struct skd_error *error)
{
    const struct skd_weights_set_params *params = &call->request.params.weights_set;
    const struct skd_setting wanted = {
        .vertices = params->vertices.data,
        .count = params->vertices.count,
        .weights = params->weights.data,
        .weight_count = params->weights.count,
        .joints = params->joints.data,
        .rest = params->rest.data,
        .shape = edit->shape,
        .offsets = params->offsets.data,
    };
    enum skd_status status = skd_setting_prepare(call->live->session, &wanted, &edit->step, error);
    if (status == SKD_OK)
        edit->vertices = edit->step->count;
    return status;
}

void skd_handle_weights_set(struct skd_call *call)
{
    static const struct skd_edit_kind kind = {.cause = SKD_CAUSE_SET,
                                              .sender_knows = true,
                                              .forgets_pins = true,
                                              .look_up = find_shape,
                                              .claim = claim_shape,
                                              .make = set};
    skd_edit_start(call, call->request.params.weights_set.session, &kind);
}

/* ---- weights.mirror ------------------------------------------------------------------------ */

static void add_unpaired(cJSON *body, const struct skd_skeleton *skeleton, const uint8_t *unpaired)
{
    cJSON *names = cJSON_AddArrayToObject(body, "unpaired_bones");
    for (int bone = 0; bone < skeleton->bone_count; bone++)
        if (unpaired[bone] != 0)
            cJSON_AddItemToArray(names, cJSON_CreateString(skeleton->names[bone]));
}

static enum skd_status mirror(struct skd_call *call, struct skd_edit *edit, struct skd_error *error)
{
    const struct skd_weights_edit_params *params = &call->request.params.weights_edit;
    struct skd_session *session = call->live->session;
    const struct skd_mirror_input input = {
        .scope = scope_of(call, &params->vertices, params->vertices_given),
        .axis = params->axis,
        .from_negative = params->from != 0,
        .origin = params->origin,
        .tolerance = params->tolerance,
    };
    struct skd_mirror_report report;
    enum skd_status status = skd_mirror_prepare(session, &input, &edit->step, &report, error);
    if (status == SKD_OK) {
        edit->vertices = edit->step->count;
        cJSON_AddNumberToObject(call->reply.body, "unmatched", (double)report.unmatched);
        add_unpaired(call->reply.body, &session->rig->skeleton, report.unpaired);
    }
    free(report.unpaired);
    return status;
}

void skd_handle_weights_mirror(struct skd_call *call)
{
    static const struct skd_edit_kind kind = {
        .cause = SKD_CAUSE_MIRROR, .forgets_pins = true, .make = mirror};
    skd_edit_start(call, call->request.params.weights_edit.session, &kind);
}

/* ---- weights.prune ------------------------------------------------------------------------- */

static enum skd_status prune(struct skd_call *call, struct skd_edit *edit, struct skd_error *error)
{
    const struct skd_weights_edit_params *params = &call->request.params.weights_edit;
    const struct skd_edit_scope scope = scope_of(call, &params->vertices, params->vertices_given);
    size_t removed;
    enum skd_status status =
        skd_prune_prepare(call->live->session, &scope, params->below, &edit->step, &removed, error);
    if (status == SKD_OK) {
        edit->vertices = edit->step->count;
        cJSON_AddNumberToObject(call->reply.body, "removed", (double)removed);
    }
    return status;
}

void skd_handle_weights_prune(struct skd_call *call)
{
    static const struct skd_edit_kind kind = {.cause = SKD_CAUSE_PRUNE, .make = prune};
    skd_edit_start(call, call->request.params.weights_edit.session, &kind);
}

/* ---- weights.reduce ------------------------------------------------------------------------ */

static enum skd_status find_poses(struct skd_call *call, const struct skd_session *session,
                                  struct skd_edit *edit, struct skd_error *error)
{
    const struct skd_weights_edit_params *params = &call->request.params.weights_edit;
    return skd_named_poses_find(session, params->poses, params->pose_count, &edit->poses, error);
}

static enum skd_status reduce(struct skd_call *call, struct skd_edit *edit, struct skd_error *error)
{
    const struct skd_weights_edit_params *params = &call->request.params.weights_edit;
    const struct skd_reduction_input input = {
        .scope = scope_of(call, &params->vertices, params->vertices_given),
        .keep = params->influences,
        .by_size = params->by == SKD_REDUCE_BY_SIZE,
        .poses = edit->poses.items,
        .pose_count = edit->poses.count,
    };
    struct skd_reduction moved;
    enum skd_status status =
        skd_reduction_prepare(call->live->session, &input, &edit->step, &moved, error);
    if (status == SKD_OK) {
        edit->vertices = edit->step->count;
        cJSON *object = cJSON_AddObjectToObject(call->reply.body, "moved");
        cJSON_AddNumberToObject(object, "poses", moved.pose_count);
        cJSON_AddNumberToObject(object, "mean", moved.mean);
        cJSON_AddNumberToObject(object, "max", moved.max);
    }
    return status;
}

void skd_handle_weights_reduce(struct skd_call *call)
{
    static const struct skd_edit_kind kind = {
        .cause = SKD_CAUSE_REDUCE, .look_up = find_poses, .make = reduce};
    skd_edit_start(call, call->request.params.weights_edit.session, &kind);
}

/* ---- pins.weigh, pins.clear ---------------------------------------------------------------- */

static enum skd_status look_for_pose(struct skd_call *call, const struct skd_session *session,
                                     struct skd_edit *edit, struct skd_error *error)
{
    const char *pose = call->request.params.pins.pose;
    (void)edit;
    return pose == NULL || skd_session_find_pose(session, pose, error) != NULL ? SKD_OK
                                                                               : SKD_NO_POSE;
}

static enum skd_status edit_pins(struct skd_call *call, struct skd_edit *edit,
                                 struct skd_error *error)
{
    const struct skd_pins_params *params = &call->request.params.pins;
    const struct skd_pin_edit wanted = {
        .scope = scope_of(call, &params->vertices, params->vertices_given),
        .pose = params->pose,
        .clear = call->request.method == SKD_REQUEST_PINS_CLEAR,
        .strength = (float)params->weight,
    };
    return skd_pin_edit_prepare(call->live->session, &wanted, &edit->step, &edit->vertices, error);
}

static const struct skd_edit_kind pin_kind = {
    .cause = SKD_CAUSE_PINS, .sender_knows = true, .look_up = look_for_pose, .make = edit_pins};

void skd_handle_pins_weigh(struct skd_call *call)
{
    skd_edit_start(call, call->request.params.pins.session, &pin_kind);
}

void skd_handle_pins_clear(struct skd_call *call)
{
    skd_edit_start(call, call->request.params.pins.session, &pin_kind);
}
