/* See gltf_source.h. */
#include "rig/gltf_source.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <xxhash.h>

enum skd_status skd_gltf_file_open(int folder_fd, const char *path, struct skd_gltf_file *file,
                                   struct skd_error *error)
{
    *file = (struct skd_gltf_file){.fd = -1};
    file->path = strdup(path);
    if (file->path == NULL)
        return skd_fail_memory(error, "a path");
    /* O_NONBLOCK: a pipe must not hold the worker up; it does nothing to a file. */
    file->fd = openat(folder_fd, path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file->fd < 0)
        return skd_fail(error, errno == ENOENT || errno == ENOTDIR ? SKD_NO_FILE : SKD_FILE_IO,
                        "\"%s\" cannot be opened: %s", path, strerror(errno));
    struct stat status;
    if (fstat(file->fd, &status) != 0)
        return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be read: %s", path, strerror(errno));
    if (!S_ISREG(status.st_mode))
        return skd_fail(error, SKD_NOT_GLTF, "\"%s\" is not a file", path);
    if ((uint64_t)status.st_size > SKD_FILE_BYTES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "\"%s\" has %lld bytes, more than %zu", path,
                        (long long)status.st_size, SKD_FILE_BYTES_MAX);
    file->bytes = (size_t)status.st_size;
    return SKD_OK;
}

static enum skd_status open_folder(const char *path, int *folder_fd, struct skd_error *error)
{
    const char *slash = strrchr(path, '/');
    char *folder = slash == NULL ? strdup(".") : strndup(path, (size_t)(slash - path) + 1);
    if (folder == NULL)
        return skd_fail_memory(error, "a path");
    *folder_fd = open(folder, O_PATH | O_DIRECTORY | O_CLOEXEC);
    const int number = errno;
    free(folder);
    if (*folder_fd >= 0)
        return SKD_OK;
    return skd_fail(error, number == ENOENT || number == ENOTDIR ? SKD_NO_FILE : SKD_FILE_IO,
                    "the folder of \"%s\" cannot be opened: %s", path, strerror(number));
}

enum skd_status skd_gltf_source_open(const char *path, struct skd_gltf_source **source,
                                     struct skd_error *error)
{
    struct skd_gltf_source *made = calloc(1, sizeof *made);
    if (made == NULL)
        return skd_fail_memory(error, "a file");
    made->folder_fd = made->main.fd = -1;
    made->path = strdup(path);
    enum skd_status status = SKD_OK;
    if (made->path == NULL)
        status = skd_fail_memory(error, "a path");
    if (status == SKD_OK)
        status = open_folder(path, &made->folder_fd, error);
    if (status == SKD_OK)
        status = skd_gltf_file_open(AT_FDCWD, path, &made->main, error);
    if (status != SKD_OK) {
        skd_gltf_source_destroy(made);
        return status;
    }
    *source = made;
    return SKD_OK;
}

static enum skd_status read_all(const struct skd_gltf_file *file, uint8_t *bytes,
                                struct skd_error *error)
{
    for (size_t done = 0; done < file->bytes;) {
        const ssize_t got = pread(file->fd, bytes + done, file->bytes - done, (off_t)done);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be read: %s", file->path,
                            strerror(errno));
        if (got == 0)
            return skd_fail(error, file->is_read ? SKD_SOURCE_CHANGED : SKD_FILE_IO,
                            "\"%s\" has become shorter while it was in use", file->path);
        done += (size_t)got;
    }
    return SKD_OK;
}

static enum skd_status check_digest(struct skd_gltf_file *file, const uint8_t *bytes,
                                    struct skd_error *error)
{
    const XXH128_hash_t hash = XXH3_128bits(bytes, file->bytes);
    struct stat status;
    if (!file->is_read) {
        file->digest[0] = hash.low64;
        file->digest[1] = hash.high64;
        file->is_read = true;
        return SKD_OK;
    }
    if (file->digest[0] == hash.low64 && file->digest[1] == hash.high64 &&
        fstat(file->fd, &status) == 0 && (uint64_t)status.st_size == file->bytes)
        return SKD_OK;
    return skd_fail(error, SKD_SOURCE_CHANGED,
                    "\"%s\" was written to since it was loaded; load it again, or put the old "
                    "file back",
                    file->path);
}

enum skd_status skd_gltf_file_read(struct skd_gltf_file *file, uint8_t **bytes,
                                   struct skd_error *error)
{
    *bytes = malloc(file->bytes + 1);
    if (*bytes == NULL)
        return skd_fail_memory(error, "the bytes of a glTF file");
    enum skd_status status = read_all(file, *bytes, error);
    if (status == SKD_OK) {
        (*bytes)[file->bytes] = 0;
        status = check_digest(file, *bytes, error);
    }
    if (status != SKD_OK) {
        free(*bytes);
        *bytes = NULL;
    }
    return status;
}

size_t skd_gltf_source_bytes(const struct skd_gltf_source *source)
{
    if (source == NULL)
        return 0;
    const size_t joints = source->skin_joints[source->skin_count];
    return sizeof *source + strlen(source->path) + 1 +
           source->external_count * sizeof *source->externals + joints * 2 * sizeof(uint16_t) +
           (size_t)(source->skin_count + 1) * sizeof(uint32_t);
}

void skd_gltf_file_close(struct skd_gltf_file *file)
{
    if (file->fd >= 0)
        close(file->fd);
    free(file->path);
    *file = (struct skd_gltf_file){.fd = -1};
}

void skd_gltf_source_destroy(struct skd_gltf_source *source)
{
    if (source == NULL)
        return;
    for (size_t i = 0; i < source->external_count; i++)
        skd_gltf_file_close(&source->externals[i]);
    free(source->externals);
    skd_gltf_file_close(&source->main);
    if (source->folder_fd >= 0)
        close(source->folder_fd);
    free(source->skin_joints);
    free(source->bone_of_joint);
    free(source->joint_of_bone);
    free(source->path);
    free(source);
}
