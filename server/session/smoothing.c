/* See smoothing.h.
 *
 * In further passes a row's slots may no longer be the session's (evidence chose others), so the
 * solver is given rows by item instead of by vertex: all of its [V] arrays are [count] ones here,
 * and its `vertices` count from 0.
 */
#include "session/smoothing.h"

#include <stdlib.h>
#include <string.h>

enum { PASSES = 17 }; /* one without, sixteen rounds of smoothing */

struct skd_smoothing {
    uint32_t *item_of;      /* [V] where the step has a vertex, or NOT_HERE */
    uint32_t *counting;     /* [count] 0, 1, 2, ... */
    float *rest;            /* [count][3] */
    uint8_t *locked;        /* [count] */
    uint16_t *joints;       /* [count][N] as the first pass left them */
    float *anchor;          /* [count][N] laid out by `joints` */
    uint16_t *start_joints; /* [count][N] */
    float *start_weights;   /* [count][N] */
    float *previous;        /* [count][N] weights of the pass before */
    float *pulls;           /* [count][N] */
};

static const uint32_t NOT_HERE = UINT32_MAX;

static void *rows(size_t count, size_t row_bytes, bool *failed)
{
    void *memory = malloc(count * row_bytes + 1);
    *failed = *failed || memory == NULL;
    return memory;
}

enum skd_status skd_smoothing_create(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_step *step = stroke->step;
    size_t vertex_count = stroke->session->rig->mesh.vertex_count;
    size_t count = step->count, slots = (size_t)step->slot_count;
    bool failed = false;
    struct skd_smoothing *smoothing = stroke->smoothing = calloc(1, sizeof *smoothing);
    if (smoothing == NULL)
        return skd_fail_memory(error, "smoothing the stroke");
    smoothing->item_of = rows(vertex_count, sizeof(uint32_t), &failed);
    smoothing->counting = rows(count, sizeof(uint32_t), &failed);
    smoothing->rest = rows(count, 3 * sizeof(float), &failed);
    smoothing->locked = rows(count, 1, &failed);
    smoothing->joints = rows(count, slots * sizeof(uint16_t), &failed);
    smoothing->anchor = rows(count, slots * sizeof(float), &failed);
    smoothing->start_joints = rows(count, slots * sizeof(uint16_t), &failed);
    smoothing->start_weights = rows(count, slots * sizeof(float), &failed);
    smoothing->previous = rows(count, slots * sizeof(float), &failed);
    smoothing->pulls = rows(count, slots * sizeof(float), &failed);
    if (failed)
        return skd_fail_memory(error, "smoothing the stroke");
    for (size_t v = 0; v < vertex_count; v++)
        smoothing->item_of[v] = NOT_HERE;
    for (size_t i = 0; i < count; i++) {
        smoothing->item_of[step->vertices[i]] = (uint32_t)i;
        smoothing->counting[i] = (uint32_t)i;
    }
    stroke->pass_count = count > 0 ? PASSES : 1;
    return SKD_OK;
}

void skd_smoothing_destroy(struct skd_smoothing *smoothing)
{
    if (smoothing == NULL)
        return;
    free(smoothing->item_of);
    free(smoothing->counting);
    free(smoothing->rest);
    free(smoothing->locked);
    free(smoothing->joints);
    free(smoothing->anchor);
    free(smoothing->start_joints);
    free(smoothing->start_weights);
    free(smoothing->previous);
    free(smoothing->pulls);
    free(smoothing);
}

/* After the first pass: the rows that all further ones work on. */
static void gather(struct skd_stroke *stroke)
{
    const struct skd_session *session = stroke->session;
    const struct skd_step *step = stroke->step;
    struct skd_smoothing *smoothing = stroke->smoothing;
    size_t slots = (size_t)step->slot_count;
    for (size_t i = 0; i < step->count; i++) {
        size_t vertex = step->vertices[i], from = vertex * slots, to = i * slots;
        const uint16_t *joints =
            step->joints_after != NULL ? step->joints_after + to : session->joints + from;
        memcpy(smoothing->rest + 3 * i,
               (stroke->rest != NULL ? stroke->rest : session->rest) + 3 * vertex,
               3 * sizeof(float));
        smoothing->locked[i] = stroke->vertex_locked != NULL && stroke->vertex_locked[vertex];
        memcpy(smoothing->joints + to, joints, slots * sizeof *joints);
        memcpy(smoothing->start_joints + to, skd_session_start_joints(session) + from,
               slots * sizeof *joints);
        memcpy(smoothing->start_weights + to, skd_session_start_weights(session) + from,
               slots * sizeof(float));
        skd_session_anchor_row(session, vertex, joints, smoothing->anchor + to);
    }
}

void skd_smoothing_next(struct skd_stroke *stroke)
{
    const struct skd_step *step = stroke->step;
    if (stroke->pass == 1)
        gather(stroke);
    memcpy(stroke->smoothing->previous, step->after,
           step->count * (size_t)step->slot_count * sizeof(float));
}

/* What a row gives a bone. */
static double weight_in(size_t slots, const uint16_t *joints, const float *weights, uint16_t bone)
{
    double weight = 0.0;
    for (size_t k = 0; k < slots; k++)
        weight += joints[k] == bone ? (double)weights[k] : 0.0;
    return weight;
}

/* How much more a vertex gives a bone than at the session's start. */
static double change_of(const struct skd_stroke *stroke, uint32_t vertex, uint16_t bone)
{
    const struct skd_session *session = stroke->session;
    const struct skd_smoothing *smoothing = stroke->smoothing;
    size_t slots = (size_t)session->slot_count, at = vertex * slots;
    uint32_t item = smoothing->item_of[vertex];
    double now = item == NOT_HERE
                     ? weight_in(slots, session->joints + at, session->weights + at, bone)
                     : weight_in(slots, smoothing->joints + item * slots,
                                 smoothing->previous + item * slots, bone);
    return now - weight_in(slots, skd_session_start_joints(session) + at,
                           skd_session_start_weights(session) + at, bone);
}

static void pull(const struct skd_stroke *stroke, size_t item)
{
    const struct skd_mesh *mesh = &stroke->session->rig->mesh;
    const struct skd_smoothing *smoothing = stroke->smoothing;
    size_t slots = (size_t)stroke->step->slot_count, vertex = stroke->step->vertices[item];
    uint32_t first = mesh->neighbour_offsets[vertex], end = mesh->neighbour_offsets[vertex + 1];
    for (size_t k = item * slots; k < (item + 1) * slots; k++) {
        double sum = 0.0;
        uint16_t bone = smoothing->joints[k];
        for (uint32_t n = first; n < end && bone != SKD_SLOT_EMPTY; n++)
            sum += change_of(stroke, mesh->neighbours[n], bone);
        /* A vertex without neighbours is drawn to itself: nothing pulls. */
        double mean = end > first ? sum / (double)(end - first)
                                  : (double)(smoothing->previous[k] - smoothing->anchor[k]);
        smoothing->pulls[k] = smoothing->anchor[k] + (float)mean;
    }
}

void skd_smoothing_solve(struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                         size_t first)
{
    const struct skd_smoothing *smoothing = stroke->smoothing;
    size_t at = first * (size_t)batch->slot_count;
    struct skd_solve_batch rows = *batch;
    for (size_t i = 0; i < batch->count; i++)
        pull(stroke, first + i);
    rows.vertices = smoothing->counting;
    rows.rest = smoothing->rest + 3 * first;
    rows.joints = smoothing->joints + at;
    rows.weights = smoothing->previous + at;
    rows.anchor = smoothing->anchor + at;
    rows.start_joints = smoothing->start_joints + at;
    rows.start_weights = smoothing->start_weights + at;
    rows.vertex_locked = smoothing->locked + first;
    rows.pulls = smoothing->pulls + at;
    skd_solve(&rows, &stroke->input.options);
}
