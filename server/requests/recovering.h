/* The sessions that were open when the daemon ended, however it ended.
 *
 * Stage: journal -> rig session. Thread: the loop, before it serves; workers read the files.
 */
#ifndef SKD_REQUESTS_RECOVERING_H
#define SKD_REQUESTS_RECOVERING_H

#include "requests/state.h"

/* Opens the session of every file in the state folder. What cannot be read stays or is set aside,
 * and is said in the log: it never stops the start. */
void skd_recover_sessions(struct skd_daemon *daemon);

#endif
