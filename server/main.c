/* skind: reads its options and runs the daemon in the foreground.
 *
 * Started by itself as skind-import it reads one file and ends (import/child.h).
 *
 * Exit status: 0 after a clean stop, 1 when it cannot serve, 2 for wrong options, 3 when another
 * skind serves the same socket.
 */
#include "base/log.h"
#include "daemon.h"
#include "import/child.h"

#include <popt.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WORKERS_MAX = 256 };

static const char examples[] =
    "\nExamples:\n"
    "  skind                             serve on the user's own socket until told to stop\n"
    "  skind --idle-exit 1800            ... or until nobody needed it for half an hour\n"
    "  skind --socket /run/user/1000/skind/test.sock --workers 1 --log debug\n"
    "\nskinctl start runs it in the background.\n";

static int parse_level(const char *word, enum skd_log_level *level)
{
    static const char *const words[] = {"error", "warning", "info", "debug"};
    for (int i = 0; i < 4; i++) {
        if (strcmp(word, words[i]) == 0) {
            *level = (enum skd_log_level)i;
            return 0;
        }
    }
    fprintf(stderr, "skind: --log takes error, warning, info or debug, not \"%s\"\n", word);
    return -1;
}

enum {
    STALL_TIMEOUT_S = 30,
    STALL_TIMEOUT_MAX_S = 3600,
    NO_PORT = -1,
    PORT_MAX = 65535,
    WAS_SOCKET = 1, /* popt's value of an option that was there */
    WAS_STATE,
};

/* The numbers as they were given. */
struct numbers {
    int workers, idle_exit, stall_timeout, tcp_port, memory, session_memory;
};

static bool check_numbers(const struct numbers *numbers)
{
    const char *wrong = NULL;
    if (numbers->workers < 0 || numbers->workers > WORKERS_MAX)
        wrong = "--workers takes 1 to 256";
    else if (numbers->idle_exit < 0)
        wrong = "--idle-exit takes whole seconds";
    else if (numbers->stall_timeout < 1 || numbers->stall_timeout > STALL_TIMEOUT_MAX_S)
        wrong = "--stall-timeout takes 1 to 3600 seconds";
    else if (numbers->tcp_port < NO_PORT || numbers->tcp_port > PORT_MAX)
        wrong = "--tcp takes a port, or 0 for any that is free";
    else if (numbers->memory < 0 || numbers->session_memory < 0)
        wrong = "--memory and --session-memory take whole MiB";
    if (wrong != NULL)
        fprintf(stderr, "skind: %s\n", wrong);
    return wrong == NULL;
}

/* Reads on to the end of the options. False: one is wrong, and that was said. A path that was given
 * and for which popt found no memory must not become the default one. */
static bool read_all(poptContext context, char *const *socket_path, char *const *state_folder)
{
    int result = 1;
    bool all = context != NULL; /* without one there seem to be no options */
    while (all && (result = poptGetNextOpt(context)) > 0)
        all = (result == WAS_SOCKET ? *socket_path : *state_folder) != NULL;
    if (!all) {
        fputs("skind: no memory for the options\n", stderr);
        exit(1);
    }
    if (result < -1)
        fprintf(stderr, "skind: %s: %s\n", poptBadOption(context, 0), poptStrerror(result));
    else if (poptPeekArg(context) != NULL)
        fprintf(stderr, "skind: what is \"%s\"? see skind --help\n", poptPeekArg(context));
    return result == -1 && poptPeekArg(context) == NULL;
}

/* Returns -1 to go on, else the exit status. */
static int read_options(int argc, const char **argv, struct skd_daemon_options *options)
{
    char *socket_path = NULL, *state_folder = NULL, *level_word = NULL;
    struct numbers numbers = {.stall_timeout = STALL_TIMEOUT_S, .tcp_port = NO_PORT};
    int help = 0, version = 0;
    enum skd_log_level level = SKD_LOG_INFO;
    const struct poptOption table[] = {
        {"socket", 's', POPT_ARG_STRING, &socket_path, WAS_SOCKET, "listen here", "PATH"},
        {"tcp", 0, POPT_ARG_INT, &numbers.tcp_port, 0,
         "listen on a port of 127.0.0.1 as well (0: any); clients show the token in PATH.token",
         "PORT"},
        {"state", 0, POPT_ARG_STRING, &state_folder, WAS_STATE,
         "keep the sessions here (default: a folder of ~/.local/state/skind)", "DIR"},
        {"workers", 'w', POPT_ARG_INT, &numbers.workers, 0,
         "threads that solve (default: one a core)", "N"},
        {"idle-exit", 'i', POPT_ARG_INT, &numbers.idle_exit, 0,
         "stop after this long without clients (default: never)", "SECONDS"},
        {"stall-timeout", 0, POPT_ARG_INT, &numbers.stall_timeout, 0,
         "drop a client that reads nothing for so long (default: 30)", "SECONDS"},
        {"memory", 0, POPT_ARG_INT, &numbers.memory, 0,
         "memory of all sessions (default: three quarters of the machine's)", "MIB"},
        {"session-memory", 0, POPT_ARG_INT, &numbers.session_memory, 0,
         "memory of one session (default: half of the machine's)", "MIB"},
        {"log", 'l', POPT_ARG_STRING, &level_word, 0, "error, warning, info (default) or debug",
         "LEVEL"},
        {"version", 'V', POPT_ARG_NONE, &version, 0, "print the version", NULL},
        {"help", 'h', POPT_ARG_NONE, &help, 0, "print this help", NULL},
        POPT_TABLEEND};
    poptContext context = poptGetContext("skind", argc, argv, table, 0);
    const bool right = read_all(context, &socket_path, &state_folder) && check_numbers(&numbers) &&
                       (level_word == NULL || parse_level(level_word, &level) == 0);
    if (right && help) {
        poptPrintHelp(context, stdout, 0);
        fputs(examples, stdout);
    } else if (right && version) {
        puts("skind " SKIND_VERSION);
    }
    poptFreeContext(context);
    free(level_word);
    skd_log_set_level(level);
    *options = (struct skd_daemon_options){
        .socket_path = socket_path,
        .state_folder = state_folder,
        .worker_count = numbers.workers,
        .idle_exit_s = (unsigned)numbers.idle_exit,
        .stall_timeout_s = (unsigned)numbers.stall_timeout,
        .memory_mib = (size_t)numbers.memory,
        .session_memory_mib = (size_t)numbers.session_memory,
        .tcp_port = numbers.tcp_port,
    };
    return !right ? 2 : help || version ? 0 : -1;
}

int main(int argc, const char **argv)
{
    struct skd_daemon_options options;
    struct skd_error error;
    if (skd_import_is_child(argc, argv))
        skd_import_child(argc, argv);
    int result = read_options(argc, argv, &options);
    if (result >= 0)
        return result;
    enum skd_status status = skd_daemon_run(&options, &error);
    free((char *)options.socket_path);
    free((char *)options.state_folder);
    if (status == SKD_OK)
        return 0;
    skd_log(SKD_LOG_ERROR, "%s", error.text);
    return status == SKD_BUSY ? 3 : 1;
}
