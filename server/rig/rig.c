/* See rig.h: the end of a rig, looking things up in it, what it weighs. */
#include "rig/rig.h"

#include "rig/clip.h"
#include "rig/gltf_source.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *skd_note_name(enum skd_note note)
{
    static const char *const names[] = {
#define NAME(name, wire, text) wire,
        SKD_NOTES(NAME)
#undef NAME
    };
    SKD_ASSERT(note < SKD_NOTE_COUNT);
    return names[note];
}

void skd_note_text(enum skd_note note, size_t count, char *text, size_t text_bytes)
{
    switch (note) {
#define TEXT(name, wire, sentence)                                                                 \
    case SKD_NOTE_##name:                                                                          \
        (void)snprintf(text, text_bytes, sentence, count);                                         \
        return;
        SKD_NOTES(TEXT)
#undef TEXT
    case SKD_NOTE_COUNT:
        break;
    }
    SKD_ASSERT(false); /* a note of skd_note */
}

static void finish_skeleton(struct skd_skeleton *skeleton)
{
    for (int b = 0; skeleton->names != NULL && b < skeleton->bone_count; b++)
        free(skeleton->names[b]);
    free(skeleton->names);
    free(skeleton->parents);
    free(skeleton->skins);
    free(skeleton->inverse_binds);
    free(skeleton->heads);
    free(skeleton->nodes);
}

static void finish_nodes(struct skd_nodes *nodes)
{
    for (size_t c = 0; nodes->clips != NULL && c < nodes->clip_count; c++) {
        struct skd_clip *clip = &nodes->clips[c];
        for (size_t i = 0; clip->channels != NULL && i < clip->channel_count; i++) {
            free(clip->channels[i].times);
            free(clip->channels[i].values);
        }
        free(clip->channels);
        free(clip->name);
    }
    free(nodes->clips);
    free(nodes->items);
    free(nodes->order);
}

static void finish_mesh(struct skd_mesh *mesh)
{
    for (size_t p = 0; mesh->parts != NULL && p < mesh->part_count; p++)
        free(mesh->parts[p].name);
    free(mesh->parts);
    free(mesh->rest);
    free(mesh->triangles);
    free(mesh->skins);
    free(mesh->twins);
    free(mesh->neighbour_offsets);
    free(mesh->neighbours);
}

void skd_rig_destroy(struct skd_rig *rig)
{
    if (rig == NULL)
        return;
    finish_skeleton(&rig->skeleton);
    finish_nodes(&rig->nodes);
    finish_mesh(&rig->mesh);
    free(rig->rest_pose);
    skd_gltf_source_destroy(rig->source);
    free(rig);
}

void skd_influences_finish(struct skd_influences *influences)
{
    if (!influences->is_borrowed) {
        free(influences->offsets);
        free(influences->joints);
        free(influences->weights);
    }
    *influences = (struct skd_influences){0};
}

static size_t channel_bytes(const struct skd_channel *channel)
{
    return sizeof *channel + channel->key_count * (1 + skd_channel_step(channel)) * sizeof(float);
}

size_t skd_rig_bytes(const struct skd_rig *rig)
{
    const struct skd_mesh *mesh = &rig->mesh;
    const struct skd_nodes *nodes = &rig->nodes;
    const size_t bones = (size_t)rig->skeleton.bone_count;
    size_t bytes = sizeof *rig;
    bytes += bones * (sizeof(char *) + SKD_MATRIX_SIZE * sizeof(double) * 2 + 3 * sizeof(float) +
                      sizeof(int32_t) + sizeof(uint16_t));
    for (size_t b = 0; b < bones; b++)
        bytes += strlen(rig->skeleton.names[b]) + 1;
    if (rig->skeleton.nodes != NULL)
        bytes += bones * sizeof(int32_t);
    bytes += nodes->count * (sizeof *nodes->items + sizeof *nodes->order);
    for (size_t c = 0; c < nodes->clip_count; c++) {
        const struct skd_clip *clip = &nodes->clips[c];
        bytes += sizeof *clip + strlen(clip->name) + 1;
        for (size_t i = 0; i < clip->channel_count; i++)
            bytes += channel_bytes(&clip->channels[i]);
    }
    bytes += mesh->vertex_count * (3 * sizeof(float) + sizeof(uint16_t) + sizeof(uint32_t));
    bytes += mesh->triangle_count * 3 * sizeof(uint32_t);
    bytes += mesh->neighbour_offsets[mesh->vertex_count] * sizeof(uint32_t);
    if (mesh->twins != NULL)
        bytes += mesh->vertex_count * sizeof(uint32_t);
    for (size_t p = 0; p < mesh->part_count; p++)
        bytes += sizeof *mesh->parts + strlen(mesh->parts[p].name) + 1;
    return bytes + skd_gltf_source_bytes(rig->source);
}

int skd_rig_find_bone(const struct skd_rig *rig, const char *name)
{
    for (int b = 0; b < rig->skeleton.bone_count; b++)
        if (strcmp(rig->skeleton.names[b], name) == 0)
            return b;
    return -1;
}

int skd_rig_find_clip(const struct skd_rig *rig, const char *name)
{
    for (size_t c = 0; c < rig->nodes.clip_count; c++)
        if (strcmp(rig->nodes.clips[c].name, name) == 0)
            return (int)c;
    return -1;
}
