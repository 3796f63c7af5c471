/* A session from its file, whatever became of the file meanwhile.
 *
 * Stage: journal -> rig session. Thread: any worker. Trusts nothing: a file may be torn, flipped,
 * zeroed or made by somebody else.
 *
 * Reading changes no file. A file of durability `second` may lack what was told last, and so gives
 * a session of a new instance. What is whole is used: the state at the last revision of which all
 * steps are there. A log that ends in a transaction that never was committed is no damage.
 */
#ifndef SKD_JOURNAL_READ_H
#define SKD_JOURNAL_READ_H

#include "session/session.h"

struct skd_journal_report {
    uint64_t revision;
    char instance[SKD_INSTANCE_BYTES + 1]; /* that the file was written for; "" where not known */
    size_t steps;   /* in the file, those that can no longer be undone too */
    uint64_t bytes; /* of the file and its log */
    uint64_t spent; /* of these, about what steps take that can no longer be undone */
    bool cut;       /* something was lost */
    bool rewrite;   /* the file is to be written anew before it is appended to: it is cut, of an
                       older version, or not sound within */
    char text[SKD_ERROR_TEXT_BYTES]; /* and what, one sentence; "" */
};

/* Reads a session. Where something was lost, the session has a new instance, and session->damage
 * and the report say what; the caller writes it anew under another name (whole.h) and removes the
 * damaged file.
 *
 * aside: a folder, made where it is not there, for damaged files: a file that has lost something is
 * copied there, one of which no session can be made is moved there. NULL: all stays where it is.
 *
 * Errors: SKD_DAMAGED (no session can be made of it), SKD_NEWER (made by a later skind: it is left
 * as it is), SKD_NO_FILE, SKD_FILE_IO, SKD_UNSUPPORTED (not a file of ours: left as it is),
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_journal_read(const char *path, const char *aside,
                                                struct skd_session **session,
                                                struct skd_journal_report *report,
                                                struct skd_error *error);

/* Reads and checks all of a file, and throws the session away; with `live` (in its turn, its file
 * closed) compares all that both have to the bit, and a difference is SKD_DAMAGED. SKD_OK with
 * report->cut: something was lost. Errors: as skd_journal_read. */
SKD_MUST_CHECK enum skd_status skd_journal_verify(const char *path, const struct skd_session *live,
                                                  struct skd_journal_report *report,
                                                  struct skd_error *error);

#endif
