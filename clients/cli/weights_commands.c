/* skinctl weights: prints them, and changes them without a stroke.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/model.h"
#include "clients/cli/print.h"
#include "clients/cli/solving.h"
#include "clients/cli/values.h"

#include "protocol/request.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NO_BONE = 65535 };

static struct {
    char *vertices;
    char *raw;
    char *axis;
    char *from;
    double origin;
    double tolerance;
    double below;
    int influences;
    char *by;
    char **poses;
} options = {.origin = (double)NAN, .tolerance = (double)NAN, .below = (double)NAN};

static const struct poptOption weights_options[] = {
    SKD_OPTION_SESSION,
    {"vertices", 'v', POPT_ARG_STRING, &options.vertices, 0,
     "of these vertices only (mirror: of the side that is written)", "LIST"},
    {"raw", 0, POPT_ARG_STRING, &options.raw, 0,
     "write PREFIX.joints.u16 and PREFIX.weights.f32 instead, little-endian", "PREFIX"},
    {"axis", 0, POPT_ARG_STRING, &options.axis, 0, "mirror: across which axis: x (default), y, z",
     "AXIS"},
    {"from", 0, POPT_ARG_STRING, &options.from, 0,
     "mirror: from which side of it: + (default) or -", "SIDE"},
    {"origin", 0, POPT_ARG_DOUBLE, &options.origin, 0,
     "mirror: where the plane cuts the axis (default: 0)", "X"},
    {"tolerance", 0, POPT_ARG_DOUBLE, &options.tolerance, 0,
     "mirror: how far vertices may be from each other's image, as a share of the mesh's "
     "diagonal, 0 to 1 (default: 0.001)",
     "SHARE"},
    {"below", 0, POPT_ARG_DOUBLE, &options.below, 0,
     "prune: weights smaller than this go, 0 to 1 (default: 0.01)", "W"},
    {"influences", 'i', POPT_ARG_INT, &options.influences, 0, "reduce: how many stay, 1 to 8", "N"},
    {"by", 0, POPT_ARG_STRING, &options.by, 0,
     "reduce: which stay: those that matter in poses (default), or the largest: size", "RULE"},
    {"pose", 'p', POPT_ARG_ARGV, &options.poses, 0,
     "reduce: a pose that counts; may be repeated (default: the guard poses, else clips)", "NAME"},
    POPT_TABLEEND,
};

enum action { PRINT, MIRROR, PRUNE, REDUCE };
static const char *const action_words[] = {"print", "mirror", "prune", "reduce", NULL};

static const char **bone_names(const struct skd_model *model)
{
    const char **names = calloc(model->bone_count + 1, sizeof *names);
    size_t used = 0;
    const cJSON *bone;
    cJSON_ArrayForEach(bone, cJSON_GetObjectItemCaseSensitive(model->info.result, "bones"))
    {
        if (names != NULL)
            names[used++] = skd_json_text(bone, "name");
    }
    return names;
}

/* One line a vertex: its index, then bone and weight for each slot that has any. */
static enum skd_status print_weights(const struct skd_model *model, const uint32_t *vertices,
                                     size_t count, const struct skd_weights *weights,
                                     struct skd_error *error)
{
    const char **names = bone_names(model);
    if (names == NULL)
        return skd_fail_memory(error, "the bones' names");
    for (size_t i = 0; i < count; i++) {
        printf("%u", vertices != NULL ? vertices[i] : (unsigned)i);
        for (size_t slot = i * weights->slots; slot < (i + 1) * weights->slots; slot++) {
            int joint = weights->joints[slot];
            if (joint != NO_BONE && weights->weights[slot] != 0)
                printf("  %s %.7g", (size_t)joint < model->bone_count ? names[joint] : "?",
                       (double)weights->weights[slot]);
        }
        putchar('\n');
    }
    free(names);
    return SKD_OK;
}

static enum skd_status write_raw(const struct skd_weights *weights, struct skd_error *error)
{
    char path[SKD_PATH_BYTES_MAX];
    size_t count = weights->vertex_count * weights->slots;
    (void)snprintf(path, sizeof path, "%s.joints.u16", options.raw);
    enum skd_status status =
        skd_file_write(path, weights->joints, count * sizeof *weights->joints, error);
    if (status != SKD_OK)
        return status;
    (void)snprintf(path, sizeof path, "%s.weights.f32", options.raw);
    status = skd_file_write(path, weights->weights, count * sizeof *weights->weights, error);
    if (status == SKD_OK)
        skd_print_raw_written(options.raw, weights->vertex_count);
    return status;
}

static enum skd_status report_weights(struct skd_link *link, const char *session,
                                      const uint32_t *vertices, size_t count,
                                      struct skd_error *error)
{
    struct skd_model model;
    enum skd_status status = skd_model_open(&model, link, session, error);
    if (status == SKD_OK)
        status = skd_model_fetch_weights(&model, vertices, count, error);
    struct skd_weights weights = skd_model_weights(&model);
    if (status == SKD_OK && options.raw != NULL)
        status = write_raw(&weights, error);
    else if (status == SKD_OK && skd_cli.json)
        skd_print_json(&model.weights.message, model.weights.message.result);
    else if (status == SKD_OK)
        status = print_weights(&model, vertices, weights.vertex_count, &weights, error);
    skd_model_close(&model);
    return status;
}

/* Options that another action takes are a slip, and not to be passed over. */
static int check_options(enum action action, struct skd_error *error)
{
    const struct {
        const char *name;
        enum action action;
        bool is_given;
    } given[] = {
        {"--raw", PRINT, options.raw != NULL},
        {"--axis", MIRROR, options.axis != NULL},
        {"--from", MIRROR, options.from != NULL},
        {"--origin", MIRROR, !isnan(options.origin)},
        {"--tolerance", MIRROR, !isnan(options.tolerance)},
        {"--below", PRUNE, !isnan(options.below)},
        {"--influences", REDUCE, options.influences != 0},
        {"--by", REDUCE, options.by != NULL},
        {"--pose", REDUCE, options.poses != NULL},
    };
    int word;
    for (size_t i = 0; i < sizeof given / sizeof *given; i++) {
        if (given[i].is_given && given[i].action != action)
            return skd_cli_usage(error, "%s goes with skinctl weights %s", given[i].name,
                                 action_words[given[i].action]);
    }
    if ((options.axis != NULL &&
         skd_value_word("--axis", options.axis, skd_axis_words, &word, error) != SKD_OK) ||
        (options.from != NULL &&
         skd_value_word("--from", options.from, skd_side_words, &word, error) != SKD_OK) ||
        (options.by != NULL &&
         skd_value_word("--by", options.by, skd_reduce_by_words, &word, error) != SKD_OK))
        return SKD_EXIT_USAGE;
    if (!isnan(options.tolerance) && !(options.tolerance >= 0 && options.tolerance <= 1))
        return skd_cli_usage(error, "--tolerance takes 0 to 1");
    if (!isnan(options.below) && !(options.below >= 0 && options.below <= 1))
        return skd_cli_usage(error, "--below takes 0 to 1");
    if (action == REDUCE && !(options.influences >= 1 && options.influences <= 8))
        return skd_cli_usage(error, "weights reduce takes --influences, 1 to 8");
    return SKD_EXIT_OK;
}

static void add_text(cJSON *body, const char *name, const char *text)
{
    if (text != NULL)
        cJSON_AddStringToObject(body, name, text);
}

static void add_number(cJSON *body, const char *name, double number)
{
    if (!isnan(number))
        cJSON_AddNumberToObject(body, name, number);
}

static cJSON *edit_body(enum action action, const char *session)
{
    cJSON *body = skd_session_body(session);
    add_text(body, "axis", options.axis);
    add_text(body, "from", options.from);
    add_number(body, "origin", options.origin);
    add_number(body, "tolerance", options.tolerance);
    add_number(body, "below", options.below);
    add_text(body, "by", options.by);
    if (action == REDUCE)
        cJSON_AddNumberToObject(body, "influences", options.influences);
    skd_add_texts(body, "poses", options.poses);
    return body;
}

static void print_edited(const cJSON *result)
{
    char count[SKD_COUNT_TEXT_BYTES];
    const cJSON *moved = cJSON_GetObjectItemCaseSensitive(result, "moved");
    const cJSON *unpaired = cJSON_GetObjectItemCaseSensitive(result, "unpaired_bones"), *bone;
    skd_print_step(result);
    if (skd_json_number(result, "removed") > 0)
        printf("%s weights removed\n", skd_count_text(skd_json_number(result, "removed"), count));
    if (skd_json_number(result, "unmatched") > 0)
        printf("%s vertices have no counterpart and kept their weights\n",
               skd_count_text(skd_json_number(result, "unmatched"), count));
    cJSON_ArrayForEach(bone, unpaired) printf("bone %s has no counterpart\n", bone->valuestring);
    if (moved != NULL)
        printf("in %.0f poses this moves them by %.3g on average and %.3g at most\n",
               skd_json_number(moved, "poses"), skd_json_number(moved, "mean"),
               skd_json_number(moved, "max"));
}

static int edit_weights(enum action action, struct skd_link *link, const char *session,
                        const uint32_t *vertices, size_t count, struct skd_error *error)
{
    static const char *const methods[] = {
        [MIRROR] = "weights.mirror", [PRUNE] = "weights.prune", [REDUCE] = "weights.reduce"};
    const struct skd_array_out named = {"vertices", SKD_U32, count, 0, vertices};
    struct skd_message answer;
    enum skd_status status =
        skd_change_call(link, session, methods[action], edit_body(action, session), &named,
                        vertices != NULL, &answer, error);
    return skd_cli_conclude(link, &answer, status, print_edited);
}

static int run_weights(const char *const *arguments, int argument_count, struct skd_error *error)
{
    struct skd_link link;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    uint32_t *vertices = NULL;
    size_t count = 0;
    int action = PRINT;
    if ((argument_count > 0 &&
         skd_value_word("weights", arguments[0], action_words, &action, error) != SKD_OK) ||
        check_options((enum action)action, error) != SKD_EXIT_OK ||
        (options.vertices != NULL &&
         skd_value_indexes("--vertices", options.vertices, &vertices, &count, error) != SKD_OK))
        return SKD_EXIT_USAGE;
    int result = skd_cli_open(&link, session, error);
    if (result == SKD_EXIT_OK && action != PRINT) {
        result = edit_weights((enum action)action, &link, session, vertices, count, error);
    } else if (result == SKD_EXIT_OK) {
        result = skd_cli_exit(report_weights(&link, session, vertices, count, error));
        skd_link_close(&link);
    }
    free(vertices);
    return result;
}

const struct skd_command skd_command_weights = {
    .group = SKD_GROUP_WORK,
    .name = "weights",
    .arguments = "[print | mirror | prune | reduce]",
    .most = 1,
    .summary = "print weights, a line a vertex; mirror, prune or reduce them",
    .options = weights_options,
    .details =
        "mirror writes one side from the other and pairs bones by their names (.L and .R, _l\n"
        "and _r, Left and Right); prune takes small weights away and scales the rest to one;\n"
        "reduce leaves each vertex the influences that move it least when the others go. Each\n"
        "is one step to undo. LIST is indexes and ranges: 0,5,10-20.\n",
    .examples = "  skinctl weights --vertices 0,5,10-20\n"
                "  skinctl weights --raw body      # body.joints.u16, body.weights.f32\n"
                "  skinctl weights mirror --from -\n"
                "  skinctl weights prune --below 0.02\n"
                "  skinctl weights reduce --influences 3 --pose bent --pose raised\n",
    .run = run_weights,
};
