/* skinctl refit: solves a whole mesh from a clip and where its points are in it.
 *
 * Stage: the client's side: the clip's poses are set, the positions sent. Thread: one.
 *
 *     FILE.pc2 ── positions, a sample a pose ──┐
 *     clip, times ── pose.set, a sample a pose ┴─> session.refit ─> session.export
 */
#include "clients/cli/cli.h"
#include "clients/cli/pc2.h"
#include "clients/cli/play.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include "protocol/request.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    MESSAGE_BYTES = 1 << 20, /* of a request beside its positions; more than any has */
};

static const double fps_default = 24, fps_max = 1e6;

static struct {
    char *clip;
    double fps;
    char *times;
    char *positions;
    int step;
    char *slots;
    double stiffness;
    int rounds;
    int influences;
    char *reduce;
    char *output;
} options = {.fps = (double)NAN, .stiffness = (double)NAN, .step = 1};

static const struct poptOption refit_options[] = {
    SKD_OPTION_SESSION,
    {"clip", 'c', POPT_ARG_STRING, &options.clip, 0, "the clip that moves the bones", "CLIP"},
    {"positions", 'p', POPT_ARG_STRING, &options.positions, 0,
     "where the mesh's points are, as a PC2 point cache (-: stdin)", "FILE.pc2"},
    {"fps", 0, POPT_ARG_DOUBLE, &options.fps, 0,
     "the cache's frames a second; its first sample is the clip's beginning (default: 24)", "N"},
    {"times", 't', POPT_ARG_STRING, &options.times, 0,
     "... or the clip's time for each sample, in seconds", "T,T,..."},
    {"step", 0, POPT_ARG_INT, &options.step, 0, "take every N-th sample only (default: 1)", "N"},
    {"slots", 0, POPT_ARG_STRING, &options.slots, 0,
     "evidence (default): choose each vertex's bones anew; or keep them", "RULE"},
    {"stiffness", 'k', POPT_ARG_DOUBLE, &options.stiffness, 0,
     "how hard weights hold on to what they were, 0 to 10 (default: chosen from the data)", "K"},
    {"rounds", 'n', POPT_ARG_INT, &options.rounds, 0,
     "how often bones are looked for, 1 to 16 (default: 3)", "N"},
    {"influences", 'i', POPT_ARG_INT, &options.influences, 0,
     "with a file: weights a vertex, 4 (default) or 8", "N"},
    {"reduce", 'r', POPT_ARG_STRING, &options.reduce, 0,
     "with a file: more influences than slots: refuse (default), largest, posed", "RULE"},
    {"output", 'o', POPT_ARG_STRING, &options.output, 0,
     "write the glTF file here (with a file: its name with -skind, in the current folder)", "FILE"},
    POPT_TABLEEND,
};

/* A refit on its way. */
struct refit {
    struct skd_model model;
    struct skd_pc2 cache;
    double *times; /* [time_count], of --times; NULL: by --fps */
    size_t time_count;
    char **poses; /* [cache.count] names, owned */
};

static int check_options(bool has_file, struct skd_error *error)
{
    int word;
    if (options.clip == NULL || options.positions == NULL)
        return skd_cli_usage(error,
                             "refit takes --clip and --positions (see skinctl refit --help)");
    if (!isnan(options.fps) && options.times != NULL)
        return skd_cli_usage(error, "give --fps or --times, not both");
    if (!isnan(options.fps) && !(options.fps > 0 && options.fps <= fps_max))
        return skd_cli_usage(error, "--fps takes frames a second, above 0");
    if (options.step < 1)
        return skd_cli_usage(error, "--step takes 1 and above");
    if (options.rounds < 0 || options.rounds > SKD_REFIT_ROUNDS_MAX)
        return skd_cli_usage(error, "--rounds takes 1 to %d", SKD_REFIT_ROUNDS_MAX);
    if (!isnan(options.stiffness) &&
        !(options.stiffness >= 0 && options.stiffness <= SKD_STIFFNESS_MAX))
        return skd_cli_usage(error, "--stiffness takes 0 to %g", SKD_STIFFNESS_MAX);
    if (has_file && skd_cli.session != NULL)
        return skd_cli_usage(error, "give a file or --session, not both");
    if (!has_file && (options.influences != 0 || options.reduce != NULL))
        return skd_cli_usage(error, "--influences and --reduce go with a file");
    if (options.influences != 0 && options.influences != 4 && options.influences != 8)
        return skd_cli_usage(error, "--influences is 4 or 8, not %d", options.influences);
    if ((options.slots != NULL &&
         skd_value_word("--slots", options.slots, skd_slots_words, &word, error) != SKD_OK) ||
        (options.reduce != NULL &&
         skd_value_word("--reduce", options.reduce, skd_reduce_words, &word, error) != SKD_OK))
        return SKD_EXIT_USAGE;
    return SKD_EXIT_OK;
}

/* The clip's duration, or the error that it is not there. */
static enum skd_status find_clip(const struct skd_model *model, double *duration,
                                 struct skd_error *error)
{
    const cJSON *clip;
    cJSON_ArrayForEach(clip, cJSON_GetObjectItemCaseSensitive(model->info.result, "clips"))
    {
        if (strcmp(skd_json_text(clip, "name"), options.clip) == 0) {
            *duration = skd_json_number(clip, "duration");
            return SKD_OK;
        }
    }
    return skd_fail(error, SKD_NO_CLIP,
                    "session \"%s\" has no clip \"%.80s\" (skinctl info names them)",
                    model->session, options.clip);
}

/* The clip's time at a sample that was read. */
static double time_of(const struct refit *refit, size_t index)
{
    size_t sample = index * refit->cache.step;
    if (refit->times != NULL)
        return refit->times[sample];
    return (double)sample * refit->cache.rate / (isnan(options.fps) ? fps_default : options.fps);
}

/* That every sample has a time, and the clip lasts as long. */
static enum skd_status check_times(const struct refit *refit, double duration,
                                   struct skd_error *error)
{
    const size_t samples = refit->cache.samples;
    if (refit->times != NULL && refit->time_count != samples)
        return skd_fail(error, SKD_COUNT_MISMATCH, "--times names %zu times for %zu samples",
                        refit->time_count, samples);
    for (size_t i = 0; i < refit->cache.count; i++) {
        /* Half a frame of grace, for durations that were rounded. */
        if (!(time_of(refit, i) <= duration + 0.5 / fps_default))
            return skd_fail(error, SKD_BAD_PARAMS,
                            "sample %zu is at %.3f s, but clip \"%s\" ends at %.3f s; say when "
                            "the samples are with --fps or --times",
                            i * refit->cache.step, time_of(refit, i), options.clip, duration);
    }
    return SKD_OK;
}

static enum skd_status read_cache(struct refit *refit, struct skd_error *error)
{
    const struct skd_model *model = &refit->model;
    double duration = 0;
    enum skd_status status = find_clip(model, &duration, error);
    if (status != SKD_OK)
        return status;
    size_t bytes = 3 * sizeof(float) * model->vertex_count;
    size_t fitting = ((size_t)SKD_FRAME_BYTES_MAX - MESSAGE_BYTES) / bytes;
    const struct skd_pc2_wanted wanted = {
        .points = model->vertex_count,
        .step = (size_t)options.step,
        .count_most = fitting < SKD_TARGET_POSES_MAX ? fitting : SKD_TARGET_POSES_MAX,
    };
    status = skd_pc2_read(options.positions, &wanted, &refit->cache, error);
    return status == SKD_OK ? check_times(refit, duration, error) : status;
}

/* Makes the poses "refit-0", "refit-1", ... */
static enum skd_status set_poses(struct refit *refit, struct skd_error *error)
{
    struct skd_progress progress;
    enum skd_status status = SKD_OK;
    refit->poses = calloc(refit->cache.count, sizeof *refit->poses);
    if (refit->poses == NULL)
        return skd_fail_memory(error, "the poses' names");
    skd_progress_begin(&progress, "posing");
    for (size_t i = 0; status == SKD_OK && i < refit->cache.count; i++) {
        char name[SKD_POSE_NAME_BYTES_MAX];
        double time = time_of(refit, i);
        (void)snprintf(name, sizeof name, "refit-%zu", i * refit->cache.step);
        refit->poses[i] = strdup(name);
        if (refit->poses[i] == NULL) {
            status = skd_fail_memory(error, "a pose's name");
            break;
        }
        const struct skd_script_pose pose = {.name = name, .clip = options.clip, .time = &time};
        status = skd_play_pose(&refit->model, &pose, error);
        skd_progress_set(&progress, (double)i / (double)refit->cache.count);
    }
    skd_progress_end(&progress);
    return status;
}

static cJSON *refit_body(const struct refit *refit)
{
    cJSON *body = skd_session_body(refit->model.session);
    cJSON_AddItemToObject(
        body, "poses",
        cJSON_CreateStringArray((const char *const *)refit->poses, (int)refit->cache.count));
    if (options.slots != NULL)
        cJSON_AddStringToObject(body, "slots", options.slots);
    if (!isnan(options.stiffness))
        cJSON_AddNumberToObject(body, "stiffness", options.stiffness);
    if (options.rounds != 0)
        cJSON_AddNumberToObject(body, "rounds", options.rounds);
    return body;
}

/* Poses, solve, and the file if one is wanted. *json is given with --json, and then filled. */
static enum skd_status play_refit(struct refit *refit, const char *output, cJSON *json,
                                  struct skd_error *error)
{
    struct skd_model *model = &refit->model;
    struct skd_outcome outcome = {0};
    struct skd_message exported = {0};
    char vertices[SKD_COUNT_TEXT_BYTES], title[2 * SKD_COUNT_TEXT_BYTES];
    enum skd_status status = read_cache(refit, error);
    if (status == SKD_OK)
        status = set_poses(refit, error);
    if (status != SKD_OK)
        return status;
    skd_cli_say("refitting %s vertices to %zu poses of clip %s ...",
                skd_count_text((double)model->vertex_count, vertices), refit->cache.count,
                options.clip);
    const struct skd_array_out positions = {
        "positions", SKD_F32, refit->cache.count * refit->cache.points, 3, refit->cache.positions};
    status =
        skd_play_call(model, "session.refit", refit_body(refit), &positions, 1, &outcome, error);
    (void)snprintf(title, sizeof title, "%zu poses", refit->cache.count);
    if (status == SKD_OK && json != NULL)
        cJSON_AddItemToObject(json, "refit", skd_outcome_json(&outcome, options.clip, false));
    else if (status == SKD_OK)
        skd_outcome_print(&outcome, title);
    if (status == SKD_OK && output != NULL) {
        status = skd_session_export(model, output, &exported, error);
        if (status == SKD_OK && json != NULL)
            cJSON_AddItemToObject(json, "export", cJSON_Duplicate(exported.result, true));
        else if (status == SKD_OK)
            skd_print_exported(exported.result);
    }
    skd_message_finish(&exported);
    skd_outcome_finish(&outcome);
    return status;
}

/* A session of the file's own, which is closed when the file is written. */
static enum skd_status load_file(struct skd_link *link, const char *file,
                                 char session[SKD_SESSION_NAME_BYTES_MAX + 1],
                                 struct skd_error *error)
{
    char path[SKD_PATH_BYTES_MAX];
    struct skd_message answer;
    enum skd_status status = skd_path_absolute(file, path, error);
    if (status != SKD_OK)
        return status;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "file", path);
    if (options.influences != 0)
        cJSON_AddNumberToObject(body, "influences", options.influences);
    if (options.reduce != NULL)
        cJSON_AddStringToObject(body, "reduce", options.reduce);
    status = skd_link_call(link, "session.create", body, NULL, 0, &answer, error);
    if (status == SKD_OK)
        (void)snprintf(session, SKD_SESSION_NAME_BYTES_MAX + 1, "%s",
                       skd_json_text(answer.result, "session"));
    skd_message_finish(&answer);
    return status;
}

static void close_own(struct skd_link *link, const char *session)
{
    struct skd_message answer;
    struct skd_error ignored;
    if (skd_link_call(link, "session.delete", skd_session_body(session), NULL, 0, &answer,
                      &ignored) != SKD_OK)
        skd_cli_say("session %s stays open: %s", session, ignored.text);
    skd_message_finish(&answer);
}

static int refit_session(struct skd_link *link, const char *session, bool is_own,
                         struct refit *refit, struct skd_error *error)
{
    char output[SKD_PATH_BYTES_MAX];
    bool has_output = options.output != NULL || is_own;
    cJSON *json = skd_cli.json ? cJSON_CreateObject() : NULL;
    enum skd_status status = skd_model_open(&refit->model, link, session, error);
    if (status == SKD_OK && has_output)
        status = options.output != NULL ? skd_path_absolute(options.output, output, error)
                                        : skd_default_output(&refit->model, output, error);
    if (status == SKD_OK)
        status = play_refit(refit, has_output ? output : NULL, json, error);
    if (status == SKD_OK && json != NULL)
        skd_print_json(NULL, json);
    cJSON_Delete(json);
    skd_model_close(&refit->model);
    if (is_own)
        close_own(link, session);
    skd_link_close(link);
    return skd_cli_exit(status);
}

static int run_refit(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct refit refit = {0};
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    int result = check_options(count > 0, error);
    if (result == SKD_EXIT_OK && options.times != NULL &&
        skd_value_numbers("--times", options.times, &refit.times, &refit.time_count, error) !=
            SKD_OK)
        result = SKD_EXIT_USAGE;
    if (result != SKD_EXIT_OK)
        return result;
    if (count == 0) {
        result = skd_cli_open(&link, session, error);
    } else {
        result = skd_cli_exit(skd_cli_connect(&link, error));
        if (result == SKD_EXIT_OK && load_file(&link, arguments[0], session, error) != SKD_OK) {
            skd_link_close(&link);
            result = SKD_EXIT_FAILED;
        }
    }
    if (result == SKD_EXIT_OK)
        result = refit_session(&link, session, count > 0, &refit, error);
    for (size_t i = 0; refit.poses != NULL && i < refit.cache.count; i++)
        free(refit.poses[i]);
    free(refit.poses);
    free(refit.times);
    skd_pc2_finish(&refit.cache);
    return result;
}

const struct skd_command skd_command_refit = {
    .group = SKD_GROUP_WORK,
    .name = "refit",
    .arguments = "[FILE]",
    .most = 1,
    .summary = "solve all weights from a clip of posed meshes (a PC2 point cache)",
    .options = refit_options,
    .details =
        "The job of baking a deformation into skin weights: bones move as the clip says, the\n"
        "mesh as the cache says, in the scene's space and in the order of the file's vertices\n"
        "(skinctl info counts them). With FILE (.glb, .gltf) it is loaded, refitted, written and\n"
        "closed again; else the open session is refitted, one step to undo, and keeps poses by\n"
        "the names refit-0, refit-1, and so on. Prints the distance of the vertices to the cache\n"
        "before and after.\n",
    .examples =
        "  skinctl refit knight.glb --clip walk --positions walk.pc2 -o knight-refit.glb\n"
        "  skinctl refit knight.glb --clip walk --positions walk.pc2 --fps 30 --step 5\n"
        "  skinctl refit --session knight --clip walk --positions p.pc2 --times 0,0.25,0.5\n",
    .run = run_refit,
};
