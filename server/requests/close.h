/* The end of an open session.
 *
 * Stage: rig session. Thread: the loop.
 */
#ifndef SKD_REQUESTS_CLOSE_H
#define SKD_REQUESTS_CLOSE_H

#include "requests/state.h"

/* Tells the session's listeners why, cancels the calls on it and takes it out of the table. Its
 * memory goes when the call that has the turn has ended. */
void skd_session_close(struct skd_daemon *daemon, struct skd_live *live, const char *reason);

#endif
