/* See rig_image_reader.h: what an export needs of the source's JSON. As in every document, nothing
 * that points somewhere is checked here (gltf_document.h): an export follows it as it would follow
 * a file. */
#include "rig/rig_image_reader.h"

#include "rig/gltf_source.h"

#include <stdlib.h>
#include <string.h>

static void *allocate(struct skd_image_reader *reader, struct skd_gltf_document *document,
                      size_t count, size_t bytes)
{
    void *memory = skd_gltf_document_alloc(document, count, bytes);
    if (memory == NULL)
        (void)skd_fail_memory(reader->error, "the source of a rig");
    return memory;
}

static enum skd_status read_views(struct skd_image_reader *reader,
                                  struct skd_gltf_document *document)
{
    const size_t count = reader->head->view_count;
    const struct skd_image_view *images = skd_image_take(reader, count, sizeof *images);
    if (images == NULL)
        return SKD_BAD_RIG;
    document->views = allocate(reader, document, count, sizeof *document->views);
    if (document->views == NULL)
        return SKD_NO_MEMORY;
    document->view_count = count;
    for (size_t i = 0; i < count; i++)
        document->views[i] = (struct skd_gltf_view){images[i].buffer, images[i].offset,
                                                    images[i].bytes, images[i].stride};
    return SKD_OK;
}

static struct skd_gltf_accessor accessor_of(const struct skd_image_accessor *image)
{
    return (struct skd_gltf_accessor){
        .view = image->view,
        .offset = image->offset,
        .count = image->count,
        .component = image->component,
        .width = image->width,
        .is_normalized = image->is_normalized != 0,
        .is_sparse = image->is_sparse != 0,
        .has_bounds = image->has_bounds != 0,
        .use_count = image->use_count,
        .sparse_count = image->sparse_count,
        .index_view = image->index_view,
        .index_offset = image->index_offset,
        .index_component = image->index_component,
        .value_view = image->value_view,
        .value_offset = image->value_offset,
    };
}

static enum skd_status read_accessors(struct skd_image_reader *reader,
                                      struct skd_gltf_document *document)
{
    const size_t count = reader->head->accessor_count;
    const struct skd_image_accessor *images = skd_image_take(reader, count, sizeof *images);
    if (images == NULL)
        return SKD_BAD_RIG;
    document->accessors = allocate(reader, document, count, sizeof *document->accessors);
    if (document->accessors == NULL)
        return SKD_NO_MEMORY;
    document->accessor_count = count;
    for (size_t i = 0; i < count; i++) {
        if (images[i].width < 1 || images[i].width > 16 || images[i].use_count < 0)
            return skd_image_wrong(reader, "an accessor has a type that glTF does not have");
        document->accessors[i] = accessor_of(&images[i]);
    }
    return SKD_OK;
}

static enum skd_status read_meshes(struct skd_image_reader *reader,
                                   struct skd_gltf_document *document)
{
    const size_t meshes = reader->head->mesh_count, all = reader->head->primitive_count;
    const uint64_t *counts = skd_image_take(reader, meshes, sizeof *counts);
    if (counts == NULL)
        return SKD_BAD_RIG;
    const struct skd_gltf_primitive *images = skd_image_take(reader, all, sizeof *images);
    if (images == NULL)
        return SKD_BAD_RIG;
    document->meshes = allocate(reader, document, meshes, sizeof *document->meshes);
    struct skd_gltf_primitive *primitives = allocate(reader, document, all, sizeof *primitives);
    if (document->meshes == NULL || primitives == NULL)
        return SKD_NO_MEMORY;
    document->mesh_count = meshes;
    memcpy(primitives, images, all * sizeof *primitives);
    for (size_t p = 0; p < all; p++)
        if (primitives[p].set_count < 0 || primitives[p].set_count > SKD_SETS_MAX + 1)
            return skd_image_wrong(reader, "a primitive has sets that it cannot have");
    size_t used = 0;
    for (size_t m = 0; m < meshes; m++) {
        if (counts[m] > all - used)
            return skd_image_wrong(reader, "a mesh has primitives that are not there");
        document->meshes[m] = (struct skd_gltf_mesh){counts[m], primitives + used};
        used += counts[m];
    }
    return used == all ? SKD_OK : skd_image_wrong(reader, "a primitive is of no mesh");
}

static enum skd_status read_node_meshes(struct skd_image_reader *reader,
                                        struct skd_gltf_document *document)
{
    const size_t count = reader->head->node_count;
    const int32_t *meshes = skd_image_take(reader, count, sizeof *meshes);
    if (meshes == NULL)
        return SKD_BAD_RIG;
    document->nodes = allocate(reader, document, count, sizeof *document->nodes);
    if (document->nodes == NULL)
        return SKD_NO_MEMORY;
    document->node_count = count;
    for (size_t n = 0; n < count; n++)
        document->nodes[n].mesh = meshes[n];
    return SKD_OK;
}

enum skd_status skd_image_read_document(struct skd_image_reader *reader,
                                        struct skd_gltf_source *source)
{
    struct skd_gltf_document *document = calloc(1, sizeof *document);
    if (document == NULL)
        return skd_fail_memory(reader->error, "the source of a rig");
    source->document = document;
    enum skd_status status = read_views(reader, document);
    if (status == SKD_OK)
        status = read_accessors(reader, document);
    if (status == SKD_OK)
        status = read_meshes(reader, document);
    return status == SKD_OK ? read_node_meshes(reader, document) : status;
}
