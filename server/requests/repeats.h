/* Requests that come a second time.
 *
 * Stage: request -> reply, commit. Thread: the loop.
 */
#ifndef SKD_REQUESTS_REPEATS_H
#define SKD_REQUESTS_REPEATS_H

#include "requests/call.h"

/* When a call's turn begins: answers it where its sequence was done before, or is too old to know,
 * and returns true; the call is gone then. */
bool skd_repeat_answered(struct skd_call *call);

/* When its step is committed: remembers call->answer for a second time. Without memory it is not
 * remembered, and coming again it would be done again. */
void skd_repeats_remember(struct skd_call *call);

#endif
