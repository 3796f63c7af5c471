/* See compare.h. */
#include "journal/compare.h"

#include <string.h>

static enum skd_status differ(const char *what, struct skd_error *error)
{
    return skd_fail(error, SKD_DAMAGED, "the file's %s differ from the session's", what);
}

static bool are_same(const void *a, const void *b, size_t bytes)
{
    if (bytes == 0 || a == NULL || b == NULL)
        return bytes == 0 || a == b;
    return memcmp(a, b, bytes) == 0;
}

static bool are_same_rows(const struct skd_sheets *a, const struct skd_sheet *sheet,
                          const struct skd_sheets *b, const struct skd_sheet *other)
{
    size_t bytes = (size_t)a->width * sizeof(float);
    if (sheet->used != other->used)
        return false;
    for (size_t v = 0; v < a->vertex_count && sheet->used > 0; v++) {
        const float *row = skd_sheet_row(a, sheet, (uint32_t)v);
        const float *other_row = skd_sheet_row(b, other, (uint32_t)v);
        if (!are_same(row, other_row, bytes))
            return false;
    }
    return true;
}

/* Sheets without rows are told to nobody, so they need not be in both. */
static bool are_same_sheets(const struct skd_sheets *a, const struct skd_sheets *b)
{
    size_t used = 0, others = 0;
    for (size_t i = 0; i < b->count; i++)
        others += b->items[i]->used > 0;
    for (size_t i = 0; i < a->count; i++) {
        if (a->items[i]->used == 0)
            continue;
        const struct skd_sheet *other = skd_sheets_find(b, a->items[i]->pose);
        if (other == NULL || !are_same_rows(a, a->items[i], b, other))
            return false;
        used++;
    }
    return used == others;
}

static bool are_same_changes(const struct skd_sheet_change *a, const struct skd_sheet_change *b,
                             size_t bones)
{
    for (; a != NULL && b != NULL; a = a->next, b = b->next) {
        size_t bytes = a->count * (size_t)a->sheets->width * sizeof(float);
        if (a->count != b->count || strcmp(a->sheet->pose->name, b->sheet->pose->name) != 0 ||
            memcmp(a->sheet->pose->matrices, b->sheet->pose->matrices,
                   bones * SKD_MATRIX_SIZE * sizeof(double)) != 0 ||
            !are_same(a->vertices, b->vertices, a->count * sizeof *a->vertices) ||
            !are_same(a->before, b->before, bytes) || !are_same(a->after, b->after, bytes))
            return false;
    }
    return a == NULL && b == NULL;
}

static bool are_same_authors(const struct skd_author *a, const struct skd_author *b)
{
    return strcmp(a->client, b->client) == 0 && strcmp(a->user, b->user) == 0 &&
           strcmp(a->id, b->id) == 0;
}

static bool are_same_steps(const struct skd_step *a, const struct skd_step *b, size_t bones)
{
    size_t slots = (size_t)a->slot_count;
    size_t weights = a->count * slots * sizeof(float), joints = a->count * slots * sizeof(uint16_t);
    size_t rest = a->count * 3 * sizeof(float);
    return a->count == b->count && a->cause == b->cause &&
           are_same_authors(&a->author, &b->author) &&
           are_same(a->vertices, b->vertices, a->count * sizeof *a->vertices) &&
           are_same(a->before, b->before, weights) && are_same(a->after, b->after, weights) &&
           are_same(a->joints_before, b->joints_before, joints) &&
           are_same(a->joints_after, b->joints_after, joints) &&
           are_same(a->rest_before, b->rest_before, rest) &&
           are_same(a->rest_after, b->rest_after, rest) &&
           are_same_changes(a->pins, b->pins, bones) && are_same_changes(a->shape, b->shape, bones);
}

static bool are_same_histories(const struct skd_history *a, const struct skd_history *b,
                               size_t bones)
{
    bool same = a->count == b->count && a->position == b->position;
    for (size_t i = 0; i < a->count && same; i++)
        same = are_same_steps(a->steps[i], b->steps[i], bones);
    return same;
}

static bool are_same_guards(const struct skd_guards *a, const struct skd_guards *b)
{
    const struct skd_samples *x = &a->poses, *y = &b->poses;
    if ((a->factors == NULL) != (b->factors == NULL))
        return false;
    if (a->factors == NULL)
        return true;
    return a->candidate_count == b->candidate_count && x->count == y->count &&
           x->bone_count == y->bone_count &&
           are_same(x->matrices, y->matrices,
                    x->count * (size_t)x->bone_count * SKD_MATRIX_SIZE * sizeof(double));
}

enum skd_status skd_compare_sessions(const struct skd_session *live, const struct skd_session *read,
                                     struct skd_error *error)
{
    size_t vertices = live->rig->mesh.vertex_count, bones = (size_t)live->rig->skeleton.bone_count;
    size_t rows = vertices * (size_t)live->slot_count;
    if (vertices != read->rig->mesh.vertex_count || live->slot_count != read->slot_count ||
        live->rig->skeleton.bone_count != read->rig->skeleton.bone_count)
        return differ("sizes", error);
    if (live->revision != read->revision)
        return differ("revisions", error);
    if (!are_same(live->weights, read->weights, rows * sizeof(float)))
        return differ("weights", error);
    if (!are_same(live->joints, read->joints, rows * sizeof(uint16_t)))
        return differ("bones", error);
    if (!are_same(live->anchor, read->anchor, rows * sizeof(float)) ||
        !are_same(skd_session_start_weights(live), skd_session_start_weights(read),
                  rows * sizeof(float)))
        return differ("weights at the start", error);
    if (!are_same(live->rest, read->rest, vertices * 3 * sizeof(float)))
        return differ("rest positions", error);
    if (!are_same_sheets(&live->pins, &read->pins))
        return differ("pins", error);
    if (!are_same_sheets(&live->shapes, &read->shapes))
        return differ("shapes", error);
    if (!are_same_guards(&live->guards, &read->guards))
        return differ("guards", error);
    if (!are_same_histories(&live->history, &read->history, bones))
        return differ("steps", error);
    return SKD_OK;
}
