/* A session's file written anew, whole: after it was suspended, when it holds much that nobody can
 * undo any more, when durability is turned on.
 *
 *     turn ──> old file closed ──> worker: new file, whole ──> appended to from now on ──> old
 * removed
 *
 * Stage: journal. Thread: the loop; a worker writes, in the session's turn.
 */
#ifndef SKD_REQUESTS_REWRITING_H
#define SKD_REQUESTS_REWRITING_H

#include "requests/call.h"
#include "requests/named_poses.h"

struct skd_rewriting {
    void (*then)(struct skd_call *call);
    struct skd_named_poses poses;
    char file[SKD_STATE_FILE_BYTES];
    char path[SKD_STATE_PATH_BYTES];
};

/* Does it within the turn that `call` has, then calls then(call) with call->status. call->state
 * begins with a struct skd_rewriting, all zero; skd_rewriting_finish in any case. A failure
 * suspends the session. */
void skd_rewriting_run(struct skd_call *call, void (*then)(struct skd_call *call));
void skd_rewriting_finish(struct skd_rewriting *rewriting);

/* Does it in a turn of the daemon's own; nothing where one is under way or waits already. */
void skd_rewriting_start(struct skd_daemon *daemon, struct skd_live *live);

/* From now on suspended sessions are tried again, which skd_keeping_suspend sets off. Once, after
 * skd_keeping_start. */
void skd_rewriting_watch(struct skd_daemon *daemon);

/* Whether the file has grown so much that it should be: looked at after each commit. */
bool skd_rewriting_is_due(const struct skd_live *live);

#endif
