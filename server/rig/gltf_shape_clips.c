/* See gltf_shapes.h: animation of morph targets' weights.
 *
 *      keys of a channel   [t0 t1][t0 t1]...        (cubic: tangent in, value, tangent out a key)
 *      with one target     [t0 t1 0][t0 t1 0]...
 */
#include "rig/gltf_shapes.h"

#include "rig/elements.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One channel of an animation. */
struct channel {
    struct skd_json json;
    long sampler;
    long mesh;           /* whose weights it moves; -1: something else */
    size_t added;        /* targets that the mesh gets */
    size_t old_count;    /* and has */
    size_t leader;       /* first channel with the same sampler and counts */
    size_t next_sampler; /* leader: the one that it uses from now on */
};

static bool is_string(struct skd_json value, const char *text)
{
    const size_t length = strlen(text);
    return (size_t)(value.end - value.start) == length + 2 && *value.start == '"' &&
           memcmp(value.start + 1, text, length) == 0;
}

/* The mesh of a node; -1: none. */
static long mesh_of_node(const struct skd_gltf_document *document, long node)
{
    return node >= 0 && (size_t)node < document->node_count ? document->nodes[node].mesh : -1;
}

/* The mesh whose weights a channel moves, all of them; -1: it moves something else.
 * KHR_animation_pointer names them "/nodes/1/weights" or "/meshes/1/weights". */
static long mesh_of_channel(const struct skd_gltf_document *document, struct skd_json channel)
{
    struct skd_json target, path, extensions, extension, pointer;
    if (!skd_json_member(channel, "target", &target) || !skd_json_member(target, "path", &path))
        return -1;
    if (is_string(path, "weights"))
        return mesh_of_node(document, skd_json_index(target, "node"));
    if (!is_string(path, "pointer") || !skd_json_member(target, "extensions", &extensions) ||
        !skd_json_member(extensions, "KHR_animation_pointer", &extension) ||
        !skd_json_member(extension, "pointer", &pointer))
        return -1;
    int index = -1, end = 0;
    if (sscanf(pointer.start, "\"/nodes/%9d/weights\"%n", &index, &end) == 1 && end > 0)
        return mesh_of_node(document, index);
    if (sscanf(pointer.start, "\"/meshes/%9d/weights\"%n", &index, &end) == 1 && end > 0)
        return index;
    return -1;
}

/* Adds the sampler's output with zeros behind each key. */
static enum skd_status widen_output(const struct skd_gltf_shaping *shaping, size_t animation,
                                    struct skd_json sampler, const struct channel *channel,
                                    int32_t *accessor, struct skd_error *error)
{
    const struct skd_gltf_document *document = shaping->container->document;
    struct skd_gltf_additions *additions = &shaping->patch->additions;
    const long input = skd_json_index(sampler, "input");
    const long output = skd_json_index(sampler, "output");
    struct skd_json interpolation;
    struct skd_elements old;
    char what[64];
    size_t at = 0;
    (void)snprintf(what, sizeof what, "sampler %ld of animation %zu", channel->sampler, animation);
    enum skd_status status =
        skd_elements_open(shaping->container, (int32_t)output, 1, what, &old, error);
    if (status != SKD_OK)
        return status;
    size_t rows = input >= 0 && (size_t)input < document->accessor_count
                      ? document->accessors[input].count
                      : 0;
    if (skd_json_member(sampler, "interpolation", &interpolation) &&
        is_string(interpolation, "CUBICSPLINE"))
        rows *= 3;
    if (rows == 0 || old.count / rows != channel->old_count || old.count % rows != 0) {
        status = skd_fail(error, SKD_UNSUPPORTED,
                          "%s has %zu values, which does not fit the %zu morph targets of mesh "
                          "%ld; mend the animation before a shape is added",
                          what, old.count, channel->old_count, channel->mesh);
        goto done;
    }
    const size_t value_bytes = skd_component_bytes(old.component);
    const size_t width = channel->old_count + channel->added;
    const struct skd_gltf_addition addition = {.component = old.component,
                                               .width = 1,
                                               .is_normalized = old.is_normalized,
                                               .count = rows * width};
    status = skd_gltf_add_elements(additions, &addition, accessor, &at, error);
    if (status != SKD_OK)
        goto done;
    uint8_t *to = additions->tail + at;
    for (size_t i = 0; i < old.count; i++)
        memcpy(to + (i / channel->old_count * width + i % channel->old_count) * value_bytes,
               old.bytes + i * old.stride, value_bytes);
done:
    skd_elements_close(&old);
    return status;
}

/* A copy of a sampler's text with another output; NULL: no memory. */
static char *copy_sampler(struct skd_json sampler, int32_t accessor)
{
    struct skd_json output;
    char *text = NULL;
    if (!skd_json_member(sampler, "output", &output) ||
        asprintf(&text, "%.*s%d%.*s", (int)(output.start - sampler.start), sampler.start, accessor,
                 (int)(sampler.end - output.end), output.end) < 0)
        return NULL;
    return text;
}

/* True when a channel that moves something else, or other numbers of weights, uses the sampler. */
static bool is_contested(const struct channel *channels, size_t count, const struct channel *of)
{
    for (size_t c = 0; c < count; c++)
        if (channels[c].sampler == of->sampler &&
            (channels[c].added != of->added || channels[c].old_count != of->old_count))
            return true;
    return false;
}

/* Lists the channels of an animation; returns whether one of them needs more weights. */
static bool read_channels(const struct skd_gltf_shaping *shaping, const struct skd_json *list,
                          size_t count, struct channel *channels)
{
    bool is_needed = false;
    for (size_t c = 0; c < count; c++) {
        struct channel *channel = &channels[c];
        *channel = (struct channel){.json = list[c],
                                    .sampler = skd_json_index(list[c], "sampler"),
                                    .mesh = mesh_of_channel(shaping->container->document, list[c]),
                                    .leader = c};
        if (channel->mesh >= 0 && (size_t)channel->mesh < shaping->mesh_count &&
            shaping->growths[channel->mesh].added > 0) {
            channel->added = shaping->growths[channel->mesh].added;
            channel->old_count = shaping->growths[channel->mesh].old_count;
            is_needed = true;
        }
        for (size_t q = 0; q < c && channel->leader == c; q++)
            if (channels[q].sampler == channel->sampler && channels[q].added == channel->added &&
                channels[q].old_count == channel->old_count)
                channel->leader = q;
    }
    return is_needed;
}

/* One animation whose channels are known. */
static enum skd_status write_channels(const struct skd_gltf_shaping *shaping, size_t animation,
                                      struct skd_json sampler_list, struct channel *channels,
                                      size_t count, struct skd_error *error)
{
    struct skd_json_edits *edits = &shaping->patch->edits;
    size_t sampler_count = 0, copy_bytes = 0;
    char *copies = NULL;
    struct skd_json *samplers = skd_json_elements(sampler_list, &sampler_count);
    FILE *text = open_memstream(&copies, &copy_bytes);
    size_t next = sampler_count;
    bool has_failed = samplers == NULL || text == NULL;
    enum skd_status status = SKD_OK;
    for (size_t c = 0; !has_failed && status == SKD_OK && c < count; c++) {
        struct channel *channel = &channels[c];
        struct skd_json old;
        int32_t accessor = -1;
        if (channel->added == 0 || channel->sampler < 0 ||
            (size_t)channel->sampler >= sampler_count)
            continue;
        const struct skd_json sampler = samplers[channel->sampler];
        const bool is_shared = is_contested(channels, count, channel);
        if (channel->leader == c) {
            status = widen_output(shaping, animation, sampler, channel, &accessor, error);
            if (status != SKD_OK)
                break;
        }
        if (!is_shared) {
            if (channel->leader == c && skd_json_member(sampler, "output", &old))
                skd_json_replace(edits, old, "%d", accessor);
            continue;
        }
        if (channel->leader == c) {
            char *copy = copy_sampler(sampler, accessor);
            has_failed = copy == NULL;
            if (!has_failed)
                fprintf(text, "%s%s", next > sampler_count ? "," : "", copy);
            free(copy);
            channel->next_sampler = next++;
        }
        if (skd_json_member(channel->json, "sampler", &old))
            skd_json_replace(edits, old, "%zu", channels[channel->leader].next_sampler);
    }
    has_failed |= text != NULL && fclose(text) != 0;
    if (!has_failed && next > sampler_count)
        skd_json_append(edits, sampler_list, copies);
    free(copies);
    free(samplers);
    return has_failed ? skd_fail_memory(error, "the animation of morph targets") : status;
}

enum skd_status skd_gltf_shape_clips_write(const struct skd_gltf_shaping *shaping,
                                           struct skd_error *error)
{
    struct skd_json animations, key, animation, samplers;
    enum skd_status status = SKD_OK;
    if (!skd_json_member(shaping->container->json, "animations", &animations))
        return SKD_OK;
    for (size_t a = 0; status == SKD_OK && skd_json_next(&animations, &key, &animation); a++) {
        size_t count = 0;
        struct skd_json *list = skd_json_member_elements(animation, "channels", &count);
        struct channel *channels = malloc((count + 1) * sizeof *channels);
        if (list == NULL || channels == NULL)
            status = skd_fail_memory(error, "the animation of morph targets");
        else if (read_channels(shaping, list, count, channels) &&
                 skd_json_member(animation, "samplers", &samplers))
            status = write_channels(shaping, a, samplers, channels, count, error);
        free(list);
        free(channels);
    }
    return status;
}
