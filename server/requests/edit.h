/* An edit: a step that one worker makes whole, committed, told to everyone.
 *
 *     start ==> look_up ==> (turn) ==> claim ==> make, answer, write ==> revision + 1,
 * session.update (loop)                 (loop)    (worker)                (loop)
 *
 * Stage: job -> commit -> reply. Thread: as marked. What an edit does is its kind's; that nothing
 * changes unless everything went well, and that nobody hears of what changed nothing, is here.
 */
#ifndef SKD_REQUESTS_EDIT_H
#define SKD_REQUESTS_EDIT_H

#include "requests/call.h"
#include "requests/named_poses.h"

struct skd_edit_kind;

/* A call's state while it is an edit. */
struct skd_edit {
    const struct skd_edit_kind *kind;
    struct skd_named_poses poses; /* for look_up to fill; let go of when the call ends */
    struct skd_sheet *shape;      /* for claim to find */
    size_t most;                  /* for look_up: vertices that the step may have; 0: all */
    struct skd_step *step;        /* for make to fill: empty where nothing changes */
    size_t vertices;              /* the same: how many it changes */
};

struct skd_edit_kind {
    enum skd_cause cause;
    bool sender_knows; /* that it needs no session.update */
    bool forgets_pins; /* of the vertices whose weights it writes */
    /* On the loop, before the turn, while the session's poses can be looked at; NULL: nothing. */
    enum skd_status (*look_up)(struct skd_call *call, const struct skd_session *session,
                               struct skd_edit *edit, struct skd_error *error);
    /* On the loop, when the turn begins: what only the loop may add to a session; NULL: nothing. */
    enum skd_status (*claim)(struct skd_session *session, struct skd_edit *edit,
                             struct skd_error *error);
    /* In a worker: makes the step, and adds to the answer (call->reply.body) what only this kind
     * tells. SKD_CANCELLED ends the call as cancelled, whatever the error says. */
    enum skd_status (*make)(struct skd_call *call, struct skd_edit *edit, struct skd_error *error);
};

/* Handles the call, a request for that session, and ends it. */
void skd_edit_start(struct skd_call *call, const char *session, const struct skd_edit_kind *kind);

#endif
