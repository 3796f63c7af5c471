/* Setting damaged files aside, so that nothing of them is written over.
 *
 * Stage: journal. Thread: any; no state.
 */
#ifndef SKD_JOURNAL_DAMAGE_H
#define SKD_JOURNAL_DAMAGE_H

#include "base/error.h"

/* Puts a file and its log into a folder (made, mode 0700, where it is not there) as
 * NAME-TIME.skind. `move`: they are there only then; else they are in both places (hard links:
 * whoever has the file written anew removes the first). Errors: SKD_FILE_IO, SKD_TOO_LARGE. */
SKD_MUST_CHECK enum skd_status skd_set_aside(const char *path, const char *folder, bool move,
                                             struct skd_error *error);

#endif
