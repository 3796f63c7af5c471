/* A sheet: rows of a few numbers that some vertices have in one pose. Pins are one kind, corrective
 * shapes the other.
 *
 *     pins     4 numbers a row: the target (posed space) and its strength omega
 *     shapes   3 numbers a row: an offset of the rest position, seen in this pose only
 *
 * Stage: rig session. Thread: rows are read and written by the worker of the call that has the
 * session's turn; sheets are added by the loop when the turn begins, and go with the session. Rows
 * live in pages, so that a sheet costs what was touched. A vertex without a row has the blank one.
 */
#ifndef SKD_SESSION_SHEET_H
#define SKD_SESSION_SHEET_H

#include "session/poses.h"

enum {
    SKD_PIN_NUMBERS = 4,
    SKD_SHAPE_NUMBERS = 3,
};

struct skd_sheet {
    struct skd_pose *pose; /* held: whose matrices these rows belong to */
    int width;             /* numbers a row */
    size_t used;           /* rows that are not blank */
    bool is_kept;          /* what skd_sheets_drop_idle is told */
    size_t page_count;
    float **pages; /* [page_count], NULL where no row was ever written */
};

/* The sheets of one kind. A sheet belongs to matrices: a name that was given to another pose since
 * finds no sheet, and the old one stays what it was. */
struct skd_sheets {
    int width;
    float blank; /* what a row is full of that is none: -1 for pins, 0 for shapes */
    size_t vertex_count;
    size_t bone_count;
    size_t count; /* those that no row is in, too: steps of the history may still fill them */
    size_t capacity;
    struct skd_sheet **items; /* [capacity] owned; in the order of their poses' names */
};

void skd_sheets_init(struct skd_sheets *sheets, int width, float blank, size_t vertex_count,
                     size_t bone_count);
void skd_sheets_finish(struct skd_sheets *sheets);
size_t skd_sheets_bytes(const struct skd_sheets *sheets);

/* The sheet of a pose with these matrices, or NULL. */
struct skd_sheet *skd_sheets_find(const struct skd_sheets *sheets, const struct skd_pose *pose);

/* The same, made where there is none (on the loop: it holds the pose). An unused sheet is told to
 * nobody, so making one changes nothing. Errors: SKD_TOO_LARGE where SKD_TARGET_POSES_MAX others
 * are used, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_sheets_need(struct skd_sheets *sheets, struct skd_pose *pose,
                                               struct skd_sheet **sheet, struct skd_error *error);

/* Lets go of the sheets that have no rows, but for those that are marked as kept, and takes the
 * marks off. Loop thread, when a turn begins. */
void skd_sheets_drop_idle(struct skd_sheets *sheets);

/* Makes room for rows of these vertices, so that writing them cannot fail. */
SKD_MUST_CHECK enum skd_status skd_sheet_reserve(const struct skd_sheets *sheets,
                                                 struct skd_sheet *sheet, const uint32_t *vertices,
                                                 size_t count, struct skd_error *error);

/* A vertex's row, [width]; NULL where it has none. */
const float *skd_sheet_row(const struct skd_sheets *sheets, const struct skd_sheet *sheet,
                           uint32_t vertex);

/* The vertices that have rows, rising; out has room for sheet->used. */
void skd_sheet_list(const struct skd_sheets *sheets, const struct skd_sheet *sheet, uint32_t *out);

/* What a step did to a sheet: rows before and after, blank ones where there was none. */
struct skd_sheet_change {
    struct skd_sheets *sheets; /* borrowed of the session, as is the sheet */
    struct skd_sheet *sheet;
    size_t count;
    uint32_t *vertices; /* [count] owned */
    float *before;      /* [count][width] owned */
    float *after;
    struct skd_sheet_change *next;
};

/* A change of these vertices (copied), with `before` and `after` both what the sheet has now, and
 * room for it reserved. NULL with an error: no memory. */
struct skd_sheet_change *skd_sheet_change_create(struct skd_sheets *sheets, struct skd_sheet *sheet,
                                                 const uint32_t *vertices, size_t count,
                                                 struct skd_error *error);
void skd_sheet_change_destroy(struct skd_sheet_change *change); /* NULL is fine; `next` too */
void skd_sheet_change_write(struct skd_sheet_change *change, bool undo);
size_t skd_sheet_change_bytes(const struct skd_sheet_change *change);

#endif
