/* The stiffness of a stroke from its own targets; see stroke_stiffness.h.
 *
 * Stage: job -> [pure solve]. Thread: a worker. A sample of the vertices is solved with next to no
 * stiffness, in the way that all will be: what is left then is noise, or out of reach.
 */
#include "session/stroke_stiffness.h"

#include "session/stroke_batch.h"
#include "solver/candidates.h"
#include "solver/rest.h"
#include "solver/stiffness.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SAMPLE_VERTICES = 2048 };

/* Every stride-th item of the stroke, copied together, and what solving it writes. */
struct sample {
    size_t count;
    uint32_t *vertices;
    uint16_t *candidates; /* [count][SKD_CANDIDATES_MAX], or NULL: slots are kept */
    uint16_t *joints;     /* [count][N] as solved */
    uint8_t *doubtful;    /* [count] not looked at */
    float *numbers;       /* one block: targets and strengths a pose, then as follows */
    float *residuals[2];  /* [count] not looked at */
    float *leftovers;     /* [count] */
    float *rest;          /* [count][3] */
    float *shown;         /* [count][3] */
    float *weights;       /* [count][N] */
    struct skd_solve_pose *poses;
};

static enum skd_status allocate(const struct skd_stroke *stroke, struct sample *sample,
                                struct skd_error *error)
{
    size_t slots = (size_t)stroke->step->slot_count, count = sample->count;
    size_t pose_count = (size_t)stroke->pose_count;
    sample->vertices = malloc(count * sizeof *sample->vertices);
    sample->joints = malloc(count * slots * sizeof *sample->joints);
    sample->doubtful = malloc(count);
    sample->numbers = malloc(count * (4 * pose_count + 9 + slots) * sizeof(float));
    sample->poses = malloc(pose_count * sizeof *sample->poses);
    if (stroke->candidates != NULL)
        sample->candidates = malloc(count * SKD_CANDIDATES_MAX * sizeof(uint16_t));
    if (sample->vertices == NULL || sample->joints == NULL || sample->doubtful == NULL ||
        sample->numbers == NULL || sample->poses == NULL ||
        (stroke->candidates != NULL && sample->candidates == NULL))
        return skd_fail_memory(error, "choosing the stiffness");
    float *next = sample->numbers + 4 * pose_count * count;
    sample->residuals[0] = next;
    sample->residuals[1] = next + count;
    sample->leftovers = next + 2 * count;
    sample->rest = next + 3 * count;
    sample->shown = next + 6 * count;
    sample->weights = next + 9 * count;
    return SKD_OK;
}

static void release(struct sample *sample)
{
    free(sample->vertices);
    free(sample->candidates);
    free(sample->joints);
    free(sample->doubtful);
    free(sample->numbers);
    free(sample->poses);
}

static void fill(const struct skd_stroke *stroke, struct sample *sample, size_t stride)
{
    const struct skd_session *session = stroke->session;
    size_t count = sample->count, slots = (size_t)session->slot_count;
    for (size_t i = 0; i < count; i++) {
        size_t vertex = sample->vertices[i] = stroke->step->vertices[i * stride];
        memcpy(sample->joints + slots * i, session->joints + slots * vertex,
               slots * sizeof(uint16_t));
        memcpy(sample->rest + 3 * i, session->rest + 3 * vertex, 3 * sizeof(float));
        if (sample->candidates != NULL)
            memcpy(sample->candidates + SKD_CANDIDATES_MAX * i,
                   stroke->candidates + SKD_CANDIDATES_MAX * i * stride,
                   SKD_CANDIDATES_MAX * sizeof(uint16_t));
    }
    float *next = sample->numbers;
    for (int p = 0; p < stroke->pose_count; p++) {
        const struct skd_stroke_pose *from = &stroke->poses[p];
        float *targets = next, *strengths = next + 3 * count;
        for (size_t i = 0; i < count; i++) {
            memcpy(targets + 3 * i, from->targets + 3 * i * stride, 3 * sizeof(float));
            strengths[i] = from->strengths != NULL ? from->strengths[i * stride] : 1.0f;
        }
        sample->poses[p] = (struct skd_solve_pose){from->matrices, targets, strengths};
        next += 4 * count;
    }
}

/* Moves the sample's rest positions too, and measures what is left after that. */
static void move_rest(const struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                      struct sample *sample)
{
    float *squares = sample->leftovers, *sums = sample->residuals[0];
    skd_rest_solve(batch, &stroke->input.options, sample->joints, sample->weights, sample->rest,
                   sample->doubtful);
    memset(squares, 0, batch->count * sizeof *squares);
    memset(sums, 0, batch->count * sizeof *sums);
    for (int p = 0; p < batch->pose_count; p++) {
        const struct skd_solve_pose *pose = &batch->poses[p];
        skd_skin(batch->count, NULL, batch->slot_count, sample->rest, sample->joints,
                 sample->weights, pose->matrices, sample->shown);
        for (size_t i = 0; i < batch->count; i++) {
            float square = 0;
            for (size_t k = 3 * i; k < 3 * i + 3; k++)
                square +=
                    (sample->shown[k] - pose->targets[k]) * (sample->shown[k] - pose->targets[k]);
            squares[i] += pose->strengths[i] * square;
            sums[i] += pose->strengths[i];
        }
    }
    for (size_t i = 0; i < batch->count; i++)
        sample->leftovers[i] = sums[i] > 0 ? sqrtf(squares[i] / sums[i]) : 0;
}

static double choose(struct skd_stroke *stroke, struct sample *sample)
{
    struct skd_solve_batch batch = skd_stroke_batch(stroke);
    bool rests = stroke->input.residual == SKD_RESIDUAL_REST;
    batch.count = sample->count;
    batch.vertices = sample->vertices;
    batch.poses = sample->poses;
    batch.residual_before = sample->residuals[0];
    batch.residual_after = sample->residuals[1];
    batch.leftover_out = sample->leftovers;
    batch.weights_out = sample->weights;
    stroke->input.options.stiffness = SKD_STIFFNESS_PROBE;
    if (sample->candidates != NULL && !rests)
        skd_stroke_solve_evidence(stroke, &batch, sample->candidates, sample->joints);
    else
        skd_solve(&batch, &stroke->input.options);
    if (rests)
        move_rest(stroke, &batch, sample);
    return skd_stiffness_choose(&batch, stroke->input.options.length, sample->leftovers);
}

enum skd_status skd_stroke_choose_stiffness(struct skd_stroke *stroke, struct skd_error *error)
{
    size_t total = stroke->step->count, stride = total / SAMPLE_VERTICES + 1;
    struct sample sample = {.count = (total + stride - 1) / stride};
    if (total == 0)
        return SKD_OK;
    enum skd_status status = allocate(stroke, &sample, error);
    if (status == SKD_OK) {
        fill(stroke, &sample, stride);
        stroke->input.options.stiffness = choose(stroke, &sample);
    }
    release(&sample);
    return status;
}
