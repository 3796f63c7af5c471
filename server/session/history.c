/* See history.h. */
#include "session/history.h"

#include <stdlib.h>
#include <string.h>

const char *skd_cause_word(enum skd_cause cause)
{
    static const char *const words[] = {
#define SKD_CAUSE_WORD(name, word) word,
        SKD_CAUSES(SKD_CAUSE_WORD)
#undef SKD_CAUSE_WORD
    };
    return words[cause];
}

struct skd_step *skd_step_create(size_t count, int slot_count)
{
    /* count is below SKD_VERTICES_MAX and slot_count below SKD_SLOT_COUNT_MAX: no overflow. */
    size_t weight_bytes = count * (size_t)slot_count * sizeof(float);
    struct skd_step *step = calloc(1, sizeof *step);
    if (step == NULL)
        return NULL;
    step->references = 1;
    step->count = count;
    step->slot_count = slot_count;
    step->vertices = malloc(count * sizeof(uint32_t) + 1);
    step->before = malloc(weight_bytes + 1);
    step->after = malloc(weight_bytes + 1);
    if (step->vertices == NULL || step->before == NULL || step->after == NULL) {
        skd_step_release(step);
        return NULL;
    }
    return step;
}

enum skd_status skd_step_add_joints(struct skd_step *step, struct skd_error *error)
{
    size_t bytes = step->count * (size_t)step->slot_count * sizeof(uint16_t);
    step->joints_before = malloc(bytes + 1);
    step->joints_after = malloc(bytes + 1);
    if (step->joints_before == NULL || step->joints_after == NULL)
        return skd_fail_memory(error, "the bones of the stroke's vertices");
    return SKD_OK;
}

enum skd_status skd_step_add_rest(struct skd_step *step, struct skd_error *error)
{
    size_t bytes = step->count * 3 * sizeof(float);
    step->rest_before = malloc(bytes + 1);
    step->rest_after = malloc(bytes + 1);
    if (step->rest_before == NULL || step->rest_after == NULL)
        return skd_fail_memory(error, "the rest positions of the stroke's vertices");
    return SKD_OK;
}

bool skd_step_is_empty(const struct skd_step *step)
{
    return step->count == 0 && step->pins == NULL && step->shape == NULL;
}

struct skd_step *skd_step_hold(struct skd_step *step)
{
    step->references++;
    return step;
}

void skd_step_release(struct skd_step *step)
{
    if (step == NULL || --step->references > 0)
        return;
    free(step->vertices);
    free(step->before);
    free(step->after);
    free(step->joints_before);
    free(step->joints_after);
    free(step->rest_before);
    free(step->rest_after);
    skd_sheet_change_destroy(step->pins);
    skd_sheet_change_destroy(step->shape);
    free(step);
}

size_t skd_step_bytes(const struct skd_step *step)
{
    size_t row_bytes = sizeof(uint32_t) + 2 * (size_t)step->slot_count * sizeof(float);
    if (step->joints_after != NULL)
        row_bytes += 2 * (size_t)step->slot_count * sizeof(uint16_t);
    if (step->rest_after != NULL)
        row_bytes += 2 * 3 * sizeof(float);
    return sizeof *step + step->count * row_bytes + skd_sheet_change_bytes(step->pins) +
           skd_sheet_change_bytes(step->shape);
}

enum skd_status skd_history_reserve(struct skd_history *history, struct skd_error *error)
{
    if (history->position < history->capacity)
        return SKD_OK;
    size_t capacity = history->capacity == 0 ? 16 : history->capacity * 2;
    struct skd_step **steps = realloc(history->steps, capacity * sizeof *steps);
    if (steps == NULL)
        return skd_fail_memory(error, "the undo history");
    history->steps = steps;
    history->capacity = capacity;
    return SKD_OK;
}

static void drop_undone(struct skd_history *history)
{
    while (history->count > history->position) {
        struct skd_step *step = history->steps[--history->count];
        history->bytes -= skd_step_bytes(step);
        step->in_history = false;
        skd_step_release(step);
    }
}

/* How many of the oldest steps must go where `count` steps take `bytes`: never the last one. */
static size_t count_surplus(const struct skd_history *history, size_t count, size_t bytes)
{
    size_t surplus = 0;
    while (surplus + 1 < count && bytes > history->bytes_max)
        bytes -= skd_step_bytes(history->steps[surplus++]);
    return surplus;
}

static size_t drop_oldest(struct skd_history *history)
{
    size_t dropped = count_surplus(history, history->count, history->bytes);
    if (dropped > history->position)
        dropped = history->position; /* what was undone goes with the next step */
    for (size_t i = 0; i < dropped; i++) {
        const uint64_t revision = history->steps[i]->revision;
        history->base_revision = revision != 0 ? revision : SKD_REVISION_NONE;
        history->bytes -= skd_step_bytes(history->steps[i]);
        history->steps[i]->in_history = false;
        skd_step_release(history->steps[i]);
    }
    history->count -= dropped;
    history->position -= dropped;
    if (dropped > 0)
        memmove(history->steps, history->steps + dropped, history->count * sizeof *history->steps);
    return dropped;
}

size_t skd_history_limit(struct skd_history *history, size_t bytes_max)
{
    history->bytes_max = bytes_max;
    return drop_oldest(history);
}

size_t skd_history_steps_with(const struct skd_history *history, const struct skd_step *step)
{
    size_t bytes = skd_step_bytes(step), count = history->position + 1;
    for (size_t i = 0; i < history->position; i++)
        bytes += skd_step_bytes(history->steps[i]);
    return count - count_surplus(history, count, bytes);
}

size_t skd_history_push(struct skd_history *history, struct skd_step *step)
{
    drop_undone(history);
    SKD_ASSERT(history->count < history->capacity);
    history->steps[history->count++] = skd_step_hold(step);
    step->in_history = true;
    history->position = history->count;
    history->bytes += skd_step_bytes(step);
    return drop_oldest(history);
}

struct skd_step *skd_history_undoable(const struct skd_history *history)
{
    return history->position > 0 ? history->steps[history->position - 1] : NULL;
}

struct skd_step *skd_history_redoable(const struct skd_history *history)
{
    return history->position < history->count ? history->steps[history->position] : NULL;
}

/* Moves one step to another place. */
static void take(struct skd_history *history, size_t from, size_t to)
{
    struct skd_step *step = history->steps[from];
    for (; from < to; from++)
        history->steps[from] = history->steps[from + 1];
    for (; from > to; from--)
        history->steps[from] = history->steps[from - 1];
    history->steps[to] = step;
}

void skd_history_move(struct skd_history *history, int direction, size_t index, uint64_t revision)
{
    size_t boundary = direction < 0 ? history->position - 1 : history->position;
    SKD_ASSERT(direction < 0 ? index < history->position
                             : index >= history->position && index < history->count);
    history->position = direction < 0 ? boundary : boundary + 1;
    if (index == boundary)
        return;
    /* What was passed by is in another order than it was made in: of the states on the way only
     * the one that is reached now is ever told. */
    take(history, index, boundary);
    size_t first = index < boundary ? index : boundary, last = index + boundary - first;
    for (size_t i = first; i <= last; i++)
        history->steps[i]->revision = 0;
    history->steps[history->position - 1]->revision = revision;
}

static void keep_sheets(const struct skd_sheet_change *change, const struct skd_sheets *sheets)
{
    for (; change != NULL; change = change->next) {
        if (change->sheets == sheets)
            change->sheet->is_kept = true;
    }
}

void skd_history_keep_sheets(const struct skd_history *history, const struct skd_sheets *sheets)
{
    for (size_t i = 0; i < history->count; i++) {
        keep_sheets(history->steps[i]->pins, sheets);
        keep_sheets(history->steps[i]->shape, sheets);
    }
}

void skd_history_finish(struct skd_history *history)
{
    for (size_t i = 0; i < history->count; i++)
        skd_step_release(history->steps[i]);
    free(history->steps);
    *history = (struct skd_history){0};
}
