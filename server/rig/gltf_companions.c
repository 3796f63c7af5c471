/* See gltf_companions.h. */
#include "rig/gltf_companions.h"

#include "rig/uri.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool is_same_file(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

void skd_companions_init(struct skd_companions *companions, const struct skd_gltf_source *source,
                         struct skd_outputs *outputs, const char *name)
{
    struct stat from, to;
    *companions = (struct skd_companions){.source = source, .outputs = outputs, .name = name};
    const char *slash = strrchr(source->path, '/');
    companions->is_same_folder = fstat(source->folder_fd, &from) == 0 &&
                                 fstat(outputs->folder_fd, &to) == 0 && is_same_file(&from, &to);
    companions->is_source =
        companions->is_same_folder && strcmp(slash != NULL ? slash + 1 : source->path, name) == 0;
}

/* True when a file of the source that stays, or one that was written already, has this path. */
static bool is_taken(const struct skd_companions *companions, size_t buffer, const char *path)
{
    const struct skd_gltf_source *source = companions->source;
    for (size_t i = 0; i < source->external_count; i++) {
        const bool stays = i != buffer || (companions->is_same_folder && !companions->is_source);
        if (stays && source->externals[i].path != NULL &&
            strcmp(source->externals[i].path, path) == 0)
            return true;
    }
    for (size_t i = 0; i < companions->outputs->count; i++)
        if (strcmp(companions->outputs->items[i].path, path) == 0)
            return true;
    return false;
}

char *skd_companions_name(const struct skd_companions *companions, size_t buffer)
{
    const char *own = companions->source->externals[buffer].path;
    const char *dot = strrchr(companions->name, '.');
    if (companions->is_source && !is_taken(companions, buffer, own))
        return strdup(own);
    for (size_t number = 0;; number++) {
        char *name = NULL, suffix[32] = "";
        if (number > 0)
            (void)snprintf(suffix, sizeof suffix, "-%zu", number);
        if (asprintf(&name, "%.*s%s.bin", (int)(dot - companions->name), companions->name, suffix) <
            0)
            return NULL;
        if (!is_taken(companions, buffer, name))
            return name;
        free(name);
    }
}

static enum skd_status copy_image(const struct skd_companions *companions, const char *uri,
                                  struct skd_error *error)
{
    struct skd_gltf_file file = {.fd = -1};
    char *path = NULL;
    uint8_t *bytes = NULL;
    if (skd_uri_is_data(uri) || skd_uri_has_scheme(uri))
        return SKD_OK;
    enum skd_status status = skd_uri_to_path(uri, &path, error);
    if (status != SKD_OK)
        return status;
    status = skd_gltf_file_open(companions->source->folder_fd, path, &file, NULL);
    if (status == SKD_OK) {
        status = skd_gltf_file_read(&file, &bytes, error);
        if (status == SKD_OK)
            status = skd_outputs_add_copy(companions->outputs, path,
                                          (struct skd_slice){bytes, file.bytes}, error);
    } else if (status != SKD_NO_MEMORY) {
        status = SKD_OK; /* it was missing before */
    } else {
        status = skd_fail_memory(error, "a path");
    }
    skd_gltf_file_close(&file);
    free(bytes);
    free(path);
    return status;
}

static enum skd_status copy_images(const struct skd_companions *companions, struct skd_json root,
                                   struct skd_error *error)
{
    struct skd_json images, key, image, uri;
    if (!skd_json_member(root, "images", &images))
        return SKD_OK;
    while (skd_json_next(&images, &key, &image)) {
        if (!skd_json_member(image, "uri", &uri) || strncmp(uri.start, "\"data:", 6) == 0)
            continue;
        cJSON *text = cJSON_ParseWithLength(uri.start, (size_t)(uri.end - uri.start));
        const char *value = cJSON_GetStringValue(text);
        const enum skd_status status =
            value != NULL ? copy_image(companions, value, error) : SKD_OK;
        cJSON_Delete(text);
        if (status != SKD_OK)
            return status;
    }
    return SKD_OK;
}

enum skd_status skd_companions_copy(const struct skd_companions *companions,
                                    const struct skd_gltf_container *container,
                                    const bool *is_written, struct skd_error *error)
{
    if (companions->is_same_folder)
        return SKD_OK;
    for (size_t i = 0; i < container->buffer_count; i++) {
        const struct skd_gltf_buffer *buffer = &container->buffers[i];
        if (buffer->storage != SKD_BUFFER_FILE || is_written[i])
            continue;
        const enum skd_status status =
            skd_outputs_add_copy(companions->outputs, companions->source->externals[i].path,
                                 (struct skd_slice){buffer->bytes, buffer->stored}, error);
        if (status != SKD_OK)
            return status;
    }
    return copy_images(companions, container->json, error);
}
