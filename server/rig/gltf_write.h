/* Writing a few files so that all of them appear whole, or none.
 *
 * Stage: export. Thread: a worker.
 * Each file goes to a temporary name in its own folder and is synced; when all are there they are
 * renamed into place, in the order in which they were added. A full disk leaves the old files.
 */
#ifndef SKD_RIG_GLTF_WRITE_H
#define SKD_RIG_GLTF_WRITE_H

#include "base/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct skd_output {
    char *path;      /* relative to the folder */
    char *temporary; /* the same, or NULL when nothing is to be renamed */
};

struct skd_outputs {
    int folder_fd;
    size_t count;
    size_t capacity;
    struct skd_output *items;
    uint64_t bytes; /* written */
};

/* A run of bytes; a file is a row of them. */
struct skd_slice {
    const void *bytes;
    size_t count;
};

/* Opens the folder of `path`; *name is the file's name in it, borrowed from path. */
SKD_MUST_CHECK enum skd_status skd_outputs_open(const char *path, struct skd_outputs *outputs,
                                                const char **name, struct skd_error *error);

/* Writes a file under a temporary name, making the folders in its path. */
SKD_MUST_CHECK enum skd_status skd_outputs_add(struct skd_outputs *outputs, const char *path,
                                               const struct skd_slice *slices, size_t slice_count,
                                               struct skd_error *error);

/* Like skd_outputs_add for a file that goes along unchanged: nothing is written when it is there
 * already, and one that is there and differs is an error. */
SKD_MUST_CHECK enum skd_status skd_outputs_add_copy(struct skd_outputs *outputs, const char *path,
                                                    struct skd_slice content,
                                                    struct skd_error *error);

/* Renames all. */
SKD_MUST_CHECK enum skd_status skd_outputs_commit(struct skd_outputs *outputs,
                                                  struct skd_error *error);

/* Removes what was not committed. */
void skd_outputs_finish(struct skd_outputs *outputs);

#endif
