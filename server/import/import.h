/* Files are parsed in a process of their own, so that none can hurt the daemon.
 *
 *     skd_import_start --> skind-import FILE ==> memory file --> done --> skd_import_read --> rig
 *     loop                 child.h              answer.h        loop     worker
 *
 * Stage: request -> rig session. Thread: the loop, but for skd_import_read. No worker waits for an
 * import: the loop hears when the process ends, and looks now and then whether it was cancelled or
 * has taken too long; then it is killed.
 *
 * The process has limits on memory, time and files; a crash or a runaway is an error of the one
 * import. What it leaves is sealed and then read as from an enemy (rig/rig_image.h).
 */
#ifndef SKD_IMPORT_IMPORT_H
#define SKD_IMPORT_IMPORT_H

#include "rig/rig.h"

#include <stdatomic.h>
#include <uv.h>

enum {
    SKD_IMPORTS_MAX = 4,          /* processes at a time; other imports wait for one to end */
    SKD_IMPORT_SECONDS_MAX = 120, /* of one process, by the clock and of a processor */
};

/* Owned by the daemon, zeroed but for the loop. */
struct skd_importer {
    uv_loop_t *loop;
    int running;
};

struct skd_import_wish {
    const char *path;             /* copied */
    size_t memory_bytes;          /* that the process may use, and its image have */
    unsigned seconds;             /* that it may take */
    const atomic_bool *cancelled; /* looked at until done is called */
    void (*done)(void *user);     /* on the loop, never from within skd_import_start */
    void *user;
};

struct skd_import;

/* Begins; NULL: no memory. */
struct skd_import *skd_import_start(struct skd_importer *importer,
                                    const struct skd_import_wish *wish);

/* After done: whether there is an image. Errors: those of skd_gltf_import, where SKD_TOO_LARGE also
 * stands for too much memory or time and SKD_BAD_RIG for a crash; SKD_CANCELLED; SKD_FILE_IO when
 * there could be no process. */
SKD_MUST_CHECK enum skd_status skd_import_result(const struct skd_import *import,
                                                 struct skd_error *error);

/* After done, with a result: bytes of the image; the rig needs about as many. */
size_t skd_import_bytes(const struct skd_import *import);

/* The rig of an import that has a result, its files opened again; any thread; once. The influences
 * last as long as the import does.
 * Errors: SKD_BAD_RIG, SKD_TOO_LARGE, SKD_NO_MEMORY; SKD_NO_FILE, SKD_FILE_IO, SKD_SOURCE_CHANGED
 * when a file is no longer what was read. */
SKD_MUST_CHECK enum skd_status skd_import_read(struct skd_import *import, struct skd_rig **rig,
                                               struct skd_influences *influences,
                                               struct skd_error *error);

void skd_import_destroy(struct skd_import *import); /* after done; NULL is fine */

#endif
