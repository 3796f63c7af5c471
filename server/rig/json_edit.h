/* Changing a few values in JSON text and leaving every other byte as it is.
 *
 * Stage: export. Thread: a worker.
 * Edits are gathered in any order and applied at once; they must not overlap.
 */
#ifndef SKD_RIG_JSON_EDIT_H
#define SKD_RIG_JSON_EDIT_H

#include "rig/json_text.h"

#include <stdbool.h>
#include <stddef.h>

struct skd_json_edit {
    struct skd_json old; /* empty: an insertion */
    char *text;          /* owned */
    size_t order;
};

struct skd_json_edits {
    size_t count;
    size_t capacity;
    struct skd_json_edit *items;
    bool has_failed; /* memory ran out somewhere; applying fails then */
};

/* Puts text in place of `old`. The text comes as printf writes it. */
void skd_json_replace(struct skd_json_edits *edits, struct skd_json old, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Puts elements, "x,y,z", at the end of an array. Once an array. */
void skd_json_append(struct skd_json_edits *edits, struct skd_json array, const char *elements);

/* Puts "name":value into an object. */
void skd_json_add(struct skd_json_edits *edits, struct skd_json object, const char *name,
                  const char *value);

/* The text with all edits made, the caller's to free; NULL: no memory. */
char *skd_json_apply(struct skd_json_edits *edits, struct skd_json text, size_t *bytes);

void skd_json_edits_finish(struct skd_json_edits *edits);

#endif
