/* See write_glb.h. */
#include "write_glb.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "glTF is little endian");

/* glTF's numbers for component types and buffer targets. */
enum { GL_U8 = 5121, GL_U16 = 5123, GL_U32 = 5125, GL_F32 = 5126 };
enum { TARGET_NONE = 0, TARGET_VERTICES = 34962, TARGET_INDICES = 34963 };

/* Buffer views, in the order of their bytes. */
enum view {
    VIEW_POSITION,
    VIEW_NORMAL,
    VIEW_JOINT,
    VIEW_WEIGHT,
    VIEW_INDEX,
    VIEW_INVERSE_BIND,
    VIEW_CLIPS,
    VIEW_COUNT
};

/* Nodes: what stands in the scene, then the bones in the skeleton's order. */
enum { NODE_ARMATURE, NODE_BODY, NODE_FIRST_BONE };

struct glb {
    const struct glb_content *content;
    cJSON *root, *accessors;
    uint32_t view_bytes[VIEW_COUNT]; /* padded to 4 */
    uint32_t index_bytes;            /* of one index */
    float *clip_data;
    uint32_t clip_floats;
    int has_failed; /* an allocation did not succeed somewhere */
};

/* ---- JSON ---------------------------------------------------------------------------------- */

/* cJSON hands out NULL when memory is short and takes NULL silently; it is noted here and reported
 * once, before anything is written. */
static cJSON *made(struct glb *glb, cJSON *item)
{
    if (item == NULL)
        glb->has_failed = 1;
    return item;
}

static void put(struct glb *glb, cJSON *object, const char *key, cJSON *item)
{
    if (!cJSON_AddItemToObject(object, key, made(glb, item))) {
        glb->has_failed = 1;
        cJSON_Delete(item);
    }
}

static void put_number(struct glb *glb, cJSON *object, const char *key, double number)
{
    made(glb, cJSON_AddNumberToObject(object, key, number));
}

static void put_text(struct glb *glb, cJSON *object, const char *key, const char *text)
{
    made(glb, cJSON_AddStringToObject(object, key, text));
}

static cJSON *put_object(struct glb *glb, cJSON *object, const char *key)
{
    return made(glb, cJSON_AddObjectToObject(object, key));
}

static cJSON *put_array(struct glb *glb, cJSON *object, const char *key)
{
    return made(glb, cJSON_AddArrayToObject(object, key));
}

static cJSON *append_object(struct glb *glb, cJSON *array)
{
    cJSON *object = made(glb, cJSON_CreateObject());
    if (!cJSON_AddItemToArray(array, object)) {
        glb->has_failed = 1;
        cJSON_Delete(object);
        return NULL;
    }
    return object;
}

static void append_number(struct glb *glb, cJSON *array, double number)
{
    cJSON *item = made(glb, cJSON_CreateNumber(number));
    if (!cJSON_AddItemToArray(array, item)) {
        glb->has_failed = 1;
        cJSON_Delete(item);
    }
}

static void put_floats(struct glb *glb, cJSON *object, const char *key, const float *values,
                       int count)
{
    put(glb, object, key, cJSON_CreateFloatArray(values, count));
}

/* Returns the accessor's object; *index is its number. */
static cJSON *add_accessor(struct glb *glb, enum view view, int component, const char *type,
                           uint32_t count, int *index)
{
    *index = cJSON_GetArraySize(glb->accessors);
    cJSON *accessor = append_object(glb, glb->accessors);
    put_number(glb, accessor, "bufferView", view);
    put_number(glb, accessor, "componentType", component);
    put_number(glb, accessor, "count", count);
    put_text(glb, accessor, "type", type);
    return accessor;
}

static void describe_mesh(struct glb *glb)
{
    const struct mesh *mesh = glb->content->mesh;
    uint32_t vertices = mesh->tessellation->vertex_count;
    cJSON *body = append_object(glb, put_array(glb, glb->root, "meshes"));
    put_text(glb, body, "name", "body");
    cJSON *primitive = append_object(glb, put_array(glb, body, "primitives"));
    cJSON *attributes = put_object(glb, primitive, "attributes");
    int index;
    cJSON *position = add_accessor(glb, VIEW_POSITION, GL_F32, "VEC3", vertices, &index);
    put_floats(glb, position, "min", mesh->lowest, 3);
    put_floats(glb, position, "max", mesh->highest, 3);
    put_number(glb, attributes, "POSITION", index);
    add_accessor(glb, VIEW_NORMAL, GL_F32, "VEC3", vertices, &index);
    put_number(glb, attributes, "NORMAL", index);
    add_accessor(glb, VIEW_JOINT, GL_U8, "VEC4", vertices, &index);
    put_number(glb, attributes, "JOINTS_0", index);
    add_accessor(glb, VIEW_WEIGHT, GL_F32, "VEC4", vertices, &index);
    put_number(glb, attributes, "WEIGHTS_0", index);
    add_accessor(glb, VIEW_INDEX, glb->index_bytes == 2 ? GL_U16 : GL_U32, "SCALAR",
                 3 * mesh->tessellation->triangle_count, &index);
    put_number(glb, primitive, "indices", index);
    put_number(glb, primitive, "material", 0);

    cJSON *material = append_object(glb, put_array(glb, glb->root, "materials"));
    put_text(glb, material, "name", "skin");
    cJSON *surface = put_object(glb, material, "pbrMetallicRoughness");
    const double colour[4] = {0.75, 0.5, 0.375, 1.0};
    put(glb, surface, "baseColorFactor", cJSON_CreateDoubleArray(colour, 4));
    put_number(glb, surface, "metallicFactor", 0);
    put_number(glb, surface, "roughnessFactor", 0.625);
}

static void describe_nodes(struct glb *glb)
{
    const struct skeleton *skeleton = glb->content->skeleton;
    cJSON *scene = append_object(glb, put_array(glb, glb->root, "scenes"));
    /* A skinned mesh below another node would move with its skeleton alone, which readers warn of:
     * the body stands beside the armature. */
    const int roots[] = {NODE_ARMATURE, NODE_BODY};
    put(glb, scene, "nodes", cJSON_CreateIntArray(roots, 2));

    cJSON *nodes = put_array(glb, glb->root, "nodes");
    cJSON *armature = append_object(glb, nodes);
    put_text(glb, armature, "name", "armature");
    append_number(glb, put_array(glb, armature, "children"), NODE_FIRST_BONE);
    cJSON *body = append_object(glb, nodes);
    put_text(glb, body, "name", "body");
    put_number(glb, body, "mesh", 0);
    put_number(glb, body, "skin", 0);

    cJSON *skin = append_object(glb, put_array(glb, glb->root, "skins"));
    cJSON *joints = put_array(glb, skin, "joints");
    cJSON *children[SKELETON_MAX_BONES] = {NULL};
    cJSON *bone_nodes[SKELETON_MAX_BONES];
    for (uint32_t b = 0; b < skeleton->bone_count; ++b) {
        const struct skeleton_bone *bone = &skeleton->bone[b];
        cJSON *node = bone_nodes[b] = append_object(glb, nodes);
        put_text(glb, node, "name", bone->name);
        put_floats(glb, node, "translation", bone->translation, 3);
        put_floats(glb, node, "rotation", bone->rotation, 4);
        append_number(glb, joints, NODE_FIRST_BONE + b);
        if (bone->parent < 0)
            continue;
        if (children[bone->parent] == NULL)
            children[bone->parent] = put_array(glb, bone_nodes[bone->parent], "children");
        append_number(glb, children[bone->parent], NODE_FIRST_BONE + b);
    }
    int index;
    add_accessor(glb, VIEW_INVERSE_BIND, GL_F32, "MAT4", skeleton->bone_count, &index);
    put_number(glb, skin, "inverseBindMatrices", index);
    put_number(glb, skin, "skeleton", NODE_ARMATURE);
}

/* ---- clips --------------------------------------------------------------------------------- */

static enum skd_status reserve_clips(struct glb *glb, struct skd_error *error)
{
    size_t floats = 0;
    for (int i = 0; i < CLIP_COUNT; ++i)
        floats += CLIP_MAX_KEYS * (CLIP_MAX_TIMES + 4 * (size_t)glb->content->clips[i].track_count);
    glb->clip_data = malloc(floats * sizeof *glb->clip_data);
    if (glb->clip_data == NULL)
        return skd_fail_memory(error, "the animation clips");
    return SKD_OK;
}

/* An accessor on the next count rows of the clips' floats, which the caller has just appended. */
static cJSON *add_clip_accessor(struct glb *glb, const char *type, uint32_t count, uint32_t width,
                                int *index)
{
    cJSON *accessor = add_accessor(glb, VIEW_CLIPS, GL_F32, type, count, index);
    put_number(glb, accessor, "byteOffset",
               (double)(glb->clip_floats - count * width) * sizeof(float));
    return accessor;
}

static int add_times(struct glb *glb, const struct clip_times *times)
{
    for (uint32_t key = 0; key < times->key_count; ++key)
        glb->clip_data[glb->clip_floats++] = times->time[key];
    int index;
    cJSON *accessor = add_clip_accessor(glb, "SCALAR", times->key_count, 1, &index);
    put_floats(glb, accessor, "min", &times->time[0], 1);
    put_floats(glb, accessor, "max", &times->time[times->key_count - 1], 1);
    return index;
}

static int add_values(struct glb *glb, const struct clip_track *track, uint32_t key_count)
{
    uint32_t width = track->is_translation ? 3 : 4;
    for (uint32_t key = 0; key < key_count; ++key)
        for (uint32_t i = 0; i < width; ++i)
            glb->clip_data[glb->clip_floats++] = track->value[key][i];
    int index;
    add_clip_accessor(glb, track->is_translation ? "VEC3" : "VEC4", key_count, width, &index);
    return index;
}

static void describe_clip(struct glb *glb, cJSON *animations, const struct clip *clip)
{
    cJSON *animation = append_object(glb, animations);
    put_text(glb, animation, "name", clip->name);
    cJSON *channels = put_array(glb, animation, "channels");
    cJSON *samplers = put_array(glb, animation, "samplers");
    int input[CLIP_MAX_TIMES];
    for (uint32_t i = 0; i < clip->times_count; ++i)
        input[i] = add_times(glb, &clip->times[i]);
    for (uint32_t i = 0; i < clip->track_count; ++i) {
        const struct clip_track *track = &clip->track[i];
        cJSON *sampler = append_object(glb, samplers);
        put_number(glb, sampler, "input", input[track->times]);
        put_number(glb, sampler, "output",
                   add_values(glb, track, clip->times[track->times].key_count));
        cJSON *channel = append_object(glb, channels);
        put_number(glb, channel, "sampler", i);
        cJSON *target = put_object(glb, channel, "target");
        put_number(glb, target, "node", NODE_FIRST_BONE + track->bone);
        put_text(glb, target, "path", track->is_translation ? "translation" : "rotation");
    }
}

/* ---- buffer -------------------------------------------------------------------------------- */

static void measure_views(struct glb *glb)
{
    const struct tessellation *t = glb->content->mesh->tessellation;
    uint32_t vertices = t->vertex_count;
    uint32_t *bytes = glb->view_bytes;
    bytes[VIEW_POSITION] = bytes[VIEW_NORMAL] = 3 * vertices * (uint32_t)sizeof(float);
    bytes[VIEW_JOINT] = INFLUENCE_COUNT * vertices;
    bytes[VIEW_WEIGHT] = INFLUENCE_COUNT * vertices * (uint32_t)sizeof(float);
    bytes[VIEW_INDEX] = 3 * t->triangle_count * glb->index_bytes;
    bytes[VIEW_INVERSE_BIND] = glb->content->skeleton->bone_count * 16 * (uint32_t)sizeof(float);
    bytes[VIEW_CLIPS] = glb->clip_floats * (uint32_t)sizeof(float);
}

static uint32_t padded(uint32_t bytes)
{
    return (bytes + 3) / 4 * 4;
}

static uint32_t describe_buffer(struct glb *glb)
{
    static const int targets[VIEW_COUNT] = {TARGET_VERTICES, TARGET_VERTICES, TARGET_VERTICES,
                                            TARGET_VERTICES, TARGET_INDICES,  TARGET_NONE,
                                            TARGET_NONE};
    cJSON *views = put_array(glb, glb->root, "bufferViews");
    uint32_t offset = 0;
    for (int i = 0; i < VIEW_COUNT; ++i) {
        cJSON *view = append_object(glb, views);
        put_number(glb, view, "buffer", 0);
        put_number(glb, view, "byteOffset", offset);
        put_number(glb, view, "byteLength", glb->view_bytes[i]);
        if (targets[i] != TARGET_NONE)
            put_number(glb, view, "target", targets[i]);
        offset += padded(glb->view_bytes[i]);
    }
    cJSON *buffer = append_object(glb, put_array(glb, glb->root, "buffers"));
    put_number(glb, buffer, "byteLength", offset);
    return offset;
}

static void describe(struct glb *glb)
{
    cJSON *asset = put_object(glb, glb->root, "asset");
    put_text(glb, asset, "version", "2.0");
    put_text(glb, asset, "generator", "skinctl generate");
    put_number(glb, glb->root, "scene", 0);
    glb->accessors = put_array(glb, glb->root, "accessors");
    describe_mesh(glb);
    describe_nodes(glb);
    cJSON *animations = put_array(glb, glb->root, "animations");
    for (int i = 0; i < CLIP_COUNT; ++i)
        describe_clip(glb, animations, &glb->content->clips[i]);
    measure_views(glb);
}

/* ---- bytes --------------------------------------------------------------------------------- */

/* Errors stay in the stream and are looked at once, when it is closed. */
static void write_padded(FILE *file, const void *bytes, uint32_t count, char padding)
{
    fwrite(bytes, 1, count, file);
    for (uint32_t i = count; i < padded(count); ++i)
        fputc(padding, file);
}

static void write_u32(FILE *file, uint32_t value)
{
    fwrite(&value, sizeof value, 1, file);
}

static void write_indices(FILE *file, const struct glb *glb)
{
    const struct mesh *mesh = glb->content->mesh;
    const struct tessellation *t = mesh->tessellation;
    for (uint32_t face = 0; face < t->surface->cage->face_count; ++face) {
        uint32_t count = skd_tessellation_triangles(t, face, mesh->position, mesh->triangle);
        if (glb->index_bytes == 4) {
            fwrite(mesh->triangle, sizeof *mesh->triangle, count, file);
            continue;
        }
        for (uint32_t i = 0; i < count; ++i) {
            const uint32_t *wide = mesh->triangle[i];
            const uint16_t corner[3] = {(uint16_t)wide[0], (uint16_t)wide[1], (uint16_t)wide[2]};
            fwrite(corner, sizeof corner, 1, file);
        }
    }
    for (uint32_t i = glb->view_bytes[VIEW_INDEX]; i < padded(glb->view_bytes[VIEW_INDEX]); ++i)
        fputc(0, file);
}

static void write_views(FILE *file, const struct glb *glb)
{
    const struct mesh *mesh = glb->content->mesh;
    const struct skeleton *skeleton = glb->content->skeleton;
    write_padded(file, mesh->position, glb->view_bytes[VIEW_POSITION], 0);
    write_padded(file, mesh->normal, glb->view_bytes[VIEW_NORMAL], 0);
    write_padded(file, mesh->joint, glb->view_bytes[VIEW_JOINT], 0);
    write_padded(file, mesh->weight, glb->view_bytes[VIEW_WEIGHT], 0);
    write_indices(file, glb);
    for (uint32_t b = 0; b < skeleton->bone_count; ++b)
        fwrite(skeleton->bone[b].inverse_bind, sizeof skeleton->bone[b].inverse_bind, 1, file);
    write_padded(file, glb->clip_data, glb->view_bytes[VIEW_CLIPS], 0);
}

static void write_file(FILE *file, const struct glb *glb, const char *json, uint32_t bin_bytes)
{
    uint32_t json_bytes = (uint32_t)strlen(json);
    fwrite("glTF", 4, 1, file);
    write_u32(file, 2);
    write_u32(file, 12 + 8 + padded(json_bytes) + 8 + bin_bytes);
    write_u32(file, padded(json_bytes));
    fwrite("JSON", 4, 1, file);
    write_padded(file, json, json_bytes, ' ');
    write_u32(file, bin_bytes);
    fwrite("BIN\0", 4, 1, file);
    write_views(file, glb);
}

/* Into a file of this process beside path, which takes path's name when it is complete. */
static enum skd_status save(const struct glb *glb, const char *json, uint32_t bin_bytes,
                            const char *path, struct skd_error *error)
{
    size_t room = strlen(path) + 32;
    char *beside = malloc(room);
    if (beside == NULL)
        return skd_fail_memory(error, "a file name");
    snprintf(beside, room, "%s.%ld.part", path, (long)getpid());
    errno = 0;
    FILE *file = fopen(beside, "wb");
    int has_failed = file == NULL;
    if (file != NULL) {
        write_file(file, glb, json, bin_bytes);
        has_failed = ferror(file) != 0;
        has_failed |= fclose(file) != 0;
        has_failed = has_failed || rename(beside, path) != 0;
    }
    enum skd_status status = SKD_OK;
    if (has_failed) {
        status = skd_fail(error, SKD_FILE_IO,
                          "cannot write %s: %s; choose a folder that is there and has room", path,
                          errno != 0 ? strerror(errno) : "the disk took only part of it");
        if (file != NULL)
            unlink(beside);
    }
    free(beside);
    return status;
}

enum skd_status skd_write_glb(const struct glb_content *content, const char *path,
                              struct skd_error *error)
{
    struct glb glb = {.content = content};
    char *json = NULL;
    /* 65535 is kept free: it means a restart. */
    glb.index_bytes = content->mesh->tessellation->vertex_count <= 65535 ? 2 : 4;
    enum skd_status status = reserve_clips(&glb, error);
    if (status != SKD_OK)
        return status;
    glb.root = made(&glb, cJSON_CreateObject());
    describe(&glb);
    uint32_t bin_bytes = describe_buffer(&glb);
    json = glb.has_failed ? NULL : cJSON_PrintUnformatted(glb.root);
    if (json == NULL)
        status = skd_fail_memory(error, "the file's description");
    else
        status = save(&glb, json, bin_bytes, path, error);
    cJSON_free(json);
    cJSON_Delete(glb.root);
    free(glb.clip_data);
    return status;
}
