/* skinctl session: what becomes of the files of rig sessions.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/model.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include "protocol/request.h"

#include <stdio.h>
#include <string.h>

static struct {
    char *name;
    char *durability;
    char *history;
} options;

static const struct poptOption session_options[] = {
    SKD_OPTION_SESSION,
    {"name", 'n', POPT_ARG_STRING, &options.name, 0, "open: the name that it is to have", "NAME"},
    {"durability", 'd', POPT_ARG_STRING, &options.durability, 0,
     "set: full (an answer means that it is on the disk), second, or off", "HOW"},
    {"history", 0, POPT_ARG_STRING, &options.history, 0,
     "set: how much undo may keep, as 200M or 2G", "SIZE"},
    POPT_TABLEEND,
};

/* One call whose answer is printed. `body` is taken over. */
static int conclude(struct skd_link *link, const char *method, cJSON *body,
                    void (*print)(const cJSON *result), struct skd_error *error)
{
    struct skd_message answer;
    enum skd_status status = skd_link_call(link, method, body, NULL, 0, &answer, error);
    return skd_cli_conclude(link, &answer, status, print);
}

static int open_body(struct skd_link *link, cJSON **body, struct skd_error *error)
{
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = skd_cli_open(link, session, error);
    if (result == SKD_EXIT_OK)
        *body = skd_session_body(session);
    return result;
}

static int add_path(cJSON *body, const char *file, struct skd_error *error)
{
    char path[SKD_PATH_BYTES_MAX];
    if (skd_path_absolute(file, path, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    cJSON_AddStringToObject(body, "path", path);
    return SKD_EXIT_OK;
}

/* ---- what is printed -------------------------------------------------------------------- */

static void print_saved(const cJSON *result)
{
    char bytes[SKD_COUNT_TEXT_BYTES];
    printf("saved %s: %s, revision %.0f\n", skd_json_text(result, "path"),
           skd_bytes_text(skd_json_number(result, "bytes"), bytes),
           skd_json_number(result, "revision"));
}

static void print_opened(const cJSON *result)
{
    char vertices[SKD_COUNT_TEXT_BYTES];
    printf("session %s: revision %.0f, %s vertices, undo %.0f, redo %.0f steps\n",
           skd_json_text(result, "session"), skd_json_number(result, "revision"),
           skd_count_text(skd_json_number(result, "vertices"), vertices),
           skd_json_number(result, "undo_steps"), skd_json_number(result, "redo_steps"));
    if (skd_json_text(result, "damage")[0] != '\0')
        printf("note: %s\n", skd_json_text(result, "damage"));
}

static void print_deleted(const cJSON *result)
{
    (void)result;
    puts("deleted");
}

static void print_verified(const cJSON *result)
{
    char bytes[SKD_COUNT_TEXT_BYTES];
    const cJSON *problem;
    bool ok = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(result, "ok"));
    printf("%s: revision %.0f, %.0f steps, %s\n", ok ? "whole" : "NOT whole",
           skd_json_number(result, "revision"), skd_json_number(result, "steps"),
           skd_bytes_text(skd_json_number(result, "bytes"), bytes));
    cJSON_ArrayForEach(problem, cJSON_GetObjectItemCaseSensitive(result, "problems"))
        printf("  %s\n", problem->valuestring);
}

static void print_settings(const cJSON *result)
{
    char bytes[SKD_COUNT_TEXT_BYTES];
    printf("session %s: durability %s, history up to %s\n", skd_json_text(result, "session"),
           skd_json_text(result, "durability"),
           skd_bytes_text(skd_json_number(result, "history_bytes"), bytes));
}

/* ---- the words ---------------------------------------------------------------------------- */

static int run_keep_list(const char *argument, struct skd_error *error)
{
    (void)argument;
    return skd_cli_list(true, error);
}

static int run_save(const char *file, struct skd_error *error)
{
    struct skd_link link;
    cJSON *body;
    int result = open_body(&link, &body, error);
    if (result != SKD_EXIT_OK)
        return result;
    result = add_path(body, file, error);
    if (result == SKD_EXIT_OK)
        return conclude(&link, "session.save", body, print_saved, error);
    cJSON_Delete(body);
    skd_link_close(&link);
    return result;
}

/* A path has a '/' or ends in .skind; all else is a closed session's name. */
static bool is_file(const char *text)
{
    size_t length = strlen(text);
    return strchr(text, '/') != NULL || (length > 6 && strcmp(text + length - 6, ".skind") == 0);
}

static int run_open(const char *what, struct skd_error *error)
{
    struct skd_link link;
    cJSON *body = cJSON_CreateObject();
    int result = SKD_EXIT_OK;
    if (is_file(what))
        result = add_path(body, what, error);
    else
        cJSON_AddStringToObject(body, "closed", what);
    if (options.name != NULL)
        cJSON_AddStringToObject(body, "name", options.name);
    if (result == SKD_EXIT_OK && skd_cli_connect(&link, error) == SKD_OK)
        return conclude(&link, "session.open", body, print_opened, error);
    cJSON_Delete(body);
    return SKD_EXIT_FAILED;
}

static int run_fork(const char *name, struct skd_error *error)
{
    struct skd_link link;
    cJSON *body;
    int result = open_body(&link, &body, error);
    if (result != SKD_EXIT_OK)
        return result;
    cJSON_AddStringToObject(body, "name", name);
    return conclude(&link, "session.fork", body, print_opened, error);
}

/* By its name, which has to be said: there is no way back. */
static int run_delete(const char *name, struct skd_error *error)
{
    struct skd_link link;
    if (skd_cli_connect(&link, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    return conclude(&link, "session.delete", skd_session_body(name), print_deleted, error);
}

static int run_verify(const char *file, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    cJSON *body = NULL;
    int result = SKD_EXIT_OK;
    if (file == NULL) {
        result = open_body(&link, &body, error);
    } else {
        body = cJSON_CreateObject();
        result = add_path(body, file, error);
        if (result == SKD_EXIT_OK && skd_cli_connect(&link, error) != SKD_OK)
            result = SKD_EXIT_FAILED;
        if (result != SKD_EXIT_OK)
            cJSON_Delete(body);
    }
    if (result != SKD_EXIT_OK)
        return result;
    enum skd_status status = skd_link_call(&link, "session.verify", body, NULL, 0, &answer, error);
    bool ok =
        status == SKD_OK && cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(answer.result, "ok"));
    result = skd_cli_conclude(&link, &answer, status, print_verified);
    if (result == SKD_EXIT_OK && !ok) {
        (void)skd_fail(error, SKD_DAMAGED, "the session is not whole on the disk");
        return SKD_EXIT_FAILED;
    }
    return result;
}

static int run_set(const char *argument, struct skd_error *error)
{
    struct skd_link link;
    cJSON *body;
    double bytes = 0;
    int word;
    (void)argument;
    if (options.durability == NULL && options.history == NULL)
        return skd_cli_usage(error, "say what to set: --durability or --history");
    if ((options.durability != NULL &&
         skd_value_word("--durability", options.durability, skd_durability_words, &word, error) !=
             SKD_OK) ||
        (options.history != NULL &&
         skd_value_size("--history", options.history, &bytes, error) != SKD_OK))
        return SKD_EXIT_USAGE;
    int result = open_body(&link, &body, error);
    if (result != SKD_EXIT_OK)
        return result;
    if (options.durability != NULL)
        cJSON_AddStringToObject(body, "durability", options.durability);
    if (options.history != NULL)
        cJSON_AddNumberToObject(body, "history_bytes", (double)(int64_t)bytes);
    return conclude(&link, "session.set", body, print_settings, error);
}

static const struct {
    const char *word;
    int least, most; /* arguments after it */
    int (*run)(const char *argument, struct skd_error *error);
} words[] = {
    {"list", 0, 0, run_keep_list}, {"save", 1, 1, run_save},     {"open", 1, 1, run_open},
    {"fork", 1, 1, run_fork},      {"delete", 1, 1, run_delete}, {"verify", 0, 1, run_verify},
    {"set", 0, 0, run_set},
};

static int run_session(const char *const *arguments, int count, struct skd_error *error)
{
    const char *word = count > 0 ? arguments[0] : "list";
    int given = count > 0 ? count - 1 : 0;
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        if (strcmp(words[i].word, word) != 0)
            continue;
        if (given < words[i].least || given > words[i].most)
            return skd_cli_usage(error, "session %s takes %s (see skinctl session --help)", word,
                                 words[i].most == 0    ? "nothing after it"
                                 : words[i].least == 1 ? "one argument"
                                                       : "at most one argument");
        return words[i].run(given > 0 ? arguments[1] : NULL, error);
    }
    return skd_cli_usage(error,
                         "there is no \"session %s\"; list, save, open, fork, delete, verify and "
                         "set are",
                         word);
}

const struct skd_command skd_command_session = {
    .group = SKD_GROUP_SESSION,
    .name = "session",
    .arguments = "list|save FILE|open FILE|open NAME|fork NAME|delete NAME|verify [FILE]|set",
    .least = 0,
    .most = 2,
    .summary = "keep rig sessions: save, open, fork, delete, verify",
    .options = session_options,
    .details =
        "The daemon keeps each session in a file of its own, history of undo and all, and opens\n"
        "it again when it starts. `save` writes a copy to carry away, `open` takes one in, or a\n"
        "session that was closed; `fork` makes a second one to try things with; `delete` is for\n"
        "good; `verify` reads the file and compares it with what the daemon holds.\n",
    .examples =
        "  skinctl session                              # which there are, and closed ones\n"
        "  skinctl session save knight.skind\n"
        "  skinctl session open knight.skind --name again\n"
        "  skinctl session fork try --session knight\n"
        "  skinctl session verify knight.skind\n"
        "  skinctl session set --durability second --history 2G\n",
    .run = run_session,
};
