/* skinctl: finds the command, reads its options, runs it, says what went wrong.
 *
 * Exit status: 0, 1 when the daemon or the work refused it, 2 for a wrong command line.
 */
#include "clients/cli/autostart.h"
#include "clients/cli/cli.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static const struct skd_command *const commands[] = {
    &skd_command_start,    &skd_command_stop,    &skd_command_status, &skd_command_load,
    &skd_command_list,     &skd_command_info,    &skd_command_export, &skd_command_close,
    &skd_command_session,  &skd_command_pose,    &skd_command_stroke, &skd_command_undo,
    &skd_command_redo,     &skd_command_weights, &skd_command_pins,   &skd_command_guard,
    &skd_command_shapes,   &skd_command_refit,   &skd_command_script, &skd_command_replay,
    &skd_command_generate, &skd_command_watch,   &skd_command_call,
};
enum { COMMAND_COUNT = sizeof commands / sizeof *commands };

static const char *const group_titles[SKD_GROUP_COUNT] = {
    [SKD_GROUP_DAEMON] = "The daemon",
    [SKD_GROUP_SESSION] = "Rig sessions",
    [SKD_GROUP_WORK] = "Poses, strokes, weights",
    [SKD_GROUP_SCRIPTS] = "Scripts and test characters",
    [SKD_GROUP_WIRE] = "Looking at the wire",
};

static int want_help, want_version;

static const struct poptOption global_options[] = {
    {"socket", 0, POPT_ARG_STRING, &skd_cli.socket, 0,
     "the daemon's socket, or tcp:PORT (default: $SKIND_SOCKET, else the user's own)", "PATH"},
    {"json", 0, POPT_ARG_NONE, &skd_cli.json, 0, "print one JSON object for programs", NULL},
    {"quiet", 'q', POPT_ARG_NONE, &skd_cli.quiet, 0, "no talk and no progress on stderr", NULL},
    {"help", 'h', POPT_ARG_NONE, &want_help, 0, "explain this, with examples", NULL},
    {"version", 'V', POPT_ARG_NONE, &want_version, 0, "print the version", NULL},
    POPT_TABLEEND,
};

static const char examples[] =
    "  skinctl generate --vertices 20000 body.glb     a character to try things with\n"
    "  skinctl load body.glb                          make it a rig session\n"
    "  skinctl script > strokes.yaml                  a script of strokes that fits it\n"
    "  skinctl replay strokes.yaml --export out.glb   solve them and keep the weights\n"
    "  skinctl replay --help                          how such a script is written\n";

static void print_overview(void)
{
    puts("Usage: skinctl [OPTION...] COMMAND [ARGUMENT...]\n\n"
         "Solves the skinning weights of rigged characters from sculpted poses: the command line\n"
         "of skind, which it starts when none runs.");
    for (int group = 0; group < SKD_GROUP_COUNT; group++) {
        printf("\n%s:\n", group_titles[group]);
        for (size_t i = 0; i < COMMAND_COUNT; i++) {
            if ((int)commands[i]->group == group)
                printf("  %-9s %s\n", commands[i]->name, commands[i]->summary);
        }
    }
    puts("\nOptions of every command:");
    for (const struct poptOption *option = global_options; option->longName != NULL; option++) {
        char name[32];
        (void)snprintf(name, sizeof name, "--%s%s%s", option->longName,
                       option->argDescrip != NULL ? " " : "",
                       option->argDescrip != NULL ? option->argDescrip : "");
        printf("  %-14s %s\n", name, option->descrip);
    }
    printf("\nExamples:\n%s\n"
           "Data goes to stdout, talk to stderr. Exit status: 0, 1 when it was refused, 2 for a "
           "wrong\ncommand line. skinctl COMMAND --help explains a command.\n",
           examples);
}

static void print_command_help(const struct skd_command *command, poptContext context)
{
    printf("%c%s.\n", command->summary[0] - 'a' + 'A', command->summary + 1);
    poptPrintHelp(context, stdout, 0);
    if (command->details != NULL)
        printf("\n%s", command->details);
    printf("\nExamples:\n%s", command->examples);
}

static const struct skd_command *find_command(const char *name)
{
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        if (strcmp(commands[i]->name, name) == 0)
            return commands[i];
    }
    return NULL;
}

/* What popt says about the options it read; *result is its last return value. */
static int check_options(poptContext context, int result, const char *help, struct skd_error *error)
{
    if (result >= -1)
        return SKD_EXIT_OK;
    return skd_cli_usage(error, "\"%s\": %s (see skinctl %s--help)",
                         poptBadOption(context, POPT_BADOPTION_NOALIAS), poptStrerror(result),
                         help);
}

static int run_command(const struct skd_command *command, int argc, const char **argv,
                       struct skd_error *error)
{
    const struct poptOption both[] = {
        {NULL, 0, POPT_ARG_INCLUDE_TABLE, (void *)(uintptr_t)command->options, 0, "Options:", NULL},
        {NULL, 0, POPT_ARG_INCLUDE_TABLE, (void *)(uintptr_t)global_options, 0,
         "Options of every command:", NULL},
        POPT_TABLEEND,
    };
    const struct poptOption *table = command->options != NULL ? both : both + 1;
    const char *no_arguments[] = {NULL};
    char program[32], usage[128], help[32];
    (void)snprintf(program, sizeof program, "skinctl %s", command->name);
    (void)snprintf(usage, sizeof usage, "[OPTION...] %s", command->arguments);
    (void)snprintf(help, sizeof help, "%s ", command->name);
    const char *name = argv[0];
    argv[0] = program; /* what popt's usage line begins with */
    poptContext context = poptGetContext("skinctl", argc, argv, table, 0);
    poptSetOtherOptionHelp(context, usage);
    int result = check_options(context, poptGetNextOpt(context), help, error);
    const char **arguments = poptGetArgs(context);
    int count = 0;
    if (arguments == NULL)
        arguments = no_arguments;
    while (arguments[count] != NULL)
        count++;
    if (result == SKD_EXIT_OK && want_help)
        print_command_help(command, context);
    else if (result == SKD_EXIT_OK && (count < command->least || count > command->most))
        result = skd_cli_usage(error, "usage: %s %s (see skinctl %s--help)", program, usage, help);
    else if (result == SKD_EXIT_OK && want_version)
        puts("skinctl " SKIND_VERSION);
    else if (result == SKD_EXIT_OK)
        result = command->run(arguments, count, error);
    poptFreeContext(context);
    argv[0] = name;
    return result;
}

/* Reads the options before the command's name, then lets the command read its own. */
static int run(int argc, const char **argv, struct skd_error *error)
{
    poptContext context =
        poptGetContext("skinctl", argc, argv, global_options, POPT_CONTEXT_POSIXMEHARDER);
    int result = check_options(context, poptGetNextOpt(context), "", error);
    const char **rest = poptGetArgs(context);
    int count = 0;
    while (rest != NULL && rest[count] != NULL)
        count++;
    if (count > 0 && strcmp(rest[0], "help") == 0) {
        want_help = 1;
        rest++, count--;
    }
    const struct skd_command *command = count > 0 ? find_command(rest[0]) : NULL;
    if (result != SKD_EXIT_OK)
        ; /* said already */
    else if (command != NULL)
        result = run_command(command, count, rest, error);
    else if (count > 0)
        result = skd_cli_usage(error, "there is no command \"%s\" (see skinctl --help)", rest[0]);
    else if (want_version)
        puts("skinctl " SKIND_VERSION);
    else if (want_help)
        print_overview();
    else
        result = skd_cli_usage(error, "say what to do (see skinctl --help)");
    poptFreeContext(context);
    return result;
}

/* Whoever reads our output has enough of it. */
static void on_closed_pipe(int signal)
{
    (void)signal;
    _exit(SKD_EXIT_OK);
}

int main(int argc, const char **argv)
{
    const struct sigaction closed_pipe = {.sa_handler = on_closed_pipe};
    struct skd_error error = {0};
    sigaction(SIGPIPE, &closed_pipe, NULL);
    int result = run(argc, argv, &error);
    if (fflush(stdout) != 0 || ferror(stdout)) {
        result = result != SKD_EXIT_OK ? result : SKD_EXIT_FAILED;
        if (error.text[0] == '\0')
            (void)skd_fail(&error, SKD_FILE_IO, "cannot write to stdout: %s", strerror(errno));
    }
    if (result != SKD_EXIT_OK && error.text[0] != '\0')
        fprintf(stderr, "skinctl: %s\n", error.text);
    return result;
}
