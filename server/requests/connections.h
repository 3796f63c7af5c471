/* Connections by their number.
 *
 * Stage: all from the request to the reply. Thread: the loop.
 */
#ifndef SKD_REQUESTS_CONNECTIONS_H
#define SKD_REQUESTS_CONNECTIONS_H

#include "requests/state.h"

/* NULL: it is gone. */
struct skd_connection *skd_connection_find(const struct skd_daemon *daemon, uint64_t id);

#endif
