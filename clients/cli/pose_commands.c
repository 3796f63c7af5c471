/* skinctl pose: makes a pose, or prints its positions.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/play.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct {
    char *clip;
    double time;
    double bend;
    int seed;
    char *matrices;
    char *vertices;
    char *raw;
    int evaluate;
} options = {.time = (double)NAN, .bend = (double)NAN};

static const struct poptOption pose_options[] = {
    SKD_OPTION_SESSION,
    {"clip", 'c', POPT_ARG_STRING, &options.clip, 0, "make the pose from this clip ...", "CLIP"},
    {"time", 't', POPT_ARG_DOUBLE, &options.time, 0, "... at this time", "SECONDS"},
    {"bend", 'b', POPT_ARG_DOUBLE, &options.bend, 0,
     "make it by bending every joint, each about an axis of its own", "DEGREES"},
    {"seed", 0, POPT_ARG_INT, &options.seed, 0, "which axes --bend takes (default: 0)", "N"},
    {"matrices", 'm', POPT_ARG_STRING, &options.matrices, 0,
     "make it from bone matrices: a JSON list of 16 numbers a bone, row by row (-: stdin)", "FILE"},
    {"evaluate", 'e', POPT_ARG_NONE, &options.evaluate, 0,
     "print the posed positions, x y z a vertex", NULL},
    {"vertices", 'v', POPT_ARG_STRING, &options.vertices, 0, "of these vertices only", "LIST"},
    {"raw", 0, POPT_ARG_STRING, &options.raw, 0,
     "write them into a file instead: float32, little-endian", "FILE"},
    POPT_TABLEEND,
};

/* Bone matrices out of a JSON file, in the form that the wire takes too. */
static enum skd_status read_matrices(const char *path, struct skd_script_pose *pose,
                                     struct skd_error *error)
{
    char *text = NULL;
    size_t bytes;
    cJSON *tree = NULL;
    void *numbers = NULL;
    struct skd_array array;
    enum skd_status status = skd_file_read(path, &text, &bytes, error);
    if (status == SKD_OK)
        status = skd_value_json(path, text, bytes, &tree, error);
    if (status == SKD_OK) {
        /* The wire's own reader, with the file for a method's name in its errors. */
        const struct skd_message message = {.method = path};
        cJSON *holder = cJSON_CreateObject();
        cJSON_AddItemToObject(holder, "matrices", tree);
        status =
            skd_message_array(&message, holder, "matrices", SKD_F64, 16, &array, &numbers, error);
        cJSON_Delete(holder);
    }
    free(text);
    if (status != SKD_OK)
        return status;
    pose->matrices = numbers;
    pose->matrices_count = (unsigned)array.rows;
    return SKD_OK;
}

static enum skd_status set_pose(struct skd_model *model, const char *name, struct skd_error *error)
{
    char pose_name[SKD_PATH_BYTES_MAX];
    uint32_t seed = (uint32_t)options.seed;
    struct skd_script_pose pose = {.name = pose_name, .clip = options.clip, .time = &options.time};
    if (!isnan(options.bend)) {
        pose.bend = &options.bend;
        pose.seed = &seed;
    }
    (void)snprintf(pose_name, sizeof pose_name, "%s", name);
    enum skd_status status = SKD_OK;
    if (options.matrices != NULL)
        status = read_matrices(options.matrices, &pose, error);
    if (status == SKD_OK)
        status = skd_play_pose(model, &pose, error);
    free(pose.matrices);
    return status;
}

static void print_positions(const struct skd_array *positions)
{
    const float *numbers = positions->data;
    for (size_t i = 0; i < positions->rows; i++)
        printf("%.9g %.9g %.9g\n", (double)numbers[3 * i], (double)numbers[3 * i + 1],
               (double)numbers[3 * i + 2]);
}

static enum skd_status write_positions(const struct skd_array *positions, struct skd_error *error)
{
    enum skd_status status =
        skd_file_write(options.raw, positions->data, positions->count * sizeof(float), error);
    if (status == SKD_OK)
        skd_print_raw_written(options.raw, positions->rows);
    return status;
}

static enum skd_status evaluate_pose(struct skd_model *model, const char *name,
                                     const uint32_t *vertices, size_t count,
                                     struct skd_error *error)
{
    struct skd_fetched positions;
    enum skd_status status = skd_model_evaluate(model, name, vertices, count, &positions, error);
    if (status == SKD_OK && options.raw != NULL)
        status = write_positions(&positions.array, error);
    else if (status == SKD_OK && skd_cli.json)
        skd_print_json(&positions.message, positions.message.result);
    else if (status == SKD_OK)
        print_positions(&positions.array);
    skd_fetched_finish(&positions);
    return status;
}

static int check_pose_options(struct skd_error *error)
{
    bool has_time = !isnan(options.time), has_bend = !isnan(options.bend);
    int sources = (options.clip != NULL) + has_bend + (options.matrices != NULL);
    if ((options.clip != NULL) != has_time)
        return skd_cli_usage(error, "a pose from a clip takes --clip and --time");
    if (sources > 1)
        return skd_cli_usage(error, "give one of --clip and --time, --bend, and --matrices");
    if (has_bend && !(fabs(options.bend) <= 180 && options.seed >= 0))
        return skd_cli_usage(error, "--bend takes -180 to 180 degrees, --seed 0 and above");
    if (sources == 0 && !options.evaluate)
        return skd_cli_usage(error, "say what the pose is, with --clip and --time, --bend or "
                                    "--matrices, or --evaluate it");
    if (!options.evaluate && (options.raw != NULL || options.vertices != NULL))
        return skd_cli_usage(error, "--raw and --vertices go with --evaluate");
    return SKD_EXIT_OK;
}

/* --vertices, if it was given. */
static int read_vertices(uint32_t **vertices, size_t *count, struct skd_error *error)
{
    *vertices = NULL;
    *count = 0;
    if (options.vertices == NULL ||
        skd_value_indexes("--vertices", options.vertices, vertices, count, error) == SKD_OK)
        return SKD_EXIT_OK;
    return SKD_EXIT_USAGE;
}

static int run_pose(const char *const *arguments, int argument_count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_model model;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    uint32_t *vertices;
    size_t count;
    (void)argument_count;
    int result = check_pose_options(error);
    if (result == SKD_EXIT_OK)
        result = read_vertices(&vertices, &count, error);
    if (result != SKD_EXIT_OK)
        return result;
    result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        goto done;
    enum skd_status status = skd_model_open(&model, &link, session, error);
    if (status == SKD_OK &&
        (options.clip != NULL || options.matrices != NULL || !isnan(options.bend)))
        status = set_pose(&model, arguments[0], error);
    if (status == SKD_OK && options.evaluate)
        status = evaluate_pose(&model, arguments[0], vertices, count, error);
    else if (status == SKD_OK && skd_cli.json) {
        cJSON *json = cJSON_CreateObject();
        cJSON_AddStringToObject(json, "pose", arguments[0]);
        skd_print_own_json(json);
    }
    skd_model_close(&model);
    skd_link_close(&link);
    result = skd_cli_exit(status);
done:
    free(vertices);
    return result;
}

const struct skd_command skd_command_pose = {
    .group = SKD_GROUP_WORK,
    .name = "pose",
    .arguments = "NAME",
    .least = 1,
    .most = 1,
    .summary = "make a pose, from a clip for instance, or print its positions",
    .options = pose_options,
    .details = "The pose \"rest\" is always there. A pose of the same name is replaced.\n"
               "LIST is indexes and ranges: 0,5,10-20.\n",
    .examples = "  skinctl pose bent --clip bend --time 0.5\n"
                "  skinctl pose bowed --bend 25 --seed 1          # for a rig without clips\n"
                "  skinctl pose bent --evaluate --vertices 0-9\n"
                "  skinctl pose own --matrices matrices.json --evaluate --raw positions.f32\n",
    .run = run_pose,
};
