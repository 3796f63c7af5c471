/* A session in words, for answers. Thread: the loop, or the worker that has just made the session.
 */
#ifndef SKD_REQUESTS_DESCRIBE_H
#define SKD_REQUESTS_DESCRIBE_H

#include "requests/state.h"

/* A row of session.list; all of session.info. Owned by the caller; NULL: no memory. The revision is
 * the last that others may know of. */
cJSON *skd_describe_briefly(const struct skd_live *live);
cJSON *skd_describe_wholly(const struct skd_daemon *daemon, const struct skd_live *live);

/* Adds what lies in the state folder beside the open sessions: `closed` and `damaged`. */
void skd_describe_folder(const struct skd_keeping *keeping, cJSON *object);

/* The answer to session.create. */
cJSON *skd_describe_created(const struct skd_session *session);

#endif
