/* See rig_image_reader.h: nodes, clips, and the files that they came from. */
#include "rig/rig_image_reader.h"

#include "rig/clip.h"
#include "rig/gltf_source.h"
#include "rig/matrix.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool are_finite(const double *numbers, size_t count)
{
    bool result = true;
    for (size_t i = 0; i < count; i++)
        result = result && isfinite(numbers[i]);
    return result;
}

static bool is_node_good(const struct skd_node *node)
{
    return are_finite(node->local, SKD_MATRIX_SIZE) && are_finite(node->translation, 3) &&
           are_finite(node->rotation, 4) && are_finite(node->scale, 3);
}

/* Each node once, behind its parent. */
static bool is_order_good(const struct skd_nodes *nodes, bool *is_listed)
{
    for (size_t i = 0; i < nodes->count; i++) {
        const int32_t node = nodes->order[i];
        if (node < 0 || (size_t)node >= nodes->count || is_listed[node])
            return false;
        const int32_t parent = nodes->items[node].parent;
        if (parent < -1 || (parent >= 0 && ((size_t)parent >= nodes->count || !is_listed[parent])))
            return false;
        is_listed[node] = true;
    }
    return true;
}

enum skd_status skd_image_read_nodes(struct skd_image_reader *reader, struct skd_rig *rig)
{
    struct skd_nodes *nodes = &rig->nodes;
    const size_t count = reader->head->node_count;
    if ((reader->head->flags & SKD_IMAGE_HAS_SOURCE) == 0)
        return SKD_OK;
    nodes->items = skd_image_copy(reader, count, sizeof *nodes->items);
    if (nodes->items == NULL)
        return reader->error->status;
    nodes->order = skd_image_copy(reader, count, sizeof *nodes->order);
    if (nodes->order == NULL)
        return reader->error->status;
    nodes->count = count;
    for (size_t n = 0; n < count; n++)
        if (!is_node_good(&nodes->items[n]))
            return skd_image_wrong(reader, "a node's transform is not finite");
    bool *is_listed = calloc(count + 1, sizeof *is_listed);
    if (is_listed == NULL)
        return skd_fail_memory(reader->error, "the nodes");
    const bool is_good = is_order_good(nodes, is_listed);
    free(is_listed);
    return is_good ? SKD_OK : skd_image_wrong(reader, "its nodes are no tree");
}

/* *budget: key values that the image may still bring. */
static enum skd_status read_keys(struct skd_image_reader *reader, struct skd_channel *channel,
                                 size_t *budget)
{
    const size_t step = skd_channel_step(channel);
    if (channel->key_count == 0 || channel->key_count > *budget / step)
        return skd_image_wrong(reader, "a channel has no keys, or its clips too many");
    *budget -= channel->key_count * step;
    channel->times = skd_image_copy(reader, channel->key_count, sizeof *channel->times);
    if (channel->times == NULL)
        return reader->error->status;
    channel->values = skd_image_copy(reader, channel->key_count * step, sizeof *channel->values);
    if (channel->values == NULL)
        return reader->error->status;
    bool is_good = true;
    for (size_t k = 0; k < channel->key_count; k++)
        is_good = is_good && isfinite(channel->times[k]) &&
                  (k == 0 || channel->times[k] >= channel->times[k - 1]);
    for (size_t i = 0; i < channel->key_count * step; i++)
        is_good = is_good && isfinite(channel->values[i]);
    return is_good ? SKD_OK : skd_image_wrong(reader, "a clip's keys are not finite or not rising");
}

static enum skd_status read_channel(const struct skd_image_reader *reader,
                                    const struct skd_image_channel *image,
                                    const struct skd_nodes *nodes, struct skd_channel *channel)
{
    if (image->node < 0 || (size_t)image->node >= nodes->count ||
        nodes->items[image->node].has_matrix || image->path > SKD_SCALE ||
        image->interpolation > SKD_CUBICSPLINE)
        return skd_image_wrong(reader, "a channel of a clip moves what cannot be moved");
    *channel = (struct skd_channel){
        .node = image->node,
        .path = (enum skd_channel_path)image->path,
        .interpolation = (enum skd_interpolation)image->interpolation,
        .key_count = image->key_count,
    };
    return SKD_OK;
}

/* The channels of all clips stand one after the other, then the keys of all. */
static enum skd_status read_channels(struct skd_image_reader *reader, struct skd_nodes *nodes,
                                     const uint32_t *counts)
{
    const size_t all = reader->head->channel_count;
    const struct skd_image_channel *images = skd_image_take(reader, all, sizeof *images);
    if (images == NULL)
        return SKD_BAD_RIG;
    size_t used = 0, budget = SKD_KEY_VALUES_MAX;
    for (size_t c = 0; c < nodes->clip_count; c++) {
        struct skd_clip *clip = &nodes->clips[c];
        if (counts[c] > all - used)
            return skd_image_wrong(reader, "a clip has channels that are not there");
        clip->channels = calloc(counts[c] + (size_t)1, sizeof *clip->channels);
        if (clip->channels == NULL)
            return skd_fail_memory(reader->error, "the clips");
        for (size_t i = 0; i < counts[c]; i++) {
            struct skd_channel *channel = &clip->channels[i];
            enum skd_status status = read_channel(reader, &images[used++], nodes, channel);
            clip->channel_count++;
            if (status == SKD_OK)
                status = read_keys(reader, channel, &budget);
            if (status != SKD_OK)
                return status;
            const double end = (double)channel->times[channel->key_count - 1];
            clip->duration = end > clip->duration ? end : clip->duration;
        }
    }
    return used == all ? SKD_OK : skd_image_wrong(reader, "a channel is of no clip");
}

static enum skd_status check_clip_names(const struct skd_image_reader *reader,
                                        const struct skd_nodes *nodes)
{
    char *names[SKD_CLIPS_MAX];
    for (size_t c = 0; c < nodes->clip_count; c++)
        names[c] = nodes->clips[c].name;
    return skd_image_check_unique(reader, names, NULL, nodes->clip_count);
}

enum skd_status skd_image_read_clips(struct skd_image_reader *reader, struct skd_rig *rig)
{
    struct skd_nodes *nodes = &rig->nodes;
    const size_t count = reader->head->clip_count;
    if ((reader->head->flags & SKD_IMAGE_HAS_SOURCE) == 0)
        return SKD_OK;
    nodes->clips = calloc(count + 1, sizeof *nodes->clips);
    if (nodes->clips == NULL)
        return skd_fail_memory(reader->error, "the clips");
    nodes->clip_count = count;
    enum skd_status status = skd_image_strings(reader, count, SKD_NAME_BYTES_MAX,
                                               &nodes->clips->name, sizeof *nodes->clips);
    if (status == SKD_OK)
        status = check_clip_names(reader, nodes);
    if (status != SKD_OK)
        return status;
    const uint32_t *counts = skd_image_take(reader, count, sizeof *counts);
    return counts != NULL ? read_channels(reader, nodes, counts) : SKD_BAD_RIG;
}

static enum skd_status read_files(struct skd_image_reader *reader, struct skd_gltf_source *source)
{
    const size_t count = source->external_count + 1;
    char *paths[SKD_GLTF_FILES_MAX + 1] = {NULL};
    const struct skd_image_file *files = NULL;
    enum skd_status status = skd_image_strings(reader, count, 0, paths, sizeof *paths);
    if (status == SKD_OK && (files = skd_image_take(reader, count, sizeof *files)) == NULL)
        status = SKD_BAD_RIG;
    for (size_t i = 0; status == SKD_OK && i < count; i++) {
        struct skd_gltf_file *file = i == 0 ? &source->main : &source->externals[i - 1];
        const bool is_file = files[i].is_file != 0;
        if (files[i].bytes > SKD_FILE_BYTES_MAX || (i == 0 && !is_file) ||
            (is_file && (paths[i][0] == '\0' || !files[i].is_read))) {
            status = skd_image_wrong(reader, "it does not say what file it came from");
            break;
        }
        if (!is_file)
            continue;
        file->path = paths[i];
        paths[i] = NULL;
        file->bytes = files[i].bytes;
        file->is_read = true;
        file->digest[0] = files[i].digest[0];
        file->digest[1] = files[i].digest[1];
    }
    for (size_t i = 0; i < count; i++)
        free(paths[i]);
    return status;
}

/* Joints and bones name each other, skin by skin. */
static bool are_joints_good(const struct skd_rig *rig)
{
    const struct skd_gltf_source *source = rig->source;
    const struct skd_skeleton *skeleton = &rig->skeleton;
    for (int s = 0; s < source->skin_count; s++)
        for (uint32_t j = source->skin_joints[s]; j < source->skin_joints[s + 1]; j++)
            if (source->bone_of_joint[j] >= skeleton->bone_count ||
                skeleton->skins[source->bone_of_joint[j]] != s)
                return false;
    for (int b = 0; b < skeleton->bone_count; b++) {
        const uint32_t *first = &source->skin_joints[skeleton->skins[b]];
        const uint16_t joint = source->joint_of_bone[b];
        if (joint >= first[1] - first[0] || source->bone_of_joint[first[0] + joint] != b)
            return false;
    }
    return true;
}

static enum skd_status read_joints(struct skd_image_reader *reader, struct skd_rig *rig)
{
    struct skd_gltf_source *source = rig->source;
    const size_t skins = (size_t)rig->skin_count, bones = (size_t)rig->skeleton.bone_count;
    uint32_t *firsts = skd_image_copy(reader, skins + 1, sizeof *firsts);
    if (firsts == NULL)
        return reader->error->status;
    source->skin_joints = firsts;
    source->skin_count = rig->skin_count;
    bool is_good = firsts[0] == 0 && firsts[skins] <= SKD_BONES_MAX;
    for (size_t s = 0; s < skins; s++)
        is_good = is_good && firsts[s] < firsts[s + 1];
    if (!is_good)
        return skd_image_wrong(reader, "its skins have no joints, or too many");
    source->bone_of_joint = skd_image_copy(reader, firsts[skins], sizeof *source->bone_of_joint);
    if (source->bone_of_joint == NULL)
        return reader->error->status;
    source->joint_of_bone = skd_image_copy(reader, bones, sizeof *source->joint_of_bone);
    if (source->joint_of_bone == NULL)
        return reader->error->status;
    return are_joints_good(rig) ? SKD_OK : skd_image_wrong(reader, "joints and bones do not match");
}

enum skd_status skd_image_read_source(struct skd_image_reader *reader, struct skd_rig *rig)
{
    struct skd_gltf_source *source = skd_gltf_source_known(reader->head->external_count);
    if (source == NULL)
        return skd_fail_memory(reader->error, "a file");
    rig->source = source;
    enum skd_status status = read_files(reader, source);
    if (status != SKD_OK)
        return status;
    source->path = strdup(source->main.path);
    if (source->path == NULL)
        return skd_fail_memory(reader->error, "a path");
    return read_joints(reader, rig);
}
