/* A session's file before SQLite is let near it: whether it is one, of which version, and what its
 * log (the -wal file) ends in.
 *
 * Stage: journal. Thread: any; no state. Opens for reading only, and never while a connection of
 * this process has the file open (closing would drop SQLite's locks on it).
 */
#ifndef SKD_JOURNAL_INSPECT_H
#define SKD_JOURNAL_INSPECT_H

#include "base/error.h"
#include "protocol/limits.h"

#include <stdint.h>

struct skd_inspection {
    uint64_t bytes;     /* of the file */
    uint64_t log_bytes; /* of its log; 0: none */
};

/* The path with the folder's symbolic links resolved, so that only the file itself may not be one.
 * Errors: SKD_NO_FILE, SKD_FILE_IO, SKD_TOO_LARGE (too long). */
SKD_MUST_CHECK enum skd_status
skd_inspect_resolve(const char *path, char resolved[SKD_PATH_BYTES_MAX], struct skd_error *error);

/* Errors: SKD_NO_FILE, SKD_FILE_IO (a symbolic link, a device, ...), SKD_DAMAGED (not a session's
 * file, or its head is damaged), SKD_NEWER. */
SKD_MUST_CHECK enum skd_status skd_inspect(const char *path, struct skd_inspection *inspection,
                                           struct skd_error *error);

/* SKD_NEWER, with the sentence. */
enum skd_status skd_inspect_newer(const char *path, int version, struct skd_error *error);

/* Whether the log holds more that was committed than SQLite will read: a frame that is not whole,
 * with the end of a transaction of the same log after it, or zeros. Without these it is what a kill
 * leaves behind.
 * Errors: SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_inspect_log(const char *path, bool *is_torn,
                                               struct skd_error *error);

/* The name of a file that belongs to another: path + suffix. False: too long. */
SKD_MUST_CHECK bool skd_inspect_beside(const char *path, const char *suffix,
                                       char out[SKD_PATH_BYTES_MAX]);

#endif
