/* See play.h. */
#include "clients/cli/play.h"

#include "clients/cli/cli.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void skd_outcome_finish(struct skd_outcome *outcome)
{
    skd_message_finish(&outcome->answer);
    *outcome = (struct skd_outcome){0};
}

static bool script_makes(const struct skd_script *script, const char *pose)
{
    for (unsigned i = 0; i < script->poses_count; i++) {
        if (strcmp(script->poses[i].name, pose) == 0)
            return true;
    }
    return false;
}

static enum skd_status check_pose(const struct skd_model *model, const struct skd_script_pose *pose,
                                  const char *where, struct skd_error *error)
{
    if (pose->clip != NULL && !skd_model_has_clip(model, pose->clip))
        return skd_fail(error, SKD_NO_CLIP,
                        "%s: session \"%s\" has no clip \"%.80s\" (skinctl info names them)", where,
                        model->session, pose->clip);
    if (pose->matrices != NULL && pose->matrices_count != model->bone_count)
        return skd_fail(error, SKD_COUNT_MISMATCH, "%s \"%s\": there are %u matrices for %zu bones",
                        where, pose->name, pose->matrices_count, model->bone_count);
    return SKD_OK;
}

static enum skd_status check_bone(const struct skd_model *model, const char *bone,
                                  const char *where, struct skd_error *error)
{
    struct skd_error found;
    int index, parent;
    if (skd_model_find_bone(model, bone, &index, &parent, &found) == SKD_OK)
        return SKD_OK;
    return skd_fail(error, found.status, "%s: %.280s", where, found.text);
}

static enum skd_status check_stroke(const struct skd_model *model, const struct skd_script *script,
                                    const struct skd_script_stroke *stroke, const char *where,
                                    struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    if (!script_makes(script, stroke->pose) && !skd_model_has_pose(model, stroke->pose))
        return skd_fail(error, SKD_NO_POSE,
                        "%s: neither the script nor session \"%s\" has a pose \"%s\"", where,
                        model->session, stroke->pose);
    if (stroke->brush != NULL && stroke->brush->bone != NULL)
        status = check_bone(model, stroke->brush->bone, where, error);
    for (unsigned i = 0; status == SKD_OK && i < stroke->lock_bones_count; i++)
        status = check_bone(model, stroke->lock_bones[i], where, error);
    for (unsigned i = 0; status == SKD_OK && i < stroke->vertices_count; i++) {
        if (stroke->vertices[i] >= model->vertex_count)
            status = skd_fail(error, SKD_BAD_INDEX, "%s: vertex %u is not one of the %zu", where,
                              stroke->vertices[i], model->vertex_count);
    }
    return status;
}

enum skd_status skd_play_check(struct skd_model *model, const struct skd_script *script,
                               const char *path, struct skd_error *error)
{
    char where[SKD_ERROR_TEXT_BYTES / 4];
    enum skd_status status = SKD_OK;
    for (unsigned i = 0; status == SKD_OK && i < script->poses_count; i++) {
        (void)snprintf(where, sizeof where, "%.60s, pose %u", path, i + 1);
        status = check_pose(model, &script->poses[i], where, error);
    }
    for (unsigned i = 0; status == SKD_OK && i < script->strokes_count; i++) {
        (void)snprintf(where, sizeof where, "%.60s, stroke %u", path, i + 1);
        status = check_stroke(model, script, &script->strokes[i], where, error);
    }
    return status;
}

enum skd_status skd_play_pose(struct skd_model *model, const struct skd_script_pose *pose,
                              struct skd_error *error)
{
    struct skd_message answer;
    const struct skd_array_out matrices = {"matrices", SKD_F64, pose->matrices_count, 16,
                                           pose->matrices};
    cJSON *body = skd_session_body(model->session);
    cJSON_AddStringToObject(body, "pose", pose->name);
    if (pose->clip != NULL) {
        cJSON_AddStringToObject(body, "clip", pose->clip);
        cJSON_AddNumberToObject(body, "time", *pose->time);
    }
    if (pose->bend != NULL)
        cJSON_AddNumberToObject(body, "bend", *pose->bend);
    if (pose->seed != NULL)
        cJSON_AddNumberToObject(body, "seed", *pose->seed);
    enum skd_status status =
        skd_model_call(model, "pose.set", body, &matrices, pose->matrices != NULL, &answer, error);
    skd_message_finish(&answer);
    return status;
}

static enum skd_status read_brush(struct skd_model *model, const struct skd_script_brush *given,
                                  const float *posed, struct skd_brush *brush,
                                  struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    int falloff = SKD_FALLOFF_SMOOTH, bone, parent;
    *brush =
        (struct skd_brush){.radius = *given->radius, .out = given->out != NULL ? *given->out : 0};
    if (given->falloff != NULL)
        status = skd_value_word("falloff", given->falloff, skd_falloff_words, &falloff, error);
    brush->falloff = (enum skd_falloff)falloff;
    if (given->move != NULL)
        memcpy(brush->move, given->move, sizeof brush->move);
    if (status != SKD_OK)
        return status;
    if (given->bone == NULL) {
        memcpy(brush->centre, given->centre, sizeof brush->centre);
        return SKD_OK;
    }
    if ((status = skd_model_find_bone(model, given->bone, &bone, &parent, error)) != SKD_OK ||
        (status = skd_model_fetch_weights(model, NULL, 0, error)) != SKD_OK)
        return status;
    struct skd_weights weights = skd_model_weights(model);
    if (!skd_bone_centre(&weights, posed, bone, parent, brush->centre))
        return skd_fail(error, SKD_BAD_PARAMS, "bone \"%s\" moves no vertex, so it has no place",
                        given->bone);
    return SKD_OK;
}

/* The pose as it is now, under the brush. */
static enum skd_status apply_brush(struct skd_model *model, const struct skd_script_stroke *stroke,
                                   struct skd_brushed *brushed, struct skd_error *error)
{
    struct skd_brush brush;
    struct skd_fetched posed;
    enum skd_status status = skd_model_evaluate(model, stroke->pose, NULL, 0, &posed, error);
    if (status == SKD_OK)
        status = read_brush(model, stroke->brush, posed.array.data, &brush, error);
    if (status == SKD_OK && brush.out != 0)
        status = skd_model_fetch_mesh(model, error);
    if (status == SKD_OK) {
        const struct skd_surface surface = {.vertex_count = model->vertex_count,
                                            .rest = model->rest.array.data,
                                            .posed = posed.array.data,
                                            .triangle_count = model->triangles.rows,
                                            .triangles = model->triangles.data};
        status = skd_brush_apply(&brush, &surface, brushed, error);
    }
    if (status == SKD_OK && brushed->count == 0)
        status = skd_fail(error, SKD_BAD_PARAMS,
                          "the brush touches nothing: no vertex of pose \"%s\" is within %g of "
                          "%g,%g,%g; the nearest is %g away",
                          stroke->pose, brush.radius, brush.centre[0], brush.centre[1],
                          brush.centre[2], brushed->nearest);
    skd_fetched_finish(&posed);
    return status;
}

/* Counts the weights that stream in. */
struct streaming {
    struct skd_progress progress;
    double request; /* whose they are */
    size_t streamed;
};

static void on_weights(void *user, const struct skd_message *message)
{
    struct streaming *streaming = user;
    if (strcmp(message->method, "stroke.weights") != 0)
        return;
    double total = skd_json_number(message->params, "total");
    double request = skd_json_number(message->params, "request");
    if (request != streaming->request)
        streaming->streamed = 0; /* what came before a connection was lost */
    streaming->request = request;
    streaming->streamed += (size_t)skd_json_number(message->params, "count");
    if (total > 0)
        skd_progress_set(&streaming->progress, (double)streaming->streamed / total);
}

static void add_text(cJSON *body, const char *name, const char *text)
{
    if (text != NULL)
        cJSON_AddStringToObject(body, name, text);
}

static void add_number(cJSON *body, const char *name, const double *number)
{
    if (number != NULL)
        cJSON_AddNumberToObject(body, name, *number);
}

/* What stroke.apply and pins.solve both take. */
static cJSON *solve_body(const struct skd_model *model, const struct skd_script_stroke *stroke)
{
    cJSON *body = skd_session_body(model->session);
    cJSON_AddStringToObject(body, "pose", stroke->pose);
    add_text(body, "constraint", stroke->constraint);
    add_number(body, "stiffness", stroke->stiffness);
    add_text(body, "slots", stroke->slots);
    add_number(body, "guard", stroke->guard);
    add_number(body, "smooth", stroke->smooth);
    add_text(body, "residual", stroke->residual);
    if (stroke->lock_bones_count > 0)
        cJSON_AddItemToObject(body, "locked_bones",
                              cJSON_CreateStringArray((const char *const *)stroke->lock_bones,
                                                      (int)stroke->lock_bones_count));
    return body;
}

static cJSON *stroke_body(const struct skd_model *model, const struct skd_script_stroke *stroke)
{
    cJSON *body = solve_body(model, stroke);
    add_text(body, "method", stroke->method);
    add_text(body, "pin", stroke->pin);
    add_number(body, "mix", stroke->mix);
    return body;
}

enum skd_status skd_play_call(struct skd_model *model, const char *method, cJSON *body,
                              const struct skd_array_out *arrays, int array_count,
                              struct skd_outcome *outcome, struct skd_error *error)
{
    struct streaming streaming = {0};
    *outcome = (struct skd_outcome){0};
    skd_progress_begin(&streaming.progress, "solving");
    model->link->notify = on_weights;
    model->link->user = &streaming;
    skd_add_sequence(body);
    double begun = skd_clock_s();
    enum skd_status status =
        skd_model_call(model, method, body, arrays, array_count, &outcome->answer, error);
    outcome->round_trip_ms = 1e3 * (skd_clock_s() - begun);
    outcome->streamed = streaming.streamed;
    model->link->notify = NULL;
    skd_progress_end(&streaming.progress);
    return status;
}

enum skd_status skd_play_stroke(struct skd_model *model, const struct skd_script_stroke *stroke,
                                struct skd_outcome *outcome, struct skd_error *error)
{
    struct skd_brushed brushed = {0};
    enum skd_status status = SKD_OK;
    *outcome = (struct skd_outcome){0};
    if (stroke->brush != NULL)
        status = apply_brush(model, stroke, &brushed, error);
    if (status == SKD_OK) {
        bool is_brushed = stroke->brush != NULL;
        size_t count = is_brushed ? brushed.count : stroke->vertices_count;
        const struct skd_array_out arrays[] = {
            {"vertices", SKD_U32, count, 0, is_brushed ? brushed.vertices : stroke->vertices},
            {"positions", SKD_F32, count, 3,
             is_brushed ? brushed.positions : &stroke->positions[0][0]},
            {"mask", SKD_F32, stroke->mask_count, 0, stroke->mask},
        };
        status = skd_play_call(model, "stroke.apply", stroke_body(model, stroke), arrays,
                               stroke->mask_count > 0 ? 3 : 2, outcome, error);
    }
    skd_brushed_finish(&brushed);
    return status;
}

enum skd_status skd_play_pins(struct skd_model *model, const struct skd_script_stroke *stroke,
                              struct skd_outcome *outcome, struct skd_error *error)
{
    const struct skd_array_out named = {"vertices", SKD_U32, stroke->vertices_count, 0,
                                        stroke->vertices};
    return skd_play_call(model, "pins.solve", solve_body(model, stroke), &named,
                         stroke->vertices != NULL, outcome, error);
}

/* An array of the answer in the place of the reference to it. */
static void spell_out(cJSON *json, const struct skd_message *answer, const char *name)
{
    struct skd_array array;
    struct skd_error ignored;
    void *owned;
    cJSON_DeleteItemFromObjectCaseSensitive(json, name);
    if (skd_message_array(answer, answer->result, name, SKD_F32, 0, &array, &owned, &ignored) ==
            SKD_OK &&
        array.data != NULL)
        cJSON_AddItemToObject(json, name, cJSON_CreateFloatArray(array.data, (int)array.count));
    free(owned);
}

cJSON *skd_outcome_json(const struct skd_outcome *outcome, const char *pose, bool with_residuals)
{
    cJSON *json = cJSON_Duplicate(outcome->answer.result, true);
    if (with_residuals)
        spell_out(json, &outcome->answer, "residuals");
    else
        cJSON_DeleteItemFromObjectCaseSensitive(json, "residuals");
    cJSON_AddStringToObject(json, "pose", pose);
    cJSON_AddNumberToObject(json, "streamed", (double)outcome->streamed);
    cJSON_AddNumberToObject(json, "round_trip_ms", outcome->round_trip_ms);
    return json;
}

/* What people read of an outcome. */
struct figures {
    char vertices[SKD_COUNT_TEXT_BYTES];
    char unreached[SKD_COUNT_TEXT_BYTES];
    double ms;
    double before_mean, before_max;
    double after_mean, after_max;
};

static struct figures read_figures(const struct skd_outcome *outcome)
{
    const cJSON *result = outcome->answer.result;
    const cJSON *residual = cJSON_GetObjectItemCaseSensitive(result, "residual");
    const cJSON *before = cJSON_GetObjectItemCaseSensitive(residual, "before");
    const cJSON *after = cJSON_GetObjectItemCaseSensitive(residual, "after");
    struct figures figures = {
        .ms = skd_json_number(cJSON_GetObjectItemCaseSensitive(result, "ms"), "total"),
        .before_mean = skd_json_number(before, "mean"),
        .before_max = skd_json_number(before, "max"),
        .after_mean = skd_json_number(after, "mean"),
        .after_max = skd_json_number(after, "max"),
    };
    skd_count_text(skd_json_number(result, "vertices"), figures.vertices);
    skd_count_text(skd_json_number(result, "unreached"), figures.unreached);
    return figures;
}

/* How it was solved, and what else changed. */
static void print_solved(const cJSON *result)
{
    static const struct {
        const char *member, *text;
    } counts[] = {{"slots_changed", "with other bones"},
                  {"rest_moved", "with another rest position"},
                  {"shaped", "shaped"}};
    double poses = skd_json_number(result, "poses");
    printf("; stiffness %.3g", skd_json_number(result, "stiffness"));
    if (poses > 1)
        printf(", %.0f poses", poses);
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        char text[SKD_COUNT_TEXT_BYTES];
        double count = skd_json_number(result, counts[i].member);
        if (count > 0)
            printf("; %s %s", skd_count_text(count, text), counts[i].text);
    }
}

static void say_warnings(const cJSON *result)
{
    const cJSON *warning;
    cJSON_ArrayForEach(warning, cJSON_GetObjectItemCaseSensitive(result, "warnings"))
        skd_cli_say("warning: %s", skd_json_text(warning, "text"));
}

void skd_outcome_print(const struct skd_outcome *outcome, const char *pose)
{
    struct figures figures = read_figures(outcome);
    printf("%s: %s vertices in %.2f ms; residual mean %.3e -> %.3e, max %.3e -> %.3e; "
           "%s unreached",
           pose, figures.vertices, figures.ms, figures.before_mean, figures.after_mean,
           figures.before_max, figures.after_max, figures.unreached);
    print_solved(outcome->answer.result);
    printf("; revision %.0f\n", skd_json_number(outcome->answer.result, "revision"));
    say_warnings(outcome->answer.result);
}

void skd_outcome_print_titles(int pose_width)
{
    printf("%3s  %-*s  %9s  %8s  %21s  %21s  %9s\n", "", pose_width, "", "", "", "residual before",
           "residual after", "");
    printf("%3s  %-*s  %9s  %8s  %10s %10s  %10s %10s  %9s\n", "#", pose_width, "pose", "vertices",
           "ms", "mean", "max", "mean", "max", "unreached");
    fflush(stdout);
}

void skd_outcome_print_line(const struct skd_outcome *outcome, size_t number, const char *pose,
                            int pose_width)
{
    struct figures figures = read_figures(outcome);
    printf("%3zu  %-*s  %9s  %8.2f  %10.3e %10.3e  %10.3e %10.3e  %9s\n", number, pose_width, pose,
           figures.vertices, figures.ms, figures.before_mean, figures.before_max,
           figures.after_mean, figures.after_max, figures.unreached);
    fflush(stdout);
    say_warnings(outcome->answer.result);
}
