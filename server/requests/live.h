/* Open sessions: the table of names, and the turns on each.
 *
 * Stage: rig session. Thread: the loop.
 * One call at a time has a session's weights; the others wait in the order they came.
 */
#ifndef SKD_REQUESTS_LIVE_H
#define SKD_REQUESTS_LIVE_H

#include "requests/state.h"

/* Reserves a name for a session that is about to be loaded. Errors: SKD_NAME_TAKEN, SKD_TOO_LARGE
 * (SKD_SESSIONS_MAX), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_live_reserve(struct skd_daemon *daemon, const char *name,
                                                struct skd_live **live, struct skd_error *error);

/* An open session, or NULL with SKD_NO_SESSION or, while it is being loaded, SKD_BUSY. */
struct skd_live *skd_live_find(struct skd_daemon *daemon, const char *name,
                               struct skd_error *error);

/* The two halves of a session's end (requests/close.h is the whole): out of the table, so that
 * nothing new finds it; then its listeners are forgotten and its memory goes, now or when the call
 * that has the turn has ended. */
void skd_live_retire(struct skd_daemon *daemon, struct skd_live *live);
void skd_live_dismiss(struct skd_live *live);

/* Keeps a session's memory, also after it was closed: for what goes on after the turn. */
void skd_live_hold(struct skd_live *live);
void skd_live_release(struct skd_live *live);

/* Turns. */
void skd_live_queue(struct skd_live *live, struct skd_call *call);
void skd_live_unqueue(struct skd_live *live, struct skd_call *call);
void skd_live_pass_turn(struct skd_live *live);
/* After a client has read what was written to it, or is gone: its calls may have waited for that.
 */
void skd_live_resume(struct skd_daemon *daemon);

#endif
