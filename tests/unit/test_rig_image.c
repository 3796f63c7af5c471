/* Rig images: what is written comes back bit for bit, and whatever else is read gives an error or a
 * rig that keeps the promises of rig.h. */
#include "rig_image_samples.h"

#include "rig/gltf.h"
#include "rig/pose.h"
#include "rig/rig_image.h"

#include <fcntl.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

struct image {
    uint8_t *bytes;
    size_t count, room;
};

static bool append(void *user, const void *bytes, size_t count)
{
    struct image *image = user;
    if (count > image->room - image->count)
        return false;
    memcpy(image->bytes + image->count, bytes, count);
    image->count += count;
    return true;
}

static struct image write_image(const struct skd_rig *rig, const struct skd_influences *influences)
{
    const size_t bytes = skd_rig_image_bytes(rig, influences);
    struct image image = {malloc(bytes), 0, bytes};
    const struct skd_image_sink sink = {append, &image};
    assert_non_null(image.bytes);
    assert_true(skd_rig_image_write(rig, influences, &sink));
    assert_int_equal(image.count, bytes);
    return image;
}

static void finish(struct loaded *loaded)
{
    skd_rig_destroy(loaded->rig);
    skd_influences_finish(&loaded->influences);
}

/* --------------------------------------------------------------------------- same, and sound */

static void assert_same_bytes(const void *a, const void *b, size_t bytes)
{
    assert_true((a == NULL) == (b == NULL));
    if (a != NULL && bytes > 0)
        assert_memory_equal(a, b, bytes);
}

static void assert_same_clips(const struct skd_nodes *a, const struct skd_nodes *b)
{
    assert_int_equal(a->clip_count, b->clip_count);
    for (size_t c = 0; c < a->clip_count; c++) {
        assert_string_equal(a->clips[c].name, b->clips[c].name);
        assert_true(a->clips[c].duration == b->clips[c].duration);
        assert_int_equal(a->clips[c].channel_count, b->clips[c].channel_count);
        for (size_t i = 0; i < a->clips[c].channel_count; i++) {
            const struct skd_channel *x = &a->clips[c].channels[i], *y = &b->clips[c].channels[i];
            const size_t width = x->path == SKD_ROTATION ? 4 : 3;
            const size_t step = x->interpolation == SKD_CUBICSPLINE ? 3 * width : width;
            assert_int_equal(x->node, y->node);
            assert_int_equal(x->path, y->path);
            assert_int_equal(x->interpolation, y->interpolation);
            assert_int_equal(x->key_count, y->key_count);
            assert_same_bytes(x->times, y->times, x->key_count * sizeof(float));
            assert_same_bytes(x->values, y->values, x->key_count * step * sizeof(float));
        }
    }
}

/* What an export needs of them. */
static void assert_same_documents(const struct skd_gltf_document *a,
                                  const struct skd_gltf_document *b)
{
    assert_int_equal(a->view_count, b->view_count);
    assert_int_equal(a->accessor_count, b->accessor_count);
    assert_int_equal(a->mesh_count, b->mesh_count);
    assert_int_equal(a->node_count, b->node_count);
    for (size_t i = 0; i < a->view_count; i++) {
        const struct skd_gltf_view *x = &a->views[i], *y = &b->views[i];
        assert_true(x->buffer == y->buffer && x->offset == y->offset && x->bytes == y->bytes &&
                    x->stride == y->stride);
    }
    for (size_t i = 0; i < a->accessor_count; i++) {
        const struct skd_gltf_accessor *x = &a->accessors[i], *y = &b->accessors[i];
        assert_true(x->view == y->view && x->offset == y->offset && x->count == y->count &&
                    x->component == y->component && x->width == y->width &&
                    x->is_normalized == y->is_normalized && x->is_sparse == y->is_sparse &&
                    x->has_bounds == y->has_bounds && x->use_count == y->use_count);
        assert_true(x->sparse_count == y->sparse_count && x->index_view == y->index_view &&
                    x->index_offset == y->index_offset &&
                    x->index_component == y->index_component && x->value_view == y->value_view &&
                    x->value_offset == y->value_offset);
    }
    for (size_t m = 0; m < a->mesh_count; m++) {
        assert_int_equal(a->meshes[m].primitive_count, b->meshes[m].primitive_count);
        assert_same_bytes(a->meshes[m].primitives, b->meshes[m].primitives,
                          a->meshes[m].primitive_count * sizeof *a->meshes[m].primitives);
    }
    for (size_t n = 0; n < a->node_count; n++)
        assert_int_equal(a->nodes[n].mesh, b->nodes[n].mesh);
}

static void assert_same_source(const struct skd_rig *a, const struct skd_rig *b)
{
    const struct skd_gltf_source *x = a->source, *y = b->source;
    assert_true((x == NULL) == (y == NULL));
    if (x == NULL)
        return;
    assert_string_equal(x->path, y->path);
    assert_int_equal(x->external_count, y->external_count);
    for (size_t i = 0; i <= x->external_count; i++) {
        const struct skd_gltf_file *f = i == 0 ? &x->main : &x->externals[i - 1];
        const struct skd_gltf_file *g = i == 0 ? &y->main : &y->externals[i - 1];
        assert_same_bytes(f->path, g->path, f->path != NULL ? strlen(f->path) + 1 : 0);
        assert_int_equal(f->bytes, g->bytes);
        assert_int_equal(f->is_read, g->is_read);
        assert_same_bytes(f->digest, g->digest, sizeof f->digest);
        assert_int_equal(g->fd, -1);
    }
    assert_same_documents(x->document, y->document);
    const size_t skins = (size_t)x->skin_count, bones = (size_t)a->skeleton.bone_count;
    assert_int_equal(x->skin_count, y->skin_count);
    assert_same_bytes(x->skin_joints, y->skin_joints, (skins + 1) * sizeof(uint32_t));
    assert_same_bytes(x->bone_of_joint, y->bone_of_joint, x->skin_joints[skins] * sizeof(uint16_t));
    assert_same_bytes(x->joint_of_bone, y->joint_of_bone, bones * sizeof(uint16_t));
}

static void assert_same_mesh(const struct skd_mesh *a, const struct skd_mesh *b)
{
    const size_t count = a->vertex_count;
    assert_int_equal(count, b->vertex_count);
    assert_int_equal(a->triangle_count, b->triangle_count);
    assert_int_equal(a->part_count, b->part_count);
    assert_same_bytes(a->rest, b->rest, count * 3 * sizeof(float));
    assert_same_bytes(a->triangles, b->triangles, a->triangle_count * 3 * sizeof(uint32_t));
    assert_same_bytes(a->skins, b->skins, count * sizeof(uint16_t));
    assert_same_bytes(a->twins, b->twins, count * sizeof(uint32_t));
    for (size_t p = 0; p < a->part_count; p++) {
        const struct skd_part *x = &a->parts[p], *y = &b->parts[p];
        assert_string_equal(x->name, y->name);
        assert_int_equal(x->first_vertex, y->first_vertex);
        assert_int_equal(x->vertex_count, y->vertex_count);
        assert_int_equal(x->skin, y->skin);
        assert_int_equal(x->mesh, y->mesh);
        assert_int_equal(x->primitive, y->primitive);
    }
    if (a->neighbour_offsets == NULL)
        return; /* the sample has none of its own */
    assert_same_bytes(a->neighbour_offsets, b->neighbour_offsets, (count + 1) * sizeof(uint32_t));
    assert_same_bytes(a->neighbours, b->neighbours, a->neighbour_offsets[count] * sizeof(uint32_t));
}

static void assert_same_rig(const struct skd_rig *a, const struct skd_rig *b)
{
    const size_t bones = (size_t)a->skeleton.bone_count;
    const size_t matrices = bones * SKD_MATRIX_SIZE * sizeof(double);
    assert_int_equal(a->skeleton.bone_count, b->skeleton.bone_count);
    assert_int_equal(a->skin_count, b->skin_count);
    assert_true(a->length == b->length);
    assert_same_bytes(a->notes, b->notes, sizeof a->notes);
    for (size_t i = 0; i < bones; i++)
        assert_string_equal(a->skeleton.names[i], b->skeleton.names[i]);
    assert_same_bytes(a->skeleton.parents, b->skeleton.parents, bones * sizeof(int32_t));
    assert_same_bytes(a->skeleton.skins, b->skeleton.skins, bones * sizeof(uint16_t));
    assert_same_bytes(a->skeleton.nodes, b->skeleton.nodes, bones * sizeof(int32_t));
    assert_same_bytes(a->skeleton.inverse_binds, b->skeleton.inverse_binds, matrices);
    assert_same_bytes(a->rest_pose, b->rest_pose, matrices);
    if (a->skeleton.heads != NULL)
        assert_same_bytes(a->skeleton.heads, b->skeleton.heads, bones * 3 * sizeof(float));
    assert_int_equal(a->nodes.count, b->nodes.count);
    assert_same_bytes(a->nodes.items, b->nodes.items, a->nodes.count * sizeof(struct skd_node));
    assert_same_bytes(a->nodes.order, b->nodes.order, a->nodes.count * sizeof(int32_t));
    assert_same_clips(&a->nodes, &b->nodes);
    assert_same_mesh(&a->mesh, &b->mesh);
    assert_same_source(a, b);
}

/* Rows of weights as rig.h promises them. */
static void assert_sound_rows(const struct skd_rig *rig, const struct skd_influences *influences)
{
    int most = 0;
    assert_int_equal(influences->offsets[0], 0);
    for (size_t v = 0; v < rig->mesh.vertex_count; v++) {
        const uint32_t first = influences->offsets[v], end = influences->offsets[v + 1];
        double sum = 0;
        assert_true(end > first && end - first <= SKD_INFLUENCES_MAX);
        most = (int)(end - first) > most ? (int)(end - first) : most;
        for (uint32_t k = first; k < end; k++) {
            assert_true(influences->joints[k] < rig->skeleton.bone_count);
            assert_true(influences->weights[k] > 0);
            assert_true(rig->skeleton.skins[influences->joints[k]] == rig->mesh.skins[v]);
            for (uint32_t i = first; i < k; i++) {
                assert_true(influences->joints[i] != influences->joints[k]);
                assert_true(influences->weights[i] >= influences->weights[k]);
            }
            sum += (double)influences->weights[k];
        }
        assert_true(fabs(sum - 1) <= 1e-7);
    }
    assert_int_equal(influences->most, most);
}

static void assert_sound_mesh(const struct skd_mesh *mesh)
{
    for (size_t i = 0; i < mesh->vertex_count * 3; i++)
        assert_true(isfinite(mesh->rest[i]));
    for (size_t i = 0; i < mesh->triangle_count * 3; i++)
        assert_true(mesh->triangles[i] < mesh->vertex_count);
    for (size_t v = 0; mesh->twins != NULL && v < mesh->vertex_count; v++) {
        size_t steps = 0, at = v;
        do {
            at = mesh->twins[at];
            assert_true(at < mesh->vertex_count && steps++ < mesh->vertex_count);
            assert_memory_equal(mesh->rest + at * 3, mesh->rest + v * 3, 3 * sizeof(float));
        } while (at != v);
    }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        assert_true(mesh->neighbour_offsets[v] <= mesh->neighbour_offsets[v + 1]);
    for (size_t i = 0; i < mesh->neighbour_offsets[mesh->vertex_count]; i++)
        assert_true(mesh->neighbours[i] < mesh->vertex_count);
}

/* Everything that others rely on; poses walk the nodes and the keys. */
static void assert_sound(const struct loaded *loaded)
{
    const struct skd_rig *rig = loaded->rig;
    const struct skd_skeleton *skeleton = &rig->skeleton;
    double *matrices = malloc((size_t)skeleton->bone_count * SKD_MATRIX_SIZE * sizeof *matrices);
    assert_true(rig->length > 0 && isfinite(rig->length));
    for (int b = 0; b < skeleton->bone_count; b++) {
        int steps = 0;
        for (int at = b; at >= 0; at = skeleton->parents[at])
            assert_true(at < skeleton->bone_count && steps++ < skeleton->bone_count);
        assert_true(skeleton->skins[b] < rig->skin_count);
        assert_true(skeleton->names[b][0] != '\0');
        for (int i = 0; i < 3; i++)
            assert_true(isfinite(skeleton->heads[b * 3 + i]));
    }
    for (size_t c = 0; c < rig->nodes.clip_count; c++) {
        assert_int_equal(skd_rig_find_clip(rig, rig->nodes.clips[c].name), c);
        assert_int_equal(
            skd_pose_from_clip(rig, (int)c, rig->nodes.clips[c].duration / 3, matrices, NULL),
            SKD_OK);
    }
    free(matrices);
    assert_sound_mesh(&rig->mesh);
    assert_sound_rows(rig, &loaded->influences);
    assert_true(skd_rig_bytes(rig) > 0);
}

/* Reads bytes that may be anything; true when they made a rig, which is sound then. */
static bool try_read(const void *bytes, size_t count)
{
    struct loaded loaded;
    struct skd_error error = {.status = SKD_OK};
    const enum skd_status status =
        skd_rig_image_read(bytes, count, &loaded.rig, &loaded.influences, &error);
    if (status != SKD_OK) {
        assert_null(loaded.rig);
        assert_null(loaded.influences.offsets);
        assert_int_equal(error.status, status);
        assert_true(status == SKD_BAD_RIG || status == SKD_TOO_LARGE);
        return false;
    }
    assert_sound(&loaded);
    finish(&loaded);
    return true;
}

/* ------------------------------------------------------------------------------------- tests */

static void check_round_trip(const struct loaded *from)
{
    struct image image = write_image(from->rig, &from->influences);
    struct image bare = write_image(from->rig, NULL);
    struct loaded to, without;
    struct skd_error error;
    if (skd_rig_image_read(image.bytes, image.count, &to.rig, &to.influences, &error) != SKD_OK)
        fail_msg("%s", error.text);
    assert_same_rig(from->rig, to.rig);
    const size_t vertices = from->rig->mesh.vertex_count;
    const size_t count = from->influences.offsets[vertices];
    assert_same_bytes(from->influences.offsets, to.influences.offsets, (vertices + 1) * 4);
    assert_same_bytes(from->influences.joints, to.influences.joints, count * sizeof(uint16_t));
    assert_same_bytes(from->influences.weights, to.influences.weights, count * sizeof(float));
    assert_int_equal(from->influences.most, to.influences.most);
    assert_sound(&to);
    assert_int_equal(skd_rig_image_read(bare.bytes, bare.count, &without.rig, NULL, &error),
                     SKD_OK);
    assert_same_rig(from->rig, without.rig);
    /* The one is not taken for the other. */
    skd_rig_destroy(without.rig);
    assert_int_equal(skd_rig_image_read(image.bytes, image.count, &without.rig, NULL, NULL),
                     SKD_BAD_RIG);
    assert_false(try_read(bare.bytes, bare.count));
    struct image again = write_image(to.rig, &to.influences);
    assert_int_equal(again.count, image.count);
    assert_memory_equal(again.bytes, image.bytes, image.count);
    finish(&to);
    free(image.bytes);
    free(bare.bytes);
    free(again.bytes);
}

static void test_round_trips(void **state)
{
    char path[] = "/tmp/skind-test-image-XXXXXX.glb";
    (void)state;
    struct loaded sample = make_sample(), arrays = make_arrays(), file, parsed;
    struct skd_error error;
    check_round_trip(&sample);
    check_round_trip(&arrays);
    close(mkstemps(path, 4));
    make_file(path);
    if (skd_gltf_import(path, &file.rig, &file.influences, &error) != SKD_OK ||
        skd_gltf_parse(path, &parsed.rig, &parsed.influences, &error) != SKD_OK)
        fail_msg("%s", error.text);
    (void)unlink(path);
    check_round_trip(&file);
    /* What the parse leaves out is no part of the image. */
    struct image whole = write_image(file.rig, &file.influences);
    struct image part = write_image(parsed.rig, &parsed.influences);
    assert_int_equal(whole.count, part.count);
    assert_memory_equal(whole.bytes, part.bytes, part.count);
    free(whole.bytes);
    free(part.bytes);
    finish(&sample);
    finish(&arrays);
    finish(&file);
    finish(&parsed);
}

static void test_sink_can_stop(void **state)
{
    (void)state;
    struct loaded sample = make_sample();
    const size_t bytes = skd_rig_image_bytes(sample.rig, &sample.influences);
    struct image image = {malloc(bytes), 0, bytes - 1};
    const struct skd_image_sink sink = {append, &image};
    assert_false(skd_rig_image_write(sample.rig, &sample.influences, &sink));
    free(image.bytes);
    finish(&sample);
}

/* A cut image that also lies about its length, so that every array is missing once. */
static void test_every_truncation(void **state)
{
    (void)state;
    struct loaded sample = make_sample();
    struct image image = write_image(sample.rig, &sample.influences);
    for (size_t count = 0; count < image.count; count++) {
        uint8_t *cut = copy(image.bytes, count); /* of its own size: a reader beyond is seen */
        assert_false(try_read(cut, count));
        const uint64_t said = count;
        if (count >= 16)
            memcpy(cut + 8, &said, sizeof said);
        assert_false(try_read(cut, count));
        free(cut);
    }
    free(image.bytes);
    finish(&sample);
}

static uint32_t random_bits(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*seed >> 33);
}

/* Every byte of the image gets every change that tends to matter. */
static void test_every_byte(void **state)
{
    (void)state;
    struct loaded samples[] = {make_sample(), make_arrays()};
    for (size_t s = 0; s < COUNT(samples); s++) {
        struct image image = write_image(samples[s].rig, &samples[s].influences);
        size_t refused = 0;
        for (size_t i = 0; i < image.count; i++) {
            const uint8_t was = image.bytes[i];
            const uint8_t changes[] = {0,
                                       0xFF,
                                       0x7F,
                                       (uint8_t)(was ^ 1),
                                       (uint8_t)(was ^ 0x80),
                                       (uint8_t)(was + 1),
                                       (uint8_t)(was - 1)};
            for (size_t c = 0; c < COUNT(changes); c++) {
                image.bytes[i] = changes[c];
                refused += !try_read(image.bytes, image.count);
            }
            image.bytes[i] = was;
        }
        assert_true(refused > image.count); /* most changes are noticed */
        assert_true(try_read(image.bytes, image.count));
        free(image.bytes);
        finish(&samples[s]);
    }
}

static void test_many_random_changes(void **state)
{
    (void)state;
    struct loaded sample = make_sample();
    struct image image = write_image(sample.rig, &sample.influences);
    uint8_t *changed = malloc(image.count);
    uint64_t seed = 1;
    for (int round = 0; round < 20000; round++) {
        memcpy(changed, image.bytes, image.count);
        for (uint32_t flips = 1 + random_bits(&seed) % 4; flips > 0; flips--) {
            const size_t at = random_bits(&seed) % image.count;
            changed[at] ^= (uint8_t)(1u << random_bits(&seed) % 8);
        }
        if (random_bits(&seed) % 4 == 0) { /* a run taken from elsewhere */
            const size_t from = random_bits(&seed) % (image.count - 64) & ~(size_t)3;
            const size_t to = random_bits(&seed) % (image.count - 64) & ~(size_t)3;
            memcpy(changed + to, image.bytes + from, 4 + random_bits(&seed) % 60);
        }
        (void)try_read(changed, image.count);
    }
    free(changed);
    free(image.bytes);
    finish(&sample);
}

/* What a writer that was taken over could say: the rig is broken, then written. X(what, how). */
#define BREAKS(X)                                                                                  \
    X(parent_cycle, rig->skeleton.parents[0] = 1)                                                  \
    X(parent_self, rig->skeleton.parents[4] = 4)                                                   \
    X(parent_far, rig->skeleton.parents[4] = 5)                                                    \
    X(parent_low, rig->skeleton.parents[4] = -2)                                                   \
    X(parent_skin, rig->skeleton.parents[4] = 0)                                                   \
    X(skin_order, rig->skeleton.skins[1] = 1)                                                      \
    X(skin_missing, rig->skin_count = 3)                                                           \
    X(name_twice, memcpy(rig->skeleton.names[4], "root", 4))                                       \
    X(name_empty, rig->skeleton.names[1][0] = '\0')                                                \
    X(name_text, rig->skeleton.names[1][0] = '\xFF')                                               \
    X(bind, rig->skeleton.inverse_binds[7] = NAN)                                                  \
    X(rest_pose, rig->rest_pose[7] = INFINITY)                                                     \
    X(bone_node, rig->skeleton.nodes[2] = 6)                                                       \
    X(length, rig->length = 0)                                                                     \
    X(node_parent, rig->nodes.items[1].parent = 6)                                                 \
    X(node_cycle, rig->nodes.items[0].parent = 4)                                                  \
    X(node_order, rig->nodes.order[5] = 5)                                                         \
    X(node_scale, rig->nodes.items[3].scale[1] = NAN)                                              \
    X(clip_name, memcpy(rig->nodes.clips[0].name, "run", 4))                                       \
    X(key_time, rig->nodes.clips[0].channels[0].times[1] = 9)                                      \
    X(key, rig->nodes.clips[0].channels[1].values[1] = NAN)                                        \
    X(channel, rig->nodes.clips[0].channels[1].node = 0)                                           \
    X(channel_far, rig->nodes.clips[1].channels[0].node = 6)                                       \
    X(rest, rig->mesh.rest[5] = NAN)                                                               \
    X(corner, rig->mesh.triangles[8] = 8)                                                          \
    X(triangle, rig->mesh.triangles[8] = 6)                                                        \
    X(twin_far, rig->mesh.twins[7] = 8)                                                            \
    X(twin_open, rig->mesh.twins[4] = 4)                                                           \
    X(twin_two, rig->mesh.twins[1] = 4)                                                            \
    X(twin_place, rig->mesh.rest[9] = 5)                                                           \
    X(twin_weights, (rows->weights[4] = 0.625f, rows->weights[5] = 0.375f))                        \
    X(part_skin, rig->mesh.parts[2].skin = 2)                                                      \
    X(part_other_skin, rig->mesh.parts[2].skin = 0)                                                \
    X(part_count, rig->mesh.parts[2].vertex_count = 2)                                             \
    X(part_mesh, rig->mesh.parts[2].mesh = -1)                                                     \
    X(offset, rows->offsets[3] = 7)                                                                \
    X(offset_empty, rows->offsets[1] = 0)                                                          \
    X(joint, rows->joints[9] = 5)                                                                  \
    X(joint_skin, rows->joints[8] = 0)                                                             \
    X(joint_twice, rows->joints[10] = 4)                                                           \
    X(weight_sum, rows->weights[10] = 0.376f)                                                      \
    X(weight_nan, rows->weights[11] = NAN)                                                         \
    X(weight_order, (rows->weights[9] = 0.375f, rows->weights[10] = 0.625f))                       \
    X(joints_none, rig->source->skin_joints[1] = 6)                                                \
    X(joint_bone, rig->source->bone_of_joint[3] = 5)                                               \
    X(joint_other_skin, rig->source->bone_of_joint[3] = 3)                                         \
    X(bone_joint, rig->source->joint_of_bone[0] = 1)                                               \
    X(bone_joint_far, rig->source->joint_of_bone[4] = 2)                                           \
    X(file_size, rig->source->main.bytes = SIZE_MAX)                                               \
    X(accessor_width, rig->source->document->accessors[1].width = 17)                              \
    X(accessor_uses, rig->source->document->accessors[1].use_count = -1)                           \
    X(primitive_sets, rig->source->document->meshes[1].primitives->set_count = 18)                 \
    X(file_unread, rig->source->externals[1].is_read = false)

enum broken {
#define NAME(what, how) BREAK_##what,
    BREAKS(NAME)
#undef NAME
        BREAK_COUNT
};

static const char *break_rig(int number, struct skd_rig *rig, struct skd_influences *rows)
{
    switch (number) {
#define CASE(what, how)                                                                            \
    case BREAK_##what:                                                                             \
        how;                                                                                       \
        return #what;
        BREAKS(CASE)
#undef CASE
    }
    return NULL;
}

static void test_broken_rigs(void **state)
{
    (void)state;
    for (int b = 0; b < BREAK_COUNT; b++) {
        struct loaded sample = make_sample();
        const char *what = break_rig(b, sample.rig, &sample.influences);
        struct image image = write_image(sample.rig, &sample.influences);
        if (try_read(image.bytes, image.count))
            fail_msg("%s was not noticed", what);
        free(image.bytes);
        finish(&sample);
    }
}

/* Counts in the head that no image of this size can have: no memory is asked for. */
static void test_huge_counts(void **state)
{
    (void)state;
    struct loaded sample = make_sample();
    struct image image = write_image(sample.rig, &sample.influences);
    static const uint64_t sizes[] = {0,
                                     1,
                                     1 << 12,
                                     1 << 18,
                                     8000000,
                                     8000001,
                                     UINT32_MAX,
                                     (uint64_t)UINT32_MAX + 1,
                                     SIZE_MAX / 2,
                                     SIZE_MAX / 8,
                                     SIZE_MAX - 7,
                                     SIZE_MAX};
    for (size_t at = 8; at < 128; at += 4)
        for (size_t s = 0; s < COUNT(sizes); s++) {
            uint64_t was;
            memcpy(&was, image.bytes + at, sizeof was);
            if (was == sizes[s])
                continue;
            memcpy(image.bytes + at, &sizes[s], sizeof was);
            assert_false(try_read(image.bytes, image.count));
            memcpy(image.bytes + at, &was, sizeof was);
        }
    assert_true(try_read(image.bytes, image.count));
    free(image.bytes);
    finish(&sample);
}

/* ------------------------------------------------------------------------ the files behind it */

static struct loaded through_image(const char *path)
{
    struct loaded from, to;
    struct skd_error error;
    if (skd_gltf_parse(path, &from.rig, &from.influences, &error) != SKD_OK)
        fail_msg("%s", error.text);
    struct image image = write_image(from.rig, &from.influences);
    if (skd_rig_image_read(image.bytes, image.count, &to.rig, &to.influences, &error) != SKD_OK)
        fail_msg("%s", error.text);
    free(image.bytes);
    finish(&from);
    return to;
}

/* Reads a file of the source; the status. */
static enum skd_status read_main(struct skd_gltf_source *source)
{
    uint8_t *bytes = NULL;
    const enum skd_status status = skd_gltf_file_read(&source->main, &bytes, NULL);
    free(bytes);
    return status;
}

static void test_files_are_found_again(void **state)
{
    char path[] = "/tmp/skind-test-image-XXXXXX.glb";
    (void)state;
    close(mkstemps(path, 4));
    make_file(path);
    struct loaded loaded = through_image(path);
    struct skd_gltf_source *source = loaded.rig->source;
    assert_string_equal(source->path, path);
    assert_int_equal(skd_gltf_source_reopen(source, NULL), SKD_OK);
    assert_int_equal(read_main(source), SKD_OK);
    /* A file of the same size with other bytes is noticed when it is read, another size at once. */
    const int fd = open(path, O_RDWR);
    assert_int_equal(pwrite(fd, "x", 1, 100), 1);
    assert_int_equal(skd_gltf_source_reopen(source, NULL), SKD_OK);
    assert_int_equal(read_main(source), SKD_SOURCE_CHANGED);
    assert_int_equal(ftruncate(fd, 1000), 0);
    assert_int_equal(skd_gltf_source_reopen(source, NULL), SKD_SOURCE_CHANGED);
    close(fd);
    (void)unlink(path);
    assert_int_equal(skd_gltf_source_reopen(source, NULL), SKD_NO_FILE);
    finish(&loaded);
}

static void test_files_are_restored_from_copies(void **state)
{
    char path[] = "/tmp/skind-test-image-XXXXXX.glb", copied[] = "/tmp/skind-test-image-XXXXXX.glb";
    (void)state;
    close(mkstemps(path, 4));
    close(mkstemps(copied, 4));
    make_file(path);
    make_file(copied);
    struct loaded loaded = through_image(path);
    struct skd_gltf_source *source = loaded.rig->source;
    (void)unlink(path);
    assert_int_equal(skd_gltf_source_restore(source, 0, open("/dev/null", O_RDONLY), NULL),
                     SKD_SOURCE_CHANGED);
    assert_int_equal(skd_gltf_source_restore(source, 0, open(copied, O_RDONLY), NULL), SKD_OK);
    (void)unlink(copied);
    assert_int_equal(read_main(source), SKD_OK);
    assert_true(source->folder_fd >= 0); /* /tmp is still there */
    finish(&loaded);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trips),
        cmocka_unit_test(test_sink_can_stop),
        cmocka_unit_test(test_every_truncation),
        cmocka_unit_test(test_every_byte),
        cmocka_unit_test(test_many_random_changes),
        cmocka_unit_test(test_broken_rigs),
        cmocka_unit_test(test_huge_counts),
        cmocka_unit_test(test_files_are_found_again),
        cmocka_unit_test(test_files_are_restored_from_copies),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
