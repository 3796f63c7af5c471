/* See script.h: a script to text. One tree of JSON is made; YAML is that tree with comments. */
#include "clients/cli/script.h"

#include "clients/cli/print.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void add_text(cJSON *object, const char *name, const char *text)
{
    if (text != NULL)
        cJSON_AddStringToObject(object, name, text);
}

static void add_number(cJSON *object, const char *name, const double *number)
{
    if (number != NULL)
        cJSON_AddNumberToObject(object, name, *number);
}

static void add_numbers(cJSON *object, const char *name, const double *numbers, size_t count)
{
    if (numbers != NULL)
        cJSON_AddItemToObject(object, name, cJSON_CreateDoubleArray(numbers, (int)count));
}

static cJSON *pose_json(const struct skd_script_pose *pose)
{
    cJSON *json = cJSON_CreateObject();
    add_text(json, "name", pose->name);
    add_text(json, "clip", pose->clip);
    add_number(json, "time", pose->time);
    add_number(json, "bend", pose->bend);
    if (pose->seed != NULL)
        cJSON_AddNumberToObject(json, "seed", *pose->seed);
    return json;
}

static cJSON *stroke_json(const struct skd_script_stroke *stroke)
{
    const struct skd_script_brush *brush = stroke->brush;
    cJSON *json = cJSON_CreateObject();
    add_text(json, "pose", stroke->pose);
    cJSON *brushed = cJSON_AddObjectToObject(json, "brush");
    add_numbers(brushed, "centre", brush->centre, 3);
    add_text(brushed, "bone", brush->bone);
    add_number(brushed, "radius", brush->radius);
    add_text(brushed, "falloff", brush->falloff);
    add_numbers(brushed, "move", brush->move, 3);
    add_number(brushed, "out", brush->out);
    return json;
}

void skd_script_write_json(const struct skd_script *script)
{
    cJSON *json = cJSON_CreateObject();
    cJSON *poses = cJSON_AddArrayToObject(json, "poses");
    cJSON *strokes = cJSON_AddArrayToObject(json, "strokes");
    for (unsigned i = 0; i < script->poses_count; i++)
        cJSON_AddItemToArray(poses, pose_json(&script->poses[i]));
    for (unsigned i = 0; i < script->strokes_count; i++)
        cJSON_AddItemToArray(strokes, stroke_json(&script->strokes[i]));
    skd_print_own_json(json);
}

/* A value on one line, as YAML writes it: {key: value, ...}, [1, 2]. */
static void write_flow(const cJSON *value)
{
    if (!cJSON_IsObject(value) && !cJSON_IsArray(value)) {
        char *text = cJSON_PrintUnformatted(value); /* a JSON string is a quoted YAML string */
        fputs(text != NULL ? text : "null", stdout);
        cJSON_free(text);
        return;
    }
    putchar(cJSON_IsObject(value) ? '{' : '[');
    for (const cJSON *item = value->child; item != NULL; item = item->next) {
        if (item != value->child)
            fputs(", ", stdout);
        if (cJSON_IsObject(value))
            printf("%s: ", item->string);
        write_flow(item);
    }
    putchar(cJSON_IsObject(value) ? '}' : ']');
}

static void write_pose(const struct skd_script_pose *pose)
{
    cJSON *json = pose_json(pose);
    fputs("  - ", stdout);
    write_flow(json);
    putchar('\n');
    cJSON_Delete(json);
}

static void write_stroke(const struct skd_script_stroke *stroke)
{
    cJSON *json = stroke_json(stroke);
    const char *lead = "  - ";
    for (const cJSON *item = json->child; item != NULL; item = item->next) {
        printf("%s%s: ", lead, item->string);
        write_flow(item);
        putchar('\n');
        lead = "    ";
    }
    cJSON_Delete(json);
}

/* What each stroke is there to teach, by what it uses. */
static const char *comment_on(const struct skd_script_brush *brush)
{
    if (brush->bone != NULL)
        return "a brush may find its place by a bone: where it and its parent share the surface";
    if (brush->move != NULL)
        return "move is one displacement for all; sharp keeps most of it near the centre";
    if (*brush->out < 0)
        return "a negative out presses the surface in";
    return "out pushes along the surface's normals: swells what the joint has flattened";
}

void skd_script_write(const struct skd_script *script, const struct skd_script_setting *setting)
{
    const char *slash = strrchr(setting->source, '/');
    char vertices[SKD_COUNT_TEXT_BYTES];
    printf("# Strokes for the rig session \"%s\"%s%s: %s vertices, length %.6g.\n",
           setting->session, setting->source[0] != '\0' ? " from " : "",
           slash != NULL ? slash + 1 : setting->source,
           skd_count_text((double)setting->vertex_count, vertices), setting->length);
    fputs("# Play them with: skinctl replay THIS_FILE --export out.glb\n"
          "# All lengths are the scene's. skinctl replay --help explains every word.\n\n",
          stdout);
    if (script->poses_count > 0)
        puts("# Poses far from the character's rest: moments of its clips (seconds), or, where "
             "these\n"
             "# are not enough, all joints bent (degrees) about axes that seed chooses.\n"
             "poses:");
    for (unsigned i = 0; i < script->poses_count; i++)
        write_pose(&script->poses[i]);
    fputs(
        "\n# One stroke after the other, each in its pose. The weights solved by one are what the\n"
        "# next one starts from. A stroke may also say how it is solved: stiffness, slots, ...\n"
        "strokes:\n",
        stdout);
    const char *said = NULL;
    for (unsigned i = 0; i < script->strokes_count; i++) {
        const char *comment = comment_on(script->strokes[i].brush);
        if (comment != said)
            printf("  # %s\n", comment);
        said = comment;
        write_stroke(&script->strokes[i]);
    }
}
