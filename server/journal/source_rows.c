/* See source_rows.h. */
#include "journal/source_rows.h"

#include "journal/checksum.h"
#include "journal/chunks.h"
#include "rig/gltf_source.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

/* The file of that number, or NULL where the number is none that is a file. */
static struct skd_gltf_file *file_of(struct skd_gltf_source *source, size_t number)
{
    struct skd_gltf_file *file = number == 0 ? &source->main : &source->externals[number - 1];
    return file->path != NULL && file->is_read ? file : NULL;
}

static uint64_t sum_of(size_t number, const struct skd_gltf_file *file)
{
    return skd_sum_bytes(skd_sum_number(number, file->bytes), file->digest, sizeof file->digest);
}

static enum skd_status write_file(struct skd_store *store, size_t number,
                                  struct skd_gltf_file *file, struct skd_error *error)
{
    uint8_t *bytes;
    enum skd_status status = skd_gltf_file_read(file, &bytes, NULL);
    if (status == SKD_NO_MEMORY)
        return skd_fail_memory(error, "the bytes of a glTF file");
    if (status != SKD_OK)
        return SKD_OK; /* it is not what it was */
    status = skd_chunks_write(store, (struct skd_chunk_name){SKD_CHUNK_SOURCE, number}, bytes,
                              file->bytes, error);
    free(bytes);
    if (status != SKD_OK)
        return status;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_SOURCE_WRITE);
    int bound = skd_bind_number(row, 1, number);
    bound |= skd_bind_number(row, 2, file->bytes);
    bound |= skd_bind_number(row, 3, sum_of(number, file));
    return skd_store_run(store, row, bound, error);
}

enum skd_status skd_source_rows_write(struct skd_store *store, const struct skd_rig *rig,
                                      struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t i = 0; rig->source != NULL && i <= rig->source->external_count; i++) {
        struct skd_gltf_file *file = file_of(rig->source, i);
        if (status == SKD_OK && file != NULL && file->fd >= 0)
            status = write_file(store, i, file, error);
    }
    return status;
}

/* ---- reading ----------------------------------------------------------------------------------
 */

static enum skd_status find_copy(struct skd_store *store, size_t number,
                                 const struct skd_gltf_file *file, struct skd_error *error)
{
    uint64_t bytes, sum;
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_SOURCE_READ);
    if (row == NULL || skd_bind_number(row, 1, number) != SQLITE_OK)
        return skd_store_fail(store, error);
    enum skd_status status = skd_store_next(store, row, &has_row, error);
    if (status == SKD_OK &&
        (!has_row || !skd_column_number(row, 0, SKD_FILE_BYTES_MAX, &bytes) ||
         bytes != file->bytes || !skd_column_sum(row, 1, &sum) || sum != sum_of(number, file)))
        status = skd_store_damaged(store, "the copy of a glTF file", error);
    (void)sqlite3_reset(row);
    return status;
}

static enum skd_status put(int fd, const void *bytes, size_t count, struct skd_error *error)
{
    for (size_t done = 0; done < count;) {
        ssize_t written = write(fd, (const char *)bytes + done, count - done);
        if (written < 0 && errno != EINTR)
            return skd_fail(error, SKD_FILE_IO, "the copy of a glTF file cannot be laid out: %s",
                            strerror(errno));
        done += written > 0 ? (size_t)written : 0;
    }
    return SKD_OK;
}

static enum skd_status copy_out(struct skd_store *store, size_t number, size_t count, int fd,
                                struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t done = 0; done < count && status == SKD_OK; done += SKD_CHUNK_BYTES) {
        size_t piece = count - done < SKD_CHUNK_BYTES ? count - done : SKD_CHUNK_BYTES;
        const void *bytes;
        status = skd_chunk_read(store, (struct skd_chunk_name){SKD_CHUNK_SOURCE, number},
                                done / SKD_CHUNK_BYTES, piece, &bytes, error);
        if (status == SKD_OK)
            status = put(fd, bytes, piece, error);
    }
    (void)sqlite3_reset(store->statements[SKD_SQL_CHUNK_READ]);
    return status;
}

/* Where a folder's file system knows no unnamed files, memory takes them. */
static int open_unnamed(const char *folder)
{
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    return fd >= 0 ? fd : memfd_create("skind-source", MFD_CLOEXEC);
}

static enum skd_status restore(struct skd_store *store, struct skd_gltf_source *source,
                               size_t number, const char *folder, struct skd_error *error)
{
    struct skd_gltf_file *file = file_of(source, number);
    enum skd_status status = find_copy(store, number, file, error);
    if (status != SKD_OK)
        return status;
    int fd = open_unnamed(folder);
    if (fd < 0)
        return skd_fail(error, SKD_FILE_IO, "the copy of a glTF file cannot be laid out: %s",
                        strerror(errno));
    status = copy_out(store, number, file->bytes, fd, error);
    if (status == SKD_OK)
        return skd_gltf_source_restore(source, number, fd, error);
    close(fd);
    return status;
}

/* Whether the open file still is what it was. */
static enum skd_status check(struct skd_gltf_file *file, bool *is_same, struct skd_error *error)
{
    uint8_t *bytes;
    *is_same = false;
    if (file->fd < 0)
        return SKD_OK;
    enum skd_status status = skd_gltf_file_read(file, &bytes, NULL);
    if (status == SKD_NO_MEMORY)
        return skd_fail_memory(error, "the bytes of a glTF file");
    *is_same = status == SKD_OK;
    if (*is_same)
        free(bytes);
    return SKD_OK;
}

enum skd_status skd_source_rows_read(struct skd_store *store, const struct skd_rig *rig,
                                     const char *folder, size_t *damaged, struct skd_error *error)
{
    struct skd_gltf_source *source = rig->source;
    *damaged = 0;
    if (source == NULL)
        return SKD_OK;
    if (skd_gltf_source_reopen(source, NULL) == SKD_NO_MEMORY)
        return skd_fail_memory(error, "a file");
    for (size_t i = 0; i <= source->external_count; i++) {
        bool is_same;
        struct skd_gltf_file *file = file_of(source, i);
        enum skd_status status = file != NULL ? check(file, &is_same, error) : SKD_OK;
        if (file != NULL && status == SKD_OK && !is_same) {
            status = restore(store, source, i, folder, error);
            if (status != SKD_OK && status != SKD_NO_MEMORY) {
                ++*damaged;
                status = SKD_OK;
            }
        }
        if (status != SKD_OK)
            return status;
    }
    return SKD_OK;
}
