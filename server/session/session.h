/* A rig session: a rig and the live weights that strokes change.
 *
 * Stage: rig session. Thread: made by a worker, then owned by the loop, which lends the weights to
 * one job at a time (requests/turn.h); nobody else reads or writes them meanwhile.
 * Knows nothing of sockets, requests or threads.
 */
#ifndef SKD_SESSION_SESSION_H
#define SKD_SESSION_SESSION_H

#include "protocol/limits.h"
#include "rig/rig.h"
#include "session/history.h"
#include "session/poses.h"
#include "solver/slots.h"

/* How far the vertices moved whose influences were cut, over poses that were tried. */
struct skd_reduction {
    int pose_count;
    double mean; /* scene units, over the reduced vertices and the poses */
    double max;
};

struct skd_session {
    char name[SKD_SESSION_NAME_BYTES_MAX + 1];
    char *source; /* the file's path, or "" for arrays */
    struct skd_rig *rig;
    int slot_count;    /* N: 4 or 8 */
    uint16_t *joints;  /* [V][N] */
    float *weights;    /* [V][N] */
    float *anchor;     /* [V][N] the weights at revision 0 */
    uint64_t revision; /* one more for each commit, undo and redo */
    uint64_t exported; /* the revision last written to a file */
    struct skd_slots_report slots;
    struct skd_reduction reduction;
    struct skd_poses poses;
    struct skd_history history;
};

struct skd_session_options {
    int slot_count;
    enum skd_fill fill;
    bool may_reduce; /* cut influences beyond the slots instead of refusing */
};

/* Makes a session from a rig and its influences: chooses slots, sets the anchor, adds the pose
 * "rest". Takes the rig over, also on failure. Errors: SKD_TOO_MANY_INFLUENCES, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_session_create(struct skd_rig *rig, const struct skd_influences *influences, const char *source,
                   const struct skd_session_options *options, struct skd_session **session,
                   struct skd_error *error);
void skd_session_destroy(struct skd_session *session); /* NULL is fine */

/* Writes a step's weights (its `after`, or its `before` when undoing) into the session. */
void skd_session_write(struct skd_session *session, const struct skd_step *step, bool undo);

/* Resident bytes of the session: rig, weights, poses and history. */
size_t skd_session_bytes(const struct skd_session *session);

/* The pose of that name, borrowed, or NULL with SKD_NO_POSE. */
struct skd_pose *skd_session_find_pose(const struct skd_session *session, const char *name,
                                       struct skd_error *error);

/* Checks a client's list of vertices against the rig: SKD_BAD_INDEX names the first bad one,
 * SKD_TOO_LARGE says that there are more than any rig has. */
SKD_MUST_CHECK enum skd_status skd_session_check_vertices(const struct skd_session *session,
                                                          const uint32_t *vertices, size_t count,
                                                          struct skd_error *error);

/* The same for a list that is to change each of its vertices: SKD_BAD_INDEX also where one is named
 * twice. Errors: SKD_NO_MEMORY too. */
SKD_MUST_CHECK enum skd_status skd_session_check_distinct(const struct skd_session *session,
                                                          const uint32_t *vertices, size_t count,
                                                          struct skd_error *error);

#endif
