/* Who is attached to a session, and how the others hear of it.
 *
 * Stage: reply. Thread: the loop. Many may come at once: what changes is gathered for a moment and
 * told once, and to nobody whose connection has something else to write (updates go first).
 */
#ifndef SKD_REQUESTS_PRESENCE_H
#define SKD_REQUESTS_PRESENCE_H

#include "requests/state.h"

/* [{connection, client, user, version, since, claim}], who came first being first. */
cJSON *skd_presence_describe(const struct skd_daemon *daemon, const struct skd_live *live);

/* Somebody came, went or claimed: the others hear of it soon. */
void skd_presence_changed(struct skd_daemon *daemon, struct skd_live *live);

/* Tells a listener whose connection is idle what it does not know yet: who is there, then what
 * others claim; one message. */
void skd_presence_tell(struct skd_daemon *daemon, struct skd_live *live,
                       struct skd_listener_of_session *listener);

/* A connection is gone from all sessions. */
void skd_presence_leave(struct skd_daemon *daemon, const struct skd_connection *connection);

#endif
