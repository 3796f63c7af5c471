/* skinctl start, stop, status, list.
 *
 * Thread: one. start may start the daemon; stop and status never do.
 */
#include "clients/cli/autostart.h"
#include "clients/cli/cli.h"
#include "clients/cli/print.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/pidfd.h>
#include <unistd.h>

enum { WORKERS_MAX = 256, STOP_MS = 10000 };

static struct {
    int workers;
    int idle_exit;
} options;

static const struct poptOption start_options[] = {
    {"workers", 'w', POPT_ARG_INT, &options.workers, 0, "threads that solve (default: one a core)",
     "N"},
    {"idle-exit", 'i', POPT_ARG_INT, &options.idle_exit, 0,
     "end it after this long without clients and unexported work (default: never)", "SECONDS"},
    POPT_TABLEEND,
};

static int run_start(const char *const *arguments, int count, struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES];
    struct skd_link link;
    struct skd_start start = {
        .path = path, .workers = options.workers, .idle_exit_s = options.idle_exit};
    (void)arguments;
    (void)count;
    if (options.workers < 0 || options.workers > WORKERS_MAX || options.idle_exit < 0)
        return skd_cli_usage(error, "--workers takes 1 to %d, --idle-exit whole seconds",
                             WORKERS_MAX);
    enum skd_status status = skd_socket_path(skd_cli.socket, path, error);
    if (status == SKD_OK)
        status = skd_autostart(&link, &start, error);
    if (status != SKD_OK)
        return SKD_EXIT_FAILED;
    if (skd_cli.json) {
        cJSON *json = cJSON_CreateObject();
        cJSON_AddBoolToObject(json, "started", start.started);
        cJSON_AddNumberToObject(json, "pid", (double)link.pid);
        cJSON_AddStringToObject(json, "version", link.version);
        cJSON_AddStringToObject(json, "socket", path);
        skd_print_own_json(json);
    } else {
        skd_cli_say(start.started ? "started skind %s (pid %ld) on %s"
                                  : "skind %s (pid %ld) runs already on %s",
                    link.version, link.pid, path);
    }
    skd_link_close(&link);
    return SKD_EXIT_OK;
}

const struct skd_command skd_command_start = {
    .group = SKD_GROUP_DAEMON,
    .name = "start",
    .arguments = "",
    .summary = "start the daemon, unless it runs already",
    .options = start_options,
    .details = "Other commands start it by themselves, to end after half an hour without use.\n"
               "The program is $SKIND_BIN, else the skind beside skinctl, else the one on PATH;\n"
               "its log is skind.log in the socket's folder.\n",
    .examples = "  skinctl start\n"
                "  skinctl start --workers 2 --idle-exit 600\n",
    .run = run_start,
};

/* Connects to a daemon that runs; nobody there is no error yet. */
static enum skd_link_state find_running(struct skd_link *link, char path[SKD_SOCKET_PATH_BYTES],
                                        struct skd_error *error)
{
    if (skd_socket_path(skd_cli.socket, path, error) != SKD_OK)
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
    .details = "Sessions are closed: export first what is to be kept.\n",
    .examples = "  skinctl stop\n"
                "  skinctl stop --socket /tmp/test/skind.sock\n",
    .run = run_stop,
};

static void print_sessions(const cJSON *sessions)
{
    struct skd_table table = {
        .columns = 6,
        .titles = {"session", "revision", "vertices", "bones", "influences", "attached"},
        .is_number = {[1] = true, [2] = true, [3] = true, [4] = true, [5] = true}};
    const cJSON *item;
    cJSON_ArrayForEach(item, sessions)
    {
        static const char *const members[] = {"revision", "vertices", "bones", "influences",
                                              "attached"};
        char counts[5][SKD_COUNT_TEXT_BYTES];
        const char *cells[6] = {skd_json_text(item, "session")};
        for (int i = 0; i < 5; i++)
            cells[i + 1] = skd_count_text(skd_json_number(item, members[i]), counts[i]);
        skd_table_add(&table, cells);
    }
    skd_table_print(&table, 0);
}

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
    if (cJSON_GetArraySize(sessions) > 0)
        print_sessions(sessions);
    else
        puts("no rig session is open");
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

static void print_list(const cJSON *result)
{
    print_sessions(cJSON_GetObjectItemCaseSensitive(result, "sessions"));
}

static int run_list(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    (void)arguments;
    (void)count;
    if (skd_cli_connect(&link, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    enum skd_status status = skd_link_call(&link, "session.list", NULL, NULL, 0, &answer, error);
    return skd_cli_conclude(&link, &answer, status, print_list);
}

const struct skd_command skd_command_list = {
    .group = SKD_GROUP_SESSION,
    .name = "list",
    .arguments = "",
    .summary = "list the open rig sessions",
    .examples = "  skinctl list\n"
                "  skinctl list --json\n",
    .run = run_list,
};
