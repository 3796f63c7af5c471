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
#include "session/durability.h"
#include "session/guards.h"
#include "session/history.h"
#include "session/poses.h"
#include "session/remembered.h"
#include "session/sheet.h"
#include "solver/slots.h"

/* How far the vertices moved whose influences were cut, over poses that were tried. */
struct skd_reduction {
    int pose_count;
    double mean; /* scene units, over the reduced vertices and the poses */
    double max;
};

enum { SKD_INSTANCE_BYTES = 16 }; /* hexadecimal digits */

struct skd_session {
    char name[SKD_SESSION_NAME_BYTES_MAX + 1];
    /* Names this line of revisions: a fork, or a session that lost its newest steps, has another. */
    char instance[SKD_INSTANCE_BYTES + 1];
    enum skd_durability durability;
    char damage[SKD_ERROR_TEXT_BYTES]; /* what its file had lost when it was read; "": nothing */
    char *source; /* the file's path, or "" for arrays */
    struct skd_rig *rig;
    int slot_count;   /* N: 4 or 8 */
    uint16_t *joints; /* [V][N] */
    float *weights;   /* [V][N] */
    float *anchor;    /* [V][N] the weights at revision 0, laid out by `joints` */
    float *rest;      /* [V][3] the rig's own, or a copy since a step moved it */
    /* What vertices had at revision 0; NULL while `joints` and `anchor` still tell. */
    uint16_t *start_joints;   /* [V][N] */
    float *start_weights;     /* [V][N] */
    uint8_t *hops;            /* [B][B], once a stroke has chosen slots */
    struct skd_guards guards; /* poses to keep */
    struct skd_sheets pins;
    struct skd_sheets shapes;
    size_t grown_bytes; /* of what grows, as of the last skd_session_account */
    uint64_t revision;  /* one more for each commit, undo and redo */
    uint64_t exported;  /* the revision last written to a file */
    struct skd_slots_report slots;
    struct skd_reduction reduction;
    struct skd_poses poses;
    struct skd_history history;
    struct skd_remembered remembered;
};

void skd_session_destroy(struct skd_session *session); /* NULL is fine */

/* A new instance, at random. */
void skd_session_new_instance(char instance[SKD_INSTANCE_BYTES + 1]);

/* Before a step that changes slots or rest positions: keeps what was at the start, so that writing
 * cannot fail. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_session_keep_start(struct skd_session *session,
                                                      struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_session_own_rest(struct skd_session *session,
                                                    struct skd_error *error);

/* The pins or shapes (`sheets`) of a pose, made where there are none; sheets that neither a row nor
 * the history needs any more are let go of when more room is wanted. Loop thread, when a call's
 * turn begins. Errors: as skd_sheets_need. */
SKD_MUST_CHECK enum skd_status
skd_session_need_sheet(struct skd_session *session, struct skd_sheets *sheets,
                       struct skd_pose *pose, struct skd_sheet **sheet, struct skd_error *error);

/* [V][N] what vertices had at revision 0. */
const uint16_t *skd_session_start_joints(const struct skd_session *session);
const float *skd_session_start_weights(const struct skd_session *session);

/* The start's weights of a vertex laid out by other joints: 0 for a bone that it did not have. */
void skd_session_anchor_row(const struct skd_session *session, size_t vertex,
                            const uint16_t *joints, float *anchor);

/* Vertices whose rest position is not the rig's. */
size_t skd_session_count_moved(const struct skd_session *session);

/* Where vertices are shown in a pose, its corrective shape included: out [count][3]. `vertices`
 * NULL: the first `count`. */
void skd_session_show(const struct skd_session *session, const struct skd_pose *pose, size_t count,
                      const uint32_t *vertices, float *out);

/* Writes what a step changes (its `after`, or its `before` when undoing) into the session. */
void skd_session_write(struct skd_session *session, const struct skd_step *step, bool undo);

/* Looks anew at what the session's growing parts take: rest, start, sheets, guard. Loop thread,
 * within a call's turn. */
void skd_session_account(struct skd_session *session);

/* A change was committed: one revision more. Loop thread, within the call's turn. */
void skd_session_advance(struct skd_session *session);

/* Resident bytes of the session: rig, weights, poses and history. Loop thread, at any time: what a
 * worker may be adding to counts as it was when it was last looked at. */
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
