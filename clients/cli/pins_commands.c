/* skinctl pins, shapes: the targets that a session keeps, and what weights could not reach.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/play.h"
#include "clients/cli/print.h"
#include "clients/cli/solving.h"
#include "clients/cli/values.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct {
    char *vertices;
} options;

static const struct poptOption pins_options[] = {
    SKD_OPTION_SESSION,
    {"vertices", 'v', POPT_ARG_STRING, &options.vertices, 0,
     "weigh, clear, solve: these vertices only", "LIST"},
    SKD_OPTIONS_SOLVING,
    POPT_TABLEEND,
};

enum action { LIST, WEIGH, CLEAR, SOLVE };
static const char *const action_words[] = {"list", "weigh", "clear", "solve", NULL};

/* What the command line says; the solving of `stroke` borrows from the options. */
struct request {
    enum action action;
    struct skd_script_stroke stroke; /* pose NULL: all */
    double weight;
};

/* The pose of a list's item, and whether its name has gone to another pose since. */
enum { POSE_TEXT_BYTES = SKD_POSE_NAME_BYTES_MAX + 32 };
static const char *pose_text(const cJSON *item, char text[POSE_TEXT_BYTES])
{
    (void)snprintf(text, POSE_TEXT_BYTES, "%s%s", skd_json_text(item, "pose"),
                   cJSON_IsFalse(cJSON_GetObjectItemCaseSensitive(item, "current"))
                       ? " (as it was before)"
                       : "");
    return text;
}

static void print_pins(const cJSON *result)
{
    struct skd_table table = {.columns = 3,
                              .titles = {"pose", "vertices", "weight"},
                              .is_number = {[1] = true, [2] = true}};
    const cJSON *pins;
    cJSON_ArrayForEach(pins, cJSON_GetObjectItemCaseSensitive(result, "pins"))
    {
        char vertices[SKD_COUNT_TEXT_BYTES], weight[SKD_COUNT_TEXT_BYTES];
        char pose[POSE_TEXT_BYTES];
        skd_count_text(skd_json_number(pins, "vertices"), vertices);
        (void)snprintf(weight, sizeof weight, "%.4g", skd_json_number(pins, "weight"));
        skd_table_add(&table, (const char *const[]){pose_text(pins, pose), vertices, weight});
    }
    if (table.rows > 0)
        skd_table_print(&table, 0);
    else
        puts("nothing is pinned");
}

/* Prints an answer's vertices with a row of numbers each, and perhaps one more. */
static enum skd_status print_vertices(const struct skd_message *answer, const char *rows_name,
                                      const char *last_name, struct skd_error *error)
{
    struct skd_array vertices = {0}, rows = {0}, last = {0};
    void *owned[3] = {NULL, NULL, NULL};
    const cJSON *result = answer->result;
    enum skd_status status =
        skd_message_array(answer, result, "vertices", SKD_U32, 0, &vertices, &owned[0], error);
    if (status == SKD_OK)
        status = skd_message_array(answer, result, rows_name, SKD_F32, 3, &rows, &owned[1], error);
    if (status == SKD_OK && last_name != NULL)
        status = skd_message_array(answer, result, last_name, SKD_F32, 0, &last, &owned[2], error);
    if (status == SKD_OK &&
        (rows.rows != vertices.rows || (last_name != NULL && last.rows != vertices.rows)))
        status = skd_fail(error, SKD_INTERNAL, "skind sent arrays of different lengths");
    for (size_t i = 0; status == SKD_OK && i < vertices.rows; i++) {
        const float *row = (const float *)rows.data + 3 * i;
        printf("%u %.9g %.9g %.9g", ((const uint32_t *)vertices.data)[i], (double)row[0],
               (double)row[1], (double)row[2]);
        if (last_name != NULL)
            printf(" %.9g", (double)((const float *)last.data)[i]);
        putchar('\n');
    }
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    return status;
}

/* A method that takes a session and perhaps a pose: the summary of all, or the arrays of one. */
static int print_layers(struct skd_link *link, const char *session, const char *pose,
                        const char *list_method, const char *get_method, const char *rows_name,
                        const char *last_name, void (*print)(const cJSON *result),
                        struct skd_error *error)
{
    struct skd_message answer;
    cJSON *body = skd_session_body(session);
    if (pose != NULL)
        cJSON_AddStringToObject(body, "pose", pose);
    enum skd_status status =
        skd_link_call(link, pose != NULL ? get_method : list_method, body, NULL, 0, &answer, error);
    if (status != SKD_OK || pose == NULL || skd_cli.json)
        return skd_cli_conclude(link, &answer, status, print);
    status = print_vertices(&answer, rows_name, last_name, error);
    skd_message_finish(&answer);
    skd_link_close(link);
    return skd_cli_exit(status);
}

/* pins.weigh and pins.clear. */
static int change_pins(struct skd_link *link, const char *session, const struct request *request,
                       struct skd_error *error)
{
    const struct skd_script_stroke *stroke = &request->stroke;
    const struct skd_array_out named = {"vertices", SKD_U32, stroke->vertices_count, 0,
                                        stroke->vertices};
    struct skd_message answer;
    cJSON *body = skd_session_body(session);
    if (stroke->pose != NULL)
        cJSON_AddStringToObject(body, "pose", stroke->pose);
    if (request->action == WEIGH)
        cJSON_AddNumberToObject(body, "weight", request->weight);
    enum skd_status status =
        skd_change_call(link, session, request->action == WEIGH ? "pins.weigh" : "pins.clear", body,
                        &named, stroke->vertices != NULL, &answer, error);
    return skd_cli_conclude(link, &answer, status, skd_print_step);
}

static int solve_pins(struct skd_link *link, const char *session,
                      const struct skd_script_stroke *stroke, struct skd_error *error)
{
    struct skd_model model;
    struct skd_outcome outcome = {0};
    enum skd_status status = skd_model_open(&model, link, session, error);
    if (status == SKD_OK)
        status = skd_play_pins(&model, stroke, &outcome, error);
    if (status == SKD_OK && skd_cli.json)
        skd_print_own_json(skd_outcome_json(&outcome, stroke->pose, true));
    else if (status == SKD_OK)
        skd_outcome_print(&outcome, stroke->pose);
    skd_outcome_finish(&outcome);
    skd_model_close(&model);
    skd_link_close(link);
    return skd_cli_exit(status);
}

static int read_weight(const char *text, double *weight, struct skd_error *error)
{
    char *end;
    *weight = strtod(text, &end);
    if (end == text || *end != '\0' || !(*weight >= 0 && *weight <= SKD_PIN_WEIGHT_MAX))
        return skd_cli_usage(error, "pins weigh takes a weight of 0 to %g, not \"%.60s\"",
                             SKD_PIN_WEIGHT_MAX, text);
    return SKD_EXIT_OK;
}

/* The pose is a copy, because a stroke's texts may be changed; free it. */
static int read_request(const char *const *arguments, int count, struct request *request,
                        struct skd_error *error)
{
    static const struct {
        int least, most; /* arguments, the action included */
        const char *usage;
    } forms[] = {[LIST] = {1, 2, "[POSE]"},
                 [WEIGH] = {3, 3, "POSE WEIGHT"},
                 [CLEAR] = {1, 2, "[POSE]"},
                 [SOLVE] = {2, 2, "POSE"}};
    int action;
    *request = (struct request){0};
    if (skd_value_word("pins", arguments[0], action_words, &action, error) != SKD_OK)
        return SKD_EXIT_USAGE;
    request->action = (enum action)action;
    if (count < forms[action].least || count > forms[action].most)
        return skd_cli_usage(error, "the form is: skinctl pins %s %s", arguments[0],
                             forms[action].usage);
    if (skd_solving_apply(&request->stroke) && action != SOLVE)
        return skd_cli_usage(error, "how to solve goes with skinctl pins solve");
    if (options.vertices != NULL && action == LIST)
        return skd_cli_usage(error, "--vertices does not go with skinctl pins list");
    if (action == WEIGH && read_weight(arguments[2], &request->weight, error) != SKD_EXIT_OK)
        return SKD_EXIT_USAGE;
    if (skd_script_check_solving(&request->stroke, "pins solve", error) != SKD_OK)
        return SKD_EXIT_USAGE;
    if (options.vertices != NULL) {
        size_t vertices;
        if (skd_value_indexes("--vertices", options.vertices, &request->stroke.vertices, &vertices,
                              error) != SKD_OK)
            return SKD_EXIT_USAGE;
        request->stroke.vertices_count = (unsigned)vertices;
    }
    if (count > 1)
        request->stroke.pose = strdup(arguments[1]);
    return SKD_EXIT_OK;
}

static int run_pins(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct request request;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = read_request(arguments, count, &request, error);
    if (result == SKD_EXIT_OK)
        result = skd_cli_open(&link, session, error);
    if (result == SKD_EXIT_OK && request.action == LIST)
        result = print_layers(&link, session, request.stroke.pose, "pins.list", "pins.get",
                              "positions", "weights", print_pins, error);
    else if (result == SKD_EXIT_OK && request.action == SOLVE)
        result = solve_pins(&link, session, &request.stroke, error);
    else if (result == SKD_EXIT_OK)
        result = change_pins(&link, session, &request, error);
    free(request.stroke.vertices);
    free(request.stroke.pose);
    return result;
}

const struct skd_command skd_command_pins = {
    .group = SKD_GROUP_WORK,
    .name = "pins",
    .arguments = "list [POSE] | weigh POSE WEIGHT | clear [POSE] | solve POSE",
    .least = 1,
    .most = 3,
    .summary = "list, weigh, clear or solve the targets that strokes left in each pose",
    .options = pins_options,
    .details =
        "A vertex that was sculpted in several poses has a pin in each, and every stroke solves\n"
        "it for all of them. list POSE prints index, x, y, z and weight of each pin. A weight is\n"
        "how much a pin counts (1 at first). Weighing and clearing change no skin weights before\n"
        "the next stroke or solve. LIST is indexes and ranges: 0,5,10-20.\n",
    .examples = "  skinctl pins list\n"
                "  skinctl pins weigh bent 0.5\n"
                "  skinctl pins clear raised --vertices 0-99\n"
                "  skinctl pins solve bent --slots evidence\n",
    .run = run_pins,
};

static void print_shapes(const cJSON *result)
{
    char vertices[SKD_COUNT_TEXT_BYTES];
    struct skd_table table = {
        .columns = 2, .titles = {"pose", "vertices"}, .is_number = {[1] = true}};
    const cJSON *shape;
    cJSON_ArrayForEach(shape, cJSON_GetObjectItemCaseSensitive(result, "shapes"))
    {
        char pose[POSE_TEXT_BYTES];
        skd_count_text(skd_json_number(shape, "vertices"), vertices);
        skd_table_add(&table, (const char *const[]){pose_text(shape, pose), vertices});
    }
    if (table.rows > 0)
        skd_table_print(&table, 0);
    else
        puts("there are no corrective shapes");
    printf("%s vertices have another rest position\n",
           skd_count_text(skd_json_number(result, "rest_moved"), vertices));
}

static int run_shapes(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    return print_layers(&link, session, count > 0 ? arguments[0] : NULL, "shapes.list",
                        "shapes.get", "offsets", NULL, print_shapes, error);
}

static const struct poptOption shapes_options[] = {
    SKD_OPTION_SESSION,
    POPT_TABLEEND,
};

const struct skd_command skd_command_shapes = {
    .group = SKD_GROUP_WORK,
    .name = "shapes",
    .arguments = "[POSE]",
    .most = 1,
    .summary = "list the corrective shapes that strokes made, or print one's offsets",
    .options = shapes_options,
    .details = "A stroke with --residual shape keeps what weights could not reach as a corrective\n"
               "shape of its pose, which export writes as a morph target. With POSE: index and\n"
               "x, y, z of the offset, in the mesh's rest space.\n",
    .examples = "  skinctl stroke bent --bone shin.L --radius 0.1 --out 0.01 --residual shape\n"
                "  skinctl shapes\n"
                "  skinctl shapes bent\n",
    .run = run_shapes,
};
