/* The options that several commands of skinctl take, and what one of them is for: talk on stderr.
 *
 * Thread: one.
 */
#ifndef SKD_CLI_OPTIONS_H
#define SKD_CLI_OPTIONS_H

#include <popt.h>

struct skd_cli_options {
    char *socket;  /* an address (link.h); NULL: the default of base/paths.h */
    char *session; /* NULL: the only open one */
    int json;
    int quiet;
};
extern struct skd_cli_options skd_cli;

/* clang-format off */
#define SKD_OPTION_SESSION                                                                         \
    {"session", 's', POPT_ARG_STRING, &skd_cli.session, 0,                                         \
     "the rig session (default: the only open one)", "NAME"}
/* clang-format on */

/* Talks on stderr, unless told to be quiet. */
void skd_cli_say(const char *format, ...) __attribute__((format(printf, 1, 2)));

#endif
