/* Requests that come a second time.
 *
 * Stage: request -> reply, commit. Thread: the loop.
 */
#ifndef SKD_REQUESTS_REPEATS_H
#define SKD_REQUESTS_REPEATS_H

#include "requests/call.h"

/* When a call's turn begins: answers it where its sequence was done before, is too old to know, or
 * where there is no memory to remember what it would be answered; then it returns true, and the
 * call is gone. */
bool skd_repeat_answered(struct skd_call *call);

/* When its step is committed: call->answer is taken over, for when it comes again. Cannot fail. */
void skd_repeats_remember(struct skd_call *call);

#endif
