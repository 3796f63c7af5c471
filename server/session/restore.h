/* A rig session put together again from what was kept of it: the base, then its steps one after the
 * other.
 *
 *     parts ──> session at its base ──> replay a step ──> replay the next ──> ... ──> settle
 *
 * Stage: journal -> rig session. Thread: a worker, before anybody else has the session. What comes
 * in may have been made by anybody: all that the session trusts is checked here, once.
 */
#ifndef SKD_SESSION_RESTORE_H
#define SKD_SESSION_RESTORE_H

#include "session/session.h"

/* The base. Everything is taken over, also on failure. */
struct skd_session_parts {
    struct skd_rig *rig;
    char *source;           /* the file's path, or "" */
    int slot_count;         /* 4 or 8 */
    uint16_t *joints;       /* [V][N] */
    float *weights;         /* [V][N] */
    float *rest;            /* [V][3] or NULL: the rig's */
    uint16_t *start_joints; /* [V][N] or NULL: `joints` */
    float *start_weights;   /* [V][N] */
};

/* The session at its base, without a name, poses and guard, at revision 0 and with an instance of
 * its own. Errors: SKD_DAMAGED (the parts make no session), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_session_restore(struct skd_session_parts *parts,
                                                   struct skd_session **session,
                                                   struct skd_error *error);

/* Rows of the base: `sheets` is the session's pins or shapes, rows [count][sheets->width].
 * Errors: SKD_DAMAGED, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_session_restore_rows(struct skd_session *session,
                                                        struct skd_sheets *sheets,
                                                        struct skd_pose *pose,
                                                        const uint32_t *vertices, const float *rows,
                                                        size_t count, struct skd_error *error);

/* Puts a change of a pose's rows at the end of a step's pins (or makes it its shape, where `sheets`
 * are the shapes); `before` is what the session has now, `after` [count][width] is the caller's to
 * fill. Errors: SKD_DAMAGED, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_session_restore_change(struct skd_session *session, struct skd_step *step,
                           struct skd_sheets *sheets, struct skd_pose *pose,
                           const uint32_t *vertices, size_t count, struct skd_sheet_change **change,
                           struct skd_error *error);

/* Does a step of which only the `after` side is known: fills in `before` from what the session has,
 * writes it and puts it on top of the history (a reference of its own), whatever that holds by
 * then. On failure the session is as it was. Errors: SKD_DAMAGED (the step fits no such session),
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_session_replay(struct skd_session *session,
                                                  struct skd_step *step, struct skd_error *error);

/* Ends replaying: of the steps that were kept, those beyond `count` go (undone first), those beyond
 * `position` are undone, and those before `first` can be undone no more. first <= position <= count
 * <= steps kept. */
void skd_session_settle(struct skd_session *session, size_t first, size_t position, size_t count);

#endif
