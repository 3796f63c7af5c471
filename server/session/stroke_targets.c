/* See stroke_targets.h.
 *
 * The pin's rule, with x the surface shown and t what the client asks for (drawn towards x by mix
 * and mask):
 *
 *     set    the pin is t
 *     move   the pin moves by t - x, so that what the anchor held back of the stroke before is not
 *            lost; it stays within WIND_UP of x, so that it does not run away where bones cannot
 *            follow and has not to be wound back
 *     none   t is solved for once, and no pin remains
 */
#include "session/stroke_targets.h"

#include "session/seams.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* How far a pin may be from the surface, in shares of L, beyond what the stroke itself asks. */
static const double WIND_UP = 0.03;

static enum skd_status no_memory(struct skd_error *error)
{
    return skd_fail_memory(error, "the stroke's targets");
}

/* Where bones are posed near the end of float32 the surface shown is infinite; a target that was
 * taken from it would be none, and a pin would keep it. Then the position asked for is taken. */
static bool fits(double number)
{
    return fabs(number) <= (double)FLT_MAX;
}

/* The request's vertices with their positions drawn to what is shown; those that the mask holds
 * where they are are left out. Both arrays are the caller's to free. */
static enum skd_status blend(const struct skd_stroke *stroke, uint32_t **vertices,
                             float **positions, size_t *count, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    float *out = *positions = malloc(input->count * 3 * sizeof **positions + 1);
    *vertices = malloc(input->count * sizeof **vertices + 1);
    *count = 0;
    if (out == NULL || *vertices == NULL)
        return no_memory(error);
    skd_session_show(stroke->session, stroke->pose, input->count, input->vertices, out);
    for (size_t i = 0; i < input->count; i++) {
        double share = input->mix * (input->mask != NULL ? (double)input->mask[i] : 1.0);
        if (!(share > 0.0))
            continue;
        for (size_t axis = 0; axis < 3; axis++) {
            double from = (double)out[3 * i + axis], to = (double)input->positions[3 * i + axis];
            double drawn = share < 1.0 ? from + share * (to - from) : to;
            out[3 * *count + axis] = fits(drawn) ? (float)drawn : (float)to;
        }
        (*vertices)[(*count)++] = input->vertices[i];
    }
    return SKD_OK;
}

/* The step with its vertices, and the positions asked for in their order (owned by the caller). */
static enum skd_status join(struct skd_stroke *stroke, const uint32_t *vertices,
                            const float *positions, size_t count, float **asked,
                            struct skd_error *error)
{
    const struct skd_session *session = stroke->session;
    struct skd_seams seams;
    enum skd_status status =
        skd_seams_join(&session->rig->mesh, vertices, positions, count, &seams, error);
    if (status != SKD_OK)
        return status;
    float *targets = seams.positions;
    if (targets == NULL && (targets = malloc(count * 3 * sizeof *targets + 1)) != NULL && count > 0)
        memcpy(targets, positions, count * 3 * sizeof *targets);
    if (stroke->step == NULL &&
        (stroke->step = skd_step_create(seams.count, session->slot_count)) != NULL &&
        seams.count > 0)
        memcpy(stroke->step->vertices, seams.vertices != NULL ? seams.vertices : vertices,
               seams.count * sizeof(uint32_t));
    free(seams.vertices);
    *asked = targets;
    return stroke->step == NULL || targets == NULL ? no_memory(error) : SKD_OK;
}

/* The vertices that pins.solve is about, rising, with their pins as targets. */
static enum skd_status list_pinned(struct skd_stroke *stroke, uint32_t **vertices,
                                   float **positions, size_t *count, struct skd_error *error)
{
    const struct skd_sheets *sheets = &stroke->session->pins;
    const struct skd_sheet *sheet = stroke->pins;
    const struct skd_stroke_input *input = &stroke->input;
    uint8_t *named = NULL;
    *vertices = malloc(sheet->used * sizeof **vertices + 1);
    *positions = malloc(sheet->used * 3 * sizeof **positions + 1);
    if (input->names_vertices)
        named = calloc(sheets->vertex_count, 1);
    if (*vertices == NULL || *positions == NULL || (input->names_vertices && named == NULL)) {
        free(named);
        return no_memory(error);
    }
    skd_sheet_list(sheets, sheet, *vertices);
    for (size_t i = 0; named != NULL && i < input->count; i++)
        named[input->vertices[i]] = 1;
    *count = 0;
    for (size_t i = 0; i < sheet->used; i++) {
        uint32_t vertex = (*vertices)[i];
        if (named != NULL && !named[vertex])
            continue;
        memcpy(*positions + 3 * *count, skd_sheet_row(sheets, sheet, vertex), 3 * sizeof(float));
        (*vertices)[(*count)++] = vertex;
    }
    free(named);
    return SKD_OK;
}

static enum skd_status start(struct skd_stroke *stroke, float **asked, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    uint32_t *vertices = NULL;
    float *positions = NULL;
    size_t count = input->count;
    enum skd_status status = SKD_OK;
    if (input->solves_pins)
        status = list_pinned(stroke, &vertices, &positions, &count, error);
    else if (input->mask != NULL || input->mix < 1.0)
        status = blend(stroke, &vertices, &positions, &count, error);
    if (status == SKD_OK)
        status = join(stroke, vertices != NULL ? vertices : input->vertices,
                      positions != NULL ? positions : input->positions, count, asked, error);
    free(vertices);
    free(positions);
    return status;
}

/* A pin that moves by what its vertex was moved: in place of `target`. */
static void move_pin(const float *pin, const float *shown, double reach, float *target)
{
    double offset[3], way = 0.0, apart = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        double moved = (double)target[axis] - (double)shown[axis];
        offset[axis] = (double)pin[axis] + moved - (double)shown[axis];
        way += moved * moved;
        apart += offset[axis] * offset[axis];
    }
    double most = fmax(reach, sqrt(way));
    double share = apart > most * most ? most / sqrt(apart) : 1.0;
    for (int axis = 0; axis < 3; axis++) {
        double moved = (double)shown[axis] + share * offset[axis];
        target[axis] = fits(moved) ? (float)moved : target[axis];
    }
}

/* Writes the stroke's targets into its pins: the change that the step makes. */
static enum skd_status pin(struct skd_stroke *stroke, float *targets, struct skd_error *error)
{
    struct skd_session *session = stroke->session;
    struct skd_step *step = stroke->step;
    double reach = WIND_UP * session->rig->length;
    step->pins =
        skd_sheet_change_create(&session->pins, stroke->pins, step->vertices, step->count, error);
    if (step->pins == NULL)
        return SKD_NO_MEMORY;
    for (size_t i = 0; i < step->count; i++) {
        float *row = step->pins->after + SKD_PIN_NUMBERS * i;
        if (stroke->vertex_locked != NULL && stroke->vertex_locked[step->vertices[i]])
            continue; /* it would be drawn there once it is not locked any more */
        bool pinned = row[3] >= 0;
        if (pinned && stroke->shown_before != NULL)
            move_pin(row, stroke->shown_before + 3 * i, reach, targets + 3 * i);
        memcpy(row, targets + 3 * i, 3 * sizeof(float));
        row[3] = pinned ? row[3] : 1.0f;
    }
    return SKD_OK;
}

/* One more pose of the stroke, in which no vertex has a target yet; NULL: no memory. */
static struct skd_stroke_pose *add_pose(struct skd_stroke *stroke, const struct skd_pose *pose)
{
    size_t count = stroke->step->count;
    struct skd_stroke_pose *added = &stroke->poses[stroke->pose_count++];
    added->matrices = pose->matrices;
    added->targets = calloc(count * 3, sizeof(float));
    added->strengths = calloc(count, sizeof(float));
    return added->targets != NULL && added->strengths != NULL ? added : NULL;
}

/* The weight of a vertex's pin in the stroke's own pose; 1 where it has none. */
static float own_weight(const struct skd_stroke *stroke, size_t item)
{
    const struct skd_step *step = stroke->step;
    const float *row = NULL;
    if (step->pins != NULL)
        row = step->pins->after + SKD_PIN_NUMBERS * item;
    else if (stroke->pins != NULL)
        row = skd_sheet_row(&stroke->session->pins, stroke->pins, step->vertices[item]);
    return row != NULL && row[3] >= 0 ? row[3] : 1.0f;
}

/* How strongly the stroke's own pose counts: strengths only where some are not 1. */
static enum skd_status weigh_first(struct skd_stroke *stroke, struct skd_error *error)
{
    size_t count = stroke->step->count, even = 0;
    struct skd_stroke_pose *own = &stroke->poses[0];
    while (even < count && !(own_weight(stroke, even) < 1.0f || own_weight(stroke, even) > 1.0f))
        even++;
    if (even == count)
        return SKD_OK;
    own->strengths = malloc(count * sizeof(float));
    if (own->strengths == NULL)
        return no_memory(error);
    for (size_t i = 0; i < count; i++)
        own->strengths[i] = own_weight(stroke, i);
    return SKD_OK;
}

/* The other poses in which some of these vertices are pinned. */
static enum skd_status add_other_pins(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_sheets *sheets = &stroke->session->pins;
    const struct skd_step *step = stroke->step;
    const struct skd_sheet *own = skd_sheets_find(sheets, stroke->pose);
    for (size_t s = 0; s < sheets->count; s++) {
        const struct skd_sheet *sheet = sheets->items[s];
        struct skd_stroke_pose *pose = NULL;
        for (size_t i = 0; i < step->count && sheet != own && sheet->used > 0; i++) {
            const float *row = skd_sheet_row(sheets, sheet, step->vertices[i]);
            if (row == NULL || !(row[3] > 0.0f))
                continue;
            if (pose == NULL && (pose = add_pose(stroke, sheet->pose)) == NULL)
                return no_memory(error);
            memcpy(pose->targets + 3 * i, row, 3 * sizeof(float));
            pose->strengths[i] = row[3];
        }
    }
    return SKD_OK;
}

static enum skd_status gather_frames(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    size_t vertex_count = stroke->session->rig->mesh.vertex_count;
    uint32_t *all = malloc(vertex_count * sizeof *all);
    enum skd_status status = all != NULL ? SKD_OK : no_memory(error);
    for (size_t v = 0; v < vertex_count && all != NULL; v++)
        all[v] = (uint32_t)v;
    for (size_t f = 0; f < input->frame_count && status == SKD_OK; f++) {
        struct skd_stroke_pose *pose = &stroke->poses[stroke->pose_count++];
        pose->matrices = input->frames[f]->matrices;
        status = join(stroke, all, input->frame_positions + 3 * f * vertex_count, vertex_count,
                      &pose->targets, error);
    }
    free(all);
    return status;
}

static enum skd_status gather_strokes(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    struct skd_stroke_pose *own = &stroke->poses[stroke->pose_count++];
    own->matrices = stroke->pose->matrices;
    enum skd_status status = start(stroke, &own->targets, error);
    if (status != SKD_OK)
        return status;
    size_t count = stroke->step->count, bytes = count * 3 * sizeof(float);
    bool pins = stroke->pins != NULL && !input->solves_pins && count > 0;
    if (pins && input->pin == SKD_PIN_MOVE) {
        stroke->shown_before = malloc(bytes);
        stroke->asked = malloc(bytes);
        if (stroke->shown_before == NULL || stroke->asked == NULL)
            return no_memory(error);
        memcpy(stroke->asked, own->targets, bytes);
        skd_session_show(stroke->session, stroke->pose, count, stroke->step->vertices,
                         stroke->shown_before);
    }
    if (pins && (status = pin(stroke, own->targets, error)) != SKD_OK)
        return status;
    if (input->options.method == SKD_METHOD_THESIS)
        return SKD_OK; /* it knows one target only */
    if ((status = weigh_first(stroke, error)) != SKD_OK)
        return status;
    return add_other_pins(stroke, error);
}

enum skd_status skd_stroke_gather(struct skd_stroke *stroke, struct skd_error *error)
{
    size_t most =
        stroke->input.frame_count > 0 ? stroke->input.frame_count : SKD_TARGET_POSES_MAX + 1;
    stroke->poses = calloc(most, sizeof *stroke->poses);
    if (stroke->poses == NULL)
        return no_memory(error);
    return stroke->input.frame_count > 0 ? gather_frames(stroke, error)
                                         : gather_strokes(stroke, error);
}
