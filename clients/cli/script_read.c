/* See script.h: text to script. The schema below is what libcyaml holds the text against. */
#include "clients/cli/script.h"

#include "clients/cli/brush.h"
#include "clients/cli/values.h"
#include "protocol/request.h"

#include <cyaml/cyaml.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

const char skd_script_format[] =
    "A script is YAML (or JSON). Lengths are scene units:\n"
    "  poses:                        # made before the first stroke; may be left out: the pose\n"
    "    - name: bent                # rest and those of the session are there already\n"
    "      clip: bend\n"
    "      time: 0.5                 # seconds\n"
    "    # - name: bowed             # ... or with every joint bent about an axis of its own\n"
    "    #   bend: 25                # degrees\n"
    "    #   seed: 1                 # which axes; any whole number\n"
    "    # - name: own               # ... or by matrices, one a bone, to the scene, row by row\n"
    "    #   matrices: [[1, 0, 0, 0,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]]\n"
    "  strokes:                      # applied one after the other\n"
    "    - pose: bent\n"
    "      brush:\n"
    "        centre: [0.1, 1.2, 0]   # on the posed surface\n"
    "        # bone: forearm.L       # ... or where that bone and its parent share the surface\n"
    "        radius: 0.08\n"
    "        falloff: smooth         # smooth (default), linear, constant, sphere, sharp\n"
    "        move: [0, 0, 0.01]      # at the centre, and less towards the radius\n"
    "        # out: 0.01             # ... or along the surface's normals; negative: inwards\n"
    "      method: exact             # or thesis\n"
    "      constraint: simplex       # or affine: weights may be negative\n"
    "      stiffness: 0.008          # 0 to 10: how hard weights hold on to what they were; left\n"
    "                                # out: chosen from the data\n"
    "      pin: set                  # or move: by as much as the brush moves what is shown; none\n"
    "      slots: keep               # or evidence: bones are chosen anew from all poses' pins\n"
    "      guard: 0.3                # 0 to 1000: how much the guard poses count, if there are "
    "any\n"
    "      smooth: 0                 # 0 to 10: neighbours change alike\n"
    "      mix: 1                    # 0 to 1: how far to go from the surface to the targets\n"
    "      residual: report          # or rest, shape: what becomes of what weights cannot reach\n"
    "      lock_bones: [head]        # their weights stay\n"
    "    - pose: bent                # no brush: vertices, and where each should be\n"
    "      vertices: [7, 8]\n"
    "      positions: [[0, 1, 0], [0.1, 1, 0]]\n"
    "      mask: [1, 0.5]            # how far each of them goes; left out: all the way\n";

enum { OPTIONAL = CYAML_FLAG_OPTIONAL | CYAML_FLAG_POINTER };

static const double bend_max = 180; /* the wire's own limit */

static const cyaml_schema_value_t number_schema = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};
static const cyaml_schema_value_t coordinate_schema = {
    CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, float)};
static const cyaml_schema_value_t index_schema = {CYAML_VALUE_UINT(CYAML_FLAG_DEFAULT, uint32_t)};
static const cyaml_schema_value_t text_schema = {
    CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char, 1, CYAML_UNLIMITED)};
static const cyaml_schema_value_t matrix_schema = {
    CYAML_VALUE_SEQUENCE_FIXED(CYAML_FLAG_DEFAULT, double, &number_schema, 16)};
static const cyaml_schema_value_t position_schema = {
    CYAML_VALUE_SEQUENCE_FIXED(CYAML_FLAG_DEFAULT, float, &coordinate_schema, 3)};

static const cyaml_schema_field_t pose_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, struct skd_script_pose, name, 1,
                           SKD_POSE_NAME_BYTES_MAX),
    CYAML_FIELD_STRING_PTR("clip", OPTIONAL, struct skd_script_pose, clip, 0, CYAML_UNLIMITED),
    CYAML_FIELD_FLOAT_PTR("time", OPTIONAL, struct skd_script_pose, time),
    CYAML_FIELD_FLOAT_PTR("bend", OPTIONAL, struct skd_script_pose, bend),
    CYAML_FIELD_UINT_PTR("seed", OPTIONAL, struct skd_script_pose, seed),
    CYAML_FIELD_SEQUENCE("matrices", OPTIONAL, struct skd_script_pose, matrices, &matrix_schema, 0,
                         CYAML_UNLIMITED),
    CYAML_FIELD_END};

static const cyaml_schema_field_t brush_fields[] = {
    CYAML_FIELD_SEQUENCE_FIXED("centre", OPTIONAL, struct skd_script_brush, centre, &number_schema,
                               3),
    CYAML_FIELD_STRING_PTR("bone", OPTIONAL, struct skd_script_brush, bone, 0, CYAML_UNLIMITED),
    CYAML_FIELD_FLOAT_PTR("radius", CYAML_FLAG_POINTER, struct skd_script_brush, radius),
    CYAML_FIELD_STRING_PTR("falloff", OPTIONAL, struct skd_script_brush, falloff, 0,
                           CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("move", OPTIONAL, struct skd_script_brush, move, &number_schema, 3),
    CYAML_FIELD_FLOAT_PTR("out", OPTIONAL, struct skd_script_brush, out),
    CYAML_FIELD_END};

static const cyaml_schema_field_t stroke_fields[] = {
    CYAML_FIELD_STRING_PTR("pose", CYAML_FLAG_POINTER, struct skd_script_stroke, pose, 1,
                           SKD_POSE_NAME_BYTES_MAX),
    CYAML_FIELD_MAPPING_PTR("brush", OPTIONAL, struct skd_script_stroke, brush, brush_fields),
    CYAML_FIELD_SEQUENCE("vertices", OPTIONAL, struct skd_script_stroke, vertices, &index_schema, 0,
                         CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE("positions", OPTIONAL, struct skd_script_stroke, positions,
                         &position_schema, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE("mask", OPTIONAL, struct skd_script_stroke, mask, &coordinate_schema, 0,
                         CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("method", OPTIONAL, struct skd_script_stroke, method, 0,
                           CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("constraint", OPTIONAL, struct skd_script_stroke, constraint, 0,
                           CYAML_UNLIMITED),
    CYAML_FIELD_FLOAT_PTR("stiffness", OPTIONAL, struct skd_script_stroke, stiffness),
    CYAML_FIELD_STRING_PTR("pin", OPTIONAL, struct skd_script_stroke, pin, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("slots", OPTIONAL, struct skd_script_stroke, slots, 0, CYAML_UNLIMITED),
    CYAML_FIELD_FLOAT_PTR("guard", OPTIONAL, struct skd_script_stroke, guard),
    CYAML_FIELD_FLOAT_PTR("smooth", OPTIONAL, struct skd_script_stroke, smooth),
    CYAML_FIELD_FLOAT_PTR("mix", OPTIONAL, struct skd_script_stroke, mix),
    CYAML_FIELD_STRING_PTR("residual", OPTIONAL, struct skd_script_stroke, residual, 0,
                           CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE("lock_bones", OPTIONAL, struct skd_script_stroke, lock_bones, &text_schema,
                         0, CYAML_UNLIMITED),
    CYAML_FIELD_END};

static const cyaml_schema_value_t pose_schema = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct skd_script_pose, pose_fields)};
static const cyaml_schema_value_t stroke_schema = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct skd_script_stroke, stroke_fields)};

static const cyaml_schema_field_t script_fields[] = {
    CYAML_FIELD_SEQUENCE("poses", OPTIONAL, struct skd_script, poses, &pose_schema, 0,
                         CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE("strokes", CYAML_FLAG_POINTER, struct skd_script, strokes, &stroke_schema,
                         1, CYAML_UNLIMITED),
    CYAML_FIELD_END};
static const cyaml_schema_value_t script_schema = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct skd_script, script_fields)};

/* What libcyaml says about a text: first the trouble, then the places, innermost first. */
struct findings {
    char trouble[SKD_ERROR_TEXT_BYTES / 2];
    unsigned line; /* 0: not said */
    char member[SKD_ERROR_TEXT_BYTES / 8];
};

static void listen(cyaml_log_t level, void *user, const char *format, va_list arguments)
{
    static const char prefix[] = "Load: ";
    struct findings *findings = user;
    char text[sizeof findings->trouble];
    (void)level;
    (void)vsnprintf(text, sizeof text, format, arguments);
    text[strcspn(text, "\n")] = '\0';
    const char *place = strrchr(text, '(');
    if (strncmp(text, "  ", 2) == 0) {
        if (findings->line == 0 && place != NULL)
            (void)sscanf(place, "(line: %u", &findings->line);
        if (findings->member[0] == '\0')
            (void)sscanf(text, "  in mapping field '%49[^']'", findings->member);
        return;
    }
    const char *sentence = text;
    if (strncmp(text, prefix, sizeof prefix - 1) == 0)
        sentence += sizeof prefix - 1;
    if (findings->trouble[0] == '\0' && strncmp(sentence, "Backtrace", 9) != 0)
        (void)snprintf(findings->trouble, sizeof findings->trouble, "%s", sentence);
}

/* "strokes.yaml, line 3, radius: Invalid FLOAT value: wide" */
static enum skd_status fail_form(const char *path, const struct findings *findings,
                                 cyaml_err_t result, struct skd_error *error)
{
    char line[24] = "";
    if (findings->line > 0)
        (void)snprintf(line, sizeof line, ", line %u", findings->line);
    return skd_fail(error, SKD_BAD_PARAMS, "%.60s%s%s%s: %s (see skinctl replay --help)", path,
                    line, findings->member[0] != '\0' ? ", " : "", findings->member,
                    findings->trouble[0] != '\0' ? findings->trouble : cyaml_strerror(result));
}

static cyaml_config_t make_config(struct findings *findings)
{
    return (cyaml_config_t){.log_fn = findings != NULL ? listen : NULL,
                            .log_ctx = findings,
                            .log_level = CYAML_LOG_ERROR,
                            .mem_fn = cyaml_mem,
                            .flags = CYAML_CFG_NO_ALIAS};
}

static bool all_finite(const double *numbers, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(numbers[i]))
            return false;
    }
    return true;
}

static enum skd_status check_pose(const struct skd_script_pose *pose, const char *where,
                                  struct skd_error *error)
{
    bool has_clip = pose->clip != NULL || pose->time != NULL;
    bool has_bend = pose->bend != NULL || pose->seed != NULL;
    bool has_matrices = pose->matrices_count > 0;
    if (strcmp(pose->name, "rest") == 0)
        return skd_fail(error, SKD_BAD_PARAMS, "%s: \"rest\" is always there; give it another name",
                        where);
    if (has_clip + has_bend + has_matrices != 1)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "%s \"%s\": give one of clip and time, bend, or matrices", where,
                        pose->name);
    if (has_clip && (pose->clip == NULL || pose->time == NULL))
        return skd_fail(error, SKD_BAD_PARAMS, "%s \"%s\": clip and time go together", where,
                        pose->name);
    if (has_clip && !(isfinite(*pose->time) && *pose->time >= 0))
        return skd_fail(error, SKD_BAD_PARAMS, "%s \"%s\": time is seconds from 0 on", where,
                        pose->name);
    if (has_bend && (pose->bend == NULL || !(fabs(*pose->bend) <= bend_max) ||
                     (pose->seed != NULL && *pose->seed > INT32_MAX)))
        return skd_fail(error, SKD_BAD_PARAMS,
                        "%s \"%s\": bend is -180 to 180 degrees, its seed 0 to %d", where,
                        pose->name, INT32_MAX);
    if (pose->matrices_count > 0 && !all_finite(pose->matrices[0], 16 * pose->matrices_count))
        return skd_fail(error, SKD_NOT_FINITE,
                        "%s \"%s\": matrices holds a number that is not "
                        "finite",
                        where, pose->name);
    return SKD_OK;
}

static enum skd_status check_brush(const struct skd_script_brush *brush, const char *where,
                                   struct skd_error *error)
{
    int falloff;
    if ((brush->centre != NULL) == (brush->bone != NULL))
        return skd_fail(error, SKD_BAD_PARAMS, "%s: the brush takes a centre or a bone%s", where,
                        brush->bone != NULL ? ", not both" : "");
    if (brush->move == NULL && brush->out == NULL)
        return skd_fail(error, SKD_BAD_PARAMS, "%s: the brush takes a displacement, move or out",
                        where);
    if (brush->centre != NULL && !all_finite(brush->centre, 3))
        return skd_fail(error, SKD_NOT_FINITE, "%s: centre is not finite", where);
    if (!(isfinite(*brush->radius) && *brush->radius > 0))
        return skd_fail(error, SKD_BAD_PARAMS, "%s: radius is %g, but must be above 0", where,
                        *brush->radius);
    if ((brush->move != NULL && !all_finite(brush->move, 3)) ||
        (brush->out != NULL && !isfinite(*brush->out)))
        return skd_fail(error, SKD_NOT_FINITE, "%s: %s is not finite", where,
                        brush->move != NULL ? "move" : "out");
    if (brush->falloff == NULL)
        return SKD_OK;
    char what[SKD_ERROR_TEXT_BYTES / 2];
    (void)snprintf(what, sizeof what, "%s: falloff", where);
    return skd_value_word(what, brush->falloff, skd_falloff_words, &falloff, error);
}

static enum skd_status check_targets(const struct skd_script_stroke *stroke, const char *where,
                                     struct skd_error *error)
{
    if (stroke->vertices_count != stroke->positions_count)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "%s: there are %u vertices and %u positions; give one position a vertex",
                        where, stroke->vertices_count, stroke->positions_count);
    for (size_t i = 0; i < stroke->positions_count; i++) {
        const float *position = stroke->positions[i];
        if (!isfinite(position[0]) || !isfinite(position[1]) || !isfinite(position[2]))
            return skd_fail(error, SKD_NOT_FINITE, "%s: the position of vertex %u is not finite",
                            where, stroke->vertices[i]);
    }
    if (stroke->mask_count > 0 && stroke->mask_count != stroke->vertices_count)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "%s: there are %u vertices and %u numbers in mask; give one a vertex, or "
                        "no mask",
                        where, stroke->vertices_count, stroke->mask_count);
    for (size_t i = 0; i < stroke->mask_count; i++) {
        if (!(stroke->mask[i] >= 0 && stroke->mask[i] <= 1))
            return skd_fail(error, SKD_BAD_PARAMS,
                            "%s: the mask of vertex %u is %g, but must be "
                            "0 to 1",
                            where, stroke->vertices[i], (double)stroke->mask[i]);
    }
    return SKD_OK;
}

static enum skd_status check_word(const char *where, const char *name, const char *text,
                                  const char *const *words, struct skd_error *error)
{
    char what[SKD_ERROR_TEXT_BYTES / 2];
    int index;
    if (text == NULL)
        return SKD_OK;
    (void)snprintf(what, sizeof what, "%s: %s", where, name);
    return skd_value_word(what, text, words, &index, error);
}

enum skd_status skd_script_check_solving(const struct skd_script_stroke *stroke, const char *where,
                                         struct skd_error *error)
{
    const struct {
        const char *name, *text;
        const char *const *words;
    } choices[] = {
        {"method", stroke->method, skd_method_words},
        {"constraint", stroke->constraint, skd_constraint_words},
        {"pin", stroke->pin, skd_pin_words},
        {"slots", stroke->slots, skd_slots_words},
        {"residual", stroke->residual, skd_residual_words},
    };
    const struct {
        const char *name;
        const double *number;
        double most;
    } numbers[] = {
        {"stiffness", stroke->stiffness, SKD_STIFFNESS_MAX},
        {"guard", stroke->guard, SKD_GUARD_MAX},
        {"smooth", stroke->smooth, SKD_SMOOTH_MAX},
        {"mix", stroke->mix, 1},
    };
    enum skd_status status = SKD_OK;
    for (size_t i = 0; status == SKD_OK && i < sizeof choices / sizeof *choices; i++)
        status = check_word(where, choices[i].name, choices[i].text, choices[i].words, error);
    for (size_t i = 0; status == SKD_OK && i < sizeof numbers / sizeof *numbers; i++) {
        const double *number = numbers[i].number;
        if (number != NULL && !(*number >= 0 && *number <= numbers[i].most))
            status = skd_fail(error, SKD_BAD_PARAMS, "%s: %s is %g, but must be 0 to %g", where,
                              numbers[i].name, *number, numbers[i].most);
    }
    return status;
}

enum skd_status skd_script_check_stroke(const struct skd_script_stroke *stroke, const char *where,
                                        struct skd_error *error)
{
    bool has_targets = stroke->vertices_count > 0 || stroke->positions_count > 0;
    enum skd_status status;
    if ((stroke->brush != NULL) == has_targets)
        return skd_fail(error, SKD_BAD_PARAMS, "%s: give a brush, or vertices and positions%s",
                        where, has_targets ? ", not both" : "");
    if (stroke->brush != NULL && stroke->mask_count > 0)
        return skd_fail(error, SKD_BAD_PARAMS, "%s: mask goes with vertices; a brush has falloff",
                        where);
    status = has_targets ? check_targets(stroke, where, error)
                         : check_brush(stroke->brush, where, error);
    return status == SKD_OK ? skd_script_check_solving(stroke, where, error) : status;
}

static enum skd_status check_script(const char *path, const struct skd_script *script,
                                    struct skd_error *error)
{
    char where[SKD_ERROR_TEXT_BYTES / 4];
    enum skd_status status = SKD_OK;
    for (unsigned i = 0; status == SKD_OK && i < script->poses_count; i++) {
        (void)snprintf(where, sizeof where, "%.60s, pose %u", path, i + 1);
        status = check_pose(&script->poses[i], where, error);
        for (unsigned k = 0; status == SKD_OK && k < i; k++) {
            if (strcmp(script->poses[i].name, script->poses[k].name) == 0)
                status = skd_fail(error, SKD_BAD_PARAMS, "%s: \"%s\" is pose %u already", where,
                                  script->poses[i].name, k + 1);
        }
    }
    for (unsigned i = 0; status == SKD_OK && i < script->strokes_count; i++) {
        (void)snprintf(where, sizeof where, "%.60s, stroke %u", path, i + 1);
        status = skd_script_check_stroke(&script->strokes[i], where, error);
    }
    return status;
}

enum skd_status skd_script_parse(const char *path, const char *text, size_t bytes,
                                 struct skd_script **script, struct skd_error *error)
{
    struct findings findings = {0};
    const cyaml_config_t config = make_config(&findings);
    cyaml_data_t *data = NULL;
    cyaml_err_t result =
        cyaml_load_data((const uint8_t *)text, bytes, &config, &script_schema, &data, NULL);
    if (result != CYAML_OK)
        return fail_form(path, &findings, result, error);
    if (data == NULL)
        return skd_fail(error, SKD_BAD_PARAMS, "%.60s: it is empty (see skinctl replay --help)",
                        path);
    *script = (struct skd_script *)data;
    enum skd_status status = check_script(path, *script, error);
    if (status != SKD_OK)
        skd_script_destroy(*script);
    return status;
}

void skd_script_destroy(struct skd_script *script)
{
    const cyaml_config_t config = make_config(NULL);
    (void)cyaml_free(&config, &script_schema, script, 0);
}
