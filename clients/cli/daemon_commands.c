/* skinctl start, stop, status, list.
 *
 * Thread: one. start may start the daemon; stop and status never do.
 */
#include "clients/cli/autostart.h"
#include "clients/cli/cli.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/pidfd.h>
#include <unistd.h>

enum { WORKERS_MAX = 256, PORT_MAX = 65535, STOP_MS = 30000 };

static struct {
    int workers;
    int idle_exit;
    int tcp_port;
    char *state;
    int all;
} options = {.tcp_port = SKD_NO_PORT};

static const struct poptOption start_options[] = {
    {"workers", 'w', POPT_ARG_INT, &options.workers, 0, "threads that solve (default: one a core)",
     "N"},
    {"idle-exit", 'i', POPT_ARG_INT, &options.idle_exit, 0,
     "end it after this long without clients and unexported work (default: never)", "SECONDS"},
    {"state", 0, POPT_ARG_STRING, &options.state, 0,
     "keep the sessions here (default: $SKIND_STATE, else a folder of ~/.local/state/skind)",
     "DIR"},
    {"tcp", 0, POPT_ARG_INT, &options.tcp_port, 0,
     "listen on this port of 127.0.0.1 as well (0: any)", "PORT"},
    POPT_TABLEEND,
};

static void report_started(const struct skd_link *link, const struct skd_start *start, int port)
{
    if (skd_cli.json) {
        cJSON *json = cJSON_CreateObject();
        cJSON_AddBoolToObject(json, "started", start->started);
        cJSON_AddNumberToObject(json, "pid", (double)link->pid);
        cJSON_AddStringToObject(json, "version", link->version);
        cJSON_AddStringToObject(json, "socket", start->path);
        if (port != SKD_NO_PORT)
            cJSON_AddNumberToObject(json, "port", port);
        skd_print_own_json(json);
        return;
    }
    skd_cli_say(start->started ? "started skind %s (pid %ld) on %s"
                               : "skind %s (pid %ld) runs already on %s",
                link->version, link->pid, start->path);
    if (port != SKD_NO_PORT)
        skd_cli_say("and on tcp:%d, for who has the token in %s.token", port, start->path);
}

/* What is wrong with the options and the address, or SKD_EXIT_OK. */
static int check_start(const char *address, struct skd_error *error)
{
    if (options.workers < 0 || options.workers > WORKERS_MAX || options.idle_exit < 0)
        return skd_cli_usage(error, "--workers takes 1 to %d, --idle-exit whole seconds",
                             WORKERS_MAX);
    if (options.tcp_port < SKD_NO_PORT || options.tcp_port > PORT_MAX)
        return skd_cli_usage(error, "--tcp takes a port, or 0 for any that is free");
    if (skd_address_is_port(address))
        return skd_cli_usage(error, "skind is started on a socket, not on %s; --tcp opens a port",
                             address);
    return SKD_EXIT_OK;
}

static int run_start(const char *const *arguments, int count, struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES], state[SKD_PATH_BYTES_MAX], token[SKD_TOKEN_DIGITS + 1];
    struct skd_link link;
    struct skd_start start = {.path = path,
                              .tcp_port = options.tcp_port,
                              .workers = options.workers,
                              .idle_exit_s = options.idle_exit};
    int port = SKD_NO_PORT;
    (void)arguments;
    (void)count;
    if (skd_cli_address(path, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    int result = check_start(path, error);
    if (result != SKD_EXIT_OK)
        return result;
    enum skd_status status = SKD_OK;
    if (options.state != NULL) {
        status = skd_path_absolute(options.state, state, error);
        start.state = state;
    }
    if (status == SKD_OK)
        status = skd_autostart(&link, &start, error);
    if (status != SKD_OK)
        return SKD_EXIT_FAILED;
    if (options.tcp_port != SKD_NO_PORT)
        status = skd_token_read(path, token, &port, error);
    if (status == SKD_NO_FILE && !start.started)
        (void)skd_fail(error, status, "skind (pid %ld) runs already, without a port; stop it first",
                       link.pid);
    if (status == SKD_OK)
        report_started(&link, &start, port);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_start = {
    .group = SKD_GROUP_DAEMON,
    .name = "start",
    .arguments = "",
    .summary = "start the daemon, unless it runs already",
    .options = start_options,
    .details = "Other commands start it by themselves, to end after half an hour without use.\n"
               "The program is $SKIND_BIN, else the skind beside skinctl, else the one on PATH;\n"
               "its log is skind.log in the socket's folder.\n"
               "A client of a port is told --socket tcp:PORT, or SKIND_SOCKET=tcp:PORT, and shows\n"
               "the token: $SKIND_TOKEN, else that in the file beside the user's own socket.\n",
    .examples = "  skinctl start\n"
                "  skinctl start --workers 2 --idle-exit 600\n"
                "  skinctl start --tcp 7531 && skinctl --socket tcp:7531 status\n",
    .run = run_start,
};

/* Connects to a daemon that runs; nobody there is no error yet. */
static enum skd_link_state find_running(struct skd_link *link, char path[SKD_SOCKET_PATH_BYTES],
                                        struct skd_error *error)
{
    if (skd_cli_address(path, error) != SKD_OK)
        return SKD_LINK_FAILED;
    return skd_link_open(link, path, error);
}

/* Waits for the process to end, which is after the socket is gone. */
static bool wait_for_end(int process)
{
    struct pollfd wait = {.fd = process, .events = POLLIN};
    int result;
    do
        result = poll(&wait, 1, STOP_MS);
    while (result < 0 && errno == EINTR);
    return result > 0;
}

static int run_stop(const char *const *arguments, int count, struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES];
    struct skd_link link;
    struct skd_message answer;
    bool stopped = false;
    (void)arguments;
    (void)count;
    switch (find_running(&link, path, error)) {
    case SKD_LINK_FAILED:
        return SKD_EXIT_FAILED;
    case SKD_LINK_NOBODY:
        skd_cli_say("no skind runs on %s", path);
        break;
    case SKD_LINK_UP: {
        int process = pidfd_open((pid_t)link.pid, 0);
        enum skd_status status = skd_link_call(&link, "shutdown", NULL, NULL, 0, &answer, error);
        skd_message_finish(&answer);
        skd_link_close(&link);
        stopped = status == SKD_OK && (process < 0 || wait_for_end(process));
        if (process >= 0)
            close(process);
        if (status == SKD_OK && !stopped)
            (void)skd_fail(error, SKD_BUSY, "skind (pid %ld) was told to stop and still runs",
                           link.pid);
        if (!stopped)
            return SKD_EXIT_FAILED;
        skd_cli_say("stopped skind (pid %ld)", link.pid);
    }
    }
    if (skd_cli.json) {
        cJSON *json = cJSON_CreateObject();
        cJSON_AddBoolToObject(json, "stopped", stopped);
        skd_print_own_json(json);
    }
    return SKD_EXIT_OK;
}

const struct skd_command skd_command_stop = {
    .group = SKD_GROUP_DAEMON,
    .name = "stop",
    .arguments = "",
    .summary = "stop the daemon and wait until it is gone",
    .details = "Nothing is lost: sessions are there again when it starts the next time, with what\n"
               "there is to undo; only those with durability off are gone.\n",
    .examples = "  skinctl stop\n"
                "  skinctl stop --socket /tmp/test/skind.sock\n",
    .run = run_stop,
};

static void print_status(const struct skd_link *link, const char *path, const cJSON *stats,
                         const cJSON *sessions)
{
    char bytes[SKD_COUNT_TEXT_BYTES], solved[SKD_COUNT_TEXT_BYTES];
    printf("skind %s, pid %ld, %s\n", link->version, link->pid, path);
    printf("up %.0f s, %.0f workers, %.0f connections, %s\n", skd_json_number(stats, "uptime_s"),
           skd_json_number(stats, "workers"), skd_json_number(stats, "connections"),
           skd_bytes_text(skd_json_number(stats, "bytes"), bytes));
    printf("solved %s vertices in %.1f ms\n",
           skd_count_text(skd_json_number(stats, "vertices_solved"), solved),
           skd_json_number(stats, "solve_ms"));
    skd_print_sessions(sessions);
}

/* Exit status 1 is the answer here, and the error was not needed. */
static int report_nobody(const char *path, struct skd_error *error)
{
    *error = (struct skd_error){0};
    if (skd_cli.json) {
        cJSON *json = cJSON_CreateObject();
        cJSON_AddBoolToObject(json, "running", false);
        cJSON_AddStringToObject(json, "socket", path);
        skd_print_own_json(json);
    } else {
        printf("no skind runs on %s\n", path);
    }
    return SKD_EXIT_FAILED;
}

static void report_running(const struct skd_link *link, const char *path, const cJSON *stats,
                           const cJSON *sessions)
{
    if (!skd_cli.json) {
        print_status(link, path, stats, sessions);
        return;
    }
    cJSON *json = cJSON_CreateObject();
    cJSON_AddBoolToObject(json, "running", true);
    cJSON_AddStringToObject(json, "socket", path);
    cJSON_AddNumberToObject(json, "pid", (double)link->pid);
    cJSON_AddStringToObject(json, "version", link->version);
    cJSON_AddItemToObject(json, "stats", cJSON_Duplicate(stats, true));
    cJSON_AddItemToObject(json, "sessions", cJSON_Duplicate(sessions, true));
    skd_print_own_json(json);
}

static int run_status(const char *const *arguments, int count, struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES];
    struct skd_link link;
    struct skd_message stats = {0}, list = {0};
    (void)arguments;
    (void)count;
    switch (find_running(&link, path, error)) {
    case SKD_LINK_FAILED:
        return SKD_EXIT_FAILED;
    case SKD_LINK_NOBODY:
        return report_nobody(path, error);
    case SKD_LINK_UP:
        break;
    }
    enum skd_status status = skd_link_call(&link, "stats", NULL, NULL, 0, &stats, error);
    if (status == SKD_OK)
        status = skd_link_call(&link, "session.list", NULL, NULL, 0, &list, error);
    if (status == SKD_OK)
        report_running(&link, path, stats.result,
                       cJSON_GetObjectItemCaseSensitive(list.result, "sessions"));
    skd_message_finish(&stats);
    skd_message_finish(&list);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_status = {
    .group = SKD_GROUP_DAEMON,
    .name = "status",
    .arguments = "",
    .summary = "tell whether the daemon runs (exit status 1: no), and what it holds",
    .examples = "  skinctl status\n"
                "  skinctl status --json\n",
    .run = run_status,
};

static void print_closed(const cJSON *closed)
{
    struct skd_table table = {
        .columns = 3, .titles = {"closed session", "when", "size"}, .is_number = {[2] = true}};
    const cJSON *item;
    cJSON_ArrayForEach(item, closed)
    {
        char size[SKD_COUNT_TEXT_BYTES], when[SKD_TIME_TEXT_BYTES];
        skd_table_add(&table,
                      (const char *const[]){skd_json_text(item, "session"),
                                            skd_time_text(skd_json_number(item, "closed_at"), when),
                                            skd_bytes_text(skd_json_number(item, "bytes"), size)});
    }
    if (table.rows > 0)
        skd_table_print(&table, 0);
}

static void print_list(const cJSON *result)
{
    const cJSON *item;
    skd_print_sessions(cJSON_GetObjectItemCaseSensitive(result, "sessions"));
    if (!options.all)
        return;
    print_closed(cJSON_GetObjectItemCaseSensitive(result, "closed"));
    cJSON_ArrayForEach(item, cJSON_GetObjectItemCaseSensitive(result, "damaged"))
        printf("damaged: %s: %s\n", skd_json_text(item, "file"), skd_json_text(item, "text"));
}

int skd_cli_list(bool all, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    options.all |= all;
    if (skd_cli_connect(&link, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    enum skd_status status = skd_link_call(&link, "session.list", NULL, NULL, 0, &answer, error);
    return skd_cli_conclude(&link, &answer, status, print_list);
}

static int run_list(const char *const *arguments, int count, struct skd_error *error)
{
    (void)arguments;
    (void)count;
    return skd_cli_list(false, error);
}

static const struct poptOption list_options[] = {
    {"all", 'a', POPT_ARG_NONE, &options.all, 0,
     "closed ones too, and files that were damaged and set aside", NULL},
    POPT_TABLEEND,
};

const struct skd_command skd_command_list = {
    .group = SKD_GROUP_SESSION,
    .name = "list",
    .arguments = "",
    .summary = "list the open rig sessions, how they are kept, and how many tools are there",
    .options = list_options,
    .examples = "  skinctl list\n"
                "  skinctl list --all\n"
                "  skinctl list --json\n",
    .run = run_list,
};
