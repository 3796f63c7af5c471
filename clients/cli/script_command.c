/* skinctl script: an example script for a session, made from its own clips and surface.
 *
 * Stage: the client's side. Thread: one.
 *
 *     clips x times ─► poses far from rest and from each other ─► where the surface deforms most
 *                      (distances between points: blind to       and bones share it ─► brushes
 *                       where the whole character is)
 */
#include "base/utf8.h"
#include "clients/cli/cli.h"
#include "clients/cli/play.h"
#include "clients/cli/print.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    POSES = 3,
    STROKES_MAX = 1000,
    PAIRS = 512,          /* of points whose distances describe a pose */
    BENDS = 8,            /* poses that are looked at where the clips are not enough */
    CANDIDATES = 48,      /* moments of clips that are looked at */
    TIMES_A_CLIP = 8,     /* at most */
    CLIP_BYTES_KEPT = 40, /* of a clip's name in a pose's */
};

static const char probe_name[] = "skinctl-probe";
static const double bend_degrees = 25;
static const double radius_over_length = 0.05, move_over_length = 0.01;
static const double radius_over_edge = 1.5;    /* at least, on a coarse surface */
static const double spacing_over_radius = 1.5; /* between the centres of one pose's brushes */
static const double strain_floor = 0.01; /* so that places without strain are told apart too */

static struct {
    int strokes;
} options = {.strokes = 6};

static const struct poptOption script_options[] = {
    SKD_OPTION_SESSION,
    {"strokes", 'n', POPT_ARG_INT, &options.strokes, 0, "how many strokes, 1 to 1000 (default: 6)",
     "N"},
    POPT_TABLEEND,
};

/* A moment of a clip, or all joints bent; and the distances that describe it. */
struct moment {
    const char *clip; /* NULL: bent */
    double time;
    uint32_t seed;
    double distances[PAIRS];
};

/* Everything that is found out about the session. */
struct study {
    struct skd_model *model;
    uint32_t points[2 * PAIRS]; /* pairs of vertices */
    double rest[PAIRS];         /* the rest pose's distances */
    struct moment moments[CANDIDATES + BENDS];
    size_t moment_count;
    const struct moment *chosen[POSES];
    size_t chosen_count;
    struct skd_fetched rest_surface; /* all positions in the rest pose */
    struct skd_fetched surfaces[POSES];
    double *scores[POSES]; /* [vertex]; how much it deforms where bones share it */
};

/* Names and single numbers: a run without memory for these ends here. */
static void *must_have(void *memory)
{
    SKD_ASSERT(memory != NULL);
    return memory;
}

static double distance_between(const float *a, const float *b)
{
    double x = (double)a[0] - (double)b[0];
    double y = (double)a[1] - (double)b[1];
    double z = (double)a[2] - (double)b[2];
    return sqrt(x * x + y * y + z * z);
}

/* The same pairs each time for the same number of vertices. */
static void choose_points(struct study *study)
{
    uint64_t state = 0x9E3779B97F4A7C15;
    for (size_t i = 0; i < 2 * PAIRS; i++) {
        state = state * 6364136223846793005 + 1442695040888963407;
        study->points[i] = (uint32_t)((state >> 33) % study->model->vertex_count);
    }
}

static enum skd_status measure_pose(struct study *study, const char *pose, double *distances,
                                    struct skd_error *error)
{
    struct skd_fetched fetched;
    enum skd_status status =
        skd_model_evaluate(study->model, pose, study->points, 2 * PAIRS, &fetched, error);
    const float *positions = fetched.array.data;
    for (size_t i = 0; status == SKD_OK && i < PAIRS; i++)
        distances[i] = distance_between(positions + 6 * i, positions + 6 * i + 3);
    skd_fetched_finish(&fetched);
    return status;
}

/* A number with few digits, so that a person can read it. */
static double short_number(double number)
{
    char text[32];
    (void)snprintf(text, sizeof text, "%.5g", number);
    return strtod(text, NULL);
}

static double *copy_numbers(const double *numbers, size_t count)
{
    double *copy = must_have(malloc(count * sizeof *copy));
    for (size_t i = 0; i < count; i++)
        copy[i] = short_number(numbers[i]);
    return copy;
}

/* A moment in a script's form; its memory is the script's. */
static struct skd_script_pose pose_of(const struct moment *moment, const char *name)
{
    struct skd_script_pose pose = {.name = must_have(strdup(name))};
    if (moment->clip != NULL) {
        pose.clip = must_have(strdup(moment->clip));
        pose.time = copy_numbers(&moment->time, 1);
    } else {
        pose.bend = copy_numbers(&bend_degrees, 1);
        pose.seed = must_have(malloc(sizeof *pose.seed));
        *pose.seed = moment->seed;
    }
    return pose;
}

/* Makes the probe's pose of a moment. */
static enum skd_status set_probe(const struct study *study, const struct moment *moment,
                                 struct skd_error *error)
{
    struct skd_script_pose pose = pose_of(moment, probe_name);
    enum skd_status status = skd_play_pose(study->model, &pose, error);
    free(pose.name);
    free(pose.clip);
    free(pose.time);
    free(pose.bend);
    free(pose.seed);
    return status;
}

static enum skd_status look_at(struct study *study, struct moment *moment, struct skd_error *error)
{
    enum skd_status status = set_probe(study, moment, error);
    return status == SKD_OK ? measure_pose(study, probe_name, moment->distances, error) : status;
}

/* Looks at moments spread evenly over the clips. */
static enum skd_status look_at_clips(struct study *study, struct skd_error *error)
{
    const cJSON *clips = cJSON_GetObjectItemCaseSensitive(study->model->info.result, "clips");
    int clip_count = cJSON_GetArraySize(clips);
    int stride = (clip_count + CANDIDATES - 1) / CANDIDATES;
    int times = clip_count > 0 ? CANDIDATES / clip_count : 0;
    times = times < 1 ? 1 : times > TIMES_A_CLIP ? TIMES_A_CLIP : times;
    enum skd_status status = measure_pose(study, "rest", study->rest, error);
    struct skd_progress progress;
    skd_progress_begin(&progress, "looking at the clips");
    for (int i = 0; status == SKD_OK && i < clip_count * times; i++) {
        const cJSON *clip = cJSON_GetArrayItem(clips, i / times);
        if (i / times % stride != 0 || study->moment_count == CANDIDATES)
            continue;
        struct moment *moment = &study->moments[study->moment_count++];
        moment->clip = skd_json_text(clip, "name");
        double time = skd_json_number(clip, "duration") * (i % times + 0.5) / times;
        moment->time = round(1e3 * time) / 1e3;
        status = look_at(study, moment, error);
        skd_progress_set(&progress, (double)i / (clip_count * times));
    }
    skd_progress_end(&progress);
    return status;
}

/* For a rig whose clips are not enough: all joints bent. */
static enum skd_status look_at_bends(struct study *study, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (uint32_t seed = 1; status == SKD_OK && seed <= BENDS; seed++) {
        struct moment *moment = &study->moments[study->moment_count++];
        *moment = (struct moment){.seed = seed};
        status = look_at(study, moment, error);
    }
    return status;
}

static double compare(const double *a, const double *b)
{
    double sum = 0;
    for (size_t i = 0; i < PAIRS; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum / PAIRS);
}

/* How far a moment is from the rest pose and from what is chosen already. */
static double novelty_of(const struct study *study, const struct moment *moment)
{
    double least = compare(moment->distances, study->rest);
    for (size_t i = 0; i < study->chosen_count; i++)
        least = fmin(least, compare(moment->distances, study->chosen[i]->distances));
    return least;
}

static void choose_moments(struct study *study)
{
    while (study->chosen_count < POSES) {
        const struct moment *best = NULL;
        double most = 1e-6 * study->model->length; /* nearer is the same pose */
        for (size_t i = 0; i < study->moment_count; i++) {
            double novelty = novelty_of(study, &study->moments[i]);
            if (novelty > most) {
                most = novelty;
                best = &study->moments[i];
            }
        }
        if (best == NULL)
            break;
        study->chosen[study->chosen_count++] = best;
    }
}

/* 0 where one bone carries the vertex, more where several share it. */
static double sharing_at(const struct skd_weights *weights, size_t vertex)
{
    double squares = 0;
    for (size_t slot = vertex * weights->slots; slot < (vertex + 1) * weights->slots; slot++)
        squares += (double)weights->weights[slot] * (double)weights->weights[slot];
    return fmax(1 - squares, 0);
}

/* Score of each vertex: how much its edges are stretched or squeezed in the pose, times how much
 * bones share it. */
static double *score_surface(const struct study *study, const float *posed)
{
    const struct skd_model *model = study->model;
    const struct skd_weights weights = skd_model_weights(model);
    const float *rest = study->rest_surface.array.data;
    const uint32_t *corners = model->triangles.data;
    double *change = calloc(model->vertex_count, sizeof *change);
    double *length = calloc(model->vertex_count, sizeof *length);
    for (size_t i = 0; change != NULL && length != NULL && i < model->triangles.count; i++) {
        size_t a = corners[i], b = corners[i % 3 < 2 ? i + 1 : i - 2];
        double before = distance_between(rest + 3 * a, rest + 3 * b);
        double after = distance_between(posed + 3 * a, posed + 3 * b);
        change[a] += fabs(after - before);
        change[b] += fabs(after - before);
        length[a] += before;
        length[b] += before;
    }
    for (size_t i = 0; change != NULL && length != NULL && i < model->vertex_count; i++) {
        double strain = length[i] > 0 ? change[i] / length[i] : 0;
        change[i] = (strain + strain_floor) * sharing_at(&weights, i);
    }
    if (length == NULL) {
        free(change);
        return NULL;
    }
    free(length);
    return change;
}

/* Fetches the surface in the poses that were chosen, or in the rest pose, and scores it. */
static enum skd_status study_surfaces(struct study *study, struct skd_error *error)
{
    enum skd_status status = skd_model_fetch_mesh(study->model, error);
    if (status == SKD_OK)
        status = skd_model_fetch_weights(study->model, NULL, 0, error);
    if (status == SKD_OK)
        status = skd_model_evaluate(study->model, "rest", NULL, 0, &study->rest_surface, error);
    size_t count = study->chosen_count > 0 ? study->chosen_count : 1;
    for (size_t i = 0; status == SKD_OK && i < count; i++) {
        const char *pose = study->chosen_count > 0 ? probe_name : "rest";
        if (study->chosen_count > 0)
            status = set_probe(study, study->chosen[i], error);
        if (status == SKD_OK)
            status = skd_model_evaluate(study->model, pose, NULL, 0, &study->surfaces[i], error);
        if (status == SKD_OK &&
            (study->scores[i] = score_surface(study, study->surfaces[i].array.data)) == NULL)
            status = skd_fail_memory(error, "the scores of the vertices");
    }
    return status;
}

static void finish_study(struct study *study)
{
    for (size_t i = 0; i < POSES; i++) {
        skd_fetched_finish(&study->surfaces[i]);
        free(study->scores[i]);
    }
    skd_fetched_finish(&study->rest_surface);
}

/* The vertex with the best score; then rules out what is around it, for the brushes to come. */
static size_t take_place(struct study *study, size_t pose, double spacing)
{
    const float *rest = study->rest_surface.array.data;
    double *scores = study->scores[pose];
    size_t best = 0;
    for (size_t i = 1; i < study->model->vertex_count; i++) {
        if (scores[i] > scores[best])
            best = i;
    }
    for (size_t i = 0; i < study->model->vertex_count; i++) {
        /* Pushed below all others and not to one value: when all is taken, the order is kept. */
        if (distance_between(rest + 3 * i, rest + 3 * best) < spacing)
            scores[i] -= 1e3;
    }
    return best;
}

/* The name of a bone at the vertex whose parent has weight there too; NULL when there is none. */
static const char *joint_at(const struct study *study, size_t vertex)
{
    const struct skd_weights weights = skd_model_weights(study->model);
    const cJSON *bones = cJSON_GetObjectItemCaseSensitive(study->model->info.result, "bones");
    const size_t first = vertex * weights.slots, end = first + weights.slots;
    for (size_t slot = first; slot < end; slot++) {
        const cJSON *bone = cJSON_GetArrayItem(bones, weights.joints[slot]);
        double parent = bone != NULL ? skd_json_number(bone, "parent") : -1;
        for (size_t other = first; weights.weights[slot] > 0 && other < end; other++) {
            if (weights.joints[other] == parent && weights.weights[other] > 0)
                return skd_json_text(bone, "name");
        }
    }
    return NULL;
}

/* The longest edge at a vertex, so that a brush on a coarse surface reaches the neighbours. */
static double edge_at(const struct study *study, const float *posed, size_t vertex)
{
    const uint32_t *corners = study->model->triangles.data;
    double longest = 0;
    for (size_t i = 0; i < study->model->triangles.count; i += 3) {
        if (corners[i] != vertex && corners[i + 1] != vertex && corners[i + 2] != vertex)
            continue;
        for (size_t k = i; k < i + 3; k++)
            longest =
                fmax(longest, distance_between(posed + 3 * vertex, posed + 3 * (size_t)corners[k]));
    }
    return longest;
}

/* Brushes take turns: out, in, a sideways move, and every sixth finds its place by a bone. */
static struct skd_script_brush *make_brush(struct study *study, size_t pose, size_t number)
{
    double length = study->model->length;
    double radius = radius_over_length * length;
    double out = (number % 3 == 1 ? -1 : 1) * move_over_length * length;
    double move[3] = {0, move_over_length * length, 0}, centre[3];
    size_t vertex = take_place(study, pose, spacing_over_radius * radius);
    const float *posed = study->surfaces[pose].array.data;
    radius = fmax(radius, radius_over_edge * edge_at(study, posed, vertex));
    const char *bone = number % 6 == 3 ? joint_at(study, vertex) : NULL;
    bool is_move = number % 3 == 2;
    for (size_t k = 0; k < 3; k++)
        centre[k] = (double)posed[3 * vertex + k];
    struct skd_script_brush *brush = must_have(calloc(1, sizeof *brush));
    brush->radius = copy_numbers(&radius, 1);
    brush->falloff = must_have(strdup(is_move ? "sharp" : "smooth"));
    brush->centre = bone == NULL ? copy_numbers(centre, 3) : NULL;
    brush->bone = bone != NULL ? must_have(strdup(bone)) : NULL;
    brush->move = is_move ? copy_numbers(move, 3) : NULL;
    brush->out = is_move ? NULL : copy_numbers(&out, 1);
    return brush;
}

/* "bend" at 0.5 s is the pose "bend-0.5"; names that were too long get a number as well. */
static void add_pose(struct skd_script *script, const struct moment *moment)
{
    struct skd_script_pose *pose = &script->poses[script->poses_count++];
    int kept = moment->clip != NULL ? skd_utf8_quote(moment->clip, CLIP_BYTES_KEPT) : 0;
    char name[SKD_POSE_NAME_BYTES_MAX + 1];
    if (moment->clip == NULL)
        (void)snprintf(name, sizeof name, "bent-%u", moment->seed);
    else if (moment->clip[kept] == '\0')
        (void)snprintf(name, sizeof name, "%s-%g", moment->clip, moment->time);
    else
        (void)snprintf(name, sizeof name, "%.*s-%g-%u", kept, moment->clip, moment->time,
                       script->poses_count);
    *pose = pose_of(moment, name);
}

static struct skd_script *make_script(struct study *study)
{
    struct skd_script *script = must_have(calloc(1, sizeof *script));
    script->poses = must_have(calloc(POSES, sizeof *script->poses));
    script->strokes = must_have(calloc((size_t)options.strokes, sizeof *script->strokes));
    for (size_t i = 0; i < study->chosen_count; i++)
        add_pose(script, study->chosen[i]);
    for (size_t i = 0; i < (size_t)options.strokes; i++) {
        struct skd_script_stroke *stroke = &script->strokes[script->strokes_count++];
        size_t pose = study->chosen_count > 0 ? i % study->chosen_count : 0;
        stroke->pose =
            must_have(strdup(study->chosen_count > 0 ? script->poses[pose].name : "rest"));
        stroke->brush = make_brush(study, pose, i);
    }
    return script;
}

static void write_script(struct study *study)
{
    const struct skd_script_setting setting = {
        .session = study->model->session,
        .source = skd_json_text(study->model->info.result, "source"),
        .length = study->model->length,
        .vertex_count = study->model->vertex_count};
    struct skd_script *script = make_script(study);
    if (study->chosen_count == 0)
        skd_cli_say("neither clips nor bent joints change the surface, so the strokes are in the "
                    "rest pose");
    if (skd_cli.json)
        skd_script_write_json(script);
    else
        skd_script_write(script, &setting);
    skd_script_destroy(script);
}

static int run_script(const char *const *arguments, int count, struct skd_error *error)
{
    static struct study study;
    struct skd_link link;
    struct skd_model model;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    (void)arguments;
    (void)count;
    if (options.strokes < 1 || options.strokes > STROKES_MAX)
        return skd_cli_usage(error, "--strokes takes 1 to %d", STROKES_MAX);
    int result = skd_cli_open(&link, session, error);
    if (result != SKD_EXIT_OK)
        return result;
    study.model = &model;
    enum skd_status status = skd_model_open(&model, &link, session, error);
    if (status == SKD_OK) {
        choose_points(&study);
        status = look_at_clips(&study, error);
    }
    if (status == SKD_OK) {
        choose_moments(&study);
        if (study.chosen_count < POSES) {
            status = look_at_bends(&study, error);
            choose_moments(&study);
        }
    }
    if (status == SKD_OK) {
        status = study_surfaces(&study, error);
    }
    if (status == SKD_OK)
        write_script(&study);
    finish_study(&study);
    skd_model_close(&model);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_script = {
    .group = SKD_GROUP_SCRIPTS,
    .name = "script",
    .arguments = "",
    .summary = "print an example script for a session, to replay or to edit",
    .options = script_options,
    .details = "Takes three moments of the character's clips that differ most (where clips do not\n"
               "move it: three poses with all joints bent), and puts brushes where the surface\n"
               "deforms and bones share it. No weight is changed; the pose\n"
               "skinctl-probe stays behind in the session.\n",
    .examples = "  skinctl script > strokes.yaml\n"
                "  skinctl script --strokes 100 | skinctl replay -\n",
    .run = run_script,
};
