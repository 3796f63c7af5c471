/* Weights that a client sets as they are, in place of those that a stroke would solve; with them,
 * where it says so, the slots' bones, the rest positions and a corrective shape: all that a tool
 * needs to bring back what it held before.
 *
 *     skd_setting_prepare  check the arrays, gather the step    one worker
 *     skd_session_write    into the session's weights           the same worker
 *
 * Stage: job -> result. Thread: a worker, while the session is lent to the job.
 * Until the write nothing of the session has changed.
 */
#ifndef SKD_SESSION_SETTING_H
#define SKD_SESSION_SETTING_H

#include "session/session.h"

/* What a client asked for. Borrowed. */
struct skd_setting {
    const uint32_t *vertices; /* [count] */
    size_t count;
    const float *weights;    /* [count][slots] by the session's slots */
    size_t weight_count;     /* numbers in `weights` */
    const uint16_t *joints;  /* [count][slots]; NULL: the slots keep their bones */
    const float *rest;       /* [count][3] bind space; NULL: the rest positions stay */
    struct skd_sheet *shape; /* the corrective shape that gets `offsets`; NULL: none */
    const float *offsets;    /* [count][3] bind space */
};

/* Checks the rows against the session and makes the step that sets them (one reference, the
 * caller's). Its vertices are those named, in their order, and then their unnamed twins. A row that
 * sums to one within 1e-7 keeps its bits; another one is scaled. A twin takes all that the first
 * that was named in its ring gets, if its slots have the same bones or bones are set too, and else
 * stays as it is.
 * Errors: SKD_COUNT_MISMATCH, SKD_BAD_INDEX (also a vertex named twice, and a joint that is no bone
 * of the vertex's skin), SKD_TOO_LARGE, SKD_NOT_FINITE, SKD_BAD_PARAMS (a weight outside 0..1 or
 * without a bone, a sum farther than 1e-3 from one, a bone twice in a row), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_setting_prepare(struct skd_session *session,
                                                   const struct skd_setting *setting,
                                                   struct skd_step **step, struct skd_error *error);

#endif
