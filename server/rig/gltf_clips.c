/* See gltf_read.h: clips. */
#include "rig/gltf_read.h"

#include "rig/clip.h"
#include "rig/elements.h"
#include "rig/matrix.h"
#include "rig/names.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* False for what moves no bone: morph weights, pointers of extensions. */
static bool read_path(const char *text, enum skd_channel_path *path)
{
    static const char *const names[] = {"translation", "rotation", "scale"};
    for (int i = 0; i < 3; i++)
        if (strcmp(text, names[i]) == 0) {
            *path = (enum skd_channel_path)i;
            return true;
        }
    return false;
}

static enum skd_interpolation read_interpolation(const char *text)
{
    if (strcmp(text, "STEP") == 0)
        return SKD_STEP;
    return strcmp(text, "CUBICSPLINE") == 0 ? SKD_CUBICSPLINE : SKD_LINEAR;
}

/* Makes each rotation key unit. A cubic key's tangents are scaled with it, so that the curve keeps
 * its shape. */
static void mend_rotations(struct skd_channel *channel, size_t *notes)
{
    const size_t step = channel->interpolation == SKD_CUBICSPLINE ? 12 : 4;
    const size_t value = channel->interpolation == SKD_CUBICSPLINE ? 4 : 0;
    for (size_t k = 0; k < channel->key_count; k++) {
        float *key = channel->values + k * step;
        double rotation[4];
        for (size_t i = 0; i < 4; i++)
            rotation[i] = (double)key[value + i];
        const double length = skd_quaternion_normalise(rotation);
        notes[SKD_NOTE_ROTATIONS_NORMALISED] += fabs(length - 1) > SKD_ROTATION_VALID;
        for (size_t i = 0; i < step; i++)
            key[i] = length > 0 ? (float)((double)key[i] / length) : 0;
        for (size_t i = 0; i < 4; i++)
            key[value + i] = (float)rotation[i];
    }
}

static enum skd_status read_times(const struct skd_elements *input, const char *what,
                                  struct skd_channel *channel, struct skd_error *error)
{
    skd_elements_floats(input, 0, channel->key_count, channel->times);
    for (size_t k = 0; k < channel->key_count; k++) {
        if (!isfinite(channel->times[k]) || (k > 0 && channel->times[k] < channel->times[k - 1]))
            return skd_fail(error, SKD_BAD_RIG, "%s: the times of its keys do not rise", what);
    }
    return SKD_OK;
}

static enum skd_status read_values(const struct skd_elements *output, const char *what,
                                   struct skd_channel *channel, struct skd_error *error)
{
    skd_elements_floats(output, 0, output->count, channel->values);
    for (size_t i = 0; i < output->count * (size_t)output->width; i++)
        if (!isfinite(channel->values[i]))
            return skd_fail(error, SKD_BAD_RIG, "%s: a key is not finite", what);
    return SKD_OK;
}

/* *budget: key values that the file may still bring. */
static enum skd_status read_keys(const struct skd_gltf_container *container,
                                 const struct skd_gltf_sampler *sampler, const char *what,
                                 struct skd_channel *channel, size_t *budget, size_t *notes,
                                 struct skd_error *error)
{
    struct skd_elements input = {0}, output = {0};
    const int width = skd_channel_width(channel);
    enum skd_status status = skd_elements_open(container, sampler->input, 1, what, &input, error);
    if (status == SKD_OK)
        status = skd_elements_open(container, sampler->output, width, what, &output, error);
    if (status != SKD_OK)
        goto done;
    const size_t per_key = channel->interpolation == SKD_CUBICSPLINE ? 3 : 1;
    if (input.count == 0 || output.count / per_key != input.count || output.count % per_key != 0) {
        status = skd_fail(error, SKD_BAD_RIG, "%s: %zu times and %zu values do not fit", what,
                          input.count, output.count);
        goto done;
    }
    if (output.count > *budget / 4) {
        status = skd_fail(error, SKD_TOO_LARGE, "the clips have more than %zu numbers",
                          SKD_KEY_VALUES_MAX);
        goto done;
    }
    *budget -= output.count * 4;
    channel->key_count = input.count;
    channel->times = malloc(input.count * sizeof *channel->times);
    channel->values = malloc(output.count * (size_t)width * sizeof *channel->values);
    if (channel->times == NULL || channel->values == NULL) {
        status = skd_fail_memory(error, "the clips");
        goto done;
    }
    status = read_times(&input, what, channel, error);
    if (status == SKD_OK)
        status = read_values(&output, what, channel, error);
    if (status == SKD_OK && channel->path == SKD_ROTATION)
        mend_rotations(channel, notes);
done:
    skd_elements_close(&input);
    skd_elements_close(&output);
    return status;
}

static enum skd_status read_clip(const struct skd_gltf_container *container, size_t index,
                                 struct skd_rig *rig, size_t *budget, struct skd_error *error)
{
    const struct skd_gltf_animation *from = &container->document->animations[index];
    struct skd_clip *clip = &rig->nodes.clips[index];
    clip->channels = calloc(from->channel_count + 1, sizeof *clip->channels);
    clip->name = strdup(from->name);
    if (clip->channels == NULL || clip->name == NULL)
        return skd_fail_memory(error, "the clips");
    for (size_t c = 0; c < from->channel_count; c++) {
        const struct skd_gltf_channel *given = &from->channels[c];
        struct skd_channel *channel = &clip->channels[clip->channel_count];
        char what[64];
        if (!read_path(given->path, &channel->path))
            continue;
        (void)snprintf(what, sizeof what, "channel %zu of animation %zu", c, index);
        if (given->sampler < 0 || (size_t)given->sampler >= from->sampler_count)
            return skd_fail(error, SKD_BAD_RIG, "%s has sampler %d, which is not there", what,
                            given->sampler);
        if (given->node < 0 || (size_t)given->node >= rig->nodes.count)
            return skd_fail(error, SKD_BAD_RIG, "%s moves node %d, which is not there", what,
                            given->node);
        channel->node = given->node;
        const struct skd_gltf_sampler *sampler = &from->samplers[given->sampler];
        channel->interpolation = read_interpolation(sampler->interpolation);
        clip->channel_count++;
        const enum skd_status status =
            read_keys(container, sampler, what, channel, budget, rig->notes, error);
        if (status != SKD_OK)
            return status;
        const double end = (double)channel->times[channel->key_count - 1];
        clip->duration = end > clip->duration ? end : clip->duration;
    }
    return SKD_OK;
}

/* A channel replaces translation, rotation or scale: a node that has a matrix instead needs them.
 */
static void split_animated_matrices(struct skd_nodes *nodes)
{
    for (size_t c = 0; c < nodes->clip_count; c++)
        for (size_t i = 0; i < nodes->clips[c].channel_count; i++) {
            struct skd_node *node = &nodes->items[nodes->clips[c].channels[i].node];
            if (!node->has_matrix)
                continue;
            skd_matrix_to_trs(node->local, node->translation, node->rotation, node->scale);
            node->has_matrix = 0;
        }
}

enum skd_status skd_gltf_read_clips(const struct skd_gltf_container *container, struct skd_rig *rig,
                                    struct skd_error *error)
{
    const size_t count = container->document->animation_count;
    size_t budget = SKD_KEY_VALUES_MAX;
    if (count > SKD_CLIPS_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "the file has %zu clips, more than %d", count,
                        (int)SKD_CLIPS_MAX);
    rig->nodes.clips = calloc(count + 1, sizeof *rig->nodes.clips);
    char **names = calloc(count + 1, sizeof *names);
    enum skd_status status = SKD_OK;
    if (rig->nodes.clips == NULL || names == NULL)
        status = skd_fail_memory(error, "the clips");
    else
        rig->nodes.clip_count = count;
    for (size_t c = 0; status == SKD_OK && c < count; c++)
        status = read_clip(container, c, rig, &budget, error);
    if (status == SKD_OK) {
        for (size_t c = 0; c < count; c++)
            names[c] = rig->nodes.clips[c].name;
        status = skd_names_make_unique(names, count, "clip", error);
        for (size_t c = 0; c < count; c++)
            rig->nodes.clips[c].name = names[c];
        split_animated_matrices(&rig->nodes);
    }
    free(names);
    return status;
}
