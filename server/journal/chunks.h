/* The large arrays of a file, cut into rows of at most 4 MiB.
 *
 * Stage: journal. Thread: that of the store.
 */
#ifndef SKD_JOURNAL_CHUNKS_H
#define SKD_JOURNAL_CHUNKS_H

#include "journal/store.h"

/* What an array is; never another meaning for a number. */
enum skd_chunk_kind {
    SKD_CHUNK_RIG = 1,
    SKD_CHUNK_JOINTS = 2,
    SKD_CHUNK_WEIGHTS = 3,
    SKD_CHUNK_REST = 4,
    SKD_CHUNK_START_JOINTS = 5,
    SKD_CHUNK_START_WEIGHTS = 6,
    SKD_CHUNK_SHEET_VERTICES = 7, /* item: the base sheet */
    SKD_CHUNK_SHEET_ROWS = 8,
    SKD_CHUNK_SOURCE = 9, /* item: the file's number */
};

enum { SKD_CHUNK_BYTES = 4 << 20 };

struct skd_chunk_name {
    enum skd_chunk_kind kind;
    size_t item;
};

/* Writes piece number `place` of an array: SKD_CHUNK_BYTES of it, or what is left. */
SKD_MUST_CHECK enum skd_status skd_chunk_write(struct skd_store *store, struct skd_chunk_name name,
                                               size_t place, const void *bytes, size_t count,
                                               struct skd_error *error);
/* Its bytes, which live until the next one is read. Errors: SKD_DAMAGED where they are not `count`
 * and as they were written. */
SKD_MUST_CHECK enum skd_status skd_chunk_read(struct skd_store *store, struct skd_chunk_name name,
                                              size_t place, size_t count, const void **bytes,
                                              struct skd_error *error);

/* All pieces of an array. */
SKD_MUST_CHECK enum skd_status skd_chunks_write(struct skd_store *store, struct skd_chunk_name name,
                                                const void *bytes, size_t count,
                                                struct skd_error *error);
/* Into *bytes, the caller's to free (also for count 0). */
SKD_MUST_CHECK enum skd_status skd_chunks_read(struct skd_store *store, struct skd_chunk_name name,
                                               size_t count, void **bytes, struct skd_error *error);

/* Looks at every piece that there is. Errors: SKD_DAMAGED, SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_chunks_check(struct skd_store *store, struct skd_error *error);

#endif
