/* The end of an open session.
 *
 * Stage: rig session. Thread: the loop.
 */
#ifndef SKD_REQUESTS_CLOSE_H
#define SKD_REQUESTS_CLOSE_H

#include "requests/state.h"

/* Tells the session's listeners why, cancels the calls on it, takes it out of the table, and lets
 * its file become what `end` says. Its memory goes when the last call on it has ended. */
void skd_session_close(struct skd_daemon *daemon, struct skd_live *live, enum skd_keeping_end end,
                       const char *reason);

#endif
