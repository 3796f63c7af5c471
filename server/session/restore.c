/* See restore.h. */
#include "session/restore.h"

#include "session/bits.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static enum skd_status check_rows(const struct skd_session *session, size_t count,
                                  const uint32_t *vertices, const uint16_t *joints,
                                  const float *weights, struct skd_error *error)
{
    size_t slots = (size_t)session->slot_count;
    int bones = session->rig->skeleton.bone_count;
    for (size_t i = 0; i < count; i++) {
        const uint16_t *row = joints != NULL
                                  ? joints + i * slots
                                  : session->joints + (vertices != NULL ? vertices[i] : i) * slots;
        for (size_t k = 0; k < slots; k++) {
            float weight = weights[i * slots + k];
            bool is_empty = row[k] == SKD_SLOT_EMPTY;
            if ((!is_empty && row[k] >= bones) || !isfinite(weight) ||
                (is_empty && (weight < 0 || weight > 0)))
                return skd_fail(error, SKD_DAMAGED, "row %zu has bone %u of %d with the weight %g",
                                i, (unsigned)row[k], bones, (double)weight);
        }
    }
    return SKD_OK;
}

static enum skd_status check_finite(const float *numbers, size_t count, const char *what,
                                    struct skd_error *error)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(numbers[i]))
            return skd_fail(error, SKD_DAMAGED, "number %zu of the %s is not finite", i, what);
    }
    return SKD_OK;
}

static enum skd_status check_vertices(const struct skd_session *session, const uint32_t *vertices,
                                      size_t count, struct skd_error *error)
{
    enum skd_status status = skd_session_check_distinct(session, vertices, count, error);
    return status == SKD_OK || status == SKD_NO_MEMORY
               ? status
               : skd_fail(error, SKD_DAMAGED,
                          "a step names a vertex twice or one that is not there");
}

/* What the start's bones and weights are, laid out by the base's bones. */
static enum skd_status restore_anchor(struct skd_session *session, struct skd_error *error)
{
    size_t slots = (size_t)session->slot_count, vertices = session->rig->mesh.vertex_count;
    session->anchor = malloc(vertices * slots * sizeof *session->anchor + 1);
    if (session->anchor == NULL)
        return skd_fail_memory(error, "the weights at the session's start");
    for (size_t v = 0; v < vertices; v++)
        skd_session_anchor_row(session, v, session->joints + v * slots,
                               session->anchor + v * slots);
    return SKD_OK;
}

static enum skd_status check_base(const struct skd_session *session, struct skd_error *error)
{
    size_t vertices = session->rig->mesh.vertex_count;
    enum skd_status status;
    if ((status = check_rows(session, vertices, NULL, NULL, session->weights, error)) != SKD_OK ||
        (status = check_rows(session, vertices, NULL, session->start_joints, session->start_weights,
                             error)) != SKD_OK)
        return status;
    return check_finite(session->rest, 3 * vertices, "rest positions", error);
}

enum skd_status skd_session_restore(struct skd_session_parts *parts, struct skd_session **result,
                                    struct skd_error *error)
{
    struct skd_session *session = calloc(1, sizeof *session);
    enum skd_status status = SKD_OK;
    if (session == NULL) {
        free(parts->source);
        free(parts->joints);
        free(parts->weights);
        free(parts->rest);
        free(parts->start_joints);
        free(parts->start_weights);
        skd_rig_destroy(parts->rig);
        return skd_fail_memory(error, "a session");
    }
    session->rig = parts->rig;
    session->source = parts->source;
    session->slot_count = parts->slot_count;
    session->joints = parts->joints;
    session->weights = parts->weights;
    session->rest = parts->rest != NULL ? parts->rest : session->rig->mesh.rest;
    session->start_joints = parts->start_joints;
    session->start_weights = parts->start_weights;
    session->history.bytes_max = SKD_HISTORY_BYTES_DEFAULT;
    skd_session_new_instance(session->instance);
    size_t bones = (size_t)session->rig->skeleton.bone_count;
    size_t vertices = session->rig->mesh.vertex_count;
    skd_sheets_init(&session->pins, SKD_PIN_NUMBERS, -1, vertices, bones);
    skd_sheets_init(&session->shapes, SKD_SHAPE_NUMBERS, 0, vertices, bones);
    if (parts->slot_count != 4 && parts->slot_count != 8)
        status = skd_fail(error, SKD_DAMAGED, "%d influences a vertex", parts->slot_count);
    if (status == SKD_OK)
        status = check_base(session, error);
    if (status == SKD_OK && session->start_joints != NULL) {
        status = restore_anchor(session, error);
    } else if (status == SKD_OK) {
        session->anchor = session->start_weights; /* laid out by `joints` already */
        session->start_weights = NULL;
    }
    if (status == SKD_OK)
        *result = session;
    else
        skd_session_destroy(session);
    return status;
}

static enum skd_status need_sheet(struct skd_sheets *sheets, struct skd_pose *pose,
                                  struct skd_sheet **sheet, struct skd_error *error)
{
    /* Idle ones are not let go of: the step that is being read may be about to write to them. */
    enum skd_status status = skd_sheets_need(sheets, pose, sheet, error);
    return status == SKD_TOO_LARGE
               ? skd_fail(error, SKD_DAMAGED, "there are pins or shapes in too many poses")
               : status;
}

enum skd_status skd_session_restore_rows(struct skd_session *session, struct skd_sheets *sheets,
                                         struct skd_pose *pose, const uint32_t *vertices,
                                         const float *rows, size_t count, struct skd_error *error)
{
    struct skd_sheet *sheet;
    size_t numbers = count * (size_t)sheets->width;
    enum skd_status status;
    if ((status = check_vertices(session, vertices, count, error)) != SKD_OK ||
        (status = check_finite(rows, numbers, "pins or shapes", error)) != SKD_OK ||
        (status = need_sheet(sheets, pose, &sheet, error)) != SKD_OK)
        return status;
    struct skd_sheet_change *change =
        skd_sheet_change_create(sheets, sheet, vertices, count, error);
    if (change == NULL)
        return SKD_NO_MEMORY;
    if (numbers > 0)
        memcpy(change->after, rows, numbers * sizeof *rows);
    skd_sheet_change_write(change, false);
    skd_sheet_change_destroy(change);
    return SKD_OK;
}

enum skd_status skd_session_restore_change(struct skd_session *session, struct skd_step *step,
                                           struct skd_sheets *sheets, struct skd_pose *pose,
                                           const uint32_t *vertices, size_t count,
                                           struct skd_sheet_change **change,
                                           struct skd_error *error)
{
    struct skd_sheet *sheet;
    enum skd_status status = check_vertices(session, vertices, count, error);
    if (status == SKD_OK && sheets == &session->shapes && step->shape != NULL)
        status = skd_fail(error, SKD_DAMAGED, "a step has two shapes");
    if (status == SKD_OK)
        status = need_sheet(sheets, pose, &sheet, error);
    if (status != SKD_OK)
        return status;
    *change = skd_sheet_change_create(sheets, sheet, vertices, count, error);
    if (*change == NULL)
        return SKD_NO_MEMORY;
    struct skd_sheet_change **end = sheets == &session->shapes ? &step->shape : &step->pins;
    while (*end != NULL)
        end = &(*end)->next;
    *end = *change;
    return SKD_OK;
}

static enum skd_status check_change(const struct skd_sheet_change *change, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (; change != NULL && status == SKD_OK; change = change->next)
        status = check_finite(change->after, change->count * (size_t)change->sheets->width,
                              "pins or shapes", error);
    return status;
}

static enum skd_status check_step(const struct skd_session *session, const struct skd_step *step,
                                  struct skd_error *error)
{
    enum skd_status status;
    if ((status = check_vertices(session, step->vertices, step->count, error)) != SKD_OK ||
        (status = check_rows(session, step->count, step->vertices, step->joints_after, step->after,
                             error)) != SKD_OK ||
        (status = check_change(step->pins, error)) != SKD_OK ||
        (status = check_change(step->shape, error)) != SKD_OK)
        return status;
    return step->rest_after != NULL
               ? check_finite(step->rest_after, 3 * step->count, "rest positions", error)
               : SKD_OK;
}

static void fill_before(const struct skd_session *session, struct skd_step *step)
{
    size_t slots = (size_t)step->slot_count;
    for (size_t i = 0; i < step->count; i++) {
        size_t vertex = step->vertices[i];
        memcpy(step->before + i * slots, session->weights + vertex * slots, slots * sizeof(float));
        if (step->joints_before != NULL)
            memcpy(step->joints_before + i * slots, session->joints + vertex * slots,
                   slots * sizeof(uint16_t));
        if (step->rest_before != NULL)
            memcpy(step->rest_before + 3 * i, session->rest + 3 * vertex, 3 * sizeof(float));
    }
}

enum skd_status skd_session_replay(struct skd_session *session, struct skd_step *step,
                                   struct skd_error *error)
{
    struct skd_history *history = &session->history;
    enum skd_status status = check_step(session, step, error);
    if (status == SKD_OK && step->joints_after != NULL)
        status = skd_session_keep_start(session, error);
    if (status == SKD_OK && step->rest_after != NULL)
        status = skd_session_own_rest(session, error);
    if (status == SKD_OK)
        status = skd_history_reserve(history, error);
    if (status != SKD_OK)
        return status;
    fill_before(session, step);
    skd_session_write(session, step, false);
    size_t limit = history->bytes_max;
    history->bytes_max = SIZE_MAX;
    (void)skd_history_push(history, step);
    history->bytes_max = limit;
    return SKD_OK;
}

static void undo_until(struct skd_session *session, size_t position)
{
    struct skd_history *history = &session->history;
    while (history->position > position) {
        skd_session_write(session, skd_history_undoable(history), true);
        history->position--;
    }
}

static void forget(struct skd_history *history, struct skd_step *step)
{
    history->bytes -= skd_step_bytes(step);
    skd_step_release(step);
}

void skd_session_settle(struct skd_session *session, size_t first, size_t position, size_t count)
{
    struct skd_history *history = &session->history;
    SKD_ASSERT(first <= position && position <= count && count <= history->position);
    undo_until(session, position);
    for (; history->count > count; history->count--)
        forget(history, history->steps[history->count - 1]);
    if (first > 0) {
        uint64_t revision = history->steps[first - 1]->revision;
        history->base_revision = revision != 0 ? revision : SKD_REVISION_NONE;
    }
    for (size_t i = 0; i < first; i++)
        forget(history, history->steps[i]);
    history->count -= first;
    history->position -= first;
    if (first > 0)
        memmove(history->steps, history->steps + first, history->count * sizeof *history->steps);
}
