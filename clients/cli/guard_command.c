/* skinctl guard: poses that strokes should leave as they are.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/model.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <stdio.h>

static struct {
    char **clips;
    char **poses;
    int count;
    int clear;
} options = {.count = -1};

static const struct poptOption guard_options[] = {
    SKD_OPTION_SESSION,
    {"clip", 'c', POPT_ARG_ARGV, &options.clips, 0, "guard frames of this clip; may be repeated",
     "CLIP"},
    {"pose", 'p', POPT_ARG_ARGV, &options.poses, 0, "guard this pose; may be repeated", "NAME"},
    {"count", 'n', POPT_ARG_INT, &options.count, 0, "how many poses to pick, 1 to 64 (default: 8)",
     "N"},
    {"clear", 0, POPT_ARG_NONE, &options.clear, 0, "guard nothing any more", NULL},
    POPT_TABLEEND,
};

static void print_guard(const cJSON *result)
{
    struct skd_table table = {.columns = 4,
                              .titles = {"#", "source", "name", "seconds"},
                              .is_number = {[0] = true, [3] = true}};
    const cJSON *pose;
    cJSON_ArrayForEach(pose, cJSON_GetObjectItemCaseSensitive(result, "poses"))
    {
        char number[SKD_COUNT_TEXT_BYTES], seconds[SKD_COUNT_TEXT_BYTES];
        (void)snprintf(number, sizeof number, "%zu", table.rows + 1);
        (void)snprintf(seconds, sizeof seconds, "%.3f", skd_json_number(pose, "time"));
        skd_table_add(&table, (const char *const[]){number, skd_json_text(pose, "source"),
                                                    skd_json_text(pose, "name"), seconds});
    }
    if (table.rows == 0) {
        puts("no poses are guarded");
        return;
    }
    printf("%zu of %.0f poses are guarded:\n", table.rows, skd_json_number(result, "candidates"));
    skd_table_print(&table, 2);
}

static int run_guard(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    bool has_poses = options.clips != NULL || options.poses != NULL;
    (void)arguments;
    (void)count;
    if (options.clear && has_poses)
        return skd_cli_usage(error, "give --clear, or what to guard, not both");
    if (options.count != -1 && !has_poses)
        return skd_cli_usage(error, "--count takes --clip or --pose to pick from");
    if (options.count == 0 || options.count < -1 || options.count > SKD_GUARD_COUNT_MAX)
        return skd_cli_usage(error, "--count takes 1 to %d", SKD_GUARD_COUNT_MAX);
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    cJSON *body = skd_session_body(session);
    skd_add_texts(body, "clips", options.clips);
    skd_add_texts(body, "poses", options.poses);
    if (options.count != -1)
        cJSON_AddNumberToObject(body, "count", options.count);
    enum skd_status status =
        skd_link_call(&link, has_poses || options.clear ? "guard.set" : "guard.get", body, NULL, 0,
                      &answer, error);
    return skd_cli_conclude(&link, &answer, status, print_guard);
}

const struct skd_command skd_command_guard = {
    .group = SKD_GROUP_WORK,
    .name = "guard",
    .arguments = "",
    .summary = "say which poses strokes should leave as they are",
    .options = guard_options,
    .details =
        "Picks the poses that differ most from rest and from each other. How much they count\n"
        "in a stroke is its --guard. Without options: tells which are guarded.\n",
    .examples = "  skinctl guard --clip walk --clip run --count 16\n"
                "  skinctl guard --pose raised\n"
                "  skinctl guard --clear\n",
    .run = run_guard,
};
