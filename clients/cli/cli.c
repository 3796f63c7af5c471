/* See cli.h. */
#include "clients/cli/cli.h"

#include "clients/cli/autostart.h"
#include "clients/cli/print.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { IDLE_EXIT_SECONDS = 1800 }; /* of a daemon that nobody asked for by name */

int skd_cli_usage(struct skd_error *error, const char *format, ...)
{
    char text[SKD_ERROR_TEXT_BYTES];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    (void)skd_fail(error, SKD_BAD_PARAMS, "%s", text);
    return SKD_EXIT_USAGE;
}

int skd_cli_exit(enum skd_status status)
{
    return status == SKD_OK ? SKD_EXIT_OK : SKD_EXIT_FAILED;
}

int skd_cli_conclude(struct skd_link *link, struct skd_message *answer, enum skd_status status,
                     void (*print)(const cJSON *result))
{
    if (status == SKD_OK && skd_cli.json)
        skd_print_json(answer, answer->result);
    else if (status == SKD_OK)
        print(answer->result);
    skd_message_finish(answer);
    skd_link_close(link);
    return skd_cli_exit(status);
}

enum skd_status skd_cli_address(char address[SKD_SOCKET_PATH_BYTES], struct skd_error *error)
{
    const char *chosen = skd_cli.socket != NULL ? skd_cli.socket : getenv("SKIND_SOCKET");
    if (chosen == NULL || !skd_address_is_port(chosen))
        return skd_socket_path(skd_cli.socket, address, error);
    (void)snprintf(address, SKD_SOCKET_PATH_BYTES, "%s", chosen);
    return SKD_OK;
}

enum skd_status skd_cli_connect(struct skd_link *link, struct skd_error *error)
{
    char address[SKD_SOCKET_PATH_BYTES];
    struct skd_start start = {
        .path = address, .tcp_port = SKD_NO_PORT, .idle_exit_s = IDLE_EXIT_SECONDS};
    enum skd_status status = skd_cli_address(address, error);
    if (status != SKD_OK)
        return status;
    if (skd_address_is_port(address))
        return skd_link_open(link, address, error) == SKD_LINK_UP ? SKD_OK : error->status;
    status = skd_autostart(link, &start, error);
    if (status == SKD_OK && start.started)
        skd_cli_say("started skind (pid %ld); it ends when nobody needed it for half an hour",
                    link->pid);
    return status;
}

enum skd_status skd_cli_reconnect(struct skd_link *link, struct skd_error *error)
{
    struct skd_link before = *link;
    skd_link_close(link);
    enum skd_status status = skd_cli_connect(link, error);
    if (status == SKD_OK) {
        link->notify = before.notify;
        link->user = before.user;
        link->last_id = before.last_id; /* so that no two requests have the same one */
    }
    return status;
}

/* The only open session's name, or an error that lists them. */
static int pick_session(const cJSON *sessions, char session[SKD_SESSION_NAME_BYTES_MAX + 1],
                        struct skd_error *error)
{
    char names[SKD_ERROR_TEXT_BYTES / 2] = "";
    const cJSON *item;
    int count = cJSON_GetArraySize(sessions);
    if (count == 0) {
        (void)skd_fail(error, SKD_NO_SESSION,
                       "no rig session is open (skinctl load FILE makes one)");
        return SKD_EXIT_FAILED;
    }
    cJSON_ArrayForEach(item, sessions)
    {
        size_t used = strlen(names);
        const char *name = skd_json_text(item, "session");
        (void)snprintf(session, SKD_SESSION_NAME_BYTES_MAX + 1, "%s", name);
        (void)snprintf(names + used, sizeof names - used, "%s%s", used > 0 ? ", " : "", name);
    }
    if (count == 1)
        return SKD_EXIT_OK;
    return skd_cli_usage(error, "%d rig sessions are open: %s (say which with --session)", count,
                         names);
}

int skd_cli_open(struct skd_link *link, char session[SKD_SESSION_NAME_BYTES_MAX + 1],
                 struct skd_error *error)
{
    struct skd_message answer;
    if (skd_cli.session != NULL && strlen(skd_cli.session) > SKD_SESSION_NAME_BYTES_MAX)
        return skd_cli_usage(error, "--session: a session's name has at most %d bytes",
                             SKD_SESSION_NAME_BYTES_MAX);
    if (skd_cli_connect(link, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    if (skd_cli.session != NULL) {
        strcpy(session, skd_cli.session);
        return SKD_EXIT_OK;
    }
    int result = skd_cli_exit(skd_link_call(link, "session.list", NULL, NULL, 0, &answer, error));
    if (result == SKD_EXIT_OK)
        result = pick_session(cJSON_GetObjectItemCaseSensitive(answer.result, "sessions"), session,
                              error);
    skd_message_finish(&answer);
    if (result != SKD_EXIT_OK)
        skd_link_close(link);
    return result;
}
