/* See gltf_write.h. */
#include "rig/gltf_write.h"

#include "base/temporary.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum skd_status fail_write(struct skd_error *error, const char *path)
{
    return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be written: %s", path, strerror(errno));
}

enum skd_status skd_outputs_open(const char *path, struct skd_outputs *outputs, const char **name,
                                 struct skd_error *error)
{
    *outputs = (struct skd_outputs){.folder_fd = -1};
    const char *slash = strrchr(path, '/');
    *name = slash == NULL ? path : slash + 1;
    char *folder = slash == NULL ? strdup(".") : strndup(path, (size_t)(slash - path) + 1);
    if (folder == NULL)
        return skd_fail_memory(error, "a path");
    outputs->folder_fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    free(folder);
    if (outputs->folder_fd < 0)
        return fail_write(error, path);
    skd_temporary_sweep(outputs->folder_fd, SKD_TEMPORARY_IDLE_S);
    return SKD_OK;
}

/* Folders that the path names are made when they are missing. */
static enum skd_status make_folders(int folder_fd, const char *path, struct skd_error *error)
{
    char *copy = strdup(path);
    if (copy == NULL)
        return skd_fail_memory(error, "a path");
    for (char *slash = strchr(copy, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        if (mkdirat(folder_fd, copy, 0777) != 0 && errno != EEXIST) {
            free(copy);
            return fail_write(error, path);
        }
        *slash = '/';
    }
    free(copy);
    return SKD_OK;
}

static bool write_all(int fd, const struct skd_slice *slices, size_t slice_count)
{
    for (size_t i = 0; i < slice_count; i++) {
        const char *from = slices[i].bytes;
        for (size_t left = slices[i].count; left > 0;) {
            const ssize_t done = write(fd, from, left);
            if (done < 0 && errno == EINTR)
                continue;
            if (done < 0)
                return false;
            from += done;
            left -= (size_t)done;
        }
    }
    return true;
}

/* A file that replaces another keeps its permissions. False when a folder is in the way, which
 * would be noticed only after other files were renamed. */
static bool may_replace(int folder_fd, const char *path, int fd)
{
    struct stat old;
    if (fstatat(folder_fd, path, &old, 0) != 0)
        return true;
    (void)fchmod(fd, old.st_mode & 0777); /* a nicety: not worth failing for */
    errno = EISDIR;
    return !S_ISDIR(old.st_mode);
}

static struct skd_output *new_output(struct skd_outputs *outputs, const char *path)
{
    if (outputs->count == outputs->capacity) {
        const size_t capacity = outputs->capacity * 2 + 8;
        struct skd_output *items = realloc(outputs->items, capacity * sizeof *items);
        if (items == NULL)
            return NULL;
        outputs->items = items;
        outputs->capacity = capacity;
    }
    struct skd_output *output = &outputs->items[outputs->count++];
    *output = (struct skd_output){.path = strdup(path)};
    return output->path != NULL ? output : NULL;
}

enum skd_status skd_outputs_add(struct skd_outputs *outputs, const char *path,
                                const struct skd_slice *slices, size_t slice_count,
                                struct skd_error *error)
{
    enum skd_status status = make_folders(outputs->folder_fd, path, error);
    if (status != SKD_OK)
        return status;
    struct skd_output *output = new_output(outputs, path);
    char *temporary = skd_temporary_name(path);
    if (output == NULL || temporary == NULL) {
        free(temporary);
        return skd_fail_memory(error, "a path");
    }
    const int fd =
        openat(outputs->folder_fd, temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0) {
        free(temporary);
        return fail_write(error, path);
    }
    output->temporary = temporary;
    if (!may_replace(outputs->folder_fd, path, fd) || !write_all(fd, slices, slice_count) ||
        fsync(fd) != 0)
        status = fail_write(error, path);
    if (close(fd) != 0 && status == SKD_OK)
        status = fail_write(error, path);
    for (size_t i = 0; i < slice_count; i++)
        outputs->bytes += slices[i].count;
    return status;
}

/* 1: a file with these bytes is there, 0: another one is, -1: none is. */
static int compare_file(int folder_fd, const char *path, struct skd_slice content)
{
    char block[1 << 14];
    const char *expected = content.bytes;
    size_t at = 0;
    const int fd = openat(folder_fd, path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0)
        return errno == ENOENT ? -1 : 0;
    ssize_t got = 0;
    bool is_same = true;
    while (is_same && (got = read(fd, block, sizeof block)) > 0) {
        is_same =
            content.count - at >= (size_t)got && memcmp(block, expected + at, (size_t)got) == 0;
        at += (size_t)got;
    }
    close(fd);
    return is_same && got == 0 && at == content.count;
}

enum skd_status skd_outputs_add_copy(struct skd_outputs *outputs, const char *path,
                                     struct skd_slice content, struct skd_error *error)
{
    switch (compare_file(outputs->folder_fd, path, content)) {
    case 1:
        return SKD_OK;
    case 0:
        return skd_fail(error, SKD_FILE_IO,
                        "\"%s\", which the file needs beside it, is there already and is another "
                        "file; export into another folder",
                        path);
    default:
        return skd_outputs_add(outputs, path, &content, 1, error);
    }
}

enum skd_status skd_outputs_commit(struct skd_outputs *outputs, struct skd_error *error)
{
    for (size_t i = 0; i < outputs->count; i++) {
        struct skd_output *output = &outputs->items[i];
        if (renameat(outputs->folder_fd, output->temporary, outputs->folder_fd, output->path) != 0)
            return fail_write(error, output->path);
        free(output->temporary);
        output->temporary = NULL;
    }
    (void)fsync(outputs->folder_fd); /* some file systems have no such thing */
    return SKD_OK;
}

void skd_outputs_finish(struct skd_outputs *outputs)
{
    for (size_t i = 0; i < outputs->count; i++) {
        if (outputs->items[i].temporary != NULL)
            (void)unlinkat(outputs->folder_fd, outputs->items[i].temporary, 0);
        free(outputs->items[i].temporary);
        free(outputs->items[i].path);
    }
    free(outputs->items);
    if (outputs->folder_fd >= 0)
        close(outputs->folder_fd);
    *outputs = (struct skd_outputs){.folder_fd = -1};
}
