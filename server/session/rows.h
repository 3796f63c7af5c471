/* Rows on their way to a step: taken from the session, changed, and what differs becomes the step.
 *
 *     skd_rows_take   the named vertices and their twins, with what they have
 *     (the edit)      changes joints and weights in place
 *     skd_rows_step   the vertices that differ from the session's, as a step
 *
 * Stage: job. Thread: a worker, while the session is lent to the job. The session is only read.
 */
#ifndef SKD_SESSION_ROWS_H
#define SKD_SESSION_ROWS_H

#include "session/session.h"

#include <stdatomic.h>

/* What a client wants edited. Borrowed. */
struct skd_edit_scope {
    const uint32_t *vertices; /* [count] */
    size_t count;
    bool all;                     /* all vertices; `vertices` is not looked at */
    const atomic_bool *cancelled; /* looked at now and then: the edit ends with SKD_CANCELLED */
};

struct skd_rows {
    int slot_count;
    size_t count;
    uint32_t *vertices; /* [count] each once */
    uint16_t *joints;   /* [count][slots] */
    float *weights;     /* [count][slots] */
};

/* The vertices of a scope and their twins, each once: the caller's to free.
 * Errors: SKD_BAD_INDEX (also a vertex named twice), SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_rows_list(const struct skd_session *session,
                                             const struct skd_edit_scope *scope,
                                             uint32_t **vertices, size_t *count,
                                             struct skd_error *error);

/* Their rows. Takes the list over, also when it fails. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_rows_take(const struct skd_session *session, uint32_t *vertices,
                                             size_t count, struct skd_rows *rows,
                                             struct skd_error *error);
void skd_rows_finish(struct skd_rows *rows);

/* The step (one reference, the caller's) of the rows that differ; count 0 when none does. What was
 * at the session's start is kept first where joints change. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_rows_step(struct skd_session *session,
                                             const struct skd_rows *rows, struct skd_step **step,
                                             struct skd_error *error);

/* SKD_CANCELLED when that was asked for; looks only every few thousand items. */
SKD_MUST_CHECK enum skd_status skd_scope_check(const struct skd_edit_scope *scope, size_t item,
                                               struct skd_error *error);

#endif
