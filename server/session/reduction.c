/* See reduction.h. */
#include "session/reduction.h"

#include "rig/influences.h"
#include "rig/matrix.h"
#include "rig/pose.h"
#include "session/guards.h"
#include "session/row_edit.h"
#include "solver/reduce.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { POSES_TRIED = 16, FRAMES_PICKED = 24, BENDS = 24 };

/* ---- how far vertices move ----------------------------------------------------------------- */

/* One vertex's influences, wherever they stand. */
struct blend {
    int count;
    const uint16_t *joints;
    const float *weights;
};

struct tally {
    double sum;
    double max;
    size_t count;
};

static void skin(const struct blend *blend, const float *rest, const double *matrices,
                 double position[3])
{
    position[0] = position[1] = position[2] = 0;
    for (int k = 0; k < blend->count; k++) {
        const double weight = (double)blend->weights[k];
        if (blend->joints[k] == SKD_SLOT_EMPTY || (!(weight > 0) && !(weight < 0)))
            continue;
        skd_matrix_add_transformed(matrices + (size_t)blend->joints[k] * SKD_MATRIX_SIZE, rest,
                                   weight, position);
    }
}

static void tally_add(struct tally *tally, const float *rest, const struct blend *whole,
                      const struct blend *kept, const double *matrices)
{
    double a[3], b[3], square = 0;
    skin(whole, rest, matrices, a);
    skin(kept, rest, matrices, b);
    for (int axis = 0; axis < 3; axis++)
        square += (a[axis] - b[axis]) * (a[axis] - b[axis]);
    tally->sum += sqrt(square);
    tally->max = fmax(tally->max, sqrt(square));
    tally->count++;
}

static struct skd_reduction summarise(const struct tally *tally, size_t pose_count)
{
    double mean = tally->count > 0 ? tally->sum / (double)tally->count : 0;
    return (struct skd_reduction){(int)pose_count, mean, tally->max};
}

/* ---- the cut at the session's start -------------------------------------------------------- */

static struct blend blend_of(const struct skd_influences *influences, size_t vertex)
{
    uint32_t first = influences->offsets[vertex];
    return (struct blend){(int)(influences->offsets[vertex + 1] - first),
                          influences->joints + first, influences->weights + first};
}

/* Pose `index` of POSES_TRIED: clips in turn, each at evenly spread times. */
static enum skd_status try_pose(const struct skd_rig *rig, int index, double *matrices,
                                struct skd_error *error)
{
    int clip_count = (int)rig->nodes.clip_count;
    if (clip_count == 0) {
        skd_pose_bend(rig, (uint32_t)index, SKD_SAMPLE_BEND_RAD, matrices);
        return SKD_OK;
    }
    int clip = index % clip_count;
    int rounds = (POSES_TRIED + clip_count - 1) / clip_count;
    double share = ((double)(index / clip_count) + 0.5) / (double)rounds;
    return skd_pose_from_clip(rig, clip, share * rig->nodes.clips[clip].duration, matrices, error);
}

enum skd_status skd_reduction_measure(const struct skd_session *session,
                                      const struct skd_influences *influences,
                                      struct skd_reduction *reduction, struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    size_t slots = (size_t)session->slot_count;
    struct tally tally = {0};
    enum skd_status status = SKD_OK;
    double *matrices = malloc((size_t)rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof(double));
    if (matrices == NULL)
        return skd_fail_memory(error, "measuring the reduction");
    for (int pose = 0; pose < POSES_TRIED && status == SKD_OK; pose++) {
        status = try_pose(rig, pose, matrices, error);
        for (size_t v = 0; v < rig->mesh.vertex_count && status == SKD_OK; v++) {
            struct blend whole = blend_of(influences, v);
            struct blend kept = {session->slot_count, session->joints + v * slots,
                                 session->weights + v * slots};
            if (whole.count > session->slot_count)
                tally_add(&tally, rig->mesh.rest + 3 * v, &whole, &kept, matrices);
        }
    }
    *reduction = summarise(&tally, POSES_TRIED);
    free(matrices);
    return status;
}

/* Poses of the rig's own: frames of its clips that are least alike, and bends. */
static enum skd_status gather_own(const struct skd_session *session, struct skd_samples *poses,
                                  struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    const struct skd_samples_skin rows = {session->slot_count, session->joints, session->weights};
    size_t clip_count = rig->nodes.clip_count;
    struct skd_samples frames = {0};
    enum skd_status status = skd_samples_init(poses, FRAMES_PICKED + BENDS, rig, error);
    int *clips = malloc(clip_count * sizeof *clips + 1);
    if (status == SKD_OK && clips == NULL)
        status = skd_fail_memory(error, "the clips");
    for (size_t i = 0; i < clip_count && status == SKD_OK; i++)
        clips[i] = (int)i;
    size_t most = clip_count > 0 ? SKD_GUARD_CANDIDATES_MAX : 0;
    if (status == SKD_OK && (status = skd_samples_init(&frames, most, rig, error)) == SKD_OK &&
        (status = skd_samples_add_clips(&frames, rig, clips, clip_count, most, error)) == SKD_OK)
        status = skd_samples_pick(&frames, rig, &rows, FRAMES_PICKED, poses, error);
    for (int seed = 0; seed < BENDS && status == SKD_OK; seed++)
        skd_samples_add_bend(poses, rig, seed);
    skd_samples_finish(&frames);
    free(clips);
    return status;
}

/* Chooses among one vertex's influences; returns how much of its weight went. */
static float cut_vertex(const struct skd_session *session, const struct skd_guard *guard,
                        const struct skd_influences *whole, size_t vertex,
                        struct skd_influences *cut)
{
    struct skd_influence row[SKD_INFLUENCES_MAX];
    float weights[SKD_INFLUENCES_MAX];
    size_t notes[SKD_NOTE_COUNT] = {0};
    struct blend blend = blend_of(whole, vertex);
    double lost = 0;
    int count = 0;
    if (blend.count > session->slot_count)
        skd_reduce(guard, session->rig->mesh.rest + 3 * vertex, blend.count, blend.joints,
                   blend.weights, session->slot_count, weights);
    else
        memcpy(weights, blend.weights, (size_t)blend.count * sizeof *weights);
    for (int k = 0; k < blend.count; k++) {
        if (weights[k] > 0)
            row[count++] = (struct skd_influence){blend.joints[k], weights[k]};
        else
            lost += (double)blend.weights[k];
    }
    count = skd_influences_mend(row, count, blend.joints[0], notes);
    skd_influences_append(cut, vertex, row, count);
    return (float)lost;
}

enum skd_status skd_reduction_cut(const struct skd_session *session,
                                  const struct skd_influences *influences,
                                  struct skd_influences *cut, float *largest_cut,
                                  struct skd_error *error)
{
    size_t vertex_count = session->rig->mesh.vertex_count;
    struct skd_samples poses = {0};
    struct skd_guard *guard = NULL;
    enum skd_status status = gather_own(session, &poses, error);
    *largest_cut = 0;
    if (status == SKD_OK && (status = skd_guards_factor(&poses, &guard, error)) == SKD_OK &&
        (status = skd_influences_reserve(cut, vertex_count, influences->offsets[vertex_count],
                                         error)) == SKD_OK) {
        for (size_t v = 0; v < vertex_count; v++)
            *largest_cut = fmaxf(*largest_cut, cut_vertex(session, guard, influences, v, cut));
        skd_influences_trim(cut, vertex_count);
    }
    free(guard);
    skd_samples_finish(&poses);
    return status;
}

/* ---- weights.reduce ------------------------------------------------------------------------ */

/* Copies poses that are at hand; of too many the least alike. */
static enum skd_status gather_named(const struct skd_session *session,
                                    const struct skd_reduction_input *input,
                                    struct skd_samples *poses, struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    const struct skd_samples_skin rows = {session->slot_count, session->joints, session->weights};
    bool too_many = input->pose_count > SKD_GUARD_POSES_MAX;
    struct skd_samples named = {0};
    struct skd_samples *into = too_many ? &named : poses;
    enum skd_status status = skd_samples_init(into, input->pose_count, rig, error);
    for (size_t i = 0; i < input->pose_count && status == SKD_OK; i++)
        skd_samples_add_pose(into, input->poses[i], (int)i);
    if (too_many && status == SKD_OK &&
        (status = skd_samples_init(poses, SKD_GUARD_POSES_MAX, rig, error)) == SKD_OK)
        status = skd_samples_pick(&named, rig, &rows, SKD_GUARD_POSES_MAX, poses, error);
    skd_samples_finish(&named);
    return status;
}

/* The influences that stay, by size: all others' weights become 0. */
static void keep_largest(int count, const uint16_t *joints, int keep, float *weights)
{
    float left[SKD_SLOT_COUNT_MAX];
    memcpy(left, weights, (size_t)count * sizeof *left);
    memset(weights, 0, (size_t)count * sizeof *weights);
    for (int turn = 0; turn < keep && turn < count; turn++) {
        int largest = skd_row_largest(count, joints, left);
        weights[largest] = left[largest];
        left[largest] = -1;
    }
}

/* Reduces one row; guard NULL: by size. */
static void reduce_row(const struct skd_guard *guard, const float *rest, int keep, int n,
                       const uint16_t *joints, float *weights)
{
    uint16_t bones[SKD_SLOT_COUNT_MAX];
    float values[SKD_SLOT_COUNT_MAX], kept[SKD_SLOT_COUNT_MAX];
    int slots[SKD_SLOT_COUNT_MAX], count = 0, influences = 0;
    for (int i = 0; i < n; i++) {
        influences += weights[i] > 0 || weights[i] < 0;
        if (!(weights[i] > 0))
            continue;
        slots[count] = i;
        bones[count] = joints[i];
        values[count++] = weights[i];
    }
    if (influences <= keep)
        return;
    memcpy(kept, values, sizeof kept);
    if (count > keep && guard != NULL)
        skd_reduce(guard, rest, count, bones, values, keep, kept);
    else
        keep_largest(count, bones, keep, kept);
    memset(weights, 0, (size_t)n * sizeof *weights);
    for (int k = 0; k < count; k++)
        weights[slots[k]] = kept[k];
    skd_row_scale(n, joints, weights);
}

static enum skd_status reduce_rows(const struct skd_session *session,
                                   const struct skd_reduction_input *input,
                                   const struct skd_guard *guard, struct skd_rows *rows,
                                   struct skd_error *error)
{
    size_t n = (size_t)rows->slot_count;
    enum skd_status status = SKD_OK;
    for (size_t i = 0; i < rows->count && status == SKD_OK; i++) {
        reduce_row(guard, session->rest + 3 * (size_t)rows->vertices[i], input->keep,
                   rows->slot_count, rows->joints + i * n, rows->weights + i * n);
        status = skd_scope_check(&input->scope, i, error);
    }
    return status;
}

/* How far the step moves its vertices. */
static enum skd_status measure_step(const struct skd_session *session,
                                    const struct skd_reduction_input *input,
                                    const struct skd_samples *poses, const struct skd_step *step,
                                    struct skd_reduction *moved, struct skd_error *error)
{
    size_t n = (size_t)step->slot_count;
    struct tally tally = {0};
    enum skd_status status = SKD_OK;
    for (size_t i = 0; i < step->count && status == SKD_OK; i++) {
        size_t vertex = step->vertices[i];
        struct blend before = {step->slot_count, session->joints + vertex * n,
                               step->before + i * n};
        struct blend after = {step->slot_count, before.joints, step->after + i * n};
        for (size_t pose = 0; pose < poses->count; pose++)
            tally_add(&tally, session->rest + 3 * vertex, &before, &after,
                      skd_samples_matrices(poses, pose));
        status = skd_scope_check(&input->scope, i, error);
    }
    *moved = summarise(&tally, poses->count);
    return status;
}

enum skd_status skd_reduction_prepare(struct skd_session *session,
                                      const struct skd_reduction_input *input,
                                      struct skd_step **step, struct skd_reduction *moved,
                                      struct skd_error *error)
{
    const struct skd_guards *guards = &session->guards;
    bool guarded = input->pose_count == 0 && guards->factors != NULL;
    struct skd_samples gathered = {0};
    struct skd_guard *built = NULL;
    struct skd_rows rows = {0};
    uint32_t *vertices;
    size_t count;
    enum skd_status status = skd_rows_list(session, &input->scope, &vertices, &count, error);
    if (status == SKD_OK)
        status = skd_rows_take(session, vertices, count, &rows, error);
    if (status == SKD_OK && !guarded)
        status = input->pose_count > 0 ? gather_named(session, input, &gathered, error)
                                       : gather_own(session, &gathered, error);
    if (status == SKD_OK && !guarded && !input->by_size && gathered.count > 0)
        status = skd_guards_factor(&gathered, &built, error);
    const struct skd_guard *guard = guarded ? guards->factors : built;
    if (status == SKD_OK &&
        (status = reduce_rows(session, input, input->by_size ? NULL : guard, &rows, error)) ==
            SKD_OK &&
        (status = skd_rows_step(session, &rows, step, error)) == SKD_OK) {
        status =
            measure_step(session, input, guarded ? &guards->poses : &gathered, *step, moved, error);
        if (status != SKD_OK) {
            skd_step_release(*step);
            *step = NULL;
        }
    }
    free(built);
    skd_samples_finish(&gathered);
    skd_rows_finish(&rows);
    return status;
}
