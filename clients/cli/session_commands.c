/* skinctl load, info, export, close, undo, redo.
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
    int influences;
    char *fill;
    char *reduce;
    char *output;
    char *durability;
    char *history;
    int own;
    int discard;
} options;

static const struct poptOption load_options[] = {
    {"name", 'n', POPT_ARG_STRING, &options.name, 0,
     "the session's name (default: made from the file's)", "NAME"},
    {"influences", 'i', POPT_ARG_INT, &options.influences, 0, "weights a vertex: 4 (default) or 8",
     "N"},
    {"fill", 'f', POPT_ARG_STRING, &options.fill, 0,
     "which bones free slots offer: neighbours (default), hop, infect, none", "RULE"},
    {"reduce", 'r', POPT_ARG_STRING, &options.reduce, 0,
     "more influences than slots: refuse (default), keep the largest, or those that move it least "
     "when posed: posed",
     "RULE"},
    {"durability", 'd', POPT_ARG_STRING, &options.durability, 0,
     "what an answer means: it is on the disk: full (default); it will be in a second: second; "
     "nothing is kept: off",
     "HOW"},
    {"history", 0, POPT_ARG_STRING, &options.history, 0, "how much undo may keep (default: 512M)",
     "SIZE"},
    POPT_TABLEEND,
};

static void print_loaded(const cJSON *result)
{
    char vertices[SKD_COUNT_TEXT_BYTES], triangles[SKD_COUNT_TEXT_BYTES];
    char filled[SKD_COUNT_TEXT_BYTES], reduced[SKD_COUNT_TEXT_BYTES];
    const cJSON *slots = cJSON_GetObjectItemCaseSensitive(result, "slots");
    const cJSON *moved = cJSON_GetObjectItemCaseSensitive(slots, "moved");
    const cJSON *note;
    printf("session %s: %s vertices, %s triangles, %.0f bones, %.0f clips, length %.6g, %.0f "
           "influences\n",
           skd_json_text(result, "session"),
           skd_count_text(skd_json_number(result, "vertices"), vertices),
           skd_count_text(skd_json_number(result, "triangles"), triangles),
           skd_json_number(result, "bones"), skd_json_number(result, "clips"),
           skd_json_number(result, "length"), skd_json_number(result, "influences"));
    cJSON_ArrayForEach(note, cJSON_GetObjectItemCaseSensitive(result, "notes"))
        printf("note: %s\n", skd_json_text(note, "text"));
    printf("slots: %s free ones filled with nearby bones",
           skd_count_text(skd_json_number(slots, "filled"), filled));
    if (skd_json_number(slots, "empty") > 0)
        printf(", %.0f left empty", skd_json_number(slots, "empty"));
    if (skd_json_number(slots, "reduced") > 0)
        printf("; %s vertices had more influences: at most %.3g of a vertex's weight was cut, "
               "which moves them by %.3g on average and %.3g at most in %.0f poses",
               skd_count_text(skd_json_number(slots, "reduced"), reduced),
               skd_json_number(slots, "largest_cut"), skd_json_number(moved, "mean"),
               skd_json_number(moved, "max"), skd_json_number(moved, "poses"));
    putchar('\n');
}

static int run_load(const char *const *arguments, int count, struct skd_error *error)
{
    char path[SKD_PATH_BYTES_MAX];
    int word;
    double history = 0;
    struct skd_link link;
    struct skd_message answer;
    (void)count;
    if (options.influences != 0 && options.influences != 4 && options.influences != 8)
        return skd_cli_usage(error, "--influences is 4 or 8, not %d", options.influences);
    if ((options.fill != NULL &&
         skd_value_word("--fill", options.fill, skd_fill_words, &word, error) != SKD_OK) ||
        (options.reduce != NULL &&
         skd_value_word("--reduce", options.reduce, skd_reduce_words, &word, error) != SKD_OK) ||
        (options.durability != NULL &&
         skd_value_word("--durability", options.durability, skd_durability_words, &word, error) !=
             SKD_OK) ||
        (options.history != NULL &&
         skd_value_size("--history", options.history, &history, error) != SKD_OK))
        return SKD_EXIT_USAGE;
    if (skd_path_absolute(arguments[0], path, error) != SKD_OK ||
        skd_cli_connect(&link, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "file", path);
    if (options.name != NULL)
        cJSON_AddStringToObject(body, "name", options.name);
    if (options.influences != 0)
        cJSON_AddNumberToObject(body, "influences", options.influences);
    if (options.fill != NULL)
        cJSON_AddStringToObject(body, "fill", options.fill);
    if (options.reduce != NULL)
        cJSON_AddStringToObject(body, "reduce", options.reduce);
    if (options.durability != NULL)
        cJSON_AddStringToObject(body, "durability", options.durability);
    if (options.history != NULL)
        cJSON_AddNumberToObject(body, "history_bytes", (double)(int64_t)history);
    enum skd_status status = skd_link_call(&link, "session.create", body, NULL, 0, &answer, error);
    return skd_cli_conclude(&link, &answer, status, print_loaded);
}

const struct skd_command skd_command_load = {
    .group = SKD_GROUP_SESSION,
    .name = "load",
    .arguments = "FILE",
    .least = 1,
    .most = 1,
    .summary = "make a rig session from a glTF file (.glb or .gltf)",
    .options = load_options,
    .details = "Prints what was found, a note for each thing that had to be mended, and how the\n"
               "influences fit into the session's slots.\n",
    .examples = "  skinctl load knight.glb\n"
                "  skinctl load body.gltf --name body --influences 8\n"
                "  skinctl load face.glb --reduce posed        # leave out what matters least\n",
    .run = run_load,
};

static void print_names(const char *title, const cJSON *list, const char *member)
{
    const cJSON *item;
    if (cJSON_GetArraySize(list) == 0)
        return;
    printf("%s:", title);
    cJSON_ArrayForEach(item, list)
        printf("%s %s", item->prev->next != NULL ? "," : "",
               member != NULL ? skd_json_text(item, member) : item->valuestring);
    putchar('\n');
}

static void print_clips(const cJSON *clips)
{
    struct skd_table table = {
        .columns = 2, .titles = {"clip", "seconds"}, .is_number = {[1] = true}};
    const cJSON *clip;
    cJSON_ArrayForEach(clip, clips)
    {
        char seconds[SKD_COUNT_TEXT_BYTES];
        (void)snprintf(seconds, sizeof seconds, "%.3f", skd_json_number(clip, "duration"));
        skd_table_add(&table, (const char *const[]){skd_json_text(clip, "name"), seconds});
    }
    if (table.rows > 0)
        skd_table_print(&table, 0);
}

/* Bones as a tree: a bone comes after its parent, so depths are known when they are needed. */
static void print_bones(const cJSON *bones)
{
    enum { DEPTHS = 65536 };
    static unsigned char depths[DEPTHS];
    const cJSON *bone;
    int index = 0;
    puts("bones:");
    cJSON_ArrayForEach(bone, bones)
    {
        double parent = skd_json_number(bone, "parent");
        int depth = parent >= 0 && parent < index && parent < DEPTHS ? depths[(int)parent] + 1 : 0;
        if (index < DEPTHS)
            depths[index] = (unsigned char)(depth < 200 ? depth : 200);
        printf("%*s%s\n", 2 + 2 * depth, "", skd_json_text(bone, "name"));
        index++;
    }
}

/* What there is to undo, and what of the session is on the disk. */
static void print_keeping(const cJSON *info)
{
    char used[SKD_COUNT_TEXT_BYTES], most[SKD_COUNT_TEXT_BYTES], file[SKD_COUNT_TEXT_BYTES];
    printf("undo %.0f, redo %.0f steps: %s of %s\n", skd_json_number(info, "undo_steps"),
           skd_json_number(info, "redo_steps"),
           skd_bytes_text(skd_json_number(info, "history_used"), used),
           skd_bytes_text(skd_json_number(info, "history_bytes"), most));
    printf("durability %s, journal %s, %s on the disk\n", skd_json_text(info, "durability"),
           skd_json_text(info, "journal"),
           skd_bytes_text(skd_json_number(info, "journal_bytes"), file));
    if (skd_json_text(info, "damage")[0] != '\0')
        printf("damage: %s\n", skd_json_text(info, "damage"));
}

static void print_info(const cJSON *info)
{
    char vertices[SKD_COUNT_TEXT_BYTES], triangles[SKD_COUNT_TEXT_BYTES];
    char bytes[SKD_COUNT_TEXT_BYTES];
    const cJSON *note;
    printf("session %s, revision %.0f\n", skd_json_text(info, "session"),
           skd_json_number(info, "revision"));
    printf("from %s\n",
           skd_json_text(info, "source")[0] != '\0' ? skd_json_text(info, "source") : "arrays");
    printf("%s vertices, %s triangles, length %.6g, %.0f influences, %s\n",
           skd_count_text(skd_json_number(info, "vertices"), vertices),
           skd_count_text(skd_json_number(info, "triangles"), triangles),
           skd_json_number(info, "length"), skd_json_number(info, "influences"),
           skd_bytes_text(skd_json_number(info, "bytes"), bytes));
    print_keeping(info);
    skd_print_present(cJSON_GetObjectItemCaseSensitive(info, "present"));
    cJSON_ArrayForEach(note, cJSON_GetObjectItemCaseSensitive(info, "notes"))
        printf("note: %s\n", skd_json_text(note, "text"));
    print_names("parts", cJSON_GetObjectItemCaseSensitive(info, "parts"), "name");
    print_names("poses", cJSON_GetObjectItemCaseSensitive(info, "poses"), NULL);
    print_clips(cJSON_GetObjectItemCaseSensitive(info, "clips"));
    print_bones(cJSON_GetObjectItemCaseSensitive(info, "bones"));
}

static int run_info(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_model model;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    (void)arguments;
    (void)count;
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    enum skd_status status = skd_model_open(&model, &link, session, error);
    if (status == SKD_OK && skd_cli.json)
        skd_print_json(&model.info, model.info.result);
    else if (status == SKD_OK)
        print_info(model.info.result);
    skd_model_close(&model);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

static const struct poptOption session_options[] = {
    SKD_OPTION_SESSION,
    POPT_TABLEEND,
};

const struct skd_command skd_command_info = {
    .group = SKD_GROUP_SESSION,
    .name = "info",
    .arguments = "",
    .summary = "tell all about a rig session: clips, poses, bones, history, who is here",
    .options = session_options,
    .examples = "  skinctl info\n"
                "  skinctl info --session knight --json\n",
    .run = run_info,
};

static const struct poptOption history_options[] = {
    SKD_OPTION_SESSION,
    {"own", 0, POPT_ARG_NONE, &options.own, 0,
     "the last one of this terminal's own, if nobody else changed the same vertices since", NULL},
    POPT_TABLEEND,
};

static int turn_history(const char *method, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    cJSON *body = skd_session_body(session);
    if (options.own)
        cJSON_AddTrueToObject(body, "own");
    enum skd_status status = skd_change_call(&link, session, method, body, NULL, 0, &answer, error);
    return skd_cli_conclude(&link, &answer, status, skd_print_step);
}

static int run_undo(const char *const *arguments, int count, struct skd_error *error)
{
    (void)arguments;
    (void)count;
    return turn_history("history.undo", error);
}

static int run_redo(const char *const *arguments, int count, struct skd_error *error)
{
    (void)arguments;
    (void)count;
    return turn_history("history.redo", error);
}

const struct skd_command skd_command_undo = {
    .group = SKD_GROUP_WORK,
    .name = "undo",
    .arguments = "",
    .summary = "take the last change back",
    .options = history_options,
    .details =
        "Changes that skinctl made from one terminal are its own; SKIND_CLIENT=NAME gives a\n"
        "script a name for its own changes.\n",
    .examples = "  skinctl undo\n"
                "  skinctl undo --session knight\n"
                "  skinctl undo --own\n",
    .run = run_undo,
};

const struct skd_command skd_command_redo = {
    .group = SKD_GROUP_WORK,
    .name = "redo",
    .arguments = "",
    .summary = "apply the change that was taken back last",
    .options = history_options,
    .examples = "  skinctl redo\n"
                "  skinctl redo --session knight\n",
    .run = run_redo,
};

static const struct poptOption export_options[] = {
    SKD_OPTION_SESSION,
    {"output", 'o', POPT_ARG_STRING, &options.output, 0,
     "the file to write (default: the source's name with -skind, in the current folder)", "FILE"},
    POPT_TABLEEND,
};

static int run_export(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer = {0};
    char session[SKD_SESSION_NAME_BYTES_MAX + 1], path[SKD_PATH_BYTES_MAX];
    (void)arguments;
    (void)count;
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    struct skd_model model;
    enum skd_status status = skd_model_open(&model, &link, session, error);
    if (status == SKD_OK)
        status = options.output != NULL ? skd_path_absolute(options.output, path, error)
                                        : skd_default_output(&model, path, error);
    if (status == SKD_OK)
        status = skd_session_export(&model, path, &answer, error);
    skd_model_close(&model);
    return skd_cli_conclude(&link, &answer, status, skd_print_exported);
}

const struct skd_command skd_command_export = {
    .group = SKD_GROUP_SESSION,
    .name = "export",
    .arguments = "",
    .summary = "write the session's glTF file with its new weights, and nothing else changed",
    .options = export_options,
    .examples = "  skinctl export                     # knight.glb becomes ./knight-skind.glb\n"
                "  skinctl export -o out/knight.glb\n",
    .run = run_export,
};

static const struct poptOption close_options[] = {
    SKD_OPTION_SESSION,
    {"discard", 'd', POPT_ARG_NONE, &options.discard, 0, "for good: it cannot be opened again",
     NULL},
    POPT_TABLEEND,
};

/* Nobody's work is thrown away by a slip: a session that is closed can be opened again, and one
 * that is not kept takes --discard while it holds changes that were not exported. */
static enum skd_status close_session(struct skd_link *link, const char *session,
                                     struct skd_error *error)
{
    struct skd_message info = {0}, answer = {0};
    enum skd_status status =
        skd_link_call(link, "session.info", skd_session_body(session), NULL, 0, &info, error);
    bool is_kept = strcmp(skd_json_text(info.result, "journal"), "ok") == 0;
    if (status == SKD_OK && !options.discard && !is_kept &&
        skd_json_number(info.result, "revision") != skd_json_number(info.result, "exported"))
        status =
            skd_fail(error, SKD_BUSY,
                     "session %s is not kept (journal %s) and its last changes were not "
                     "exported; use skinctl export or session save, or close it with --discard",
                     session, skd_json_text(info.result, "journal"));
    if (status == SKD_OK)
        status = skd_link_call(link, options.discard ? "session.delete" : "session.close",
                               skd_session_body(session), NULL, 0, &answer, error);
    skd_message_finish(&info);
    skd_message_finish(&answer);
    return status;
}

static int run_close(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    (void)arguments;
    (void)count;
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    enum skd_status status = close_session(&link, session, error);
    if (status == SKD_OK && skd_cli.json)
        puts("{}");
    else if (status == SKD_OK)
        printf("closed session %s%s\n", session, options.discard ? " for good" : "");
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_close = {
    .group = SKD_GROUP_SESSION,
    .name = "close",
    .arguments = "",
    .summary = "close a rig session; session open takes it up again",
    .options = close_options,
    .examples = "  skinctl close\n"
                "  skinctl close --session knight-2 --discard\n",
    .run = run_close,
};
