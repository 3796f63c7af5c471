/* See stroke.h. */
#include "session/stroke.h"

#include "session/seams.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A vertex that ends farther than this share of L from its target counts as unreached. */
static const double REACH_PER_LENGTH = 1e-3;

static enum skd_status check_positions(const struct skd_stroke_input *input,
                                       struct skd_error *error)
{
    for (size_t i = 0; i < input->count * 3; i++) {
        if (!isfinite(input->positions[i]))
            return skd_fail(error, SKD_NOT_FINITE,
                            "positions[%zu] (vertex %u) is not finite; send the posed position in "
                            "scene units",
                            i / 3, (unsigned)input->vertices[i / 3]);
    }
    return SKD_OK;
}

static enum skd_status lock_bones(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_skeleton *skeleton = &stroke->session->rig->skeleton;
    if (input->locked_bone_count == 0)
        return SKD_OK;
    stroke->bone_locked = calloc((size_t)skeleton->bone_count, 1);
    if (stroke->bone_locked == NULL)
        return skd_fail_memory(error, "the locked bones");
    for (size_t i = 0; i < input->locked_bone_count; i++) {
        bool found = false;
        for (int bone = 0; bone < skeleton->bone_count; bone++) {
            if (strcmp(skeleton->names[bone], input->locked_bones[i]) == 0)
                stroke->bone_locked[bone] = 1, found = true;
        }
        if (!found)
            return skd_fail(error, SKD_NO_BONE,
                            "locked_bones names \"%s\", which is no bone of session \"%s\"",
                            input->locked_bones[i], stroke->session->name);
    }
    return SKD_OK;
}

static enum skd_status lock_vertices(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_mesh *mesh = &stroke->session->rig->mesh;
    if (input->locked_vertex_count == 0)
        return SKD_OK;
    enum skd_status status = skd_session_check_vertices(stroke->session, input->locked_vertices,
                                                        input->locked_vertex_count, error);
    if (status != SKD_OK)
        return status;
    stroke->vertex_locked = calloc(mesh->vertex_count, 1);
    if (stroke->vertex_locked == NULL)
        return skd_fail_memory(error, "the locked vertices");
    for (size_t i = 0; i < input->locked_vertex_count; i++) {
        uint32_t first = input->locked_vertices[i], vertex = first;
        if (stroke->vertex_locked[first])
            continue; /* and so is its ring, which may be long */
        do {
            stroke->vertex_locked[vertex] = 1;
            vertex = mesh->twins != NULL ? mesh->twins[vertex] : first;
        } while (vertex != first);
    }
    return SKD_OK;
}

static enum skd_status check_method(const struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    if (input->options.method != SKD_METHOD_THESIS)
        return SKD_OK;
    if (stroke->session->slot_count != 4)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "method \"thesis\" is defined for 4 influences and this session has %d; "
                        "use method \"exact\"",
                        stroke->session->slot_count);
    if (input->locked_bone_count > 0 || input->options.constraint != SKD_CONSTRAINT_SIMPLEX)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "method \"thesis\" knows neither locked bones nor constraint \"affine\"; "
                        "use method \"exact\"");
    return SKD_OK;
}

/* The step's vertices and targets: the client's, and the twins that go with them. */
static enum skd_status gather(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_session *session = stroke->session;
    struct skd_seams seams;
    enum skd_status status = skd_seams_join(&session->rig->mesh, input->vertices, input->positions,
                                            input->count, &seams, error);
    if (status != SKD_OK)
        return status;
    stroke->expanded = seams.positions;
    stroke->targets = seams.positions != NULL ? seams.positions : input->positions;
    stroke->step = skd_step_create(seams.count, session->slot_count);
    stroke->residual_before = malloc(seams.count * sizeof(float) + 1);
    stroke->residual_after = malloc(seams.count * sizeof(float) + 1);
    if (stroke->step != NULL)
        memcpy(stroke->step->vertices, seams.vertices != NULL ? seams.vertices : input->vertices,
               seams.count * sizeof(uint32_t));
    free(seams.vertices);
    if (stroke->step == NULL || stroke->residual_before == NULL || stroke->residual_after == NULL)
        return skd_fail_memory(error, "the stroke's weights");
    return SKD_OK;
}

enum skd_status skd_stroke_prepare(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    enum skd_status status;
    if ((status = check_method(stroke, error)) != SKD_OK ||
        (status = skd_session_check_distinct(stroke->session, input->vertices, input->count,
                                             error)) != SKD_OK ||
        (status = check_positions(input, error)) != SKD_OK ||
        (status = lock_bones(stroke, error)) != SKD_OK ||
        (status = lock_vertices(stroke, error)) != SKD_OK)
        return status;
    stroke->input.options.length = stroke->session->rig->length;
    return gather(stroke, error);
}

void skd_stroke_solve(struct skd_stroke *stroke, size_t first, size_t count)
{
    const struct skd_session *session = stroke->session;
    struct skd_step *step = stroke->step;
    size_t slots = (size_t)step->slot_count;
    for (size_t i = first; i < first + count; i++)
        memcpy(step->before + i * slots, session->weights + step->vertices[i] * slots,
               slots * sizeof(float));
    struct skd_solve_batch batch = {
        .count = count,
        .slot_count = step->slot_count,
        .vertices = step->vertices + first,
        .targets = stroke->targets + 3 * first,
        .rest = session->rig->mesh.rest,
        .joints = session->joints,
        .weights = session->weights,
        .anchor = session->anchor,
        .vertex_locked = stroke->vertex_locked,
        .bone_locked = stroke->bone_locked,
        .matrices = stroke->pose->matrices,
        .weights_out = step->after + first * slots,
        .residual_before = stroke->residual_before + first,
        .residual_after = stroke->residual_after + first,
    };
    skd_solve(&batch, &stroke->input.options);
}

/* Where numbers near the end of their range were posed or asked for, a distance overflows. It is
 * told as the largest that there is, because JSON knows none beyond. */
static double distance_of(float residual)
{
    return isfinite(residual) ? (double)residual : (double)FLT_MAX;
}

static struct skd_residual summarise(const float *residuals, size_t count)
{
    struct skd_residual residual = {0, 0};
    for (size_t i = 0; i < count; i++) {
        double distance = distance_of(residuals[i]);
        residual.mean += distance;
        residual.max = fmax(residual.max, distance);
    }
    if (count > 0)
        residual.mean /= (double)count;
    return residual;
}

void skd_stroke_finish(struct skd_stroke *stroke)
{
    size_t count = stroke->step->count;
    stroke->before = summarise(stroke->residual_before, count);
    stroke->after = summarise(stroke->residual_after, count);
    stroke->reach = REACH_PER_LENGTH * stroke->session->rig->length;
    stroke->unreached_count = 0;
    for (size_t i = 0; i < count; i++)
        stroke->unreached_count += distance_of(stroke->residual_after[i]) > stroke->reach;
}

void skd_stroke_dismiss(struct skd_stroke *stroke)
{
    free(stroke->expanded);
    free(stroke->residual_before);
    free(stroke->residual_after);
    free(stroke->bone_locked);
    free(stroke->vertex_locked);
    skd_step_release(stroke->step);
    *stroke = (struct skd_stroke){0};
}
