/* A file that is being appended to: what the writer knows of it, and how a record becomes rows.
 *
 *     begin ──> put a record ──> ... ──> commit          one transaction
 *
 * Stage: journal. Thread: the writer. After a failure the file is only fit to be closed.
 */
#ifndef SKD_JOURNAL_WRITING_H
#define SKD_JOURNAL_WRITING_H

#include "journal/pose_rows.h"
#include "journal/record.h"
#include "journal/remembered_rows.h"
#include "journal/session_row.h"

struct skd_writing {
    struct skd_store store;
    struct skd_session_row session;
    struct skd_state_row state;
    /* The rows from the first step that can be undone, or somewhat before it; those that were
     * forgotten are in the file only, and their chain ends in `forgotten_chain`. */
    struct skd_history_row *history; /* [state.count - forgotten] */
    size_t history_capacity;
    uint64_t forgotten, forgotten_chain;
    uint64_t next_step;
    struct skd_pose_rows poses;
    struct skd_remembered_rows remembered;
    bool is_full;        /* each transaction is on the disk when it is committed */
    bool is_ahead;       /* some that were committed are not */
    uint64_t log_bytes;  /* that a checkpoint would fold in */
    uint64_t file_bytes; /* file and log together */
};

/* Opens a file that skd_journal_write made. Close in any case. */
SKD_MUST_CHECK enum skd_status skd_writing_open(struct skd_writing *writing, const char *path,
                                                struct skd_error *error);
/* Leaves the log where it is. */
void skd_writing_close(struct skd_writing *writing);

SKD_MUST_CHECK enum skd_status skd_writing_begin(struct skd_writing *writing,
                                                 enum skd_durability durability,
                                                 struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_writing_put(struct skd_writing *writing,
                                               const struct skd_record *record,
                                               struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_writing_commit(struct skd_writing *writing,
                                                  struct skd_error *error);

/* Brings to the disk what was committed without being there yet. */
SKD_MUST_CHECK enum skd_status skd_writing_sync(struct skd_writing *writing,
                                                struct skd_error *error);
/* Folds the log into the file; the next transaction begins the log anew. `truncate`: the log is
 * empty then, and closing removes it. */
SKD_MUST_CHECK enum skd_status skd_writing_checkpoint(struct skd_writing *writing, bool truncate,
                                                      struct skd_error *error);

#endif
