/* See paths.h. */
#include "base/paths.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The socket of a user who chose none. Returns snprintf's result. */
static int write_default(char path[SKD_SOCKET_PATH_BYTES])
{
    const char *runtime = getenv("XDG_RUNTIME_DIR");
    if (runtime != NULL && runtime[0] == '/')
        return snprintf(path, SKD_SOCKET_PATH_BYTES, "%s/skind/skind.sock", runtime);
    return snprintf(path, SKD_SOCKET_PATH_BYTES, "/tmp/skind-%ld/skind.sock", (long)getuid());
}

enum skd_status skd_socket_path(const char *chosen, char path[SKD_SOCKET_PATH_BYTES],
                                struct skd_error *error)
{
    if (chosen == NULL)
        chosen = getenv("SKIND_SOCKET");
    int length;
    if (chosen != NULL && chosen[0] != '\0')
        length = snprintf(path, SKD_SOCKET_PATH_BYTES, "%s", chosen);
    else
        length = write_default(path);
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

/* The folder's name: a daemon on a socket of its own has sessions of its own. */
static void name_folder(const char *socket_path, char name[SKD_SOCKET_PATH_BYTES])
{
    char usual[SKD_SOCKET_PATH_BYTES];
    (void)write_default(usual);
    bool is_usual = strcmp(socket_path, usual) == 0;
    (void)snprintf(name, SKD_SOCKET_PATH_BYTES, "%s", is_usual ? "default" : socket_path + 1);
    for (char *slash = strchr(name, '/'); slash != NULL; slash = strchr(slash, '/'))
        *slash = '%';
}

enum skd_status skd_state_folder(const char *socket_path, const char *chosen,
                                 char folder[SKD_STATE_PATH_BYTES], struct skd_error *error)
{
    const char *state = getenv("XDG_STATE_HOME"), *home = getenv("HOME");
    char name[SKD_SOCKET_PATH_BYTES];
    int length;
    if (chosen == NULL)
        chosen = getenv("SKIND_STATE");
    name_folder(socket_path, name);
    if (chosen != NULL && chosen[0] != '\0')
        length = snprintf(folder, SKD_STATE_PATH_BYTES, "%s", chosen);
    else if (state != NULL && state[0] == '/')
        length = snprintf(folder, SKD_STATE_PATH_BYTES, "%s/skind/%s", state, name);
    else if (home != NULL && home[0] == '/')
        length = snprintf(folder, SKD_STATE_PATH_BYTES, "%s/.local/state/skind/%s", home, name);
    else
        return skd_fail(error, SKD_BAD_PARAMS,
                        "there is no home folder to keep sessions in; choose one with --state");
    /* What lies in it has names of up to 256 bytes. */
    if (length < 0 || length > SKD_STATE_PATH_BYTES - 300)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "the state folder's path is too long; choose a shorter one with --state");
    if (folder[0] != '/')
        return skd_fail(error, SKD_BAD_PARAMS,
                        "the state folder \"%s\" is not absolute; begin it with /", folder);
    return SKD_OK;
}
