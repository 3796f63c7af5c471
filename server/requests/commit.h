/* The commit: what a worker wrote into a session becomes a revision.
 *
 *     written ──> history, revision + 1, changes ──> turn passed on ──> journal ··> durable
 *     (worker)    (loop)                                                            │ (loop)
 *                                        answer <── updates to the others <─────────┘
 *
 * Stage: commit -> reply. Thread: the loop. The next call has the session while this one waits for
 * the disk, so that strokes which come fast share one write. Nobody hears of a revision that is not
 * as durable as the session wants it.
 */
#ifndef SKD_REQUESTS_COMMIT_H
#define SKD_REQUESTS_COMMIT_H

#include "requests/call.h"

enum skd_commit_kind { SKD_COMMIT_STEP, SKD_COMMIT_UNDO, SKD_COMMIT_REDO };

struct skd_commit {
    enum skd_commit_kind kind;
    struct skd_step *step; /* borrowed; the call's state holds it until the call ends */
    enum skd_cause cause;  /* of a new step */
    bool sender_knows;     /* that it needs no session.update */
    size_t index;          /* undo, redo: which step of the history it is */
};

/* Ends a call whose step is in the session's memory. Room in the history was reserved before. */
void skd_commit(struct skd_call *call, const struct skd_commit *commit);

/* Ends a call (whose reply is encoded) that might have made a step, and found nothing to change.
 * What it was answered is remembered all the same: done later, it might change something. */
void skd_commit_unchanged(struct skd_call *call);

/* Ends a call (whose reply is encoded) that changed something else about its session: a guard, a
 * pose, what was exported. The record is taken over; NULL: there was no memory for it. */
void skd_commit_record(struct skd_call *call, struct skd_record *record);

#endif
