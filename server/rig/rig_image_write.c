/* See rig_image.h: the writer. One walk over the rig both counts and writes. */
#include "rig/rig_image.h"

#include "rig/clip.h"
#include "rig/gltf_source.h"
#include "rig/rig_image_layout.h"

#include <string.h>

enum { STAGE_BYTES = 8192 };

/* Small runs are gathered, large ones go straight from where they are. */
struct writer {
    const struct skd_image_sink *sink; /* NULL: only count */
    size_t bytes;                      /* put so far */
    bool is_stopped;
    size_t staged;
    char stage[STAGE_BYTES];
};

static void pass_on(struct writer *writer, const void *bytes, size_t count)
{
    if (count > 0 && !writer->is_stopped && writer->sink != NULL)
        writer->is_stopped = !writer->sink->write(writer->sink->user, bytes, count);
}

static void flush(struct writer *writer)
{
    pass_on(writer, writer->stage, writer->staged);
    writer->staged = 0;
}

static void put_bytes(struct writer *writer, const void *bytes, size_t count)
{
    writer->bytes += count;
    if (writer->sink == NULL || count == 0)
        return;
    if (count > STAGE_BYTES - writer->staged)
        flush(writer);
    if (count > STAGE_BYTES) {
        pass_on(writer, bytes, count);
        return;
    }
    memcpy(writer->stage + writer->staged, bytes, count);
    writer->staged += count;
}

static void pad(struct writer *writer)
{
    static const char zeros[8];
    put_bytes(writer, zeros, (8 - writer->bytes % 8) % 8);
}

static void put(struct writer *writer, const void *items, size_t count, size_t size)
{
    put_bytes(writer, items, count * size);
    pad(writer);
}

static void put_length(struct writer *writer, const char *text)
{
    const uint32_t length = text != NULL ? (uint32_t)strlen(text) : 0;
    put_bytes(writer, &length, sizeof length);
}

static void put_text(struct writer *writer, const char *text)
{
    if (text != NULL)
        put_bytes(writer, text, strlen(text));
}

static void put_head(struct writer *writer, const struct skd_rig *rig,
                     const struct skd_influences *influences, size_t bytes)
{
    const struct skd_mesh *mesh = &rig->mesh;
    struct skd_image_head head = {
        .magic = SKD_IMAGE_MAGIC,
        .bytes = bytes,
        .vertex_count = mesh->vertex_count,
        .triangle_count = mesh->triangle_count,
        .influence_count = influences != NULL ? influences->offsets[mesh->vertex_count] : 0,
        .node_count = rig->nodes.count,
        .clip_count = rig->nodes.clip_count,
        .part_count = mesh->part_count,
        .bone_count = (uint32_t)rig->skeleton.bone_count,
        .skin_count = (uint32_t)rig->skin_count,
        .flags = (mesh->twins != NULL ? SKD_IMAGE_HAS_TWINS : 0u) |
                 (influences != NULL ? SKD_IMAGE_HAS_INFLUENCES : 0u) |
                 (rig->source != NULL ? SKD_IMAGE_HAS_SOURCE : 0u),
        .note_count = SKD_NOTE_COUNT,
        .length = rig->length,
    };
    if (rig->source != NULL) {
        const struct skd_gltf_document *document = rig->source->document;
        head.external_count = rig->source->external_count;
        head.view_count = document->view_count;
        head.accessor_count = document->accessor_count;
        head.mesh_count = document->mesh_count;
        for (size_t m = 0; m < document->mesh_count; m++)
            head.primitive_count += document->meshes[m].primitive_count;
    }
    for (size_t c = 0; c < rig->nodes.clip_count; c++)
        head.channel_count += rig->nodes.clips[c].channel_count;
    put(writer, &head, 1, sizeof head);
    for (int n = 0; n < SKD_NOTE_COUNT; n++) {
        const uint64_t note = rig->notes[n];
        put(writer, &note, 1, sizeof note);
    }
}

static void put_bones(struct writer *writer, const struct skd_rig *rig)
{
    const struct skd_skeleton *skeleton = &rig->skeleton;
    const size_t count = (size_t)skeleton->bone_count;
    for (size_t b = 0; b < count; b++)
        put_length(writer, skeleton->names[b]);
    pad(writer);
    for (size_t b = 0; b < count; b++)
        put_text(writer, skeleton->names[b]);
    pad(writer);
    put(writer, skeleton->parents, count, sizeof *skeleton->parents);
    put(writer, skeleton->skins, count, sizeof *skeleton->skins);
    put(writer, skeleton->inverse_binds, count * SKD_MATRIX_SIZE, sizeof(double));
    put(writer, rig->rest_pose, count * SKD_MATRIX_SIZE, sizeof(double));
    if (rig->source != NULL)
        put(writer, skeleton->nodes, count, sizeof *skeleton->nodes);
}

static void put_channels(struct writer *writer, const struct skd_clip *clip)
{
    for (size_t i = 0; i < clip->channel_count; i++) {
        const struct skd_channel *channel = &clip->channels[i];
        const struct skd_image_channel image = {
            .node = channel->node,
            .path = (uint16_t)channel->path,
            .interpolation = (uint16_t)channel->interpolation,
            .key_count = channel->key_count,
        };
        put(writer, &image, 1, sizeof image);
    }
}

static void put_keys(struct writer *writer, const struct skd_clip *clip)
{
    for (size_t i = 0; i < clip->channel_count; i++) {
        const struct skd_channel *channel = &clip->channels[i];
        put(writer, channel->times, channel->key_count, sizeof *channel->times);
        put(writer, channel->values, channel->key_count * skd_channel_step(channel),
            sizeof *channel->values);
    }
}

static void put_nodes(struct writer *writer, const struct skd_nodes *nodes)
{
    put(writer, nodes->items, nodes->count, sizeof *nodes->items);
    put(writer, nodes->order, nodes->count, sizeof *nodes->order);
    for (size_t c = 0; c < nodes->clip_count; c++)
        put_length(writer, nodes->clips[c].name);
    pad(writer);
    for (size_t c = 0; c < nodes->clip_count; c++)
        put_text(writer, nodes->clips[c].name);
    pad(writer);
    for (size_t c = 0; c < nodes->clip_count; c++) {
        const uint32_t channels = (uint32_t)nodes->clips[c].channel_count;
        put_bytes(writer, &channels, sizeof channels);
    }
    pad(writer);
    for (size_t c = 0; c < nodes->clip_count; c++)
        put_channels(writer, &nodes->clips[c]);
    for (size_t c = 0; c < nodes->clip_count; c++)
        put_keys(writer, &nodes->clips[c]);
}

static void put_mesh(struct writer *writer, const struct skd_mesh *mesh)
{
    for (size_t p = 0; p < mesh->part_count; p++)
        put_length(writer, mesh->parts[p].name);
    pad(writer);
    for (size_t p = 0; p < mesh->part_count; p++)
        put_text(writer, mesh->parts[p].name);
    pad(writer);
    for (size_t p = 0; p < mesh->part_count; p++) {
        const struct skd_part *part = &mesh->parts[p];
        const struct skd_image_part image = {
            .vertex_count = part->vertex_count,
            .skin = part->skin,
            .mesh = part->mesh,
            .primitive = part->primitive,
        };
        put(writer, &image, 1, sizeof image);
    }
    put(writer, mesh->rest, mesh->vertex_count * 3, sizeof *mesh->rest);
    put(writer, mesh->triangles, mesh->triangle_count * 3, sizeof *mesh->triangles);
    if (mesh->twins != NULL)
        put(writer, mesh->twins, mesh->vertex_count, sizeof *mesh->twins);
}

static void put_influences(struct writer *writer, const struct skd_influences *influences,
                           size_t vertex_count)
{
    const size_t count = influences->offsets[vertex_count];
    put(writer, influences->offsets, vertex_count + 1, sizeof *influences->offsets);
    put(writer, influences->joints, count, sizeof *influences->joints);
    put(writer, influences->weights, count, sizeof *influences->weights);
}

static void put_file(struct writer *writer, const struct skd_gltf_file *file)
{
    const struct skd_image_file image = {
        .bytes = file->bytes,
        .digest = {file->digest[0], file->digest[1]},
        .is_file = file->path != NULL,
        .is_read = file->is_read,
    };
    put(writer, &image, 1, sizeof image);
}

static void put_source(struct writer *writer, const struct skd_rig *rig)
{
    const struct skd_gltf_source *source = rig->source;
    put_length(writer, source->main.path);
    for (size_t i = 0; i < source->external_count; i++)
        put_length(writer, source->externals[i].path);
    pad(writer);
    put_text(writer, source->main.path);
    for (size_t i = 0; i < source->external_count; i++)
        put_text(writer, source->externals[i].path);
    pad(writer);
    put_file(writer, &source->main);
    for (size_t i = 0; i < source->external_count; i++)
        put_file(writer, &source->externals[i]);
    put(writer, source->skin_joints, (size_t)source->skin_count + 1, sizeof *source->skin_joints);
    put(writer, source->bone_of_joint, source->skin_joints[source->skin_count],
        sizeof *source->bone_of_joint);
    put(writer, source->joint_of_bone, (size_t)rig->skeleton.bone_count,
        sizeof *source->joint_of_bone);
}

static void put_accessor(struct writer *writer, const struct skd_gltf_accessor *accessor)
{
    const struct skd_image_accessor image = {
        .offset = accessor->offset,
        .count = accessor->count,
        .sparse_count = accessor->sparse_count,
        .index_offset = accessor->index_offset,
        .value_offset = accessor->value_offset,
        .view = accessor->view,
        .component = accessor->component,
        .width = accessor->width,
        .use_count = accessor->use_count,
        .index_view = accessor->index_view,
        .index_component = accessor->index_component,
        .value_view = accessor->value_view,
        .is_normalized = accessor->is_normalized,
        .is_sparse = accessor->is_sparse,
        .has_bounds = accessor->has_bounds,
    };
    put(writer, &image, 1, sizeof image);
}

static void put_document(struct writer *writer, const struct skd_gltf_document *document)
{
    for (size_t i = 0; i < document->view_count; i++) {
        const struct skd_gltf_view *view = &document->views[i];
        const struct skd_image_view image = {view->offset, view->bytes, view->stride, view->buffer,
                                             0};
        put(writer, &image, 1, sizeof image);
    }
    for (size_t i = 0; i < document->accessor_count; i++)
        put_accessor(writer, &document->accessors[i]);
    for (size_t m = 0; m < document->mesh_count; m++) {
        const uint64_t primitives = document->meshes[m].primitive_count;
        put(writer, &primitives, 1, sizeof primitives);
    }
    for (size_t m = 0; m < document->mesh_count; m++)
        put(writer, document->meshes[m].primitives, document->meshes[m].primitive_count,
            sizeof(struct skd_gltf_primitive));
    for (size_t n = 0; n < document->node_count; n++)
        put_bytes(writer, &document->nodes[n].mesh, sizeof document->nodes[n].mesh);
    pad(writer);
}

static void put_rig(struct writer *writer, const struct skd_rig *rig,
                    const struct skd_influences *influences, size_t bytes)
{
    put_head(writer, rig, influences, bytes);
    put_bones(writer, rig);
    put_nodes(writer, &rig->nodes);
    put_mesh(writer, &rig->mesh);
    if (influences != NULL)
        put_influences(writer, influences, rig->mesh.vertex_count);
    if (rig->source != NULL) {
        put_source(writer, rig);
        put_document(writer, rig->source->document);
    }
    flush(writer);
}

size_t skd_rig_image_bytes(const struct skd_rig *rig, const struct skd_influences *influences)
{
    struct writer writer = {.sink = NULL};
    put_rig(&writer, rig, influences, 0);
    return writer.bytes;
}

bool skd_rig_image_write(const struct skd_rig *rig, const struct skd_influences *influences,
                         const struct skd_image_sink *sink)
{
    struct writer writer = {.sink = sink};
    put_rig(&writer, rig, influences, skd_rig_image_bytes(rig, influences));
    return !writer.is_stopped;
}
