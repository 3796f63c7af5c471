/* See samples.h. */
#include "session/samples.h"

#include "rig/pose.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VERTICES_COMPARED = 2000 };
static const double FRAMES_PER_SECOND = 10;
static const double FRAMES_MAX = 1e6; /* of one clip: far more than are ever kept */
static const double ALIKE_PER_LENGTH = 1e-6;

static size_t pose_numbers(const struct skd_samples *samples)
{
    return (size_t)samples->bone_count * SKD_MATRIX_SIZE;
}

enum skd_status skd_samples_init(struct skd_samples *samples, size_t capacity,
                                 const struct skd_rig *rig, struct skd_error *error)
{
    *samples = (struct skd_samples){
        .capacity = capacity,
        .bone_count = rig->skeleton.bone_count,
        .items = calloc(capacity + 1, sizeof *samples->items),
    };
    samples->matrices = malloc(capacity * pose_numbers(samples) * sizeof(double) + 1);
    if (samples->items == NULL || samples->matrices == NULL)
        return skd_fail_memory(error, "the poses to choose from");
    return SKD_OK;
}

void skd_samples_finish(struct skd_samples *samples)
{
    free(samples->items);
    free(samples->matrices);
    *samples = (struct skd_samples){0};
}

const double *skd_samples_matrices(const struct skd_samples *samples, size_t index)
{
    return samples->matrices + index * pose_numbers(samples);
}

/* Where the next pose's matrices go. */
static double *next(struct skd_samples *samples)
{
    SKD_ASSERT(samples->count < samples->capacity);
    return samples->matrices + samples->count * pose_numbers(samples);
}

static void name_next(struct skd_samples *samples, enum skd_sample_source source, const char *name,
                      double time, int index)
{
    struct skd_sample *item = &samples->items[samples->count++];
    *item = (struct skd_sample){.source = source, .time = time, .index = index};
    SKD_ASSERT(strlen(name) < sizeof item->name);
    memcpy(item->name, name, strlen(name) + 1);
}

void skd_samples_add_pose(struct skd_samples *samples, const struct skd_pose *pose, int index)
{
    memcpy(next(samples), pose->matrices, pose_numbers(samples) * sizeof(double));
    name_next(samples, SKD_SAMPLE_POSE, pose->name, 0, index);
}

enum skd_status skd_samples_add_matrices(struct skd_samples *samples, const struct skd_rig *rig,
                                         const double *posed, int index, struct skd_error *error)
{
    enum skd_status status = skd_pose_from_matrices(rig, posed, next(samples), error);
    if (status == SKD_OK)
        name_next(samples, SKD_SAMPLE_MATRICES, "", 0, index);
    return status;
}

void skd_samples_add_bend(struct skd_samples *samples, const struct skd_rig *rig, int seed)
{
    skd_pose_bend(rig, (uint32_t)seed, SKD_SAMPLE_BEND_RAD, next(samples));
    name_next(samples, SKD_SAMPLE_BEND, "", 0, seed);
}

/* Frames of a clip: the first, the last, and no gap above a tenth of a second. */
static size_t count_frames(const struct skd_clip *clip)
{
    double gaps = ceil(clip->duration * FRAMES_PER_SECOND);
    return gaps > 0 ? (size_t)fmin(gaps, FRAMES_MAX) + 1 : 1;
}

enum skd_status skd_samples_add_clips(struct skd_samples *samples, const struct skd_rig *rig,
                                      const int *clips, size_t clip_count, size_t most,
                                      struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    size_t total = 0, clip = 0, before = 0;
    for (size_t i = 0; i < clip_count; i++)
        total += count_frames(&rig->nodes.clips[clips[i]]);
    size_t wanted = total < most ? total : most;
    for (size_t i = 0; i < wanted && status == SKD_OK; i++) {
        size_t frame = wanted > 1 ? i * (total - 1) / (wanted - 1) : 0;
        while (frame - before >= count_frames(&rig->nodes.clips[clips[clip]]))
            before += count_frames(&rig->nodes.clips[clips[clip++]]);
        const struct skd_clip *source = &rig->nodes.clips[clips[clip]];
        size_t frames = count_frames(source);
        double share = frames > 1 ? (double)(frame - before) / (double)(frames - 1) : 0;
        double time = share * source->duration;
        status = skd_pose_from_clip(rig, clips[clip], time, next(samples), error);
        if (status == SKD_OK)
            name_next(samples, SKD_SAMPLE_CLIP, source->name, time, (int)(frame - before));
    }
    return status;
}

static double square_between(const float *a, const float *b, size_t numbers)
{
    double square = 0;
    for (size_t i = 0; i < numbers; i++)
        square += ((double)a[i] - (double)b[i]) * ((double)a[i] - (double)b[i]);
    return square;
}

/* What tells poses apart: [samples + 1][numbers] posed vertices, the rest pose last. */
struct shown {
    size_t numbers;
    float *positions;
    double *nearest; /* [samples] squared distance to the nearest that was picked */
};

static void pick_farthest(const struct skd_samples *samples, const struct shown *shown,
                          double least, size_t most, struct skd_samples *picked)
{
    size_t count = samples->count, latest = count, numbers = shown->numbers;
    double *nearest = shown->nearest;
    for (size_t i = 0; i < count; i++)
        nearest[i] = INFINITY;
    for (size_t turn = 0; turn < most; turn++) {
        size_t farthest = count;
        for (size_t i = 0; i < count; i++) {
            nearest[i] =
                fmin(nearest[i], square_between(shown->positions + i * numbers,
                                                shown->positions + latest * numbers, numbers));
            if (nearest[i] > (farthest < count ? nearest[farthest] : least))
                farthest = i;
        }
        if (farthest == count)
            return;
        memcpy(next(picked), skd_samples_matrices(samples, farthest),
               pose_numbers(samples) * sizeof(double));
        picked->items[picked->count++] = samples->items[farthest];
        latest = farthest;
    }
}

enum skd_status skd_samples_pick(const struct skd_samples *samples, const struct skd_rig *rig,
                                 const struct skd_samples_skin *skin, size_t most,
                                 struct skd_samples *picked, struct skd_error *error)
{
    size_t vertices = rig->mesh.vertex_count, count = samples->count;
    size_t compared = vertices < VERTICES_COMPARED ? vertices : VERTICES_COMPARED;
    double alike = ALIKE_PER_LENGTH * rig->length;
    uint32_t list[VERTICES_COMPARED];
    struct shown shown = {.numbers = compared * 3};
    enum skd_status status = SKD_OK;
    shown.positions = malloc((count + 1) * shown.numbers * sizeof *shown.positions + 1);
    shown.nearest = malloc(count * sizeof *shown.nearest + 1);
    if (shown.positions == NULL || shown.nearest == NULL) {
        status = skd_fail_memory(error, "comparing poses");
    } else {
        for (size_t i = 0; i < compared; i++)
            list[i] = (uint32_t)(i * vertices / compared);
        for (size_t i = 0; i <= count; i++)
            skd_skin(compared, list, skin->slot_count, rig->mesh.rest, skin->joints, skin->weights,
                     i < count ? skd_samples_matrices(samples, i) : rig->rest_pose,
                     shown.positions + i * shown.numbers);
        pick_farthest(samples, &shown, alike * alike * (double)compared, most, picked);
    }
    free(shown.positions);
    free(shown.nearest);
    return status;
}
