/* See gltf_shapes.h: weights and names that stand beside morph targets. */
#include "rig/gltf_shapes.h"

#include "rig/names.h"

#include <stdlib.h>
#include <string.h>

/* Puts `text` ("x,y") in place of an array's elements from `kept` on. */
static void replace_rest(struct skd_json_edits *edits, struct skd_json array, size_t kept,
                         const char *text)
{
    struct skd_json at = array, key, last = {array.start, array.start + 1};
    for (size_t i = 0; i < kept; i++)
        (void)skd_json_next(&at, &key, &last);
    skd_json_replace(edits, (struct skd_json){last.end, array.end - 1}, "%s%s", kept > 0 ? "," : "",
                     text);
}

/* "weights" of a mesh or node, if it has them. */
static enum skd_status lengthen_weights(const struct skd_gltf_shaping *shaping,
                                        struct skd_json owner, const struct skd_gltf_growth *growth,
                                        struct skd_error *error)
{
    struct skd_json weights;
    if (growth->added == 0 || !skd_json_member(owner, "weights", &weights) || *weights.start != '[')
        return SKD_OK;
    const size_t there = skd_json_count(weights);
    const size_t kept = there < growth->old_count ? there : growth->old_count;
    const size_t zeros = growth->old_count - kept + growth->added;
    char *text = malloc(2 * zeros);
    if (text == NULL)
        return skd_fail_memory(error, "the weights of morph targets");
    for (size_t i = 0; i < zeros; i++) {
        text[2 * i] = '0';
        text[2 * i + 1] = i + 1 < zeros ? ',' : '\0';
    }
    replace_rest(&shaping->patch->edits, weights, kept, text);
    free(text);
    return SKD_OK;
}

/* A JSON string as plain text, or NULL. */
static char *decode(struct skd_json value)
{
    cJSON *item = cJSON_ParseWithLength(value.start, (size_t)(value.end - value.start));
    const char *text = cJSON_GetStringValue(item);
    char *copy = text != NULL ? strdup(text) : NULL;
    cJSON_Delete(item);
    return copy;
}

/* The name of the accessor of target `index`, as programs show it when there is no other. */
static char *accessor_name(const struct skd_gltf_shaping *shaping, size_t m, size_t index,
                           const struct skd_json *accessors, size_t accessor_count)
{
    struct skd_json primitive, targets, key, target = {NULL, NULL}, name;
    if (!skd_gltf_primitive_json(shaping->meshes, m, 0, &primitive) ||
        !skd_json_member(primitive, "targets", &targets))
        return NULL;
    for (size_t i = 0; i <= index; i++)
        if (!skd_json_next(&targets, &key, &target))
            return NULL;
    const long accessor = skd_json_index(target, "POSITION");
    return accessor >= 0 && (size_t)accessor < accessor_count &&
                   skd_json_member(accessors[accessor], "name", &name)
               ? decode(name)
               : NULL;
}

/* Names of all targets of a mesh, the file's and then the shapes', none twice. */
static enum skd_status find_names(const struct skd_gltf_shaping *shaping, size_t m,
                                  struct skd_json list, char **names, struct skd_error *error)
{
    const struct skd_gltf_growth *growth = &shaping->growths[m];
    const struct skd_gltf_content *content = shaping->content;
    struct skd_json key, value;
    size_t count = 0, accessor_count = 0;
    while (count < growth->old_count && skd_json_next(&list, &key, &value))
        names[count++] = decode(value);
    if (count < growth->old_count) {
        struct skd_json *accessors =
            skd_json_member_elements(shaping->container->json, "accessors", &accessor_count);
        if (accessors == NULL)
            return skd_fail_memory(error, "the names of morph targets");
        for (; count < growth->old_count; count++)
            names[count] = accessor_name(shaping, m, count, accessors, accessor_count);
        free(accessors);
    }
    for (size_t s = 0; s < content->shape_count; s++)
        if (shaping->is_used[s * shaping->mesh_count + m]) {
            names[count] = strdup(content->shapes[s].name);
            if (names[count++] == NULL)
                return skd_fail_memory(error, "the names of morph targets");
        }
    return skd_names_make_unique(names, count, "target_", error);
}

/* names[first..count-1] as JSON strings with commas between them, or NULL. */
static char *print_names(char *const *names, size_t first, size_t count)
{
    cJSON *list = cJSON_CreateArray();
    for (size_t i = first; i < count; i++)
        cJSON_AddItemToArray(list, cJSON_CreateString(names[i]));
    char *text = cJSON_PrintUnformatted(list);
    cJSON_Delete(list);
    if (text == NULL)
        return NULL;
    const size_t length = strlen(text);
    memmove(text, text + 1, length - 2);
    text[length - 2] = '\0';
    return text;
}

/* extras.targetNames of a mesh. Names that stand there stay as they are written. */
static enum skd_status complete_names(const struct skd_gltf_shaping *shaping, size_t m,
                                      struct skd_error *error)
{
    const struct skd_gltf_growth *growth = &shaping->growths[m];
    const size_t count = growth->old_count + growth->added;
    struct skd_json extras, list = {NULL, NULL};
    struct skd_json_edits *edits = &shaping->patch->edits;
    const bool has_extras = skd_json_member(shaping->meshes[m], "extras", &extras);
    const bool has_list = has_extras && skd_json_member(extras, "targetNames", &list);
    if ((has_extras && *extras.start != '{') || (has_list && *list.start != '['))
        return SKD_OK;
    const size_t there = has_list ? skd_json_count(list) : 0;
    const size_t kept = there < growth->old_count ? there : growth->old_count;
    char *text = NULL, *array = NULL;
    char **names = calloc(count, sizeof *names);
    enum skd_status status = names != NULL ? find_names(shaping, m, list, names, error)
                                           : skd_fail_memory(error, "the names of morph targets");
    if (status != SKD_OK)
        goto done;
    text = print_names(names, kept, count);
    if (text == NULL ||
        asprintf(&array, has_extras ? "[%s]" : "{\"targetNames\":[%s]}", text) < 0) {
        status = skd_fail_memory(error, "the names of morph targets");
        goto done;
    }
    if (has_list)
        replace_rest(edits, list, kept, text);
    else if (has_extras)
        skd_json_add(edits, extras, "targetNames", array);
    else
        skd_json_add(edits, shaping->meshes[m], "extras", array);
done:
    for (size_t i = 0; names != NULL && i < count; i++)
        free(names[i]);
    free(names);
    free(text);
    free(array);
    return status;
}

enum skd_status skd_gltf_shape_names_write(const struct skd_gltf_shaping *shaping,
                                           struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t m = 0; status == SKD_OK && m < shaping->mesh_count; m++) {
        if (shaping->growths[m].added == 0)
            continue;
        status = lengthen_weights(shaping, shaping->meshes[m], &shaping->growths[m], error);
        if (status == SKD_OK)
            status = complete_names(shaping, m, error);
    }
    struct skd_json nodes, key, node;
    if (!skd_json_member(shaping->container->json, "nodes", &nodes))
        return status;
    while (status == SKD_OK && skd_json_next(&nodes, &key, &node)) {
        const long mesh = skd_json_index(node, "mesh");
        if (mesh >= 0 && (size_t)mesh < shaping->mesh_count)
            status = lengthen_weights(shaping, node, &shaping->growths[mesh], error);
    }
    return status;
}
