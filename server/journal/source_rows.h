/* Copies of the files that a rig came from, so that it can be exported when they have changed or
 * are gone.
 *
 * Stage: journal. Thread: that of the store.
 */
#ifndef SKD_JOURNAL_SOURCE_ROWS_H
#define SKD_JOURNAL_SOURCE_ROWS_H

#include "journal/store.h"
#include "rig/rig.h"

/* Writes those of the rig's files that are what they were when they were read; the others are left
 * out: a session without them can do all but export. */
SKD_MUST_CHECK enum skd_status
skd_source_rows_write(struct skd_store *store, const struct skd_rig *rig, struct skd_error *error);

/* Opens the rig's files: where they were, if they are what they were, else as copies in unnamed
 * temporary files in `folder`. *damaged: files of which neither can be had; they stay closed.
 * Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_source_rows_read(struct skd_store *store,
                                                    const struct skd_rig *rig, const char *folder,
                                                    size_t *damaged, struct skd_error *error);

#endif
