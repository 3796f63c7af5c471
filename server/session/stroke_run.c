/* See stroke_run.h. */
#include "session/stroke_run.h"

#include "session/pose_spread.h"
#include "session/smoothing.h"
#include "session/stroke_candidates.h"
#include "session/stroke_check.h"
#include "session/stroke_stiffness.h"
#include "session/stroke_targets.h"

#include <stdlib.h>

enum skd_status skd_stroke_claim(struct skd_stroke *stroke, struct skd_error *error)
{
    struct skd_session *session = stroke->session;
    const struct skd_stroke_input *input = &stroke->input;
    enum skd_status status = SKD_OK;
    if (stroke->pose == NULL)
        return SKD_OK;
    bool keeps = input->pin != SKD_PIN_NONE && input->options.method != SKD_METHOD_THESIS;
    if (input->solves_pins)
        stroke->pins = skd_sheets_find(&session->pins, stroke->pose);
    else if (keeps)
        status =
            skd_session_need_sheet(session, &session->pins, stroke->pose, &stroke->pins, error);
    if (status != SKD_OK)
        return status;
    if (input->residual == SKD_RESIDUAL_SHAPE)
        return skd_session_need_sheet(session, &session->shapes, stroke->pose, &stroke->shape,
                                      error);
    struct skd_sheet *shape = skd_sheets_find(&session->shapes, stroke->pose);
    stroke->shape = shape != NULL && shape->used > 0 ? shape : NULL;
    return SKD_OK;
}

/* How many targets a vertex of the step has. */
static int count_targets(const struct skd_stroke *stroke, size_t item)
{
    int count = 0;
    for (int p = 0; p < stroke->pose_count; p++) {
        const float *strengths = stroke->poses[p].strengths;
        count += strengths == NULL || strengths[item] > 0.0f;
    }
    return count;
}

/* What is known of the poses once they are gathered. */
static enum skd_status weigh_evidence(struct skd_stroke *stroke, struct skd_error *error)
{
    size_t single = 0, count = stroke->step->count;
    for (size_t i = 0; i < count; i++) {
        int targets = count_targets(stroke, i);
        single += targets < 2;
        stroke->most_poses = targets > stroke->most_poses ? targets : stroke->most_poses;
    }
    if (stroke->input.slots == SKD_SLOTS_EVIDENCE && stroke->most_poses > 1)
        stroke->warnings[SKD_WARNING_POSES_ALIKE] = skd_pose_spread_count_still(stroke);
    if (stroke->input.residual != SKD_RESIDUAL_REST || count == 0)
        return SKD_OK;
    if (single == count)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "rest positions cannot be told from one pose, and none of these vertices "
                        "has a target in another; sculpt them in a second pose, or use residual "
                        "\"shape\"");
    stroke->warnings[SKD_WARNING_REST_ONE_POSE] = single;
    return SKD_OK;
}

/* Room for what the solve writes beside weights, and what it reads beside targets. */
static enum skd_status make_room(struct skd_stroke *stroke, struct skd_error *error)
{
    struct skd_session *session = stroke->session;
    struct skd_step *step = stroke->step;
    size_t count = step->count;
    enum skd_status status = SKD_OK;
    stroke->residual_before = malloc(count * sizeof(float) + 1);
    stroke->residual_after = malloc(count * sizeof(float) + 1);
    if (stroke->residual_before == NULL || stroke->residual_after == NULL)
        return skd_fail_memory(error, "the stroke's weights");
    if (stroke->input.slots == SKD_SLOTS_EVIDENCE &&
        ((status = skd_step_add_joints(step, error)) != SKD_OK ||
         (status = skd_session_keep_start(session, error)) != SKD_OK))
        return status;
    if (stroke->input.residual == SKD_RESIDUAL_REST &&
        ((status = skd_step_add_rest(step, error)) != SKD_OK ||
         (status = skd_session_own_rest(session, error)) != SKD_OK))
        return status;
    if (stroke->input.residual == SKD_RESIDUAL_REST &&
        (stroke->doubtful = calloc(count + 1, 1)) == NULL)
        return skd_fail_memory(error, "the rest positions of the stroke's vertices");
    if (stroke->shape == NULL || count == 0)
        return SKD_OK;
    step->shape =
        skd_sheet_change_create(&session->shapes, stroke->shape, step->vertices, count, error);
    return step->shape != NULL ? SKD_OK : SKD_NO_MEMORY;
}

enum skd_status skd_stroke_prepare(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    enum skd_status status;
    stroke->input.options.length = stroke->session->rig->length;
    stroke->pass_count =
        input->frame_count > 0 && input->slots == SKD_SLOTS_EVIDENCE ? input->rounds : 1;
    if (input->residual == SKD_RESIDUAL_REST && input->slots == SKD_SLOTS_EVIDENCE)
        stroke->first_pass = stroke->pass = SKD_PASS_REST_FIRST;
    if ((status = skd_stroke_check(stroke, error)) != SKD_OK ||
        (status = skd_stroke_gather(stroke, error)) != SKD_OK ||
        (status = weigh_evidence(stroke, error)) != SKD_OK ||
        (status = make_room(stroke, error)) != SKD_OK)
        return status;
    if (input->slots == SKD_SLOTS_EVIDENCE &&
        (status = skd_stroke_find_candidates(stroke, error)) != SKD_OK)
        return status;
    if (input->choose_stiffness && (status = skd_stroke_choose_stiffness(stroke, error)) != SKD_OK)
        return status;
    if (input->options.smooth > 0.0)
        return skd_smoothing_create(stroke, error);
    return SKD_OK;
}

void skd_stroke_dismiss(struct skd_stroke *stroke)
{
    for (int p = 0; p < stroke->pose_count; p++) {
        free(stroke->poses[p].targets);
        free(stroke->poses[p].strengths);
    }
    free(stroke->poses);
    free(stroke->asked);
    free(stroke->shown_before);
    free(stroke->residual_before);
    free(stroke->residual_after);
    free(stroke->candidates);
    free(stroke->doubtful);
    free(stroke->bone_locked);
    free(stroke->vertex_locked);
    free(stroke->told);
    free(stroke->rest);
    skd_smoothing_destroy(stroke->smoothing);
    skd_step_release(stroke->step);
    *stroke = (struct skd_stroke){0};
}
