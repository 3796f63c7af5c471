/* Who listens to a session: the connections that are attached to it.
 *
 * Stage: rig session. Thread: the loop.
 */
#ifndef SKD_REQUESTS_LISTENERS_H
#define SKD_REQUESTS_LISTENERS_H

#include "requests/state.h"

/* Attaching twice is once. */
SKD_MUST_CHECK enum skd_status skd_listener_attach(struct skd_live *live, uint64_t connection_id,
                                                   struct skd_listener_of_session **listener,
                                                   struct skd_error *error);
/* False: it was not attached. */
bool skd_listener_detach(struct skd_live *live, uint64_t connection_id);
/* All of them, with their claims: the session ends. */
void skd_listeners_forget(struct skd_live *live);

/* NULL: not attached. */
struct skd_listener_of_session *skd_listener_find(const struct skd_live *live,
                                                  uint64_t connection_id);
/* A listener's connection, or NULL while that is going away. */
struct skd_connection *skd_listener_connection(const struct skd_daemon *daemon,
                                               const struct skd_listener_of_session *listener);
int skd_listener_count(const struct skd_live *live);

#endif
