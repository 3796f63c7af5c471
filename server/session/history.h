/* What strokes did, so that it can be undone and redone to the bit.
 *
 * Stage: commit. Thread: the loop owns the history and counts references; a worker fills the
 * arrays of a step before the loop has it, and reads them while its job runs.
 *
 * A step is also what travels: the weights that a stroke streams out are slices of its `after`,
 * so a step lives until the last byte of it was written.
 *
 *      steps:   [0] [1] [2] | [3] [4]
 *               done        ^ position   undone, next redo is [3]
 */
#ifndef SKD_SESSION_HISTORY_H
#define SKD_SESSION_HISTORY_H

#include "protocol/author.h"
#include "session/sheet.h"

#include <stddef.h>
#include <stdint.h>

/* What can make a step; its word is what session.update tells and what the journal keeps. */
#define SKD_CAUSES(X)                                                                              \
    X(STROKE, "stroke")                                                                            \
    X(REFIT, "refit")                                                                              \
    X(SET, "set")                                                                                  \
    X(PINS, "pins")                                                                                \
    X(MIRROR, "mirror")                                                                            \
    X(PRUNE, "prune")                                                                              \
    X(REDUCE, "reduce")

enum skd_cause {
#define SKD_CAUSE_ENUM(name, word) SKD_CAUSE_##name,
    SKD_CAUSES(SKD_CAUSE_ENUM)
#undef SKD_CAUSE_ENUM
        SKD_CAUSE_COUNT
};

const char *skd_cause_word(enum skd_cause cause);

/* Steps of one session keep at most this much unless it was told otherwise; the oldest go first. */
#define SKD_HISTORY_BYTES_DEFAULT ((size_t)512 << 20)

struct skd_step {
    int references;
    enum skd_cause cause;
    struct skd_author author; /* who made it */
    uint64_t revision; /* that it made; 0: with it on top the session was in no state ever told */
    size_t count;      /* vertices */
    int slot_count;
    uint32_t *vertices; /* [count] each once */
    float *before;      /* [count][slots] weights */
    float *after;       /* [count][slots] */
    /* What few steps change; both of a pair are NULL where the step does not. */
    uint16_t *joints_before; /* [count][slots] */
    uint16_t *joints_after;
    float *rest_before; /* [count][3] */
    float *rest_after;
    struct skd_sheet_change *pins;  /* a list, each of its own vertices */
    struct skd_sheet_change *shape; /* of the step's vertices, or NULL */
    bool in_history;                /* a history holds it: others who do cost no more memory */
};

/* A step with room for `count` vertices, one reference held by the caller; NULL: no memory. */
struct skd_step *skd_step_create(size_t count, int slot_count);
/* Room for joints or rest positions too; what is there before is left to the caller. */
SKD_MUST_CHECK enum skd_status skd_step_add_joints(struct skd_step *step, struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_step_add_rest(struct skd_step *step, struct skd_error *error);
struct skd_step *skd_step_hold(struct skd_step *step);
void skd_step_release(struct skd_step *step); /* NULL is fine */
/* Whether it changes nothing, and so is no step of the history. */
bool skd_step_is_empty(const struct skd_step *step);
size_t skd_step_bytes(const struct skd_step *step);

/* No state that was ever told. */
#define SKD_REVISION_NONE UINT64_MAX

struct skd_history {
    struct skd_step **steps;
    size_t count;
    size_t capacity;
    size_t position; /* steps that are done */
    size_t bytes;
    size_t bytes_max;       /* the oldest steps go when there are more */
    uint64_t base_revision; /* of the state before the oldest step, or SKD_REVISION_NONE */
};

/* Makes room for one more step, so that skd_history_push cannot fail. Called before a commit
 * changes anything. */
SKD_MUST_CHECK enum skd_status skd_history_reserve(struct skd_history *history,
                                                   struct skd_error *error);
/* How many steps could be undone once this one was pushed: the oldest may have to go for it. */
size_t skd_history_steps_with(const struct skd_history *history, const struct skd_step *step);
/* Drops what was undone and puts the step (a reference of its own) on top. Returns how many of the
 * oldest had to go for it. */
size_t skd_history_push(struct skd_history *history, struct skd_step *step);
/* Another limit. Returns how many of the oldest steps had to go for it. */
size_t skd_history_limit(struct skd_history *history, size_t bytes_max);
/* The step that undo or redo is to apply, or NULL. Borrowed. */
struct skd_step *skd_history_undoable(const struct skd_history *history);
struct skd_step *skd_history_redoable(const struct skd_history *history);
/* A step was undone (direction -1) or redone (+1), which made `revision`: the one at `index`, which
 * is taken to the boundary, past steps that touch nothing of what it does. */
void skd_history_move(struct skd_history *history, int direction, size_t index, uint64_t revision);
/* Marks the sheets of a kind that a step may write to (skd_sheets_drop_idle). */
void skd_history_keep_sheets(const struct skd_history *history, const struct skd_sheets *sheets);
void skd_history_finish(struct skd_history *history);

#endif
