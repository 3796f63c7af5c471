/* Claims, as others hear of them and as strokes run into them.
 *
 * Stage: reply. Thread: the loop, except where a function says so.
 */
#ifndef SKD_REQUESTS_CLAIMS_H
#define SKD_REQUESTS_CLAIMS_H

#include "requests/call.h"

/* Tells an idle listener one claim of another that it does not know yet. False: it knows all. */
bool skd_claims_tell(struct skd_daemon *daemon, const struct skd_live *live,
                     struct skd_listener_of_session *listener);

/* Whose claims a stroke may run into: those of other tools, as of the beginning of its turn. NULL:
 * nobody else claims anything, or there was no memory to look. Loop thread. */
struct skd_claims_seen;
struct skd_claims_seen *skd_claims_look(const struct skd_call *call);
void skd_claims_forget(struct skd_claims_seen *seen); /* NULL is fine */

/* Adds {name: "claimed", count, text} to a stroke's warnings where any vertex of the step is
 * claimed by itself, or by a bone that weighed most there before the step. A worker, before the
 * step is written. */
void skd_claims_warn(const struct skd_claims_seen *seen, const struct skd_session *session,
                     const struct skd_step *step, cJSON *warnings);

#endif
