/* See random_session.h. */
#include "support/random_session.h"

#include "rig/rig_build.h"
#include "session/creation.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

uint64_t random_next(struct random *random)
{
    uint64_t z = random->state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

size_t random_below(struct random *random, size_t limit)
{
    return (size_t)(random_next(random) % limit);
}

float random_share(struct random *random)
{
    return (float)(random_next(random) >> 40) * 0x1p-24F;
}

/* The arrays of a strip: pairs of vertices up a chain of bones. */
struct strip {
    float *positions;
    uint32_t *triangles, *offsets;
    int32_t *parents;
    double *binds;
    uint16_t *joints;
    float *weights;
};

static void fill_strip(struct strip *strip, size_t vertices, int bones)
{
    for (size_t v = 0; v < vertices; v++) {
        double height = (double)v / (double)vertices * bones;
        int bone = (int)height < bones - 1 ? (int)height : bones - 2;
        float share = (float)(height - bone) < 1.0F ? (float)(height - bone) : 1.0F;
        strip->positions[3 * v] = (float)(v % 2);
        strip->positions[3 * v + 1] = (float)height;
        strip->positions[3 * v + 2] = 0;
        strip->offsets[v] = (uint32_t)(2 * v);
        strip->joints[2 * v] = (uint16_t)bone;
        strip->joints[2 * v + 1] = (uint16_t)(bone + 1);
        strip->weights[2 * v] = 1.0F - share;
        strip->weights[2 * v + 1] = share;
    }
    strip->offsets[vertices] = (uint32_t)(2 * vertices);
    for (size_t t = 0; t + 2 < vertices; t++) {
        for (size_t k = 0; k < 3; k++)
            strip->triangles[3 * t + k] = (uint32_t)(t + k);
    }
    for (int b = 0; b < bones; b++) {
        strip->parents[b] = b - 1;
        for (int k = 0; k < 16; k++)
            strip->binds[16 * b + k] = k % 5 == 0 ? 1 : k == 7 ? b : 0;
    }
}

struct skd_session *random_session(struct random *random, size_t vertices, int bones, int slots)
{
    struct strip strip = {
        .positions = malloc(vertices * 3 * sizeof(float)),
        .triangles = malloc(vertices * 3 * sizeof(uint32_t)),
        .offsets = malloc((vertices + 1) * sizeof(uint32_t)),
        .parents = malloc((size_t)bones * sizeof(int32_t)),
        .binds = malloc((size_t)bones * 16 * sizeof(double)),
        .joints = malloc(vertices * 2 * sizeof(uint16_t)),
        .weights = malloc(vertices * 2 * sizeof(float)),
    };
    fill_strip(&strip, vertices, bones);
    struct skd_rig_arrays arrays = {
        .vertex_count = vertices,
        .positions = strip.positions,
        .triangle_count = vertices - 2,
        .triangles = strip.triangles,
        .bone_count = bones,
        .parents = strip.parents,
        .bind_matrices = strip.binds,
        .influence_offsets = strip.offsets,
        .influence_joints = strip.joints,
        .influence_weights = strip.weights,
    };
    const struct skd_session_options options = {.slot_count = slots, .fill = SKD_FILL_HOP};
    struct skd_rig *rig;
    struct skd_influences influences;
    struct skd_session *session;
    SKD_ASSERT(skd_rig_from_arrays(&arrays, &rig, &influences, NULL) == SKD_OK);
    SKD_ASSERT(skd_session_create(rig, &influences, "", &options, &session, NULL) == SKD_OK);
    (void)snprintf(session->name, sizeof session->name, "random%u",
                   (unsigned)random_below(random, 1000));
    skd_influences_finish(&influences);
    free(strip.positions);
    free(strip.triangles);
    free(strip.offsets);
    free(strip.parents);
    free(strip.binds);
    free(strip.joints);
    free(strip.weights);
    return session;
}

struct skd_pose *random_pose(const struct skd_session *session, struct random *random,
                             const char *name)
{
    size_t numbers = (size_t)session->rig->skeleton.bone_count * SKD_MATRIX_SIZE;
    struct skd_pose *pose = skd_pose_create(name, session->rig->skeleton.bone_count);
    SKD_ASSERT(pose != NULL);
    for (size_t i = 0; i < numbers; i++)
        pose->matrices[i] = (double)random_share(random) - 0.5;
    return pose;
}

/* `count` different vertices, anywhere. */
static void choose_vertices(const struct skd_session *session, struct random *random, size_t count,
                            uint32_t *out)
{
    size_t vertices = session->rig->mesh.vertex_count, place = random_below(random, vertices);
    size_t stride = vertices / count;
    for (size_t i = 0; i < count; i++)
        out[i] = (uint32_t)((place + i * stride) % vertices);
}

struct skd_pose *random_sheet_pose(const struct skd_session *session, struct random *random)
{
    char name[8];
    struct random own = {random_below(random, 4)};
    (void)snprintf(name, sizeof name, "p%u", (unsigned)own.state);
    return random_pose(session, &own, name);
}

static struct skd_sheet_change *change_rows(struct skd_session *session, struct skd_sheets *sheets,
                                            struct random *random, const uint32_t *vertices,
                                            size_t count)
{
    struct skd_sheet *sheet;
    struct skd_pose *pose = random_sheet_pose(session, random);
    SKD_ASSERT(skd_session_need_sheet(session, sheets, pose, &sheet, NULL) == SKD_OK);
    skd_pose_release(pose);
    struct skd_sheet_change *change = skd_sheet_change_create(sheets, sheet, vertices, count, NULL);
    SKD_ASSERT(change != NULL);
    bool clear = random_below(random, 4) == 0;
    for (size_t i = 0; i < count * (size_t)sheets->width; i++)
        change->after[i] = clear ? sheets->blank : random_share(random);
    return change;
}

static void fill_weights(const struct skd_session *session, struct random *random,
                         struct skd_step *step)
{
    size_t slots = (size_t)step->slot_count;
    size_t bones = (size_t)session->rig->skeleton.bone_count;
    for (size_t i = 0; i < step->count; i++) {
        size_t at = step->vertices[i] * slots, first = random_below(random, bones);
        const uint16_t *joints = session->joints + at;
        memcpy(step->before + i * slots, session->weights + at, slots * sizeof(float));
        for (size_t k = 0; step->joints_after != NULL && k < slots; k++) {
            step->joints_before[i * slots + k] = session->joints[at + k];
            step->joints_after[i * slots + k] =
                (uint16_t)(k < bones ? (first + k) % bones : SKD_SLOT_EMPTY);
        }
        if (step->joints_after != NULL)
            joints = step->joints_after + i * slots;
        for (size_t k = 0; k < slots; k++)
            step->after[i * slots + k] = joints[k] == SKD_SLOT_EMPTY ? 0 : random_share(random);
    }
}

struct skd_step *random_step(struct skd_session *session, struct random *random, size_t count,
                             unsigned changes)
{
    struct skd_step *step =
        skd_step_create((changes & RANDOM_CLEAR) != 0 ? 0 : count, session->slot_count);
    uint32_t *vertices = malloc(count * sizeof *vertices);
    SKD_ASSERT(step != NULL && vertices != NULL);
    choose_vertices(session, random, count, vertices);
    memcpy(step->vertices, vertices, step->count * sizeof *vertices);
    if ((changes & RANDOM_JOINTS) != 0)
        SKD_ASSERT(skd_session_keep_start(session, NULL) == SKD_OK &&
                   skd_step_add_joints(step, NULL) == SKD_OK);
    fill_weights(session, random, step);
    if ((changes & RANDOM_REST) != 0) {
        SKD_ASSERT(skd_session_own_rest(session, NULL) == SKD_OK &&
                   skd_step_add_rest(step, NULL) == SKD_OK);
        for (size_t i = 0; i < step->count; i++) {
            for (size_t k = 0; k < 3; k++) {
                step->rest_before[3 * i + k] = session->rest[3 * (size_t)step->vertices[i] + k];
                step->rest_after[3 * i + k] = random_share(random);
            }
        }
    }
    if ((changes & (RANDOM_PINS | RANDOM_CLEAR)) != 0)
        step->pins = change_rows(session, &session->pins, random, vertices, count);
    if ((changes & RANDOM_SHAPE) != 0 && step->count > 0)
        step->shape = change_rows(session, &session->shapes, random, vertices, count);
    step->cause = (enum skd_cause)random_below(random, SKD_CAUSE_COUNT);
    (void)snprintf(step->author.client, sizeof step->author.client, "tool %u",
                   (unsigned)random_below(random, 3));
    (void)snprintf(step->author.user, sizeof step->author.user, "person %u",
                   (unsigned)random_below(random, 3));
    (void)snprintf(step->author.id, sizeof step->author.id, "c%u",
                   (unsigned)random_below(random, 3));
    free(vertices);
    return step;
}

static uint64_t digest_sheets(uint64_t digest, const struct skd_sheets *sheets)
{
    for (size_t i = 0; i < sheets->count; i++) {
        const struct skd_sheet *sheet = sheets->items[i];
        if (sheet->used == 0)
            continue;
        digest = XXH3_64bits_withSeed(sheet->pose->name, strlen(sheet->pose->name), digest);
        digest = XXH3_64bits_withSeed(
            sheet->pose->matrices, sheets->bone_count * SKD_MATRIX_SIZE * sizeof(double), digest);
        for (uint32_t v = 0; v < sheets->vertex_count; v++) {
            const float *row = skd_sheet_row(sheets, sheet, v);
            if (row != NULL)
                digest =
                    XXH3_64bits_withSeed(row, (size_t)sheets->width * sizeof(float), digest + v);
        }
    }
    return digest;
}

uint64_t random_digest(const struct skd_session *session)
{
    size_t vertices = session->rig->mesh.vertex_count;
    size_t rows = vertices * (size_t)session->slot_count;
    uint64_t digest = XXH3_64bits(session->weights, rows * sizeof(float));
    digest = XXH3_64bits_withSeed(session->joints, rows * sizeof(uint16_t), digest);
    digest = XXH3_64bits_withSeed(session->anchor, rows * sizeof(float), digest);
    digest = XXH3_64bits_withSeed(session->rest, vertices * 3 * sizeof(float), digest);
    return digest_sheets(digest_sheets(digest, &session->pins), &session->shapes);
}
