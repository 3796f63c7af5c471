/* Where sessions are kept: one journal a session in the state folder, and what becomes of it.
 *
 *     STATE/                          mode 0700, ours, locked by the daemon that uses it
 *     STATE/NAME-TAG.skind       an open session (SQLite, journal/)
 *     STATE/closed/...                sessions that were closed: the last 32
 *     STATE/damaged/...               copies of files that had lost something
 *
 * Stage: journal. Thread: the loop, except where a function says so. A session whose journal cannot
 * be written is `suspended`: it goes on in memory, everybody is told, and its file is written anew
 * as soon as that works.
 */
#ifndef SKD_REQUESTS_KEEPING_H
#define SKD_REQUESTS_KEEPING_H

#include "requests/call.h"

/* Takes the state folder and starts the journal's writer. Before the loop runs. Errors: SKD_BUSY
 * (another daemon has the folder), SKD_FILE_IO. */
SKD_MUST_CHECK enum skd_status skd_keeping_start(struct skd_daemon *daemon, const char *folder,
                                                 struct skd_error *error);
/* Writes what waits and lets the folder go. After the last session was closed. */
void skd_keeping_stop(struct skd_daemon *daemon);

/* Writes a session's file for the first time, under a new name, which *file gets; a worker, before
 * anybody else has the session. A failure is not the session's end: see skd_keeping_begin. */
SKD_MUST_CHECK enum skd_status skd_keeping_write_first(const struct skd_daemon *daemon,
                                                       struct skd_session *session,
                                                       char file[SKD_STATE_FILE_BYTES],
                                                       struct skd_error *error);
/* From now on what the session does is appended to that file; or, where it could not be written
 * (`failure` not NULL), the session begins suspended. */
void skd_keeping_begin(struct skd_daemon *daemon, struct skd_live *live,
                       const char file[SKD_STATE_FILE_BYTES], const struct skd_error *failure);

/* The file of a session cannot be written: tells everybody, and tries again later. `resume` is for
 * requests/rewriting.c, which succeeded. */
void skd_keeping_suspend(struct skd_daemon *daemon, struct skd_live *live, const char *reason);
void skd_keeping_resume(struct skd_daemon *daemon, struct skd_live *live);

/* Opens the session's file (live->file, written whole just now), to append to it. False where that
 * failed; then the session is suspended. */
bool skd_keeping_reopen(struct skd_daemon *daemon, struct skd_live *live);

/* "ok", "suspended" or "off". */
const char *skd_keeping_word(const struct skd_live *live);

/* The session goes on, and is not kept any more: done(user) here when its file is removed. In a
 * call's turn. */
void skd_keeping_forget(struct skd_daemon *daemon, struct skd_live *live, void (*done)(void *user),
                        void *user);

/* The session is closed: its file stays, goes among the closed ones, or is removed; now, or when it
 * is back from where it is away. Of a suspended session that is closed the file has to be written
 * anew before (requests/rewriting.h); when the daemon stops, it is tried here. */
void skd_keeping_end(struct skd_daemon *daemon, struct skd_live *live, enum skd_keeping_end end);

#endif
