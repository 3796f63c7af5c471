/* Poses of a session, held while a call works with them.
 *
 * Stage: request. Thread: the loop finds and lets go; a worker reads the matrices.
 */
#ifndef SKD_REQUESTS_NAMED_POSES_H
#define SKD_REQUESTS_NAMED_POSES_H

#include "session/session.h"

struct skd_named_poses {
    struct skd_pose **items; /* [count] in the order asked for, each held */
    size_t count;
};

/* Finds `count` poses by name. Finish in any case. Errors: SKD_NO_POSE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_named_poses_find(const struct skd_session *session,
                                                    const char *const *names, size_t count,
                                                    struct skd_named_poses *poses,
                                                    struct skd_error *error);
/* Holds all that have names now. Finish in any case. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_named_poses_all(const struct skd_session *session,
                                                   struct skd_named_poses *poses,
                                                   struct skd_error *error);
void skd_named_poses_finish(struct skd_named_poses *poses);

#endif
