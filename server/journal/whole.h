/* A session's file in one go: at the session's begin, for a save or a fork, and after trouble.
 *
 * Stage: journal. Thread: any worker, in the session's turn.
 */
#ifndef SKD_JOURNAL_WHOLE_H
#define SKD_JOURNAL_WHOLE_H

#include "session/session.h"

/* Whose file it is to be, where that is not the session itself. */
struct skd_journal_identity {
    char name[SKD_SESSION_NAME_BYTES_MAX + 1];
    char instance[SKD_INSTANCE_BYTES + 1];
};

/* Writes a complete file beside the target and renames it: at any moment there is the old file or
 * the new one, whole and on the disk. Mode 0600. The target's folder must be there; a log that
 * another file left at the target's name is removed.
 *
 * The session is undone to its oldest step and redone in place, to the bit, so nobody may read it
 * meanwhile. Its named poses come as references that the caller holds, in the order in which they
 * were put (the loop may put others at any time). identity NULL: the session's own.
 * Errors: SKD_FILE_IO (also a full disk), SKD_NO_MEMORY; then the target is what it was. */
SKD_MUST_CHECK enum skd_status skd_journal_write(const char *path, struct skd_session *session,
                                                 const struct skd_journal_identity *identity,
                                                 struct skd_pose *const *poses, size_t pose_count,
                                                 struct skd_error *error);

/* Removes what writing left in a folder when it was killed. Only while nobody else writes there. */
void skd_journal_sweep(const char *folder);

#endif
