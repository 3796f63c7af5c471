/* skinctl: what all of its commands share.
 *
 * Stage: outside the daemon; a client as any other. Thread: one, and one run of one command, so the
 * options are file-level variables that popt's tables can point at.
 *
 *     main.c -> a command (*_commands.c) -> link.h (the wire), model.h (a session's data),
 *               play.h (poses and strokes), print.h, files.h
 *
 * A command prints its data on stdout, talks on stderr, and leaves its error to main.c.
 */
#ifndef SKD_CLI_H
#define SKD_CLI_H

#include "base/paths.h"
#include "clients/cli/link.h"
#include "clients/cli/options.h"

enum skd_exit {
    SKD_EXIT_OK = 0,
    SKD_EXIT_FAILED = 1, /* the daemon or the work refused it */
    SKD_EXIT_USAGE = 2,  /* the command line is wrong */
};

enum skd_command_group {
    SKD_GROUP_DAEMON,
    SKD_GROUP_SESSION,
    SKD_GROUP_WORK,
    SKD_GROUP_SCRIPTS,
    SKD_GROUP_WIRE,
    SKD_GROUP_COUNT
};

/* One command: how it is called, how it explains itself, and what it does. */
struct skd_command {
    enum skd_command_group group;
    const char *name;
    const char *arguments; /* for the usage line: "FILE" */
    int least;             /* how many arguments it takes */
    int most;
    const char *summary;              /* one line */
    const struct poptOption *options; /* may be NULL */
    const char *details;              /* paragraphs after the options; may be NULL */
    const char *examples;             /* lines, indented by two */
    /* Returns an enum skd_exit, and a sentence in *error when that is not SKD_EXIT_OK; error->text
     * may be empty when everything was said. arguments: [count], then NULL. */
    int (*run)(const char *const *arguments, int count, struct skd_error *error);
};

extern const struct skd_command skd_command_start, skd_command_stop, skd_command_status;
extern const struct skd_command skd_command_load, skd_command_list, skd_command_info;
extern const struct skd_command skd_command_close, skd_command_session;
extern const struct skd_command skd_command_undo, skd_command_redo, skd_command_export;
extern const struct skd_command skd_command_pose, skd_command_weights, skd_command_stroke;
extern const struct skd_command skd_command_pins, skd_command_guard, skd_command_shapes;
extern const struct skd_command skd_command_refit;
extern const struct skd_command skd_command_replay, skd_command_script, skd_command_generate;
extern const struct skd_command skd_command_watch, skd_command_call;

/* Fills *error and returns SKD_EXIT_USAGE. */
int skd_cli_usage(struct skd_error *error, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* SKD_EXIT_OK or SKD_EXIT_FAILED. */
int skd_cli_exit(enum skd_status status);

/* How a command with one answer ends: prints the result, as JSON if that was asked for and else
 * with `print`, frees the answer and closes the link. Returns skd_cli_exit(status). */
int skd_cli_conclude(struct skd_link *link, struct skd_message *answer, enum skd_status status,
                     void (*print)(const cJSON *result));

/* skinctl list, with or without what is closed or damaged. */
int skd_cli_list(bool all, struct skd_error *error);

/* Where the daemon is, or is to be: --socket, else $SKIND_SOCKET, else the user's own socket. */
SKD_MUST_CHECK enum skd_status skd_cli_address(char address[SKD_SOCKET_PATH_BYTES],
                                               struct skd_error *error);

/* Connects to the daemon and starts it when none runs, unless its address is a port. */
SKD_MUST_CHECK enum skd_status skd_cli_connect(struct skd_link *link, struct skd_error *error);

/* The same for a link that was up and was lost. It is closed when that fails. */
SKD_MUST_CHECK enum skd_status skd_cli_reconnect(struct skd_link *link, struct skd_error *error);

/* Connects, and finds the session that is meant. Returns an enum skd_exit; *link needs no closing
 * when it is not SKD_EXIT_OK. */
SKD_MUST_CHECK int skd_cli_open(struct skd_link *link, char session[SKD_SESSION_NAME_BYTES_MAX + 1],
                                struct skd_error *error);

#endif
