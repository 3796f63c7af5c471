/* See gltf_container.h. */
#include "rig/gltf_container.h"

#include "rig/uri.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { GLB_HEADER = 12, CHUNK_HEADER = 8 };

#define CHUNK_JSON 0x4E4F534Au
#define CHUNK_BIN 0x004E4942u
/* What is handed to tinygltf after buffers and images are left out. */
#define JSON_BYTES_MAX ((size_t)1 << 29)

static uint32_t read_u32(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
           (uint32_t)bytes[3] << 24;
}

/* Finds a chunk at `offset`; its contents are [*start, *start + *length). */
static bool find_chunk(const struct skd_gltf_container *container, size_t end, size_t offset,
                       uint32_t type, size_t *start, size_t *length)
{
    if (end < offset || end - offset < CHUNK_HEADER)
        return false;
    const uint8_t *header = container->file + offset;
    if (read_u32(header + 4) != type || read_u32(header) > end - offset - CHUNK_HEADER)
        return false;
    *start = offset + CHUNK_HEADER;
    *length = read_u32(header);
    return true;
}

/* Finds the chunks of a GLB; bin stays NULL when it has no BIN chunk. */
static enum skd_status split_glb(struct skd_gltf_container *container, struct skd_error *error)
{
    const size_t size = container->file_bytes;
    if (size < GLB_HEADER + CHUNK_HEADER || read_u32(container->file + 4) != 2)
        return skd_fail(error, SKD_NOT_GLTF, "this is not a binary glTF file of version 2");
    const size_t end = read_u32(container->file + 8);
    if (end > size)
        return skd_fail(error, SKD_NOT_GLTF,
                        "the .glb should have %zu bytes and has %zu: it was cut short", end, size);
    if (!find_chunk(container, end, GLB_HEADER, CHUNK_JSON, &container->json_offset,
                    &container->json_bytes))
        return skd_fail(error, SKD_NOT_GLTF, "the .glb has no JSON chunk where it should be");
    size_t start = 0;
    container->glb_bytes = end;
    container->chunks_end = container->json_offset + container->json_bytes;
    if (find_chunk(container, end, container->chunks_end, CHUNK_BIN, &start,
                   &container->bin_bytes)) {
        container->bin = container->file + start;
        container->chunks_end = start + container->bin_bytes;
    }
    return SKD_OK;
}

static enum skd_status check_json(struct skd_gltf_container *container, struct skd_error *error)
{
    const char *text = (const char *)container->file + container->json_offset, *problem = NULL;
    if (skd_json_whole(text, container->json_bytes, &container->json, &problem) &&
        *container->json.start == '{')
        return SKD_OK;
    return skd_fail(error, SKD_NOT_GLTF,
                    "this is not a glTF file: its JSON is wrong, or nested deeper than %d, at byte "
                    "%zu",
                    (int)SKD_JSON_DEPTH_MAX, (size_t)(problem - text));
}

static enum skd_status check_version(struct skd_json root, struct skd_error *error)
{
    struct skd_json asset, version;
    if (!skd_json_member(root, "asset", &asset) || !skd_json_member(asset, "version", &version) ||
        version.end - version.start < 4)
        return skd_fail(error, SKD_NOT_GLTF,
                        "this is not a glTF file: it does not say its asset.version");
    if (strncmp(version.start, "\"2.", 3) == 0)
        return SKD_OK;
    return skd_fail(error, SKD_UNSUPPORTED, "the file is glTF %.*s; save it as glTF 2.0",
                    (int)(version.end - version.start < 20 ? version.end - version.start : 20),
                    version.start);
}

static enum skd_status check_extensions(struct skd_json root, struct skd_error *error)
{
    static const char *const lists[] = {"extensionsUsed", "extensionsRequired"};
    static const struct {
        const char *extension; /* as it stands in the text */
        const char *name;
    } refused[] = {{"\"KHR_draco_mesh_compression\"", "Draco"},
                   {"\"EXT_meshopt_compression\"", "meshopt"},
                   {"\"KHR_meshopt_compression\"", "meshopt"}};
    struct skd_json list, key, name;
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        if (!skd_json_member(root, lists[i], &list))
            continue;
        while (skd_json_next(&list, &key, &name))
            for (size_t r = 0; r < sizeof refused / sizeof *refused; r++)
                if ((size_t)(name.end - name.start) == strlen(refused[r].extension) &&
                    memcmp(name.start, refused[r].extension, strlen(refused[r].extension)) == 0)
                    return skd_fail(error, SKD_UNSUPPORTED,
                                    "the file is compressed with %s (%s), which skind cannot read; "
                                    "export it again without mesh compression",
                                    refused[r].name, refused[r].extension);
    }
    return SKD_OK;
}

/* Only what skind reads goes to tinygltf: it would copy buffers and open or decode images.
 * Returns the text, or NULL when there is no memory. */
static char *reduce_json(struct skd_json root, size_t *bytes)
{
    static const char *const parts[] = {"asset", "bufferViews", "accessors", "meshes",
                                        "nodes", "skins",       "animations"};
    char *text = malloc((size_t)(root.end - root.start) + 128), *to = text;
    if (text == NULL)
        return NULL;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        struct skd_json part;
        if (!skd_json_member(root, parts[i], &part))
            continue;
        to += sprintf(to, "%c\"%s\":", to == text ? '{' : ',', parts[i]);
        memcpy(to, part.start, (size_t)(part.end - part.start));
        to += part.end - part.start;
    }
    *to++ = '}';
    *bytes = (size_t)(to - text);
    return text;
}

/* The first time: later the bytes are the same, and so is what they say. */
static enum skd_status parse_document(const struct skd_gltf_container *container,
                                      struct skd_gltf_source *source, struct skd_error *error)
{
    size_t bytes = 0;
    char problem[200] = "";
    char *text = reduce_json(container->json, &bytes);
    if (text == NULL)
        return skd_fail_memory(error, "the JSON of a glTF file");
    enum skd_gltf_parsed parsed = SKD_GLTF_INVALID;
    if (bytes <= JSON_BYTES_MAX)
        parsed = skd_gltf_document_parse(text, bytes, &source->document, problem, sizeof problem);
    free(text);
    if (bytes > JSON_BYTES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "the JSON of the file has %zu bytes, more than %zu",
                        bytes, JSON_BYTES_MAX);
    if (parsed == SKD_GLTF_NO_MEMORY)
        return skd_fail_memory(error, "the JSON of a glTF file");
    if (parsed == SKD_GLTF_INVALID)
        return skd_fail(error, SKD_NOT_GLTF, "this is not a valid glTF 2.0 file: %s", problem);
    return SKD_OK;
}

/* tinygltf leaves out primitives that it does not understand; numbers would shift. */
static enum skd_status check_primitives(const struct skd_gltf_container *container,
                                        struct skd_error *error)
{
    struct skd_json meshes, key, mesh, primitives;
    if (!skd_json_member(container->json, "meshes", &meshes))
        return SKD_OK;
    for (size_t m = 0; skd_json_next(&meshes, &key, &mesh); m++) {
        const size_t count =
            skd_json_member(mesh, "primitives", &primitives) ? skd_json_count(primitives) : 0;
        if (m >= container->document->mesh_count ||
            count != container->document->meshes[m].primitive_count)
            return skd_fail(error, SKD_BAD_RIG, "mesh %zu has a primitive without attributes", m);
    }
    return SKD_OK;
}

static enum skd_status open_external(struct skd_gltf_source *source, size_t index, const char *uri,
                                     struct skd_error *error)
{
    if (source->externals[index].fd >= 0)
        return SKD_OK;
    if (source->is_known)
        return skd_fail(error, SKD_SOURCE_CHANGED, "\"%s\" is another file than the one loaded",
                        source->path);
    char *path = NULL;
    enum skd_status status = skd_uri_to_path(uri, &path, error);
    if (status == SKD_OK)
        status = skd_gltf_file_open(source->folder_fd, path, &source->externals[index], error);
    free(path);
    return status;
}

static enum skd_status read_buffer(struct skd_gltf_container *container,
                                   struct skd_gltf_source *source, size_t index, const cJSON *item,
                                   struct skd_error *error)
{
    struct skd_gltf_buffer *buffer = &container->buffers[index];
    const cJSON *length = cJSON_GetObjectItemCaseSensitive(item, "byteLength");
    buffer->uri = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(item, "uri"));
    if (!cJSON_IsNumber(length) || !(length->valuedouble >= 0) ||
        length->valuedouble > (double)SKD_FILE_BYTES_MAX)
        return skd_fail(error, SKD_NOT_GLTF, "buffer %zu has no byteLength that makes sense",
                        index);
    buffer->size = (size_t)length->valuedouble;
    enum skd_status status = SKD_OK;
    if (buffer->uri == NULL) {
        buffer->storage = SKD_BUFFER_CHUNK;
        buffer->bytes = container->bin;
        buffer->stored = container->bin_bytes;
        if (index != 0 || buffer->bytes == NULL)
            return skd_fail(error, SKD_NOT_GLTF,
                            "buffer %zu has no uri, and there is no BIN chunk for it", index);
    } else if (skd_uri_is_data(buffer->uri)) {
        buffer->storage = SKD_BUFFER_DATA_URI;
        buffer->is_owned = true;
        status = skd_uri_decode_data(buffer->uri, &buffer->bytes, &buffer->stored, error);
    } else {
        buffer->storage = SKD_BUFFER_FILE;
        buffer->is_owned = true;
        status = open_external(source, index, buffer->uri, error);
        if (status == SKD_OK)
            status = skd_gltf_file_read(&source->externals[index], &buffer->bytes, error);
        buffer->stored = source->externals[index].bytes;
    }
    if (status == SKD_OK && buffer->stored < buffer->size)
        return skd_fail(error, SKD_BAD_RIG, "buffer %zu should have %zu bytes and has %zu", index,
                        buffer->size, buffer->stored);
    return status;
}

static enum skd_status prepare_externals(struct skd_gltf_source *source, size_t count,
                                         struct skd_error *error)
{
    if (count > SKD_GLTF_FILES_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "the file has %zu buffers, more than %d; save it as .glb", count,
                        (int)SKD_GLTF_FILES_MAX);
    if (source->is_known)
        return count == source->external_count
                   ? SKD_OK
                   : skd_fail(error, SKD_SOURCE_CHANGED,
                              "\"%s\" is another file than the one loaded", source->path);
    return skd_gltf_source_expect(source, count) ? SKD_OK : skd_fail_memory(error, "buffers");
}

static enum skd_status read_buffers(struct skd_gltf_container *container,
                                    struct skd_gltf_source *source, struct skd_error *error)
{
    static const char none[] = "[]";
    struct skd_json list;
    if (!skd_json_member(container->json, "buffers", &list))
        list = (struct skd_json){none, none + strlen(none)};
    const size_t count = skd_json_count(list);
    enum skd_status status = prepare_externals(source, count, error);
    if (status != SKD_OK)
        return status;
    container->buffer_list = cJSON_ParseWithLength(list.start, (size_t)(list.end - list.start));
    if (container->buffer_list == NULL)
        return skd_fail_memory(error, "buffers");
    container->buffers = calloc(count + 1, sizeof *container->buffers);
    if (container->buffers == NULL)
        return skd_fail_memory(error, "buffers");
    container->buffer_count = count;
    size_t index = 0;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, container->buffer_list)
    {
        status = read_buffer(container, source, index++, item, error);
        if (status != SKD_OK)
            return status;
    }
    return SKD_OK;
}

enum skd_status skd_gltf_container_read(struct skd_gltf_source *source,
                                        struct skd_gltf_container *container,
                                        struct skd_error *error)
{
    *container = (struct skd_gltf_container){0};
    enum skd_status status = skd_gltf_file_read(&source->main, &container->file, error);
    if (status != SKD_OK)
        return status;
    container->file_bytes = container->json_bytes = source->main.bytes;
    container->is_glb = container->file_bytes >= 4 && memcmp(container->file, "glTF", 4) == 0;
    if (container->is_glb)
        status = split_glb(container, error);
    if (status == SKD_OK)
        status = check_json(container, error);
    if (status == SKD_OK)
        status = check_version(container->json, error);
    if (status == SKD_OK)
        status = check_extensions(container->json, error);
    if (status == SKD_OK)
        status = source->document == NULL ? parse_document(container, source, error) : SKD_OK;
    container->document = source->document;
    if (status == SKD_OK)
        status = check_primitives(container, error);
    if (status == SKD_OK)
        status = read_buffers(container, source, error);
    if (status != SKD_OK)
        skd_gltf_container_finish(container);
    return status;
}

void skd_gltf_container_finish(struct skd_gltf_container *container)
{
    for (size_t i = 0; i < container->buffer_count; i++)
        if (container->buffers[i].is_owned)
            free(container->buffers[i].bytes);
    free(container->buffers);
    cJSON_Delete(container->buffer_list);
    free(container->file);
    *container = (struct skd_gltf_container){0};
}
