/* The answers that are given again when a request comes a second time.
 *
 * Stage: journal. Thread: that of the store. The rows are those of the last
 * SKD_REMEMBERED_CLIENTS_MAX clients that changed something, and of each the last
 * SKD_REMEMBERED_ANSWERS_MAX.
 */
#ifndef SKD_JOURNAL_REMEMBERED_ROWS_H
#define SKD_JOURNAL_REMEMBERED_ROWS_H

#include "journal/store.h"
#include "session/session.h"

/* A client and the rows that it has, oldest first. */
struct skd_speaker_rows {
    char id[SKD_CLIENT_ID_BYTES_MAX + 1];
    size_t count;
    uint64_t rows[SKD_REMEMBERED_ANSWERS_MAX];
};

struct skd_remembered_rows {
    uint64_t next_id;
    size_t count;
    struct skd_speaker_rows *clients; /* [count], the one that was longest silent first */
};

/* Nothing yet. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_remembered_rows_start(struct skd_remembered_rows *rows,
                                                         struct skd_error *error);
/* What there is in the file, for the rows that are written next. Finish in any case. */
SKD_MUST_CHECK enum skd_status skd_remembered_rows_open(struct skd_store *store,
                                                        struct skd_remembered_rows *rows,
                                                        struct skd_error *error);
void skd_remembered_rows_finish(struct skd_remembered_rows *rows);

/* One more answer; what is beyond the limits goes. */
SKD_MUST_CHECK enum skd_status skd_remembered_rows_add(struct skd_store *store,
                                                       struct skd_remembered_rows *rows,
                                                       const char *client_id, uint64_t sequence,
                                                       uint64_t revision, const char *answer,
                                                       struct skd_error *error);

/* Writes what a session remembers, oldest first. */
SKD_MUST_CHECK enum skd_status skd_remembered_rows_write(struct skd_store *store,
                                                         const struct skd_session *session,
                                                         struct skd_error *error);
/* Gives the session what the file remembers of revisions that it has. *damaged: rows that are not
 * whole; they are left out. */
SKD_MUST_CHECK enum skd_status skd_remembered_rows_read(struct skd_store *store,
                                                        struct skd_session *session,
                                                        size_t *damaged, struct skd_error *error);

#endif
