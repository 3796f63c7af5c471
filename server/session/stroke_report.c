/* See stroke_report.h. */
#include "session/stroke_report.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A vertex that ends farther than this share of L from its target counts as unreached. */
static const double REACH_PER_LENGTH = 1e-3;

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

/* Vertices of the step whose rows of a pair differ. */
static size_t count_changed(size_t count, const void *before, const void *after, size_t row_bytes)
{
    size_t changed = 0;
    for (size_t i = 0; i < count && after != NULL; i++)
        changed += memcmp((const char *)before + i * row_bytes, (const char *)after + i * row_bytes,
                          row_bytes) != 0;
    return changed;
}

static size_t count_shaped(const struct skd_step *step)
{
    static const float none[SKD_SHAPE_NUMBERS] = {0};
    size_t shaped = 0;
    for (size_t i = 0; step->shape != NULL && i < step->count; i++)
        shaped += memcmp(step->shape->after + SKD_SHAPE_NUMBERS * i, none, sizeof none) != 0;
    return shaped;
}

/* Whether the step's vertices are the request's, in their order. */
static bool follows_request(const struct skd_stroke *stroke)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_step *step = stroke->step;
    return input->count == step->count &&
           (step->count == 0 ||
            memcmp(input->vertices, step->vertices, step->count * sizeof *step->vertices) == 0);
}

/* Whether the request named vertices in an order of its own; else residuals are told by rising
 * ones. */
static bool has_order(const struct skd_stroke *stroke)
{
    return !stroke->input.solves_pins && stroke->input.frame_count == 0;
}

/* Residuals in the request's order or by rising vertices. A vertex that the mask kept out is where
 * it was asked to be. */
static void tell_in_order(struct skd_stroke *stroke, float *of_vertex)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_step *step = stroke->step;
    size_t vertex_count = stroke->session->rig->mesh.vertex_count, told = 0;
    for (size_t v = 0; v < vertex_count; v++)
        of_vertex[v] = -1;
    for (size_t i = 0; i < step->count; i++)
        of_vertex[step->vertices[i]] = (float)distance_of(stroke->residual_after[i]);
    for (size_t v = 0; v < vertex_count && !has_order(stroke); v++) {
        if (of_vertex[v] >= 0)
            stroke->told[told++] = of_vertex[v];
    }
    for (size_t i = 0; i < input->count && has_order(stroke); i++)
        stroke->told[i] = fmaxf(of_vertex[input->vertices[i]], 0);
}

static enum skd_status tell_residuals(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    size_t count = stroke->told_count = has_order(stroke) ? input->count : stroke->step->count;
    bool direct = has_order(stroke) && follows_request(stroke);
    float *of_vertex = NULL;
    stroke->told = malloc(count * sizeof *stroke->told + 1);
    if (!direct)
        of_vertex = malloc(stroke->session->rig->mesh.vertex_count * sizeof *of_vertex);
    if (stroke->told == NULL || (!direct && of_vertex == NULL)) {
        free(of_vertex);
        return skd_fail_memory(error, "the residuals");
    }
    for (size_t i = 0; i < count && direct; i++)
        stroke->told[i] = (float)distance_of(stroke->residual_after[i]);
    if (!direct)
        tell_in_order(stroke, of_vertex);
    free(of_vertex);
    return SKD_OK;
}

enum skd_status skd_stroke_finish(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_step *step = stroke->step;
    size_t count = step->count, slots = (size_t)step->slot_count;
    stroke->before = summarise(stroke->residual_before, count);
    stroke->after = summarise(stroke->residual_after, count);
    stroke->reach = REACH_PER_LENGTH * stroke->session->rig->length;
    stroke->unreached_count = 0;
    for (size_t i = 0; i < count; i++)
        stroke->unreached_count += distance_of(stroke->residual_after[i]) > stroke->reach;
    stroke->slots_changed =
        count_changed(count, step->joints_before, step->joints_after, slots * sizeof(uint16_t));
    stroke->rest_moved =
        count_changed(count, step->rest_before, step->rest_after, 3 * sizeof(float));
    stroke->shaped = count_shaped(step);
    for (size_t i = 0; i < count && stroke->doubtful != NULL; i++)
        stroke->warnings[SKD_WARNING_REST_DOUBTFUL] += stroke->doubtful[i] != 0;
    return tell_residuals(stroke, error);
}
