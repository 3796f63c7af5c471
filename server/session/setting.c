/* See setting.h. Each ring of twins is walked once, however many of its vertices were named. */
#include "session/setting.h"

#include "session/bits.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* How far a weight may lie outside 0..1, and a row's sum from one, to count as rounding that is
 * mended. */
static const double SLACK = 1e-3;

static enum skd_status check_row(const struct skd_session *session, uint32_t vertex, size_t row,
                                 const float *weights, struct skd_error *error)
{
    size_t slots = (size_t)session->slot_count;
    const uint16_t *joints = session->joints + vertex * slots;
    double sum = 0;
    for (size_t i = 0; i < slots; i++) {
        double weight = (double)weights[i];
        if (!isfinite(weight))
            return skd_fail(error, SKD_NOT_FINITE,
                            "weights[%zu] (vertex %u) is not finite in slot %zu; send numbers of "
                            "0 to 1",
                            row, (unsigned)vertex, i);
        if (weight < 0 || weight > 1 + SLACK)
            return skd_fail(error, SKD_BAD_PARAMS,
                            "weights[%zu] (vertex %u) has %g in slot %zu; send numbers of 0 to 1",
                            row, (unsigned)vertex, weight, i);
        if (joints[i] == SKD_SLOT_EMPTY && weight != 0)
            return skd_fail(error, SKD_BAD_PARAMS,
                            "weights[%zu] (vertex %u) has %g in slot %zu, which has no bone (joint "
                            "%d); send 0 there",
                            row, (unsigned)vertex, weight, i, SKD_SLOT_EMPTY);
        sum += weight;
    }
    if (fabs(sum - 1) > SLACK)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "weights[%zu] (vertex %u) sums to %g; send weights that sum to one", row,
                        (unsigned)vertex, sum);
    return SKD_OK;
}

static enum skd_status check(const struct skd_session *session, const struct skd_setting *setting,
                             struct skd_error *error)
{
    size_t slots = (size_t)session->slot_count;
    enum skd_status status;
    if (setting->weight_count != setting->count * slots)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "%zu weights were sent for %zu vertices, but session \"%s\" has %zu "
                        "influences; send a row of %zu a vertex",
                        setting->weight_count, setting->count, session->name, slots, slots);
    status = skd_session_check_distinct(session, setting->vertices, setting->count, error);
    for (size_t i = 0; i < setting->count && status == SKD_OK; i++)
        status = check_row(session, setting->vertices[i], i, setting->weights + i * slots, error);
    return status;
}

/* Whether a row of one vertex means the same on the other. */
static bool have_same_slots(const struct skd_session *session, uint32_t a, uint32_t b)
{
    size_t slots = (size_t)session->slot_count;
    return memcmp(session->joints + a * slots, session->joints + b * slots,
                  slots * sizeof *session->joints) == 0;
}

/* Counts the step's vertices: those named and those that follow them. With a step it writes these
 * behind the named ones, whose rows are there. */
static size_t follow(const struct skd_session *session, const struct skd_setting *setting,
                     const uint8_t *named, uint8_t *walked, struct skd_step *step)
{
    const uint32_t *twins = session->rig->mesh.twins;
    size_t slots = (size_t)session->slot_count, count = setting->count;
    for (size_t i = 0; i < setting->count; i++) {
        uint32_t first = setting->vertices[i];
        if (skd_bits_take(walked, first))
            continue; /* and so was its ring, which may be long */
        for (uint32_t twin = twins[first]; twin != first; twin = twins[twin]) {
            (void)skd_bits_take(walked, twin);
            if (skd_bits_has(named, twin) || !have_same_slots(session, first, twin))
                continue;
            if (step != NULL) {
                step->vertices[count] = twin;
                memcpy(step->after + count * slots, step->after + i * slots, slots * sizeof(float));
            }
            count++;
        }
    }
    return count;
}

/* The rows as they are stored, and what they replace. */
static void fill_named(const struct skd_session *session, const struct skd_setting *setting,
                       struct skd_step *step)
{
    size_t slots = (size_t)session->slot_count;
    memcpy(step->vertices, setting->vertices, setting->count * sizeof(uint32_t));
    memcpy(step->after, setting->weights, setting->count * slots * sizeof(float));
    for (size_t i = 0; i < setting->count; i++)
        skd_slots_normalise(session->slot_count, session->joints + step->vertices[i] * slots,
                            step->after + i * slots);
}

static void fill_before(const struct skd_session *session, struct skd_step *step)
{
    size_t slots = (size_t)session->slot_count;
    for (size_t i = 0; i < step->count; i++)
        memcpy(step->before + i * slots, session->weights + step->vertices[i] * slots,
               slots * sizeof(float));
}

enum skd_status skd_setting_prepare(const struct skd_session *session,
                                    const struct skd_setting *setting, struct skd_step **result,
                                    struct skd_error *error)
{
    const struct skd_mesh *mesh = &session->rig->mesh;
    size_t bytes = skd_bits_bytes(mesh->vertex_count), count = setting->count;
    uint8_t *named = NULL, *walked = NULL;
    struct skd_step *step = NULL;
    enum skd_status status = check(session, setting, error);
    if (status != SKD_OK)
        return status;
    if (mesh->twins != NULL) {
        named = calloc(bytes, 1);
        walked = calloc(bytes, 1);
        if (named == NULL || walked == NULL)
            goto done;
        for (size_t i = 0; i < setting->count; i++)
            (void)skd_bits_take(named, setting->vertices[i]);
        count = follow(session, setting, named, walked, NULL);
    }
    step = skd_step_create(count, session->slot_count);
    if (step == NULL)
        goto done;
    if (count > 0)
        fill_named(session, setting, step);
    if (count > setting->count) {
        memset(walked, 0, bytes);
        (void)follow(session, setting, named, walked, step);
    }
    fill_before(session, step);
done:
    free(named);
    free(walked);
    *result = step;
    return step != NULL ? SKD_OK : skd_fail_memory(error, "the weights to set");
}
