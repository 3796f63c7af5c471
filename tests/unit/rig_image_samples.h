/* Rigs to make images of: one with everything that a file can bring, one of arrays, one from a
 * file. For test_rig_image.c alone. */
#ifndef SKD_TEST_RIG_IMAGE_SAMPLES_H
#define SKD_TEST_RIG_IMAGE_SAMPLES_H

#include "clients/cli/generate/generate.h"
#include "rig/gltf_document.h"
#include "rig/gltf_source.h"
#include "rig/rig_build.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

struct loaded {
    struct skd_rig *rig;
    struct skd_influences influences;
};

static void *copy(const void *from, size_t bytes)
{
    void *to = malloc(bytes > 0 ? bytes : 1);
    assert_non_null(to);
    memcpy(to, from, bytes);
    return to;
}

#define COPY(type, ...) copy((const type[]){__VA_ARGS__}, sizeof((const type[]){__VA_ARGS__}))

static struct skd_channel make_channel(int32_t node, enum skd_channel_path path,
                                       enum skd_interpolation interpolation, size_t keys)
{
    struct skd_channel channel = {node, path, interpolation, keys, NULL, NULL};
    const size_t width = path == SKD_ROTATION ? 4 : 3;
    const size_t step = interpolation == SKD_CUBICSPLINE ? 3 * width : width;
    channel.times = calloc(keys, sizeof *channel.times);
    channel.values = calloc(keys * step, sizeof *channel.values);
    for (size_t k = 0; k < keys; k++)
        channel.times[k] = (float)k * 0.5f;
    for (size_t i = 0; i < keys * step; i++)
        channel.values[i] = 0.5f;
    return channel;
}

static void make_nodes(struct skd_nodes *nodes)
{
    const struct skd_node node = {.parent = -1, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    nodes->count = 6;
    nodes->items = calloc(6, sizeof *nodes->items);
    for (int n = 0; n < 6; n++) {
        nodes->items[n] = node;
        nodes->items[n].parent = n == 0 || n == 5 ? -1 : n - 1;
    }
    nodes->items[0].has_matrix = 1;
    nodes->items[0].local[0] = nodes->items[0].local[5] = nodes->items[0].local[10] = 1;
    nodes->order = COPY(int32_t, 5, 0, 1, 2, 3, 4);
    nodes->clip_count = 2;
    nodes->clips = calloc(2, sizeof *nodes->clips);
    nodes->clips[0] =
        (struct skd_clip){strdup("walk"), 1, 2, calloc(2, sizeof(struct skd_channel))};
    nodes->clips[0].channels[0] = make_channel(1, SKD_ROTATION, SKD_CUBICSPLINE, 3);
    nodes->clips[0].channels[1] = make_channel(2, SKD_TRANSLATION, SKD_LINEAR, 2);
    nodes->clips[1] = (struct skd_clip){strdup("run"), 0, 1, calloc(1, sizeof(struct skd_channel))};
    nodes->clips[1].channels[0] = make_channel(3, SKD_SCALE, SKD_STEP, 1);
}

static void make_document(struct skd_gltf_document *document)
{
    document->view_count = 2;
    document->views = skd_gltf_document_alloc(document, 2, sizeof *document->views);
    document->views[1] = (struct skd_gltf_view){1, 16, 96, 12};
    document->accessor_count = 3;
    document->accessors = skd_gltf_document_alloc(document, 3, sizeof *document->accessors);
    for (int i = 0; i < 3; i++)
        document->accessors[i] = (struct skd_gltf_accessor){.view = i,
                                                            .offset = 12,
                                                            .count = 8,
                                                            .component = SKD_GLTF_FLOAT,
                                                            .width = 1 + i,
                                                            .use_count = i,
                                                            .sparse_count = 3,
                                                            .index_view = 1,
                                                            .index_offset = 4,
                                                            .index_component = SKD_GLTF_BYTE,
                                                            .value_view = 2,
                                                            .value_offset = 8};
    document->accessors[0].is_normalized = true;
    document->accessors[2].is_sparse = document->accessors[1].has_bounds = true;
    document->mesh_count = 2;
    document->meshes = skd_gltf_document_alloc(document, 2, sizeof *document->meshes);
    struct skd_gltf_primitive *primitives =
        skd_gltf_document_alloc(document, 3, sizeof *primitives);
    primitives[2].set_count = SKD_SETS_MAX + 1;
    document->meshes[0] = (struct skd_gltf_mesh){2, primitives};
    document->meshes[1] = (struct skd_gltf_mesh){1, primitives + 2};
    document->node_count = 6;
    document->nodes = skd_gltf_document_alloc(document, 6, sizeof *document->nodes);
    document->nodes[5].mesh = 1;
}

static void make_source(struct skd_gltf_source *source)
{
    source->document = calloc(1, sizeof *source->document);
    make_document(source->document);
    source->path = strdup("/nowhere/knight.gltf");
    source->main.path = strdup(source->path);
    source->main.bytes = 1234;
    source->main.is_read = source->externals[1].is_read = true;
    source->main.digest[0] = 7;
    source->externals[1].path = strdup("knight.bin");
    source->externals[1].bytes = 99;
    source->skin_count = 2;
    source->skin_joints = COPY(uint32_t, 0, 4, 6); /* joint 3 stands for bone 1 again */
    source->bone_of_joint = COPY(uint16_t, 0, 1, 2, 1, 3, 4);
    source->joint_of_bone = COPY(uint16_t, 0, 1, 2, 0, 1);
}

/* What a file with everything makes: two skins, a joint that stands twice, a part without vertices,
 * vertices 1, 3 and 4 at one place, an external buffer. */
static struct loaded make_sample(void)
{
    struct loaded sample = {calloc(1, sizeof(struct skd_rig)), {.most = 2}};
    struct skd_rig *rig = sample.rig;
    static const char *const names[] = {"root", "arm", "h\xC3\xA4nd", "root", "tail"};
    rig->skin_count = 2;
    rig->length = 3.5;
    rig->notes[SKD_NOTE_JOINTS_DUPLICATE] = 1;
    rig->skeleton.bone_count = 5;
    rig->skeleton.names = calloc(5, sizeof(char *));
    rig->skeleton.inverse_binds = calloc(5 * SKD_MATRIX_SIZE, sizeof(double));
    rig->rest_pose = calloc(5 * SKD_MATRIX_SIZE, sizeof(double));
    for (int b = 0; b < 5; b++) {
        rig->skeleton.names[b] = strdup(names[b]);
        for (int i = 0; i < 3; i++)
            rig->skeleton.inverse_binds[b * SKD_MATRIX_SIZE + i * 5] =
                rig->rest_pose[b * SKD_MATRIX_SIZE + i * 5] = 1;
    }
    rig->skeleton.parents = COPY(int32_t, -1, 2, 0, -1, 3);
    rig->skeleton.skins = COPY(uint16_t, 0, 0, 0, 1, 1);
    rig->skeleton.nodes = COPY(int32_t, 1, 3, 2, 5, 4);
    make_nodes(&rig->nodes);
    struct skd_mesh *mesh = &rig->mesh;
    mesh->vertex_count = 8;
    mesh->rest =
        COPY(float, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 2, 2, 2, 3, 2, 2, 2, 3, 2);
    mesh->skins = COPY(uint16_t, 0, 0, 0, 0, 0, 1, 1, 1);
    mesh->twins = COPY(uint32_t, 0, 3, 2, 4, 1, 5, 6, 7);
    mesh->triangle_count = 3;
    mesh->triangles = COPY(uint32_t, 0, 1, 2, 2, 3, 0, 5, 6, 7);
    mesh->part_count = 3;
    mesh->parts = calloc(3, sizeof *mesh->parts);
    mesh->parts[0] = (struct skd_part){0, 5, 0, 0, 0, strdup("body")};
    mesh->parts[1] = (struct skd_part){5, 0, 0, 0, 1, strdup("")};
    mesh->parts[2] = (struct skd_part){5, 3, 1, 1, 0, strdup("cloak")};
    sample.influences.offsets = COPY(uint32_t, 0, 1, 3, 4, 6, 8, 9, 11, 12);
    sample.influences.joints = COPY(uint16_t, 0, 1, 2, 0, 1, 2, 1, 2, 3, 4, 3, 4);
    sample.influences.weights =
        COPY(float, 1, 0.75f, 0.25f, 1, 0.75f, 0.25f, 0.75f, 0.25f, 1, 0.625f, 0.375f, 1);
    rig->source = skd_gltf_source_known(2);
    make_source(rig->source);
    return sample;
}

static struct loaded make_arrays(void)
{
    static const float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
    static const uint32_t triangles[] = {0, 1, 2, 2, 1, 3};
    static const int32_t parents[] = {1, -1};
    static const uint32_t offsets[] = {0, 1, 3, 3, 5};
    static const uint16_t joints[] = {0, 1, 0, 0, 1};
    static const float weights[] = {1, 0.5f, 0.5f, 0.25f, 0.75f};
    double binds[32] = {0};
    for (int i = 0; i < 4; i++)
        binds[i * 5] = binds[16 + i * 5] = 1;
    const struct skd_rig_arrays arrays = {4,       positions, 2,       triangles, 2,      NULL,
                                          parents, binds,     offsets, joints,    weights};
    struct loaded loaded;
    assert_int_equal(skd_rig_from_arrays(&arrays, &loaded.rig, &loaded.influences, NULL), SKD_OK);
    return loaded;
}

static void make_file(const char *path)
{
    const struct skd_generate_options options = {.vertex_count = 1000, .bone_count = 20};
    struct skd_error error;
    if (skd_generate_humanoid(&options, path, &error) != SKD_OK)
        fail_msg("%s", error.text);
}

#endif
