/* See connections.h. */
#include "requests/connections.h"

struct skd_connection *skd_connection_find(const struct skd_daemon *daemon, uint64_t id)
{
    struct skd_connection *connection;
    HASH_FIND(hh, daemon->connections, &id, sizeof id, connection);
    return connection;
}
