/* See own_steps.h. */
#include "session/own_steps.h"

#include "session/bits.h"

#include <stdlib.h>
#include <string.h>

static void mark(uint8_t *touched, const uint32_t *vertices, size_t count)
{
    for (size_t i = 0; i < count; i++)
        (void)skd_bits_take(touched, vertices[i]);
}

static bool meets(const uint8_t *touched, const uint32_t *vertices, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (skd_bits_has(touched, vertices[i]))
            return true;
    }
    return false;
}

/* All that a step touches: the vertices of its weights, and those of its pins (of a shape they are
 * the step's). */
static void mark_step(uint8_t *touched, const struct skd_step *step)
{
    mark(touched, step->vertices, step->count);
    for (const struct skd_sheet_change *change = step->pins; change != NULL; change = change->next)
        mark(touched, change->vertices, change->count);
}

static bool step_meets(const uint8_t *touched, const struct skd_step *step)
{
    if (meets(touched, step->vertices, step->count))
        return true;
    for (const struct skd_sheet_change *change = step->pins; change != NULL;
         change = change->next) {
        if (meets(touched, change->vertices, change->count))
            return true;
    }
    return false;
}

static enum skd_status check_way(const struct skd_session *session, int direction, size_t index,
                                 struct skd_error *error)
{
    const struct skd_history *history = &session->history;
    uint8_t *touched = calloc(skd_bits_bytes(session->rig->mesh.vertex_count), 1);
    enum skd_status status = SKD_OK;
    char who[SKD_AUTHOR_TEXT_BYTES];
    if (touched == NULL)
        return skd_fail_memory(error, "looking at later steps");
    mark_step(touched, history->steps[index]);
    size_t first = direction < 0 ? index + 1 : history->position;
    size_t end = direction < 0 ? history->position : index;
    for (size_t i = first; i < end && status == SKD_OK; i++) {
        const struct skd_step *other = history->steps[i];
        if (step_meets(touched, other))
            status = skd_fail(error, SKD_CONFLICT,
                              "a %s by %s touches the same vertices and was %s after yours",
                              skd_cause_word(other->cause), skd_author_text(&other->author, who),
                              direction < 0 ? "done" : "undone");
    }
    free(touched);
    return status;
}

static bool is_own(const struct skd_step *step, const char *client_id)
{
    return client_id == NULL || strcmp(step->author.id, client_id) == 0;
}

enum skd_status skd_own_step_find(const struct skd_session *session, int direction,
                                  const char *client_id, size_t *index, struct skd_error *error)
{
    const struct skd_history *history = &session->history;
    const char *whose = client_id != NULL ? " of this tool's own" : "";
    size_t at = history->position;
    if (direction < 0) {
        while (at > 0 && !is_own(history->steps[at - 1], client_id))
            at--;
        if (at == 0)
            return skd_fail(error, SKD_NOTHING_TO_UNDO, "session \"%s\" has nothing%s to undo",
                            session->name, whose);
        *index = at - 1;
    } else {
        while (at < history->count && !is_own(history->steps[at], client_id))
            at++;
        if (at == history->count)
            return skd_fail(error, SKD_NOTHING_TO_REDO, "session \"%s\" has nothing%s to redo",
                            session->name, whose);
        *index = at;
    }
    return client_id != NULL ? check_way(session, direction, *index, error) : SKD_OK;
}
