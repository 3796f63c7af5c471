/* The guard in a file: the poses that were picked. What the solver needs of them is built anew.
 *
 *     body: [count] { source i32, index i32, time f64, name char[264] } then [count][bones][12] f64
 *
 * Stage: journal. Thread: that of the store; packing is the loop's or that of a session's turn.
 */
#ifndef SKD_JOURNAL_GUARD_ROWS_H
#define SKD_JOURNAL_GUARD_ROWS_H

#include "journal/store.h"
#include "session/session.h"

struct skd_guard_row {
    size_t candidates;
    size_t count; /* 0: no guard */
    size_t bytes;
    void *body; /* owned */
};

/* Packs what a guard was made of. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_guard_row_pack(const struct skd_guards *guards,
                                                  struct skd_guard_row *row,
                                                  struct skd_error *error);
void skd_guard_row_finish(struct skd_guard_row *row);

/* Puts a packed guard in the place of the one before. */
SKD_MUST_CHECK enum skd_status skd_guard_row_write(struct skd_store *store,
                                                   const struct skd_guard_row *row,
                                                   struct skd_error *error);

/* Gives a session without a guard the file's, if it has one, with its factors.
 * Errors: SKD_DAMAGED, SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_guard_row_read(struct skd_store *store, struct skd_session *session, struct skd_error *error);

#endif
