/* A session from a rig: slots for every vertex, the anchor, the pose "rest".
 *
 * Stage: rig session. Thread: a worker.
 */
#ifndef SKD_SESSION_CREATION_H
#define SKD_SESSION_CREATION_H

#include "session/session.h"

enum skd_cut { SKD_CUT_REFUSE, SKD_CUT_LARGEST, SKD_CUT_POSED };

struct skd_session_options {
    int slot_count;
    enum skd_fill fill;
    enum skd_cut cut;
};

/* Makes a session from a rig and its influences: chooses slots, sets the anchor, adds the pose
 * "rest". Takes the rig over, also on failure. Errors: SKD_TOO_MANY_INFLUENCES, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_session_create(struct skd_rig *rig, const struct skd_influences *influences, const char *source,
                   const struct skd_session_options *options, struct skd_session **session,
                   struct skd_error *error);

/* The pose that always exists, as the rig has it. Errors: what skd_poses_put says, SKD_NO_MEMORY.
 */
SKD_MUST_CHECK enum skd_status skd_session_add_rest_pose(struct skd_session *session,
                                                         struct skd_error *error);

#endif
