/* See gltf_source.h. */
#include "rig/gltf_source.h"

#include "rig/gltf_document.h"

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

static struct skd_gltf_source *make_empty(void)
{
    struct skd_gltf_source *source = calloc(1, sizeof *source);
    if (source != NULL)
        source->folder_fd = source->main.fd = -1;
    return source;
}

bool skd_gltf_source_expect(struct skd_gltf_source *source, size_t count)
{
    source->externals = calloc(count + 1, sizeof *source->externals);
    if (source->externals == NULL)
        return false;
    source->external_count = count;
    for (size_t i = 0; i < count; i++)
        source->externals[i].fd = -1;
    return true;
}

struct skd_gltf_source *skd_gltf_source_known(size_t external_count)
{
    struct skd_gltf_source *source = make_empty();
    if (source == NULL)
        return NULL;
    source->is_known = true;
    if (skd_gltf_source_expect(source, external_count))
        return source;
    skd_gltf_source_destroy(source);
    return NULL;
}

enum skd_status skd_gltf_source_open(const char *path, struct skd_gltf_source **source,
                                     struct skd_error *error)
{
    struct skd_gltf_source *made = make_empty();
    if (made == NULL)
        return skd_fail_memory(error, "a file");
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

/* Gives the file a descriptor (taken over) when what it opens can be what was read. */
static enum skd_status adopt(struct skd_gltf_file *file, int fd, struct skd_error *error)
{
    struct stat status;
    if (fstat(fd, &status) != 0 || !S_ISREG(status.st_mode) ||
        (uint64_t)status.st_size != file->bytes) {
        close(fd);
        return skd_fail(error, SKD_SOURCE_CHANGED,
                        "\"%s\" is not the file of %zu bytes that it was", file->path, file->bytes);
    }
    if (file->fd >= 0)
        close(file->fd);
    file->fd = fd;
    return SKD_OK;
}

static enum skd_status reopen_file(int folder_fd, struct skd_gltf_file *file,
                                   struct skd_error *error)
{
    struct skd_gltf_file again;
    enum skd_status status = skd_gltf_file_open(folder_fd, file->path, &again, error);
    if (status == SKD_OK) {
        status = adopt(file, again.fd, error);
        again.fd = -1;
    }
    skd_gltf_file_close(&again);
    return status;
}

enum skd_status skd_gltf_source_reopen(struct skd_gltf_source *source, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    if (source->folder_fd < 0)
        status = open_folder(source->path, &source->folder_fd, error);
    if (status == SKD_OK)
        status = reopen_file(AT_FDCWD, &source->main, error);
    for (size_t i = 0; status == SKD_OK && i < source->external_count; i++)
        if (source->externals[i].path != NULL)
            status = reopen_file(source->folder_fd, &source->externals[i], error);
    return status;
}

enum skd_status skd_gltf_source_restore(struct skd_gltf_source *source, size_t number, int fd,
                                        struct skd_error *error)
{
    struct skd_gltf_file *file = number == 0 ? &source->main : &source->externals[number - 1];
    SKD_ASSERT(number <= source->external_count && file->path != NULL);
    if (source->folder_fd < 0)
        (void)open_folder(source->path, &source->folder_fd, NULL);
    return adopt(file, fd, error);
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
    return sizeof *source + strlen(source->path) + 1 + skd_gltf_document_bytes(source->document) +
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
    skd_gltf_document_destroy(source->document);
    skd_gltf_file_close(&source->main);
    if (source->folder_fd >= 0)
        close(source->folder_fd);
    free(source->skin_joints);
    free(source->bone_of_joint);
    free(source->joint_of_bone);
    free(source->path);
    free(source);
}
