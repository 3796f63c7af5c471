/* Whether two sessions are the same to the bit: one that lives, and one that was read.
 *
 * Stage: journal. Thread: any that may read both.
 */
#ifndef SKD_JOURNAL_COMPARE_H
#define SKD_JOURNAL_COMPARE_H

#include "session/session.h"

/* Compares weights, bones, rest positions, the start, pins, shapes, the guard, the revision and the
 * whole undo history. Errors: SKD_DAMAGED, which names the first difference. */
SKD_MUST_CHECK enum skd_status skd_compare_sessions(const struct skd_session *live,
                                                    const struct skd_session *read,
                                                    struct skd_error *error);

#endif
