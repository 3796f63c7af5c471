/* See chunks.h. A row's id is kind, item and place, so that no index is needed. */
#include "journal/chunks.h"

#include "journal/checksum.h"

#include <stdlib.h>

static uint64_t id_of(struct skd_chunk_name name, size_t place)
{
    SKD_ASSERT(name.item < (size_t)1 << 20 && place < (size_t)1 << 28);
    return (uint64_t)name.kind << 48 | (uint64_t)name.item << 28 | place;
}

enum skd_status skd_chunk_write(struct skd_store *store, struct skd_chunk_name name, size_t place,
                                const void *bytes, size_t count, struct skd_error *error)
{
    uint64_t id = id_of(name, place);
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_CHUNK_WRITE);
    int bound = skd_bind_number(row, 1, id);
    bound |= skd_bind_number(row, 2, skd_sum_bytes(skd_sum_number(0, id), bytes, count));
    bound |= skd_bind_array(row, 3, bytes, count);
    return skd_store_run(store, row, bound, error);
}

enum skd_status skd_chunk_read(struct skd_store *store, struct skd_chunk_name name, size_t place,
                               size_t count, const void **bytes, struct skd_error *error)
{
    uint64_t id = id_of(name, place), sum;
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_CHUNK_READ);
    if (row == NULL || skd_bind_number(row, 1, id) != SQLITE_OK)
        return skd_store_fail(store, error);
    enum skd_status status = skd_store_next(store, row, &has_row, error);
    if (status != SKD_OK)
        return status;
    if (!has_row || !skd_column_sum(row, 0, &sum) || !skd_column_blob(row, 1, count, bytes) ||
        skd_sum_bytes(skd_sum_number(0, id), *bytes, count) != sum)
        return skd_store_damaged(store, "one of the large arrays", error);
    return SKD_OK;
}

static size_t piece(size_t count, size_t done)
{
    return count - done < SKD_CHUNK_BYTES ? count - done : SKD_CHUNK_BYTES;
}

enum skd_status skd_chunks_write(struct skd_store *store, struct skd_chunk_name name,
                                 const void *bytes, size_t count, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t done = 0; done < count && status == SKD_OK; done += SKD_CHUNK_BYTES)
        status = skd_chunk_write(store, name, done / SKD_CHUNK_BYTES, (const char *)bytes + done,
                                 piece(count, done), error);
    return status;
}

enum skd_status skd_chunks_read(struct skd_store *store, struct skd_chunk_name name, size_t count,
                                void **bytes, struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    const void *row;
    *bytes = NULL;
    if (count > store->bytes)
        return skd_fail(error, SKD_DAMAGED, "an array is larger than the whole file");
    *bytes = malloc(count + 1);
    if (*bytes == NULL)
        return skd_fail_memory(error, "a session's arrays");
    for (size_t done = 0; done < count && status == SKD_OK; done += SKD_CHUNK_BYTES) {
        status =
            skd_chunk_read(store, name, done / SKD_CHUNK_BYTES, piece(count, done), &row, error);
        if (status == SKD_OK)
            memcpy((char *)*bytes + done, row, piece(count, done));
    }
    sqlite3_reset(store->statements[SKD_SQL_CHUNK_READ]);
    if (status != SKD_OK) {
        free(*bytes);
        *bytes = NULL;
    }
    return status;
}

enum skd_status skd_chunks_check(struct skd_store *store, struct skd_error *error)
{
    uint64_t id, sum;
    bool has_row;
    enum skd_status status;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_CHUNKS_READ);
    while ((status = skd_store_next(store, row, &has_row, error)) == SKD_OK && has_row) {
        size_t count = (size_t)sqlite3_column_bytes(row, 2);
        const void *bytes;
        if (!skd_column_number(row, 0, INT64_MAX, &id) || !skd_column_sum(row, 1, &sum) ||
            !skd_column_blob(row, 2, count, &bytes) ||
            skd_sum_bytes(skd_sum_number(0, id), bytes, count) != sum) {
            status = skd_store_damaged(store, "one of the large arrays", error);
            break;
        }
    }
    (void)sqlite3_reset(row);
    return status;
}
