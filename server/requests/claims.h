/* Claims: what a tool says that it works on, so that two artists see each other before they
 * collide. A claim tells others and stops nobody.
 *
 * Stage: request -> reply; a claim is made and looked at by workers, kept by the loop. It belongs
 * to a connection in a session and goes with it; it never changes once it is made.
 */
#ifndef SKD_REQUESTS_CLAIMS_H
#define SKD_REQUESTS_CLAIMS_H

#include "requests/call.h"

/* What all claims of a session may take together. */
#define SKD_CLAIM_BYTES_MAX ((size_t)64 << 20)

/* {bones, vertices} of a listener's claim, or of none. */
cJSON *skd_claim_describe(const struct skd_live *live,
                          const struct skd_listener_of_session *listener);

/* Takes a listener's claim away. */
void skd_claim_drop(struct skd_live *live, struct skd_listener_of_session *listener);

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
