/* The two single rows of a file: what a session is, and how far it has come.
 *
 * Stage: journal. Thread: that of the store.
 */
#ifndef SKD_JOURNAL_SESSION_ROW_H
#define SKD_JOURNAL_SESSION_ROW_H

#include "journal/store.h"
#include "session/session.h"

enum {
    SKD_PART_REST = 1,         /* the base has rest positions of its own */
    SKD_PART_START_JOINTS = 2, /* other bones at the session's start than in the base */
};

struct skd_session_row {
    char name[SKD_SESSION_NAME_BYTES_MAX + 1];
    char source[SKD_PATH_BYTES_MAX + 1];
    uint64_t slots, vertices, bones;
    uint64_t rig_bytes; /* of the rig's image */
    uint64_t parts;     /* SKD_PART_* */
    uint64_t sheets;    /* of the base, pins and shapes */
    uint64_t revision;  /* of the base, or SKD_REVISION_NONE */
    struct skd_slots_report report;
    struct skd_reduction reduction;
    uint64_t sum; /* also where the chain of the history begins */
};

struct skd_state_row {
    char instance[SKD_INSTANCE_BYTES + 1];
    uint64_t revision;
    uint64_t first; /* steps before it cannot be undone */
    uint64_t position;
    uint64_t count;
    uint64_t exported;
    uint64_t durability;
    uint64_t history_bytes;
    uint64_t chain; /* that of step count - 1 */
};

/* Fills in row->sum. */
SKD_MUST_CHECK enum skd_status skd_session_row_write(struct skd_store *store,
                                                     struct skd_session_row *row,
                                                     struct skd_error *error);
SKD_MUST_CHECK enum skd_status
skd_session_row_read(struct skd_store *store, struct skd_session_row *row, struct skd_error *error);

/* `seed`: the session row's sum. */
SKD_MUST_CHECK enum skd_status skd_state_row_write(struct skd_store *store, uint64_t seed,
                                                   const struct skd_state_row *state,
                                                   struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_state_row_read(struct skd_store *store, uint64_t seed,
                                                  struct skd_state_row *state,
                                                  struct skd_error *error);

/* A link of the history's chain. */
struct skd_history_row {
    uint64_t step;
    uint64_t revision; /* 0: none that was told */
    uint64_t sum;      /* the step's; not in the row itself */
    uint64_t chain;
};
uint64_t skd_history_chain(uint64_t before, uint64_t place, const struct skd_history_row *row);
SKD_MUST_CHECK enum skd_status skd_history_row_write(struct skd_store *store, uint64_t place,
                                                     const struct skd_history_row *row,
                                                     struct skd_error *error);

#endif
