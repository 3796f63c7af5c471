/* The guard of a session: poses that strokes should leave as they are, and what the solver needs
 * to know of them.
 *
 * Stage: rig session. Thread: built by a worker; put in place and read by the call that has the
 * session's turn.
 */
#ifndef SKD_SESSION_GUARDS_H
#define SKD_SESSION_GUARDS_H

#include "session/samples.h"
#include "solver/guard.h"

enum { SKD_GUARD_CANDIDATES_MAX = 256 }; /* poses to pick from */

struct skd_guards {
    struct skd_guard *factors; /* for the solver; NULL: no guard */
    struct skd_samples poses;  /* in the order picked */
    size_t candidate_count;    /* that they were picked from */
};

void skd_guards_finish(struct skd_guards *guards);
size_t skd_guards_bytes(const struct skd_guards *guards);

/* The pair factors of 1..SKD_GUARD_POSES_MAX poses, the caller's to free. Errors: SKD_NO_MEMORY,
 * SKD_UNSUPPORTED past SKD_GUARD_BONES_MAX bones. */
SKD_MUST_CHECK enum skd_status skd_guards_factor(const struct skd_samples *poses,
                                                 struct skd_guard **factors,
                                                 struct skd_error *error);

#endif
