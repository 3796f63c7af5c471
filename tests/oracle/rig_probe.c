/* The rig room behind a command line, for tests/oracle/rig_lib.py.
 *
 *   rig_probe load FILE [ARRAYS]                     summary; ARRAYS gets rest, joints, ...
 *   rig_probe pose FILE OUT (CLIP TIME)...           posed positions, float32 [poses][V][3]
 *   rig_probe export FILE TARGET N JOINTS WEIGHTS [REST|- [NAME VERTICES OFFSETS]...]
 *                                                    raw uint16 and float32 [V][N] files; float32
 *                                                    [V][3]; uint32 [n] and float32 [n][3] a shape
 *   rig_probe hold FILE TARGET N JOINTS WEIGHTS      the same, after a line on stdin
 *   rig_probe image FILE OUT                         its image (rig/rig_image.h)
 *   rig_probe time FILE TIMES                        milliseconds of each load
 *   rig_probe check FILE...                          status and text of each, one object a line
 *
 * Prints one JSON object; what skind refuses has "status" and "text" and is no failure.
 */
#include "rig/gltf.h"
#include "rig/pose.h"
#include "rig/rig_image.h"

#include <cjson/cJSON.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

struct loaded {
    struct skd_rig *rig;
    struct skd_influences influences;
};

static _Noreturn void die(const char *what)
{
    perror(what);
    exit(1);
}

static void *allocate(size_t count, size_t bytes)
{
    void *memory = calloc(count + 1, bytes);
    if (memory == NULL)
        die("memory");
    return memory;
}

static void print_json(cJSON *json)
{
    char *text = cJSON_PrintUnformatted(json);
    puts(text);
    free(text);
    cJSON_Delete(json);
}

static const char *status_name(enum skd_status status)
{
    switch (status) {
    case SKD_NO_FILE:
        return "no_file";
    case SKD_FILE_IO:
        return "file_io";
    case SKD_NOT_GLTF:
        return "not_gltf";
    case SKD_UNSUPPORTED:
        return "unsupported";
    case SKD_BAD_RIG:
        return "bad_rig";
    case SKD_TOO_LARGE:
        return "too_large";
    case SKD_SOURCE_CHANGED:
        return "source_changed";
    case SKD_BAD_INDEX:
        return "bad_index";
    case SKD_NOT_FINITE:
        return "not_finite";
    default:
        return "other";
    }
}

/* Prints what stopped it, if anything did. */
static bool has_failed(enum skd_status status, const struct skd_error *error)
{
    if (status == SKD_OK)
        return false;
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "status", status_name(status));
    cJSON_AddStringToObject(json, "text", error->text);
    print_json(json);
    return true;
}

static void finish(struct loaded *loaded)
{
    skd_rig_destroy(loaded->rig);
    skd_influences_finish(&loaded->influences);
}

/* One array in the file of arrays. */
static void put_array(FILE *file, cJSON *arrays, const char *name, const char *type, size_t rows,
                      size_t columns, const void *bytes, size_t element_bytes)
{
    cJSON *entry = cJSON_AddObjectToObject(arrays, name);
    cJSON_AddStringToObject(entry, "dtype", type);
    cJSON_AddNumberToObject(entry, "offset", (double)ftell(file));
    cJSON_AddNumberToObject(entry, "rows", (double)rows);
    cJSON_AddNumberToObject(entry, "columns", (double)columns);
    if (fwrite(bytes, element_bytes, rows * columns, file) != rows * columns)
        die("fwrite");
}

static void put_arrays(const struct loaded *loaded, const char *path, cJSON *json)
{
    const struct skd_mesh *mesh = &loaded->rig->mesh;
    const struct skd_skeleton *skeleton = &loaded->rig->skeleton;
    const size_t vertices = mesh->vertex_count, bones = (size_t)skeleton->bone_count;
    const size_t influences = loaded->influences.offsets[vertices];
    FILE *file = fopen(path, "wb");
    if (file == NULL)
        die(path);
    cJSON *arrays = cJSON_AddObjectToObject(json, "arrays");
    put_array(file, arrays, "inverse_binds", "<f8", bones, 12, skeleton->inverse_binds, 8);
    put_array(file, arrays, "rest_pose", "<f8", bones, 12, loaded->rig->rest_pose, 8);
    put_array(file, arrays, "parents", "<i4", bones, 1, skeleton->parents, 4);
    put_array(file, arrays, "bone_skins", "<u2", bones, 1, skeleton->skins, 2);
    put_array(file, arrays, "rest", "<f4", vertices, 3, mesh->rest, 4);
    put_array(file, arrays, "triangles", "<u4", mesh->triangle_count, 3, mesh->triangles, 4);
    put_array(file, arrays, "skins", "<u2", vertices, 1, mesh->skins, 2);
    if (mesh->twins != NULL)
        put_array(file, arrays, "twins", "<u4", vertices, 1, mesh->twins, 4);
    put_array(file, arrays, "neighbour_offsets", "<u4", vertices + 1, 1, mesh->neighbour_offsets,
              4);
    put_array(file, arrays, "neighbours", "<u4", mesh->neighbour_offsets[vertices], 1,
              mesh->neighbours, 4);
    put_array(file, arrays, "offsets", "<u4", vertices + 1, 1, loaded->influences.offsets, 4);
    put_array(file, arrays, "joints", "<u2", influences, 1, loaded->influences.joints, 2);
    put_array(file, arrays, "weights", "<f4", influences, 1, loaded->influences.weights, 4);
    if (fclose(file) != 0)
        die(path);
}

static void add_names(cJSON *json, const struct skd_rig *rig)
{
    cJSON *bones = cJSON_AddArrayToObject(json, "bones");
    for (int b = 0; b < rig->skeleton.bone_count; b++)
        cJSON_AddItemToArray(bones, cJSON_CreateString(rig->skeleton.names[b]));
    cJSON *clips = cJSON_AddArrayToObject(json, "clips");
    for (size_t c = 0; c < rig->nodes.clip_count; c++) {
        cJSON *clip = cJSON_CreateObject();
        cJSON_AddStringToObject(clip, "name", rig->nodes.clips[c].name);
        cJSON_AddNumberToObject(clip, "duration", rig->nodes.clips[c].duration);
        cJSON_AddItemToArray(clips, clip);
    }
    cJSON *parts = cJSON_AddArrayToObject(json, "parts");
    for (size_t p = 0; p < rig->mesh.part_count; p++) {
        const struct skd_part *part = &rig->mesh.parts[p];
        cJSON *entry = cJSON_CreateObject();
        cJSON_AddNumberToObject(entry, "mesh", part->mesh);
        cJSON_AddNumberToObject(entry, "primitive", part->primitive);
        cJSON_AddNumberToObject(entry, "first", (double)part->first_vertex);
        cJSON_AddNumberToObject(entry, "count", (double)part->vertex_count);
        cJSON_AddNumberToObject(entry, "skin", part->skin);
        cJSON_AddItemToArray(parts, entry);
    }
    cJSON *notes = cJSON_AddObjectToObject(json, "notes");
    for (int n = 0; n < SKD_NOTE_COUNT; n++)
        if (rig->notes[n] != 0)
            cJSON_AddNumberToObject(notes, skd_note_name((enum skd_note)n), (double)rig->notes[n]);
}

static void command_load(const struct loaded *loaded, int count, char **arguments)
{
    const struct skd_rig *rig = loaded->rig;
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "status", "ok");
    cJSON_AddNumberToObject(json, "vertices", (double)rig->mesh.vertex_count);
    cJSON_AddNumberToObject(json, "triangles", (double)rig->mesh.triangle_count);
    cJSON_AddNumberToObject(json, "skins", rig->skin_count);
    cJSON_AddNumberToObject(json, "most", loaded->influences.most);
    cJSON_AddNumberToObject(json, "length", rig->length);
    cJSON_AddNumberToObject(json, "bytes", (double)skd_rig_bytes(rig));
    add_names(json, rig);
    if (count > 0)
        put_arrays(loaded, arguments[0], json);
    print_json(json);
}

/* Influences as [V][most] rows, for skd_skin. */
static void make_rows(const struct loaded *loaded, uint16_t *joints, float *weights)
{
    const struct skd_influences *from = &loaded->influences;
    const size_t most = (size_t)from->most;
    for (size_t v = 0; v < loaded->rig->mesh.vertex_count; v++)
        for (size_t k = 0; k < most; k++) {
            const size_t at = from->offsets[v] + k;
            const bool is_there = at < from->offsets[v + 1];
            joints[v * most + k] = is_there ? from->joints[at] : SKD_SLOT_EMPTY;
            weights[v * most + k] = is_there ? from->weights[at] : 0;
        }
}

static void command_pose(const struct loaded *loaded, int count, char **arguments)
{
    const struct skd_rig *rig = loaded->rig;
    const size_t vertices = rig->mesh.vertex_count, most = (size_t)loaded->influences.most;
    uint16_t *joints = allocate(vertices * most, sizeof *joints);
    float *weights = allocate(vertices * most, sizeof *weights);
    float *posed = allocate(vertices * 3, sizeof *posed);
    double *matrices = allocate((size_t)rig->skeleton.bone_count * SKD_MATRIX_SIZE, sizeof(double));
    FILE *file = fopen(arguments[0], "wb");
    if (file == NULL)
        die(arguments[0]);
    make_rows(loaded, joints, weights);
    for (int i = 1; i + 1 < count; i += 2) {
        struct skd_error error = {0};
        const enum skd_status status = skd_pose_from_clip(
            rig, atoi(arguments[i]), strtod(arguments[i + 1], NULL), matrices, &error);
        if (status != SKD_OK) {
            fprintf(stderr, "%s\n", error.text);
            exit(1);
        }
        skd_skin(vertices, NULL, (int)most, rig->mesh.rest, joints, weights, matrices, posed);
        if (fwrite(posed, 3 * sizeof *posed, vertices, file) != vertices)
            die("fwrite");
    }
    if (fclose(file) != 0)
        die(arguments[0]);
    free(joints);
    free(weights);
    free(posed);
    free(matrices);
    puts("{\"status\":\"ok\"}");
}

static void read_raw(const char *path, void *to, size_t bytes)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL || fread(to, 1, bytes, file) != bytes)
        die(path);
    fclose(file);
}

/* A whole file; *bytes is its size. */
static void *read_whole(const char *path, size_t *bytes)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0)
        die(path);
    *bytes = (size_t)ftell(file);
    fclose(file);
    void *memory = allocate(*bytes, 1);
    read_raw(path, memory, *bytes);
    return memory;
}

/* NAME VERTICES OFFSETS, again and again. */
static struct skd_export_shape *read_shapes(size_t count, char **arguments)
{
    struct skd_export_shape *shapes = allocate(count, sizeof *shapes);
    for (size_t s = 0; s < count; s++) {
        size_t bytes = 0;
        shapes[s].name = arguments[3 * s];
        shapes[s].vertices = read_whole(arguments[3 * s + 1], &bytes);
        shapes[s].count = bytes / sizeof *shapes[s].vertices;
        shapes[s].offsets = read_whole(arguments[3 * s + 2], &bytes);
    }
    return shapes;
}

static void command_export(const struct loaded *loaded, int count, char **arguments)
{
    const size_t vertices = loaded->rig->mesh.vertex_count, slots = (size_t)atoi(arguments[1]);
    uint16_t *joints = allocate(vertices * slots, sizeof *joints);
    float *weights = allocate(vertices * slots, sizeof *weights);
    float *rest = allocate(vertices * 3, sizeof *rest);
    const size_t shape_count = count > 5 ? (size_t)(count - 5) / 3 : 0;
    struct skd_export_shape *shapes = read_shapes(shape_count, arguments + 5);
    const bool has_rest = count > 4 && strcmp(arguments[4], "-") != 0;
    struct skd_gltf_export_report report;
    struct skd_error error = {0};
    read_raw(arguments[2], joints, vertices * slots * sizeof *joints);
    read_raw(arguments[3], weights, vertices * slots * sizeof *weights);
    if (has_rest)
        read_raw(arguments[4], rest, vertices * 3 * sizeof *rest);
    const struct skd_gltf_content content = {.slot_count = (int)slots,
                                             .joints = joints,
                                             .weights = weights,
                                             .rest = has_rest ? rest : NULL,
                                             .shape_count = shape_count,
                                             .shapes = shapes};
    const enum skd_status status =
        skd_gltf_export(loaded->rig, &content, arguments[0], &report, &error);
    for (size_t s = 0; s < shape_count; s++) {
        free((void *)shapes[s].vertices);
        free((void *)shapes[s].offsets);
    }
    free(shapes);
    free(joints);
    free(weights);
    free(rest);
    if (has_failed(status, &error))
        return;
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "status", "ok");
    cJSON_AddNumberToObject(json, "bytes", (double)report.bytes);
    cJSON_AddNumberToObject(json, "accessors", (double)report.accessors);
    cJSON_AddNumberToObject(json, "positions", (double)report.positions);
    cJSON_AddNumberToObject(json, "targets", (double)report.targets);
    cJSON_AddNumberToObject(json, "largest_rounding", report.largest_rounding);
    print_json(json);
}

/* Says that the file is loaded and lets the caller change it. */
static void command_hold(const struct loaded *loaded, char **arguments)
{
    char line[8];
    puts("{\"status\":\"loaded\"}");
    fflush(stdout);
    if (fgets(line, sizeof line, stdin) != NULL)
        command_export(loaded, 4, arguments);
}

static bool write_to(void *user, const void *bytes, size_t count)
{
    return fwrite(bytes, 1, count, user) == count;
}

static void command_image(const struct loaded *loaded, const char *path)
{
    FILE *file = fopen(path, "wb");
    const struct skd_image_sink sink = {write_to, file};
    if (file == NULL || !skd_rig_image_write(loaded->rig, &loaded->influences, &sink) ||
        fclose(file) != 0)
        die(path);
    puts("{\"status\":\"ok\"}");
}

static double now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

static void command_time(const char *path, int times)
{
    cJSON *json = cJSON_CreateObject();
    cJSON *list = cJSON_AddArrayToObject(json, "ms");
    for (int i = 0; i < times; i++) {
        struct loaded loaded;
        struct skd_error error = {0};
        const double start = now_ms();
        if (skd_gltf_import(path, &loaded.rig, &loaded.influences, &error) != SKD_OK)
            die(error.text);
        cJSON_AddItemToArray(list, cJSON_CreateNumber(now_ms() - start));
        finish(&loaded);
    }
    print_json(json);
}

static void command_check(int count, char **paths)
{
    for (int i = 0; i < count; i++) {
        struct loaded loaded;
        struct skd_error error = {0};
        const enum skd_status status =
            skd_gltf_import(paths[i], &loaded.rig, &loaded.influences, &error);
        if (has_failed(status, &error))
            continue;
        puts("{\"status\":\"ok\",\"text\":\"\"}");
        finish(&loaded);
    }
}

int main(int count, char **arguments)
{
    struct loaded loaded;
    struct skd_error error = {0};
    if (count < 3) {
        fprintf(stderr, "see rig_probe.c\n");
        return 2;
    }
    const char *command = arguments[1];
    if (strcmp(command, "time") == 0 && count == 4) {
        command_time(arguments[2], atoi(arguments[3]));
        return 0;
    }
    if (strcmp(command, "check") == 0) {
        command_check(count - 2, arguments + 2);
        return 0;
    }
    if (has_failed(skd_gltf_import(arguments[2], &loaded.rig, &loaded.influences, &error), &error))
        return 0;
    if (strcmp(command, "load") == 0)
        command_load(&loaded, count - 3, arguments + 3);
    else if (strcmp(command, "pose") == 0 && count >= 4)
        command_pose(&loaded, count - 3, arguments + 3);
    else if (strcmp(command, "export") == 0 && count >= 7)
        command_export(&loaded, count - 3, arguments + 3);
    else if (strcmp(command, "image") == 0 && count == 4)
        command_image(&loaded, arguments[3]);
    else if (strcmp(command, "hold") == 0 && count == 7)
        command_hold(&loaded, arguments + 3);
    else
        fprintf(stderr, "see rig_probe.c\n");
    finish(&loaded);
    return 0;
}
