/* See pin_edit.h. */
#include "session/pin_edit.h"

#include "session/bits.h"

#include <stdlib.h>
#include <string.h>

enum { STRENGTH = SKD_PIN_NUMBERS - 1 }; /* where a row has its omega */

/* Of some vertices those whose pins in a layer change; returns how many. */
static size_t filter(const struct skd_sheets *sheets, const struct skd_sheet *sheet,
                     const struct skd_pin_edit *edit, const uint32_t *vertices, size_t count,
                     uint32_t *out)
{
    size_t kept = 0;
    for (size_t i = 0; i < count && sheet->used > 0; i++) {
        const float *row = skd_sheet_row(sheets, sheet, vertices[i]);
        bool same =
            row != NULL && row[STRENGTH] >= edit->strength && row[STRENGTH] <= edit->strength;
        if (row != NULL && (edit->clear || !same))
            out[kept++] = vertices[i];
    }
    return kept;
}

static struct skd_sheet_change *change_layer(struct skd_sheets *sheets, struct skd_sheet *sheet,
                                             const struct skd_pin_edit *edit,
                                             const uint32_t *vertices, size_t count,
                                             struct skd_error *error)
{
    struct skd_sheet_change *change =
        skd_sheet_change_create(sheets, sheet, vertices, count, error);
    for (size_t i = 0; change != NULL && i < count; i++) {
        float *row = change->after + i * SKD_PIN_NUMBERS;
        for (int k = 0; edit->clear && k < SKD_PIN_NUMBERS; k++)
            row[k] = sheets->blank;
        if (!edit->clear)
            row[STRENGTH] = edit->strength;
    }
    return change;
}

/* What an edit is about to change, and the room that it needs. */
struct pin_work {
    const uint32_t *vertices; /* [count] */
    size_t count;
    uint32_t *changed; /* [count] of one layer */
    uint8_t *counted;  /* a bit a vertex */
    size_t vertex_count;
};

static enum skd_status change_all(struct skd_sheets *sheets, const struct skd_pin_edit *edit,
                                  struct pin_work *work, struct skd_step *step,
                                  struct skd_error *error)
{
    for (size_t layer = 0; layer < sheets->count; layer++) {
        struct skd_sheet *sheet = sheets->items[layer];
        if (edit->pose != NULL && strcmp(edit->pose, sheet->pose->name) != 0)
            continue;
        size_t count = filter(sheets, sheet, edit, work->vertices, work->count, work->changed);
        if (count == 0)
            continue;
        struct skd_sheet_change *change =
            change_layer(sheets, sheet, edit, work->changed, count, error);
        if (change == NULL)
            return SKD_NO_MEMORY;
        change->next = step->pins;
        step->pins = change;
        for (size_t i = 0; i < count; i++)
            work->vertex_count += !skd_bits_take(work->counted, work->changed[i]);
    }
    return SKD_OK;
}

static enum skd_status edit_pins(struct skd_session *session, const struct skd_pin_edit *edit,
                                 const uint32_t *vertices, size_t count, struct skd_step *step,
                                 size_t *vertex_count, struct skd_error *error)
{
    struct pin_work work = {.vertices = vertices, .count = count};
    enum skd_status status;
    work.changed = malloc(count * sizeof *work.changed + 1);
    work.counted = calloc(skd_bits_bytes(session->rig->mesh.vertex_count), 1);
    if (work.changed == NULL || work.counted == NULL)
        status = skd_fail_memory(error, "the pins to change");
    else
        status = change_all(&session->pins, edit, &work, step, error);
    *vertex_count = work.vertex_count;
    free(work.changed);
    free(work.counted);
    return status;
}

enum skd_status skd_pin_edit_prepare(struct skd_session *session, const struct skd_pin_edit *edit,
                                     struct skd_step **step, size_t *vertex_count,
                                     struct skd_error *error)
{
    uint32_t *vertices;
    size_t count;
    *vertex_count = 0;
    enum skd_status status = skd_rows_list(session, &edit->scope, &vertices, &count, error);
    if (status != SKD_OK)
        return status;
    struct skd_step *made = skd_step_create(0, session->slot_count);
    if (made == NULL)
        status = skd_fail_memory(error, "the pins to change");
    else
        status = edit_pins(session, edit, vertices, count, made, vertex_count, error);
    if (status == SKD_OK)
        *step = made;
    else
        skd_step_release(made);
    free(vertices);
    return status;
}

enum skd_status skd_pins_forget(struct skd_session *session, struct skd_step *step,
                                struct skd_error *error)
{
    const struct skd_pin_edit edit = {.clear = true};
    size_t vertex_count;
    return edit_pins(session, &edit, step->vertices, step->count, step, &vertex_count, error);
}
