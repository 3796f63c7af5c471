/* Weights that are too small to matter go, and what stays sums to one.
 *
 * Stage: job -> result. Thread: a worker, while the session is lent to the job.
 */
#ifndef SKD_SESSION_PRUNE_H
#define SKD_SESSION_PRUNE_H

#include "session/rows.h"

/* Makes the step that sets weights below `below` (compared as float32) to 0 and scales what is left
 * of their rows to sum to one within 1e-7 as stored. A vertex keeps its largest weight whatever
 * that is (of equal ones, the lower bone's), a row that loses nothing its bits, a slot its bone.
 * Twins of named vertices go along. *removed counts weights.
 * Errors: those of skd_rows_list, SKD_CANCELLED. */
SKD_MUST_CHECK enum skd_status skd_prune_prepare(struct skd_session *session,
                                                 const struct skd_edit_scope *scope, double below,
                                                 struct skd_step **step, size_t *removed,
                                                 struct skd_error *error);

#endif
