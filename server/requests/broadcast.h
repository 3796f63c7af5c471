/* A notification to every tool that said hello.
 *
 * Stage: reply. Thread: the loop.
 */
#ifndef SKD_REQUESTS_BROADCAST_H
#define SKD_REQUESTS_BROADCAST_H

#include "requests/state.h"

/* `body` (may be NULL: no memory) is taken over. */
void skd_broadcast(struct skd_daemon *daemon, const char *method, cJSON *body);

#endif
