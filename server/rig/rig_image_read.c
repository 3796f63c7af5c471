/* See rig_image.h: the reader's frame, and the bones. */
#include "rig/rig_image.h"

#include "base/utf8.h"
#include "rig/gltf_source.h"
#include "rig/matrix.h"
#include "rig/rig_derive.h"
#include "rig/rig_image_reader.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool are_skins_in_order(const struct skd_skeleton *skeleton, int skin_count)
{
    int last = -1;
    for (int b = 0; b < skeleton->bone_count; b++) {
        if (skeleton->skins[b] != last && skeleton->skins[b] != last + 1)
            return false;
        last = skeleton->skins[b];
    }
    return last == skin_count - 1;
}

/* Parents are of the same skin, and no bone is above itself. marks[], zeroed: 1 on the way up that
 * is being walked, 2 known to end. */
static bool are_parents_good(const struct skd_skeleton *skeleton, uint8_t *marks)
{
    const int32_t *parents = skeleton->parents;
    for (int b = 0; b < skeleton->bone_count; b++) {
        if (parents[b] < -1 || parents[b] >= skeleton->bone_count)
            return false;
        if (parents[b] >= 0 && skeleton->skins[parents[b]] != skeleton->skins[b])
            return false;
    }
    for (int b = 0; b < skeleton->bone_count; b++) {
        int at = b;
        for (; at >= 0 && marks[at] == 0; at = parents[at])
            marks[at] = 1;
        if (at >= 0 && marks[at] == 1)
            return false;
        for (at = b; at >= 0 && marks[at] == 1; at = parents[at])
            marks[at] = 2;
    }
    return true;
}

static enum skd_status check_bones(const struct skd_image_reader *reader, const struct skd_rig *rig)
{
    const struct skd_skeleton *skeleton = &rig->skeleton;
    uint8_t marks[SKD_BONES_MAX] = {0};
    if (!are_skins_in_order(skeleton, rig->skin_count))
        return skd_image_wrong(reader, "its bones are not in the order of their skins");
    if (!are_parents_good(skeleton, marks))
        return skd_image_wrong(reader, "a bone has a parent that cannot be");
    for (int b = 0; b < skeleton->bone_count; b++) {
        if (!skd_matrix_is_finite(skeleton->inverse_binds + b * SKD_MATRIX_SIZE) ||
            !skd_matrix_is_finite(rig->rest_pose + b * SKD_MATRIX_SIZE))
            return skd_image_wrong(reader, "a bone's matrix is not finite");
        if (skeleton->nodes != NULL &&
            (skeleton->nodes[b] < 0 || (uint64_t)skeleton->nodes[b] >= reader->head->node_count))
            return skd_image_wrong(reader, "a bone has a node that is not there");
    }
    return skd_image_check_unique(reader, skeleton->names, skeleton->skins,
                                  (size_t)skeleton->bone_count);
}

enum skd_status skd_image_read_bones(struct skd_image_reader *reader, struct skd_rig *rig)
{
    struct skd_skeleton *skeleton = &rig->skeleton;
    const size_t count = reader->head->bone_count;
    rig->skin_count = (int)reader->head->skin_count;
    skeleton->names = calloc(count, sizeof *skeleton->names);
    if (skeleton->names == NULL)
        return skd_fail_memory(reader->error, "the bones");
    skeleton->bone_count = (int)count;
    const enum skd_status status = skd_image_strings(reader, count, SKD_NAME_BYTES_MAX,
                                                     skeleton->names, sizeof *skeleton->names);
    if (status != SKD_OK)
        return status;
    const bool has_nodes = (reader->head->flags & SKD_IMAGE_HAS_SOURCE) != 0;
    if ((skeleton->parents = skd_image_copy(reader, count, sizeof *skeleton->parents)) == NULL ||
        (skeleton->skins = skd_image_copy(reader, count, sizeof *skeleton->skins)) == NULL ||
        (skeleton->inverse_binds =
             skd_image_copy(reader, count * SKD_MATRIX_SIZE, sizeof(double))) == NULL ||
        (rig->rest_pose = skd_image_copy(reader, count * SKD_MATRIX_SIZE, sizeof(double))) ==
            NULL ||
        (has_nodes &&
         (skeleton->nodes = skd_image_copy(reader, count, sizeof *skeleton->nodes)) == NULL))
        return reader->error->status;
    return check_bones(reader, rig);
}

/* Every count within the limits, so that what is worked out from them cannot overflow. Counts
 * without a limit in rig.h are held against the bytes that are there. */
static enum skd_status check_head(const struct skd_image_reader *reader, size_t bytes,
                                  bool wants_influences)
{
    const struct skd_image_head *head = reader->head;
    const bool has_influences = (head->flags & SKD_IMAGE_HAS_INFLUENCES) != 0;
    const bool has_source = (head->flags & SKD_IMAGE_HAS_SOURCE) != 0;
    if (memcmp(head->magic, SKD_IMAGE_MAGIC, sizeof head->magic) != 0 || head->bytes != bytes)
        return skd_image_wrong(reader, "it does not begin like one");
    if (has_influences != wants_influences)
        return skd_image_wrong(reader, "it should be with or without influences");
    if (head->vertex_count == 0 || head->vertex_count > SKD_VERTICES_MAX ||
        head->triangle_count > SKD_TRIANGLES_MAX || head->bone_count == 0 ||
        head->bone_count > SKD_BONES_MAX || head->skin_count == 0 ||
        head->skin_count > head->bone_count || head->node_count > SKD_NODES_MAX ||
        head->clip_count > SKD_CLIPS_MAX || head->part_count > bytes ||
        head->channel_count > bytes || head->view_count > bytes || head->accessor_count > bytes ||
        head->mesh_count > bytes || head->primitive_count > bytes ||
        head->external_count > SKD_GLTF_FILES_MAX ||
        head->influence_count > (has_influences ? UINT32_MAX : 0) ||
        head->note_count > SKD_NOTE_COUNT)
        return skd_image_wrong(reader, "a count is beyond the limits");
    if (!has_source &&
        (head->node_count | head->clip_count | head->channel_count | head->external_count |
         head->view_count | head->accessor_count | head->mesh_count | head->primitive_count) != 0)
        return skd_image_wrong(reader, "it has nodes without a file that they came from");
    if (!isfinite(head->length) || !(head->length > 0))
        return skd_image_wrong(reader, "its length is no length");
    return SKD_OK;
}

static enum skd_status read_notes(struct skd_image_reader *reader, struct skd_rig *rig)
{
    const uint64_t *notes = skd_image_take(reader, reader->head->note_count, sizeof *notes);
    if (notes == NULL)
        return SKD_BAD_RIG;
    for (size_t n = 0; n < reader->head->note_count; n++)
        rig->notes[n] = notes[n];
    rig->length = reader->head->length;
    return SKD_OK;
}

static enum skd_status read_all(struct skd_image_reader *reader, struct skd_rig *rig,
                                struct skd_influences *influences)
{
    enum skd_status status = read_notes(reader, rig);
    if (status == SKD_OK)
        status = skd_image_read_bones(reader, rig);
    if (status == SKD_OK)
        status = skd_image_read_nodes(reader, rig);
    if (status == SKD_OK)
        status = skd_image_read_clips(reader, rig);
    if (status == SKD_OK)
        status = skd_image_read_mesh(reader, rig);
    if (status == SKD_OK && influences != NULL)
        status = skd_image_read_influences(reader, rig, influences);
    if (status == SKD_OK && (reader->head->flags & SKD_IMAGE_HAS_SOURCE) != 0)
        status = skd_image_read_source(reader, rig);
    if (status == SKD_OK && rig->source != NULL)
        status = skd_image_read_document(reader, rig->source);
    if (status == SKD_OK && reader->left > 0)
        status = skd_image_wrong(reader, "something stands behind its end");
    return status;
}

enum skd_status skd_rig_image_read(const void *bytes, size_t count, struct skd_rig **rig,
                                   struct skd_influences *influences, struct skd_error *error)
{
    struct skd_error own;
    struct skd_image_reader reader = {.at = bytes, .left = count, .error = error ? error : &own};
    struct skd_scratch scratch = {0};
    *rig = NULL;
    if (influences != NULL)
        *influences = (struct skd_influences){0};
    reader.head = skd_image_take(&reader, 1, sizeof *reader.head);
    if (reader.head == NULL)
        return SKD_BAD_RIG;
    enum skd_status status = check_head(&reader, count, influences != NULL);
    if (status != SKD_OK)
        return status;
    struct skd_rig *made = calloc(1, sizeof *made);
    if (made == NULL)
        return skd_fail_memory(error, "a rig");
    status = read_all(&reader, made, influences);
    if (status == SKD_OK)
        status = skd_rig_derive(made, &scratch, error);
    skd_scratch_finish(&scratch);
    if (status == SKD_OK) {
        *rig = made;
        return SKD_OK;
    }
    skd_rig_destroy(made);
    if (influences != NULL)
        skd_influences_finish(influences);
    return status;
}
