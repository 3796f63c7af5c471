/* See setting.h. Each ring of twins is walked once, however many of its vertices were named. */
#include "session/setting.h"

#include "session/bits.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* How far a weight may lie outside 0..1, and a row's sum from one, to count as rounding that is
 * mended. */
static const double SLACK = 1e-3;

/* The bones that a row's weights are for: those sent, or those that the vertex has. */
static const uint16_t *joints_of(const struct skd_session *session,
                                 const struct skd_setting *setting, size_t row)
{
    size_t slots = (size_t)session->slot_count;
    return setting->joints != NULL ? setting->joints + row * slots
                                   : session->joints + setting->vertices[row] * slots;
}

static enum skd_status check_joints(const struct skd_session *session,
                                    const struct skd_setting *setting, size_t row,
                                    struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    uint32_t vertex = setting->vertices[row];
    const uint16_t *joints = joints_of(session, setting, row);
    for (int i = 0; i < session->slot_count; i++) {
        if (joints[i] == SKD_SLOT_EMPTY)
            continue;
        if (joints[i] >= rig->skeleton.bone_count ||
            rig->skeleton.skins[joints[i]] != rig->mesh.skins[vertex])
            return skd_fail(error, SKD_BAD_INDEX,
                            "joints[%zu] (vertex %u) names bone %u in slot %d, which is none of "
                            "the vertex's skin (session \"%s\" has %d bones)",
                            row, (unsigned)vertex, (unsigned)joints[i], i, session->name,
                            rig->skeleton.bone_count);
        for (int k = 0; k < i; k++) {
            if (joints[k] == joints[i])
                return skd_fail(error, SKD_BAD_PARAMS,
                                "joints[%zu] (vertex %u) names bone %u twice; a bone has one slot",
                                row, (unsigned)vertex, (unsigned)joints[i]);
        }
    }
    return SKD_OK;
}

static enum skd_status check_row(const struct skd_session *session,
                                 const struct skd_setting *setting, size_t row,
                                 struct skd_error *error)
{
    size_t slots = (size_t)session->slot_count;
    uint32_t vertex = setting->vertices[row];
    const float *weights = setting->weights + row * slots;
    const uint16_t *joints = joints_of(session, setting, row);
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

static enum skd_status check_vectors(const struct skd_setting *setting, const float *vectors,
                                     const char *name, struct skd_error *error)
{
    for (size_t i = 0; vectors != NULL && i < setting->count * 3; i++) {
        if (!isfinite(vectors[i]))
            return skd_fail(error, SKD_NOT_FINITE,
                            "%s[%zu] (vertex %u) is not finite; send numbers in bind space", name,
                            i / 3, (unsigned)setting->vertices[i / 3]);
    }
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
        status = check_row(session, setting, i, error);
    for (size_t i = 0; i < setting->count && setting->joints != NULL && status == SKD_OK; i++)
        status = check_joints(session, setting, i, error);
    if (status == SKD_OK)
        status = check_vectors(setting, setting->rest, "rest", error);
    return status == SKD_OK ? check_vectors(setting, setting->offsets, "offsets", error) : status;
}

/* Whether a row of one vertex means the same on the other. */
static bool have_same_slots(const struct skd_session *session, uint32_t a, uint32_t b)
{
    size_t slots = (size_t)session->slot_count;
    return memcmp(session->joints + a * slots, session->joints + b * slots,
                  slots * sizeof *session->joints) == 0;
}

/* The step's vertices and, of each, the row that was sent for it. */
struct list {
    size_t count;
    uint32_t *vertices;
    uint32_t *rows;
};

/* Lists those named, then the twins that follow them. Only counts where `list` has no arrays. */
static void follow(const struct skd_session *session, const struct skd_setting *setting,
                   const uint8_t *named, uint8_t *walked, struct list *list)
{
    const uint32_t *twins = session->rig->mesh.twins;
    list->count = setting->count;
    for (size_t i = 0; i < setting->count && list->vertices != NULL; i++) {
        list->vertices[i] = setting->vertices[i];
        list->rows[i] = (uint32_t)i;
    }
    for (size_t i = 0; i < setting->count && twins != NULL; i++) {
        uint32_t first = setting->vertices[i];
        if (skd_bits_take(walked, first))
            continue; /* and so was its ring, which may be long */
        for (uint32_t twin = twins[first]; twin != first; twin = twins[twin]) {
            (void)skd_bits_take(walked, twin);
            if (skd_bits_has(named, twin) ||
                (setting->joints == NULL && !have_same_slots(session, first, twin)))
                continue;
            if (list->vertices != NULL) {
                list->vertices[list->count] = twin;
                list->rows[list->count] = (uint32_t)i;
            }
            list->count++;
        }
    }
}

static enum skd_status list_vertices(const struct skd_session *session,
                                     const struct skd_setting *setting, struct list *list,
                                     struct skd_error *error)
{
    size_t bytes = skd_bits_bytes(session->rig->mesh.vertex_count);
    uint8_t *named = calloc(bytes, 1), *walked = calloc(bytes, 1);
    enum skd_status status = SKD_OK;
    *list = (struct list){0};
    if (named == NULL || walked == NULL)
        goto fail;
    for (size_t i = 0; i < setting->count; i++)
        (void)skd_bits_take(named, setting->vertices[i]);
    follow(session, setting, named, walked, list);
    list->vertices = malloc(list->count * sizeof *list->vertices + 1);
    list->rows = malloc(list->count * sizeof *list->rows + 1);
    if (list->vertices == NULL || list->rows == NULL)
        goto fail;
    memset(walked, 0, bytes);
    follow(session, setting, named, walked, list);
    goto done;
fail:
    status = skd_fail_memory(error, "the weights to set");
done:
    free(named);
    free(walked);
    return status;
}

/* The rows as they are stored, and what they replace. */
static void fill_weights(const struct skd_session *session, const struct skd_setting *setting,
                         const uint32_t *rows, struct skd_step *step)
{
    size_t slots = (size_t)session->slot_count;
    for (size_t i = 0; i < step->count; i++) {
        size_t at = step->vertices[i] * slots, to = i * slots;
        const uint16_t *joints = joints_of(session, setting, rows[i]);
        memcpy(step->before + to, session->weights + at, slots * sizeof(float));
        memcpy(step->after + to, setting->weights + rows[i] * slots, slots * sizeof(float));
        skd_slots_normalise(session->slot_count, joints, step->after + to);
        if (step->joints_after == NULL)
            continue;
        memcpy(step->joints_before + to, session->joints + at, slots * sizeof(uint16_t));
        memcpy(step->joints_after + to, joints, slots * sizeof(uint16_t));
    }
}

static void fill_rest(const struct skd_session *session, const struct skd_setting *setting,
                      const uint32_t *rows, struct skd_step *step)
{
    for (size_t i = 0; i < step->count; i++) {
        memcpy(step->rest_before + 3 * i, session->rest + 3 * (size_t)step->vertices[i],
               3 * sizeof(float));
        memcpy(step->rest_after + 3 * i, setting->rest + 3 * (size_t)rows[i], 3 * sizeof(float));
    }
}

static enum skd_status fill_shape(struct skd_session *session, const struct skd_setting *setting,
                                  const uint32_t *rows, struct skd_step *step,
                                  struct skd_error *error)
{
    step->shape = skd_sheet_change_create(&session->shapes, setting->shape, step->vertices,
                                          step->count, error);
    if (step->shape == NULL)
        return SKD_NO_MEMORY;
    for (size_t i = 0; i < step->count; i++)
        memcpy(step->shape->after + 3 * i, setting->offsets + 3 * (size_t)rows[i],
               3 * sizeof(float));
    return SKD_OK;
}

static enum skd_status fill(struct skd_session *session, const struct skd_setting *setting,
                            const uint32_t *rows, struct skd_step *step, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    if (setting->joints != NULL && ((status = skd_step_add_joints(step, error)) != SKD_OK ||
                                    (status = skd_session_keep_start(session, error)) != SKD_OK))
        return status;
    if (setting->rest != NULL && ((status = skd_step_add_rest(step, error)) != SKD_OK ||
                                  (status = skd_session_own_rest(session, error)) != SKD_OK))
        return status;
    fill_weights(session, setting, rows, step);
    if (setting->rest != NULL)
        fill_rest(session, setting, rows, step);
    return setting->shape != NULL ? fill_shape(session, setting, rows, step, error) : SKD_OK;
}

enum skd_status skd_setting_prepare(struct skd_session *session, const struct skd_setting *setting,
                                    struct skd_step **result, struct skd_error *error)
{
    struct list list = {0};
    struct skd_step *step = NULL;
    enum skd_status status = check(session, setting, error);
    if (status == SKD_OK)
        status = list_vertices(session, setting, &list, error);
    if (status == SKD_OK) {
        step = skd_step_create(list.count, session->slot_count);
        status = step != NULL ? SKD_OK : skd_fail_memory(error, "the weights to set");
    }
    if (status == SKD_OK && list.count > 0) {
        memcpy(step->vertices, list.vertices, list.count * sizeof *list.vertices);
        status = fill(session, setting, list.rows, step, error);
    }
    free(list.vertices);
    free(list.rows);
    if (status == SKD_OK)
        *result = step;
    else
        skd_step_release(step);
    return status;
}
