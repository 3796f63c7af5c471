/* The stiffness of a stroke from its own targets; see stroke_solve.h.
 *
 * Stage: job -> [pure solve]. Thread: a worker. A sample of the vertices is solved with next to no
 * stiffness, in the way that all will be: what is left then is noise, or out of reach.
 */
#include "session/stroke_solve.h"

#include "solver/candidates.h"
#include "solver/stiffness.h"

#include <stdlib.h>
#include <string.h>

enum { SAMPLE_VERTICES = 2048 };

/* Every stride-th item of the stroke, copied together. */
struct sample {
    size_t count;
    uint32_t *vertices;
    uint16_t *candidates; /* and behind them the joints that are chosen; NULL: slots are kept */
    float *numbers;       /* one block: targets and strengths a pose, then the solve's outputs */
    float *outputs;       /* in that block */
    struct skd_solve_pose *poses;
};

static enum skd_status allocate(const struct skd_stroke *stroke, struct sample *sample,
                                struct skd_error *error)
{
    size_t slots = (size_t)stroke->step->slot_count, count = sample->count;
    size_t pose_count = (size_t)stroke->pose_count;
    sample->vertices = malloc(count * sizeof *sample->vertices);
    sample->numbers = malloc(count * (4 * pose_count + slots + 3) * sizeof(float));
    sample->poses = malloc(pose_count * sizeof *sample->poses);
    if (stroke->candidates != NULL)
        sample->candidates = malloc(count * (SKD_CANDIDATES_MAX + slots) * sizeof(uint16_t));
    if (sample->vertices == NULL || sample->numbers == NULL || sample->poses == NULL ||
        (stroke->candidates != NULL && sample->candidates == NULL))
        return skd_fail_memory(error, "choosing the stiffness");
    sample->outputs = sample->numbers + 4 * pose_count * count;
    return SKD_OK;
}

static void fill(const struct skd_stroke *stroke, struct sample *sample, size_t stride)
{
    size_t count = sample->count;
    float *next = sample->numbers;
    for (size_t i = 0; i < count; i++) {
        sample->vertices[i] = stroke->step->vertices[i * stride];
        if (sample->candidates != NULL)
            memcpy(sample->candidates + SKD_CANDIDATES_MAX * i,
                   stroke->candidates + SKD_CANDIDATES_MAX * i * stride,
                   SKD_CANDIDATES_MAX * sizeof(uint16_t));
    }
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

static double choose(struct skd_stroke *stroke, const struct sample *sample)
{
    struct skd_solve_batch batch = skd_stroke_batch(stroke);
    size_t count = batch.count = sample->count;
    batch.vertices = sample->vertices;
    batch.poses = sample->poses;
    batch.residual_before = sample->outputs;
    batch.residual_after = sample->outputs + count;
    batch.leftover_out = sample->outputs + 2 * count;
    batch.weights_out = sample->outputs + 3 * count;
    stroke->input.options.stiffness = SKD_STIFFNESS_PROBE;
    if (sample->candidates != NULL)
        skd_stroke_solve_evidence(stroke, &batch, sample->candidates,
                                  sample->candidates + SKD_CANDIDATES_MAX * count);
    else
        skd_solve(&batch, &stroke->input.options);
    return skd_stiffness_from_leftovers(&batch, stroke->input.options.length, batch.leftover_out);
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
    free(sample.vertices);
    free(sample.candidates);
    free(sample.numbers);
    free(sample.poses);
    return status;
}
