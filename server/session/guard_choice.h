/* Which poses a session's guard is made of: those that a client named, the least alike of them.
 *
 * Stage: job -> result. Thread: a worker, in the session's turn.
 */
#ifndef SKD_SESSION_GUARD_CHOICE_H
#define SKD_SESSION_GUARD_CHOICE_H

#include "session/session.h"

#include <stdatomic.h>

/* What a client named. Borrowed. All empty: no guard. */
struct skd_guards_input {
    struct skd_pose *const *poses;
    size_t pose_count;
    const char *const *clips;
    size_t clip_count;
    const double *matrices;       /* [matrix_count][16] posed bones, pose after pose */
    size_t matrix_count;          /* a whole number of the rig's bones */
    size_t most;                  /* poses to pick, 1..SKD_GUARD_POSES_MAX */
    const atomic_bool *cancelled; /* looked at between the stages; NULL: never */
};

/* Gathers the candidates, picks the least alike (by the weights at the session's start) and builds
 * the factors. Named poses and matrices are all candidates; frames of clips are thinned to what is
 * left of SKD_GUARD_CANDIDATES_MAX. Changes nothing of the session. Finish in any case.
 * Errors: SKD_NO_CLIP, SKD_COUNT_MISMATCH, SKD_NOT_FINITE, SKD_BAD_PARAMS (a last row other than
 * 0 0 0 1, or no pose unlike the rest pose), SKD_TOO_LARGE (too many named), SKD_UNSUPPORTED (too
 * many bones), SKD_CANCELLED, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_guards_build(const struct skd_session *session,
                                                const struct skd_guards_input *input,
                                                struct skd_guards *guards, struct skd_error *error);

#endif
