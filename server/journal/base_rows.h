/* The base of a session in its file: its rig, and what its vertices had before the oldest step.
 *
 * Stage: journal. Thread: that of the store.
 */
#ifndef SKD_JOURNAL_BASE_ROWS_H
#define SKD_JOURNAL_BASE_ROWS_H

#include "journal/pose_rows.h"
#include "journal/session_row.h"

/* Writes what the session is now as the base, and the row of what it is; `row` has its name
 * and gets the rest. */
SKD_MUST_CHECK enum skd_status skd_base_write(struct skd_store *store, struct skd_pose_rows *poses,
                                              const struct skd_session *session,
                                              struct skd_session_row *row, struct skd_error *error);

/* The session at its base, with its name; `poses` gets its bone count and is read.
 * *damaged: poses that were lost. Errors: SKD_DAMAGED, SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_base_read(struct skd_store *store, struct skd_pose_rows *poses,
                                             struct skd_session_row *row,
                                             struct skd_session **session, size_t *damaged,
                                             struct skd_error *error);

#endif
