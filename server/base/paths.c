/* See paths.h. */
#include "base/paths.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum skd_status skd_socket_path(const char *chosen, char path[SKD_SOCKET_PATH_BYTES],
                                struct skd_error *error)
{
    const char *runtime = getenv("XDG_RUNTIME_DIR");
    if (chosen == NULL)
        chosen = getenv("SKIND_SOCKET");
    int length;
    if (chosen != NULL && chosen[0] != '\0')
        length = snprintf(path, SKD_SOCKET_PATH_BYTES, "%s", chosen);
    else if (runtime != NULL && runtime[0] == '/')
        length = snprintf(path, SKD_SOCKET_PATH_BYTES, "%s/skind/skind.sock", runtime);
    else
        length = snprintf(path, SKD_SOCKET_PATH_BYTES, "/tmp/skind-%ld/skind.sock", (long)getuid());
    if (length < 0 || length >= SKD_SOCKET_PATH_BYTES)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "the socket path is %d bytes long and a Unix socket takes %d; set "
                        "SKIND_SOCKET to a shorter one",
                        length, SKD_SOCKET_PATH_BYTES - 1);
    if (path[0] != '/')
        return skd_fail(error, SKD_BAD_PARAMS,
                        "the socket path \"%s\" is not absolute; begin it with /", path);
    return SKD_OK;
}
