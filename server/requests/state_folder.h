/* The state folder and the names of the files in it.
 *
 *     FOLDER/lock                        held (flock) by the daemon that keeps its sessions here
 *     FOLDER/NAME-TAG.skind              an open session
 *     FOLDER/closed/NAME-TAG.skind       a closed one
 *     FOLDER/damaged/...                 copies of files that had lost something (journal/damage.h)
 *
 * Stage: journal. Thread: any; nothing is kept here. No file is opened: a session's name is read
 * off the file's.
 */
#ifndef SKD_REQUESTS_STATE_FOLDER_H
#define SKD_REQUESTS_STATE_FOLDER_H

#include "base/error.h"
#include "base/paths.h"
#include "protocol/limits.h"

#include <stddef.h>
#include <stdint.h>

enum {
    SKD_STATE_FILE_BYTES = 256,
};
#define SKD_CLOSED_FILES_MAX ((size_t)32) /* older closed sessions go */

enum skd_state_part { SKD_STATE_OPEN, SKD_STATE_CLOSED, SKD_STATE_DAMAGED };

struct skd_state_file {
    char name[SKD_STATE_FILE_BYTES];              /* of the file, in its part of the folder */
    char session[SKD_SESSION_NAME_BYTES_MAX + 1]; /* "" where the name tells none */
    uint64_t bytes;
    int64_t changed_s; /* unix time; of a closed one, when it was closed */
};

struct skd_state_files {
    size_t count;
    struct skd_state_file *items; /* the newest first */
};

/* Makes the folder and its parts where they are not there (mode 0700, whatever the umask), checks
 * that they are ours, closed to others and no symlinks, and takes the lock. Errors: SKD_BUSY
 * (another daemon has it), SKD_FILE_IO. */
SKD_MUST_CHECK enum skd_status skd_state_folder_take(const char *folder, int *lock,
                                                     struct skd_error *error);

/* Where a session's file is, or would be. Errors: SKD_TOO_LARGE (a path too long). */
SKD_MUST_CHECK enum skd_status skd_state_path(const char *folder, enum skd_state_part part,
                                              const char *file, char path[SKD_STATE_PATH_BYTES],
                                              struct skd_error *error);

/* A name for a new file of a session; never the same twice, so that a file which is written anew
 * does not meet what its predecessor left beside it (SQLite's log). */
void skd_state_new_file(const char *session, char file[SKD_STATE_FILE_BYTES]);

/* Removes a file, and what SQLite may have left beside it. */
void skd_state_remove(const char *path);

/* Lists one part; free items. Errors: SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_state_list(const char *folder, enum skd_state_part part,
                                              struct skd_state_files *files,
                                              struct skd_error *error);

/* A file came among the closed ones just now: it is the newest, however old what it holds, and those
 * beyond the newest SKD_CLOSED_FILES_MAX go. */
void skd_state_closed(const char *folder, const char *file);

/* Whether a path names something in the state folder, however it is spelt. */
bool skd_state_has(const char *folder, const char *path);

#endif
