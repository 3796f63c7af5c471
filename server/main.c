/* skind: reads its options and runs the daemon in the foreground.
 *
 * Exit status: 0 after a clean stop, 1 when it cannot serve, 2 for wrong options, 3 when another
 * skind serves the same socket.
 */
#include "base/log.h"
#include "daemon.h"

#include <popt.h>
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

/* Returns -1 to go on, else the exit status. */
static int read_options(int argc, const char **argv, struct skd_daemon_options *options)
{
    char *socket_path = NULL, *level_word = NULL;
    int workers = 0, idle_exit = 0, help = 0, version = 0;
    enum skd_log_level level = SKD_LOG_INFO;
    const struct poptOption table[] = {
        {"socket", 's', POPT_ARG_STRING, &socket_path, 0, "listen here", "PATH"},
        {"workers", 'w', POPT_ARG_INT, &workers, 0, "threads that solve (default: one a core)",
         "N"},
        {"idle-exit", 'i', POPT_ARG_INT, &idle_exit, 0,
         "stop after this long without clients and unexported work (default: never)", "SECONDS"},
        {"log", 'l', POPT_ARG_STRING, &level_word, 0, "error, warning, info (default) or debug",
         "LEVEL"},
        {"version", 'V', POPT_ARG_NONE, &version, 0, "print the version", NULL},
        {"help", 'h', POPT_ARG_NONE, &help, 0, "print this help", NULL},
        POPT_TABLEEND};
    poptContext context = poptGetContext("skind", argc, argv, table, 0);
    int result = poptGetNextOpt(context);
    if (result < -1)
        fprintf(stderr, "skind: %s: %s\n", poptBadOption(context, 0), poptStrerror(result));
    else if (poptPeekArg(context) != NULL)
        fprintf(stderr, "skind: what is \"%s\"? see skind --help\n", poptPeekArg(context));
    else if (workers < 0 || workers > WORKERS_MAX || idle_exit < 0)
        fprintf(stderr, "skind: --workers takes 1 to %d, --idle-exit whole seconds\n", WORKERS_MAX);
    else if (level_word == NULL || parse_level(level_word, &level) == 0)
        result = 0;
    if (result == 0 && help) {
        poptPrintHelp(context, stdout, 0);
        fputs(examples, stdout);
    } else if (result == 0 && version) {
        puts("skind " SKIND_VERSION);
    }
    poptFreeContext(context);
    free(level_word);
    skd_log_set_level(level);
    *options = (struct skd_daemon_options){socket_path, workers, (unsigned)idle_exit};
    return result != 0 ? 2 : help || version ? 0 : -1;
}

int main(int argc, const char **argv)
{
    struct skd_daemon_options options;
    struct skd_error error;
    int result = read_options(argc, argv, &options);
    if (result >= 0)
        return result;
    enum skd_status status = skd_daemon_run(&options, &error);
    free((char *)options.socket_path);
    if (status == SKD_OK)
        return 0;
    skd_log(SKD_LOG_ERROR, "%s", error.text);
    return status == SKD_BUSY ? 3 : 1;
}
