/* See json_edit.h. */
#include "rig/json_edit.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Takes the text, which is NULL when there was no memory for it. */
static void add_edit(struct skd_json_edits *edits, struct skd_json old, char *text)
{
    if (text == NULL) {
        edits->has_failed = true;
        return;
    }
    if (edits->count == edits->capacity) {
        const size_t capacity = edits->capacity * 2 + 16;
        struct skd_json_edit *items = realloc(edits->items, capacity * sizeof *items);
        if (items == NULL) {
            free(text);
            edits->has_failed = true;
            return;
        }
        edits->items = items;
        edits->capacity = capacity;
    }
    edits->items[edits->count] = (struct skd_json_edit){old, text, edits->count};
    edits->count++;
}

void skd_json_replace(struct skd_json_edits *edits, struct skd_json old, const char *format, ...)
{
    char *text = NULL;
    va_list arguments;
    va_start(arguments, format);
    if (vasprintf(&text, format, arguments) < 0)
        text = NULL;
    va_end(arguments);
    add_edit(edits, old, text);
}

void skd_json_append(struct skd_json_edits *edits, struct skd_json array, const char *elements)
{
    const struct skd_json end = {array.end - 1, array.end - 1};
    skd_json_replace(edits, end, "%s%s", skd_json_count(array) > 0 ? "," : "", elements);
}

void skd_json_add(struct skd_json_edits *edits, struct skd_json object, const char *name,
                  const char *value)
{
    const struct skd_json start = {object.start + 1, object.start + 1};
    skd_json_replace(edits, start, "\"%s\":%s%s", name, value,
                     skd_json_count(object) > 0 ? "," : "");
}

static int compare_edits(const void *a, const void *b)
{
    const struct skd_json_edit *x = a, *y = b;
    if (x->old.start != y->old.start)
        return x->old.start < y->old.start ? -1 : 1;
    return x->order < y->order ? -1 : 1;
}

char *skd_json_apply(struct skd_json_edits *edits, struct skd_json text, size_t *bytes)
{
    size_t most = (size_t)(text.end - text.start) + 1;
    for (size_t i = 0; i < edits->count; i++)
        most += strlen(edits->items[i].text);
    char *result = edits->has_failed ? NULL : malloc(most), *to = result;
    if (result == NULL)
        return NULL;
    if (edits->count > 0)
        qsort(edits->items, edits->count, sizeof *edits->items, compare_edits);
    const char *from = text.start;
    for (size_t i = 0; i < edits->count; i++) {
        const struct skd_json_edit *edit = &edits->items[i];
        to = mempcpy(to, from, (size_t)(edit->old.start - from));
        to = mempcpy(to, edit->text, strlen(edit->text));
        from = edit->old.end;
    }
    to = mempcpy(to, from, (size_t)(text.end - from));
    *bytes = (size_t)(to - result);
    return result;
}

void skd_json_edits_finish(struct skd_json_edits *edits)
{
    for (size_t i = 0; i < edits->count; i++)
        free(edits->items[i].text);
    free(edits->items);
    *edits = (struct skd_json_edits){0};
}
