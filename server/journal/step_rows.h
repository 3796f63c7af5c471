/* A step in a file: who made it, its vertices, and what they have since.
 *
 * Stage: journal. Thread: that of the store; a step that is written is only read, and so are the
 * poses of its sheets.
 */
#ifndef SKD_JOURNAL_STEP_ROWS_H
#define SKD_JOURNAL_STEP_ROWS_H

#include "journal/pose_rows.h"

enum { SKD_STEP_SHEETS_MAX = 1023 }; /* that one step changes; a session has at most 256 and 1 */

/* Writes a step under an id. `poses`: those of its sheets, its pins' first, in order: a step's
 * sheets themselves may be gone by now. *sum: the step's checksum. */
SKD_MUST_CHECK enum skd_status skd_step_row_write(struct skd_store *store,
                                                  struct skd_pose_rows *rows, uint64_t id,
                                                  const struct skd_step *step,
                                                  struct skd_pose *const *poses, uint64_t *sum,
                                                  struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_step_row_delete(struct skd_store *store, uint64_t id,
                                                   struct skd_error *error);

/* Reads the `after` side of a step (one reference, the caller's) that comes next in the session;
 * its rows' `before` is what the session has now. Errors: SKD_DAMAGED, SKD_FILE_IO,
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_step_row_read(struct skd_store *store,
                                                 const struct skd_pose_rows *rows, uint64_t id,
                                                 struct skd_session *session,
                                                 struct skd_step **step, uint64_t *sum,
                                                 struct skd_error *error);

#endif
