/* skinctl watch: what happens to a session, as it happens.
 *
 *     connect ─► attach ─► print, until the session, the count or the wait is at its end
 *        ▲                    │ --keep, and the connection broke off
 *        └────────────────────┘ (it catches up with the revision that it has)
 *
 * Thread: one. What happens is data (stdout); how the watch itself fares is talk (stderr).
 */
#include "clients/cli/cli.h"
#include "clients/cli/events.h"
#include "clients/cli/follower.h"
#include "clients/cli/print.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/signalfd.h>
#include <unistd.h>

enum { LOOK_AGAIN_MS = 200 }; /* whether the daemon is back */

static struct {
    int no_arrays;
    int digest;
    int keep;
    int count;
} options = {.count = INT_MAX};

static const struct poptOption watch_options[] = {
    SKD_OPTION_SESSION,
    {"no-arrays", 'n', POPT_ARG_NONE, &options.no_arrays, 0,
     "with --json: counts in place of vertices and weights", NULL},
    {"digest", 'd', POPT_ARG_NONE, &options.digest, 0,
     "hold the weights, and print a digest of all of them after each change", NULL},
    {"keep", 'k', POPT_ARG_NONE, &options.keep, 0,
     "when the connection breaks off, connect again, catch up and go on", NULL},
    {"count", 'c', POPT_ARG_INT, &options.count, 0, "end after this many updates", "N"},
    POPT_TABLEEND,
};

/* What the watch is at. */
struct watch {
    struct skd_link link;
    struct skd_follower follower;
    int interrupts; /* a signalfd, or -1 */
    int printed;    /* updates */
    bool ended;     /* the session is closed, or somebody pressed Ctrl-C */
};

static void mask_interrupts(int how, sigset_t *signals)
{
    sigemptyset(signals);
    sigaddset(signals, SIGINT);
    sigaddset(signals, SIGTERM);
    sigprocmask(how, signals, NULL);
}

/* SIGINT and SIGTERM as something to wait for beside the daemon: blocked for the process, readable
 * from the descriptor that comes back; -1 when that cannot be had. */
static int catch_interrupts(void)
{
    sigset_t signals;
    mask_interrupts(SIG_BLOCK, &signals);
    return signalfd(-1, &signals, SFD_CLOEXEC);
}

/* Waits until the daemon has something to say, or for this long (-1: for ever); an interrupt ends
 * the watch. */
static void wait_for_something(struct watch *watch, int ms)
{
    struct pollfd waits[] = {{.fd = watch->interrupts, .events = POLLIN},
                             {.fd = watch->link.fd, .events = POLLIN}};
    while (poll(waits, 2, ms) < 0 && errno == EINTR)
        ;
    if (waits[0].revents != 0)
        watch->ended = true;
}

static void print_digest(const struct skd_follower *follower)
{
    char digest[SKD_DIGEST_BYTES];
    skd_follower_digest(follower, digest);
    skd_event_print_digest(follower->session, follower->instance, follower->revision, digest);
}

static void print_event(struct watch *watch, const struct skd_message *message)
{
    skd_event_print(message, !options.no_arrays && !options.digest);
    if (strcmp(message->method, "session.update") == 0)
        watch->printed++;
    if (strcmp(message->method, "session.closed") == 0)
        watch->ended = true;
}

static bool is_about_us(const struct watch *watch, const struct skd_message *message)
{
    return message->method != NULL &&
           strcmp(skd_json_text(message->params, "session"), watch->follower.session) == 0;
}

/* What comes while the weights are fetched: they have it in them. */
static void on_notification(void *user, const struct skd_message *message)
{
    struct watch *watch = user;
    if (is_about_us(watch, message))
        print_event(watch, message);
}

static enum skd_status take(struct watch *watch, const struct skd_message *message,
                            struct skd_error *error)
{
    if (!is_about_us(watch, message))
        return SKD_OK;
    if (strcmp(message->method, "session.update") != 0) {
        print_event(watch, message);
        return SKD_OK;
    }
    if (!skd_follower_is_behind(&watch->follower, message))
        return SKD_OK;
    print_event(watch, message);
    enum skd_status status = skd_follower_take(&watch->follower, &watch->link, message, error);
    if (status == SKD_OK && options.digest)
        print_digest(&watch->follower);
    return status;
}

/* Prints until there is enough, or until the session, the wait or the link ends. */
static enum skd_status follow(struct watch *watch, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    while (status == SKD_OK && !watch->ended && watch->printed < options.count) {
        struct skd_message message;
        wait_for_something(watch, -1);
        if (watch->ended)
            return SKD_OK;
        status = skd_link_next(&watch->link, &message, error);
        if (status == SKD_OK)
            status = take(watch, &message, error);
        skd_message_finish(&message);
    }
    return status;
}

static enum skd_status attach(struct watch *watch, struct skd_error *error)
{
    struct skd_message answer;
    bool is_again = watch->follower.revision >= 0;
    watch->link.notify = on_notification;
    watch->link.user = watch;
    enum skd_status status = skd_follower_attach(&watch->follower, &watch->link, &answer, error);
    if (status == SKD_OK) {
        skd_event_print_attached(answer.result);
        skd_cli_say("watching \"%s\"%s from revision %.0f on", watch->follower.session,
                    is_again ? " again," : "", watch->follower.revision);
    }
    skd_message_finish(&answer);
    if (status == SKD_OK)
        status = skd_follower_fetch(&watch->follower, &watch->link, error);
    if (status == SKD_OK && options.digest)
        print_digest(&watch->follower);
    return status;
}

/* After a goodbye somebody wants the daemon, or us, gone: it is not started, only looked for. */
static enum skd_status wait_for_daemon(struct watch *watch, struct skd_error *error)
{
    char address[SKD_SOCKET_PATH_BYTES];
    enum skd_status status = skd_cli_address(address, error);
    skd_link_close(&watch->link);
    while (status == SKD_OK) {
        switch (skd_link_open(&watch->link, address, error)) {
        case SKD_LINK_UP:
            return SKD_OK;
        case SKD_LINK_FAILED:
            return error->status;
        case SKD_LINK_NOBODY:
            wait_for_something(watch, LOOK_AGAIN_MS);
            if (watch->ended)
                return SKD_OK;
        }
    }
    return status;
}

/* A daemon that died is started again; Ctrl-C ends us meanwhile as it ends any program. */
static enum skd_status come_back(struct watch *watch, struct skd_error *error)
{
    sigset_t signals;
    if (!skd_link_is_lost(&watch->link)) {
        skd_cli_say("%s; waiting until it is there again", error->text);
        return wait_for_daemon(watch, error);
    }
    skd_cli_say("%s; connecting again", error->text);
    mask_interrupts(SIG_UNBLOCK, &signals);
    enum skd_status status = skd_cli_reconnect(&watch->link, error);
    mask_interrupts(SIG_BLOCK, &signals);
    return status;
}

static enum skd_status watch_session(struct watch *watch, struct skd_error *error)
{
    for (;;) {
        enum skd_status status = attach(watch, error);
        if (status == SKD_OK)
            status = follow(watch, error);
        if (status != SKD_SHUTTING_DOWN || !options.keep)
            return status;
        status = come_back(watch, error);
        if (status != SKD_OK || watch->ended)
            return status;
    }
}

static int run_watch(const char *const *arguments, int count, struct skd_error *error)
{
    struct watch watch = {.follower = {.revision = -1, .holds_weights = options.digest != 0}};
    (void)arguments;
    (void)count;
    if (options.count < 1)
        return skd_cli_usage(error, "--count takes a number from 1 on");
    int result = skd_cli_open(&watch.link, watch.follower.session, error);
    if (result != SKD_EXIT_OK)
        return result;
    watch.interrupts = catch_interrupts();
    enum skd_status status = watch_session(&watch, error);
    if (watch.interrupts >= 0)
        close(watch.interrupts);
    skd_follower_finish(&watch.follower);
    skd_link_close(&watch.link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_watch = {
    .group = SKD_GROUP_SESSION,
    .name = "watch",
    .arguments = "",
    .summary = "tell what happens to a rig session: changes, who comes and goes, claims",
    .options = watch_options,
    .details =
        "A line each; with --json an object each, with the values that changed. Ends with the\n"
        "session, or on Ctrl-C. --keep stays over the daemon's end: one that died it starts\n"
        "again, for one that was stopped it waits. Two watches with the same digest hold the\n"
        "same weights to the bit.\n",
    .examples = "  skinctl watch\n"
                "  skinctl watch --keep --digest\n"
                "  skinctl watch --session knight --json --count 10 > updates.jsonl\n",
    .run = run_watch,
};
