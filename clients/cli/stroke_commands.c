/* skinctl stroke, replay: poses and strokes into a session.
 *
 * Thread: one. A stroke on the command line is a script's stroke that was written differently.
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
    char *centre;
    char *bone;
    double radius;
    char *falloff;
    char *move;
    double out;
    double in;
    char *vertices;
    char **vertex;
    char *export;
} options = {.radius = (double)NAN, .out = (double)NAN, .in = (double)NAN};

static const struct poptOption stroke_options[] = {
    SKD_OPTION_SESSION,
    {"centre", 'c', POPT_ARG_STRING, &options.centre, 0, "the brush's place on the posed surface",
     "X,Y,Z"},
    {"bone", 'b', POPT_ARG_STRING, &options.bone, 0,
     "... or where this bone and its parent share the surface", "NAME"},
    {"radius", 'r', POPT_ARG_DOUBLE, &options.radius, 0, "how far the brush reaches", "R"},
    {"falloff", 'f', POPT_ARG_STRING, &options.falloff, 0,
     "smooth (default), linear, constant, sphere or sharp", "SHAPE"},
    {"move", 'm', POPT_ARG_STRING, &options.move, 0, "displacement at the centre", "DX,DY,DZ"},
    {"out", 'o', POPT_ARG_DOUBLE, &options.out, 0, "... or along the surface's normals", "D"},
    {"in", 'i', POPT_ARG_DOUBLE, &options.in, 0, "... or against them", "D"},
    {"vertices", 'v', POPT_ARG_STRING, &options.vertices, 0,
     "no brush: a file of lines \"index x y z\" or \"index x y z mask\" (-: stdin)", "FILE"},
    {"vertex", 'x', POPT_ARG_ARGV, &options.vertex, 0,
     "no brush: one vertex and its new posed position; may be repeated", "INDEX=X,Y,Z"},
    SKD_OPTIONS_SCULPT,
    SKD_OPTIONS_SOLVING,
    POPT_TABLEEND,
};

/* --vertices and --vertex. */
static int read_targets(struct skd_targets *targets, struct skd_error *error)
{
    if (options.vertices != NULL && skd_targets_read(targets, options.vertices, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    for (unsigned i = 0; i < skd_count_texts(options.vertex); i++) {
        if (skd_targets_add(targets, "--vertex", options.vertex[i], error) != SKD_OK)
            return SKD_EXIT_USAGE;
    }
    return SKD_EXIT_OK;
}

/* The brush's options; *brush borrows from the other arguments and from the options. */
static int read_brush(struct skd_script_brush *brush, double centre[3], double move[3],
                      struct skd_error *error)
{
    bool has_out = !isnan(options.out), has_in = !isnan(options.in);
    if (isnan(options.radius))
        return skd_cli_usage(error, "a brush takes --radius (see skinctl stroke --help)");
    if (has_out && has_in)
        return skd_cli_usage(error, "give --out or --in, not both");
    if (has_in)
        options.out = -options.in;
    *brush = (struct skd_script_brush){.bone = options.bone,
                                       .radius = &options.radius,
                                       .falloff = options.falloff,
                                       .out = has_out || has_in ? &options.out : NULL};
    if (options.centre != NULL) {
        if (skd_value_vector("--centre", options.centre, centre, error) != SKD_OK)
            return SKD_EXIT_USAGE;
        brush->centre = centre;
    }
    if (options.move != NULL) {
        if (skd_value_vector("--move", options.move, move, error) != SKD_OK)
            return SKD_EXIT_USAGE;
        brush->move = move;
    }
    return SKD_EXIT_OK;
}

static int play_one(const struct skd_script_stroke *stroke, struct skd_error *error)
{
    struct skd_link link;
    struct skd_model model;
    struct skd_outcome outcome = {0};
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    enum skd_status status = skd_model_open(&model, &link, session, error);
    if (status == SKD_OK)
        status = skd_play_stroke(&model, stroke, &outcome, error);
    if (status == SKD_OK && skd_cli.json) {
        skd_print_own_json(skd_outcome_json(&outcome, stroke->pose, true));
    } else if (status == SKD_OK) {
        skd_outcome_print(&outcome, stroke->pose);
    }
    skd_outcome_finish(&outcome);
    skd_model_close(&model);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

static int run_stroke(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_targets targets = {0};
    struct skd_script_brush brush;
    double centre[3], move[3];
    bool has_targets = options.vertices != NULL || options.vertex != NULL;
    bool has_brush = options.centre != NULL || options.bone != NULL || options.move != NULL ||
                     !isnan(options.radius) || !isnan(options.out) || !isnan(options.in);
    (void)count;
    if (has_targets == has_brush)
        return skd_cli_usage(error, "give a brush (--centre or --bone, --radius, --move, --out or "
                                    "--in), or else --vertices or --vertex");
    char *pose = strdup(arguments[0]);
    struct skd_script_stroke stroke = {
        .pose = pose,
        .brush = has_brush ? &brush : NULL,
    };
    (void)skd_solving_apply(&stroke);
    int result =
        has_brush ? read_brush(&brush, centre, move, error) : read_targets(&targets, error);
    stroke.vertices = targets.vertices;
    stroke.positions = (float(*)[3])targets.positions;
    stroke.vertices_count = stroke.positions_count = (unsigned)targets.count;
    if (targets.has_mask) {
        stroke.mask = targets.mask;
        stroke.mask_count = (unsigned)targets.count;
    }
    if (result == SKD_EXIT_OK && skd_script_check_stroke(&stroke, "the stroke", error) != SKD_OK)
        result = SKD_EXIT_USAGE;
    if (result == SKD_EXIT_OK)
        result = play_one(&stroke, error);
    skd_targets_finish(&targets);
    free(pose);
    return result;
}

const struct skd_command skd_command_stroke = {
    .group = SKD_GROUP_WORK,
    .name = "stroke",
    .arguments = "POSE",
    .least = 1,
    .most = 1,
    .summary = "move part of a posed surface and solve the weights for it",
    .options = stroke_options,
    .details =
        "Only vertices that the brush moves are sent; all lengths are scene units (skinctl\n"
        "info tells the character's). Prints how many vertices were solved, how far they\n"
        "were from their targets before and after, and how many weights cannot take there.\n"
        "A stroke pins its vertices in its pose, so that strokes in other poses keep them in\n"
        "mind (skinctl pins --help).\n",
    .examples =
        "  skinctl stroke bent --centre 0.3,1.2,0.05 --radius 0.08 --move 0,0,0.01\n"
        "  skinctl stroke bent --bone forearm.L --radius 0.1 --out 0.01 --lock-bone hand.L\n"
        "  skinctl stroke bent --vertex 12=0.1,1.0,0.2 --vertex 13=0.1,1.1,0.2\n"
        "  skinctl stroke bent --bone thigh.L --radius 0.2 --in 0.01 --slots evidence --guard 1\n"
        "  skinctl pose bent --evaluate | awk '{print NR-1, $1, $2, $3 + 0.01}' |\n"
        "    skinctl stroke bent --vertices -\n",
    .run = run_stroke,
};

static const struct poptOption replay_options[] = {
    SKD_OPTION_SESSION,
    {"export", 'o', POPT_ARG_STRING, &options.export, 0, "then write the session's glTF file here",
     "FILE"},
    SKD_OPTIONS_SCULPT,
    SKD_OPTIONS_SOLVING,
    POPT_TABLEEND,
};

static int pose_width_of(const struct skd_script *script)
{
    size_t width = strlen("pose");
    for (unsigned i = 0; i < script->strokes_count; i++) {
        if (strlen(script->strokes[i].pose) > width)
            width = strlen(script->strokes[i].pose);
    }
    return (int)width;
}

/* Plays the strokes, each with a line or, for `report`, an object. */
static enum skd_status play_strokes(struct skd_model *model, const struct skd_script *script,
                                    cJSON *report, struct skd_error *error)
{
    int width = pose_width_of(script);
    enum skd_status status = SKD_OK;
    if (report == NULL)
        skd_outcome_print_titles(width);
    for (unsigned i = 0; status == SKD_OK && i < script->strokes_count; i++) {
        struct skd_outcome outcome;
        struct skd_error found;
        struct skd_script_stroke stroke = script->strokes[i];
        (void)skd_solving_apply(&stroke);
        status = skd_play_stroke(model, &stroke, &outcome, &found);
        if (status != SKD_OK)
            (void)skd_fail(error, status, "stroke %u: %.300s; the %u before it were applied", i + 1,
                           found.text, i);
        else if (report != NULL)
            cJSON_AddItemToArray(report, skd_outcome_json(&outcome, stroke.pose, false));
        else
            skd_outcome_print_line(&outcome, i + 1, stroke.pose, width);
        skd_outcome_finish(&outcome);
    }
    return status;
}

static enum skd_status export_played(struct skd_model *model, const char *path, cJSON *report,
                                     struct skd_error *error)
{
    struct skd_message answer;
    enum skd_status status = skd_session_export(model, path, &answer, error);
    if (status == SKD_OK && report != NULL)
        cJSON_AddItemToObject(report, "export", cJSON_Duplicate(answer.result, true));
    else if (status == SKD_OK)
        skd_print_exported(answer.result);
    skd_message_finish(&answer);
    return status;
}

static enum skd_status play_script(struct skd_model *model, const struct skd_script *script,
                                   const char *path, const char *export_path, cJSON *report,
                                   struct skd_error *error)
{
    enum skd_status status = skd_play_check(model, script, path, error);
    for (unsigned i = 0; status == SKD_OK && i < script->poses_count; i++)
        status = skd_play_pose(model, &script->poses[i], error);
    if (status == SKD_OK) {
        cJSON *strokes = NULL;
        if (report != NULL) {
            cJSON_AddStringToObject(report, "session", model->session);
            strokes = cJSON_AddArrayToObject(report, "strokes");
        }
        status = play_strokes(model, script, strokes, error);
    }
    if (status == SKD_OK && export_path != NULL)
        status = export_played(model, export_path, report, error);
    return status;
}

static int replay(const struct skd_script *script, const char *path, const char *export_path,
                  struct skd_error *error)
{
    struct skd_link link;
    struct skd_model model;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    cJSON *report = skd_cli.json ? cJSON_CreateObject() : NULL;
    enum skd_status status = skd_model_open(&model, &link, session, error);
    if (status == SKD_OK)
        status = play_script(&model, script, path, export_path, report, error);
    if (status == SKD_OK && report != NULL)
        skd_print_json(NULL, report);
    cJSON_Delete(report);
    skd_model_close(&model);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

static int run_replay(const char *const *arguments, int count, struct skd_error *error)
{
    char *text;
    char export_path[SKD_PATH_BYTES_MAX];
    size_t bytes;
    struct skd_script *script;
    struct skd_script_stroke asked = {0};
    (void)count;
    if (skd_solving_apply(&asked) &&
        skd_script_check_solving(&asked, "the options", error) != SKD_OK)
        return SKD_EXIT_USAGE;
    if ((options.export != NULL &&
         skd_path_absolute(options.export, export_path, error) != SKD_OK) ||
        skd_file_read(arguments[0], &text, &bytes, error) != SKD_OK)
        return SKD_EXIT_FAILED;
    const char *name = strcmp(arguments[0], "-") == 0 ? "the script" : arguments[0];
    enum skd_status status = skd_script_parse(name, text, bytes, &script, error);
    free(text);
    if (status != SKD_OK)
        return SKD_EXIT_FAILED;
    int result = replay(script, name, options.export != NULL ? export_path : NULL, error);
    skd_script_destroy(script);
    return result;
}

const struct skd_command skd_command_replay = {
    .group = SKD_GROUP_SCRIPTS,
    .name = "replay",
    .arguments = "SCRIPT",
    .least = 1,
    .most = 1,
    .summary = "apply a script of strokes (-: from stdin), a line a stroke",
    .options = replay_options,
    .details = skd_script_format,
    .examples = "  skinctl script > strokes.yaml      # one that fits the session, to start from\n"
                "  skinctl replay strokes.yaml --export out.glb\n"
                "  skinctl replay strokes.yaml --method thesis --json   # the options go above the "
                "script's\n",
    .run = run_replay,
};
