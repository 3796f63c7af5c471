/* Undo and redo of a tool's own steps, past those of others that have nothing to do with them.
 *
 *     done:  [A] [B] [C] |        undo of B's tool:  [A] [C] | [B]
 *
 * Steps that touch different vertices can be done in any order, to the bit; so the own step is
 * taken to the history's boundary (skd_history_move), if no step on the way touches what it
 * touches.
 *
 * Stage: job. Thread: a worker, in the session's turn.
 */
#ifndef SKD_SESSION_OWN_STEPS_H
#define SKD_SESSION_OWN_STEPS_H

#include "session/session.h"

/* The step of the history that undo (direction -1) or redo (+1) of a client is about: the newest
 * done one, or the first undone one, that is its own; client_id NULL: anybody's. Errors:
 * SKD_NOTHING_TO_UNDO, SKD_NOTHING_TO_REDO, SKD_CONFLICT (a step on the way touches its vertices;
 * the sentence names whose), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_own_step_find(const struct skd_session *session, int direction,
                                                 const char *client_id, size_t *index,
                                                 struct skd_error *error);

#endif
