/* skinctl watch, call: the wire as it is.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/model.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/signalfd.h>
#include <unistd.h>

static struct {
    int no_arrays;
    int count;
} options = {.count = INT_MAX};

static const struct poptOption watch_options[] = {
    SKD_OPTION_SESSION,
    {"no-arrays", 'n', POPT_ARG_NONE, &options.no_arrays, 0,
     "leave out vertices and weights, and tell how many vertices changed", NULL},
    {"count", 'c', POPT_ARG_INT, &options.count, 0, "end after this many updates", "N"},
    POPT_TABLEEND,
};

/* SIGINT and SIGTERM as something to wait for beside the daemon: blocked for the process, readable
 * from the descriptor that comes back; -1 when that cannot be had. */
static int catch_interrupts(void)
{
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    sigprocmask(SIG_BLOCK, &signals, NULL);
    return signalfd(-1, &signals, SFD_CLOEXEC);
}

/* Waits until the daemon has something to say; true when an interrupt came first. */
static bool is_interrupted(const struct skd_link *link, int interrupts)
{
    struct pollfd waits[] = {{.fd = interrupts, .events = POLLIN},
                             {.fd = link->fd, .events = POLLIN}};
    while (poll(waits, 2, -1) < 0 && errno == EINTR)
        ;
    return waits[0].revents != 0;
}

static void print_update(const struct skd_message *update)
{
    if (!options.no_arrays) {
        skd_print_json(update, update->params);
        return;
    }
    struct skd_array vertices;
    void *owned;
    struct skd_error error;
    cJSON *brief = cJSON_Duplicate(update->params, true);
    if (skd_message_array(update, update->params, "vertices", SKD_U32, 0, &vertices, &owned,
                          &error) == SKD_OK)
        cJSON_ReplaceItemInObjectCaseSensitive(brief, "vertices",
                                               cJSON_CreateNumber((double)vertices.count));
    cJSON_DeleteItemFromObjectCaseSensitive(brief, "weights");
    skd_print_own_json(brief);
    cJSON_free(owned);
}

/* Prints updates until there are enough, or until the session or the wait ends. */
static enum skd_status print_updates(struct skd_link *link, const char *session, int interrupts,
                                     struct skd_error *error)
{
    int printed = 0;
    bool closed = false;
    enum skd_status status = SKD_OK;
    while (status == SKD_OK && !closed && printed < options.count &&
           !is_interrupted(link, interrupts)) {
        struct skd_message message;
        status = skd_link_next(link, &message, error);
        const char *method = status == SKD_OK && message.method != NULL ? message.method : "";
        bool is_ours = strcmp(skd_json_text(message.params, "session"), session) == 0;
        if (strcmp(method, "session.update") == 0 && is_ours) {
            print_update(&message);
            printed++;
        } else if (strcmp(method, "session.closed") == 0 && is_ours) {
            skd_cli_say("session \"%s\" was closed: %s", session,
                        skd_json_text(message.params, "reason"));
            closed = true;
        }
        skd_message_finish(&message);
    }
    return status;
}

static int run_watch(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    (void)arguments;
    (void)count;
    if (options.count < 1)
        return skd_cli_usage(error, "--count takes a number from 1 on");
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    enum skd_status status =
        skd_link_call(&link, "session.attach", skd_session_body(session), NULL, 0, &answer, error);
    if (status == SKD_OK) {
        int interrupts = catch_interrupts();
        skd_cli_say("watching \"%s\" from revision %.0f on", session,
                    skd_json_number(answer.result, "revision"));
        status = print_updates(&link, session, interrupts, error);
        if (interrupts >= 0)
            close(interrupts);
    }
    skd_message_finish(&answer);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_watch = {
    .group = SKD_GROUP_WIRE,
    .name = "watch",
    .arguments = "",
    .summary = "print each change of a session's weights as it comes, one JSON object a line",
    .options = watch_options,
    .details = "Ends with the session, or on Ctrl-C.\n",
    .examples = "  skinctl watch --no-arrays\n"
                "  skinctl watch --session knight --count 10 > updates.jsonl\n",
    .run = run_watch,
};

static int run_call(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    cJSON *params = NULL;
    if (count > 1 && skd_value_json("the parameters", arguments[1], strlen(arguments[1]), &params,
                                    error) != SKD_OK)
        return SKD_EXIT_USAGE;
    if (params != NULL && !cJSON_IsObject(params)) {
        cJSON_Delete(params);
        return skd_cli_usage(error, "the parameters are a JSON object: '{\"session\": \"rig\"}'");
    }
    if (skd_cli_connect(&link, error) != SKD_OK) {
        cJSON_Delete(params);
        return SKD_EXIT_FAILED;
    }
    enum skd_status status = skd_link_call(&link, arguments[0], params, NULL, 0, &answer, error);
    if (status == SKD_OK)
        skd_print_json(&answer, answer.result);
    skd_message_finish(&answer);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_call = {
    .group = SKD_GROUP_WIRE,
    .name = "call",
    .arguments = "METHOD [PARAMS]",
    .least = 1,
    .most = 2,
    .summary = "send any request and print its result as JSON",
    .details = "PARAMS is a JSON object. protocol/PROTOCOL.md lists the methods.\n",
    .examples = "  skinctl call session.list\n"
                "  skinctl call session.close '{\"session\": \"knight\"}'\n"
                "  skinctl call weights.get '{\"session\": \"knight\", \"vertices\": [0, 1]}'\n",
    .run = run_call,
};
