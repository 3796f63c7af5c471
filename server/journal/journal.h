/* The journal: what happens to sessions goes to their files, in order, by one thread.
 *
 *     loop     record ──> the file's queue ··········································> done
 *     writer                 all that waits ──> one transaction ──> one fsync ──┘ (uv_async)
 *
 * Stage: journal. Thread: every function here is the loop's, and so are `done` and the events. The
 * writer thread owns the SQLite connections; it reads the arrays of steps and poses, which never
 * change, and counts no references.
 *
 * One file a session (see schema.h for what is in it). A file that cannot be written is suspended:
 * it is closed, what waits is forgotten and everybody who waits is told at once; the loop says so
 * and has it written anew (whole.h).
 */
#ifndef SKD_JOURNAL_JOURNAL_H
#define SKD_JOURNAL_JOURNAL_H

#include "session/session.h"

#include <uv.h>

struct skd_journal;
struct skd_journal_file;

struct skd_journal_events {
    void *user;
    /* Writing the owner's file failed, once a file. What was appended to it and not told `done`
     * yet is told so after this event. skd_journal_close may be called from here. */
    void (*suspended)(void *user, void *owner, const char *reason);
};

/* Starts the writer. Errors: SKD_NO_MEMORY, SKD_INTERNAL (no thread). */
SKD_MUST_CHECK enum skd_status skd_journal_start(struct skd_journal **journal, uv_loop_t *loop,
                                                 const struct skd_journal_events *events,
                                                 struct skd_error *error);

/* Writes all that waits, closes all files, and joins the thread; `done`s that are due are called
 * before it returns, suspensions are not told any more. The journal's memory goes when the loop
 * runs the close callbacks of its handles. */
void skd_journal_stop(struct skd_journal *journal);

/* A file that skd_journal_write made, or that was appended to before. The writer opens it: what is
 * wrong with it comes as a suspension. `instance` is the session's: the file gets it with the first
 * transaction, should it have another. `owner` is handed to the events, and not after
 * skd_journal_close. Errors: SKD_FILE_IO (there is none), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_journal_open(struct skd_journal *journal, const char *path,
                                                enum skd_durability durability,
                                                const char *instance, void *owner,
                                                struct skd_journal_file **file,
                                                struct skd_error *error);

/* Ends a file: what waits is written first, then its log is folded into it and it is closed. Then
 * the file stays (move_to NULL), is removed (""), or is renamed to move_to (copied), replacing what
 * is there. done(user) comes last; it may be NULL. */
void skd_journal_close(struct skd_journal_file *file, const char *move_to, void (*done)(void *user),
                       void *user);

/* What one record says. Made by the functions below, which hold what they need of a step or pose;
 * NULL: no memory. */
struct skd_record;

/* A new step on top; what was undone is gone. `dropped`: how many of the oldest steps can no longer
 * be undone since. */
struct skd_record *skd_record_create_step(struct skd_step *step, uint64_t revision, size_t dropped);
/* The step `index` (0: the oldest of the history) was taken to the history's boundary and undone
 * (direction -1) or redone (+1). */
struct skd_record *skd_record_create_move(int direction, size_t index, uint64_t revision);
/* A pose was put under its name. */
struct skd_record *skd_record_create_pose(struct skd_pose *pose);
/* Another guard, or none. The poses are copied. */
struct skd_record *skd_record_create_guard(const struct skd_guards *guards);
/* The session's weights were exported as they were at that revision. */
struct skd_record *skd_record_create_exported(uint64_t revision);
/* Another durability (also of the records after this one) and history limit; `dropped` as above. */
struct skd_record *skd_record_create_settings(enum skd_durability durability,
                                              uint64_t history_bytes, size_t dropped);

/* Nothing but an answer, which is put in by the function below. */
struct skd_record *skd_record_create_answer(void);

/* The answer of the request that made this record, to be given again should it come a second time.
 * All is copied. False: no memory. */
SKD_MUST_CHECK bool skd_record_remember(struct skd_record *record, const char *client_id,
                                        uint64_t sequence, const char *answer);
void skd_record_destroy(struct skd_record *record); /* NULL is fine */

/* Appends a record, which is taken over. True: done(user) is called later, on the loop, in the
 * order of appending, once the record is on the disk (durability full), or is no longer ahead of it
 * by more than the journal's memory for what waits (second), or the file is suspended. False: it is
 * as durable as it will get; done is not called. Never calls done itself. done may be NULL. */
bool skd_journal_append(struct skd_journal_file *file, struct skd_record *record,
                        void (*done)(void *user), void *user);

/* Bytes of the file and its log as of the last transaction. */
uint64_t skd_journal_bytes(const struct skd_journal_file *file);

#endif
