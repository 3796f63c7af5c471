/* See journal.h.
 *
 * The loop and the writer share, under one lock: each file's queue, the list of files, and the
 * queue of records that come back. Everything else belongs to one of them:
 *
 *     loop     skd_journal_file.{owner, durability, untold, is_closing}, callbacks, all memory
 *     writer   skd_journal_file.{writing, ...}: what is open, what is ahead of the disk
 *
 * A record stays in memory until it has come back, so the loop alone counts references.
 */
#include "journal/journal.h"

#include "base/log.h"
#include "journal/inspect.h"
#include "journal/record.h"
#include "journal/writing.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const size_t WAITING_BYTES_MAX = (size_t)256 << 20; /* ahead of the disk, of one file */
static const size_t BATCH_BYTES_MAX = (size_t)64 << 20;    /* of one transaction */
static const uint64_t LOG_BYTES_MAX = (uint64_t)16 << 20;  /* then it is folded into the file */
static const uint64_t LOG_BYTES_IDLE = (uint64_t)1 << 20;  /* so much is, when nothing waits */
static const uint64_t AHEAD_NS_MAX = 900 * 1000 * 1000;    /* of durability second */
static const uint64_t IDLE_NS = 100 * 1000 * 1000;

struct queue {
    struct skd_record *first, **end;
};

enum move { MOVE_NONE, MOVE_REMOVE, MOVE_RENAME };

struct skd_journal_file {
    struct skd_journal *journal;
    struct skd_journal_file *next; /* of the journal's list */
    char path[SKD_PATH_BYTES_MAX];
    char instance[SKD_INSTANCE_BYTES + 1];
    /* the loop's */
    void *owner;
    enum skd_durability durability;
    size_t untold;   /* records whose `done` is due */
    bool is_closing; /* skd_journal_close was called */
    /* shared */
    struct queue waiting;
    size_t waiting_bytes;
    bool has_failed; /* nothing more is written */
    atomic_uint_fast64_t bytes;
    /* the writer's */
    struct skd_writing writing;
    bool is_open;
    bool has_ended;
    enum skd_durability written_as;
    uint64_t ahead_since_ns;
    uint64_t written_ns;
    /* told by the loop */
    struct skd_record suspended, end;
    char reason[SKD_ERROR_TEXT_BYTES];
    enum move move;
    char move_to[SKD_PATH_BYTES_MAX];
};

struct skd_journal {
    uv_async_t wake; /* .data: the journal */
    uv_thread_t thread;
    uv_mutex_t lock;
    uv_cond_t work;
    struct skd_journal_events events;
    struct skd_journal_file *files;
    struct skd_journal_file *last_served;
    struct queue back; /* records on their way to the loop */
    bool is_stopping;
};

/* ---- queues -----------------------------------------------------------------------------------
 */

static void queue_init(struct queue *queue)
{
    queue->first = NULL;
    queue->end = &queue->first;
}

static void queue_put(struct queue *queue, struct skd_record *record)
{
    record->next = NULL;
    *queue->end = record;
    queue->end = &record->next;
}

/* Moves all of `from` to the end of `to`. */
static void queue_append(struct queue *to, struct queue *from)
{
    if (from->first == NULL)
        return;
    *to->end = from->first;
    to->end = from->end;
    queue_init(from);
}

static struct skd_record *queue_take(struct queue *queue)
{
    struct skd_record *record = queue->first;
    if (record != NULL && (queue->first = record->next) == NULL)
        queue->end = &queue->first;
    return record;
}

/* ---- the writer -------------------------------------------------------------------------------
 */

/* Gives records back to the loop. */
static void give_back(struct skd_journal *journal, struct queue *done)
{
    uv_mutex_lock(&journal->lock);
    for (struct skd_record *record = done->first; record != NULL; record = record->next)
        record->file->waiting_bytes -= record->bytes;
    queue_append(&journal->back, done);
    uv_mutex_unlock(&journal->lock);
    uv_async_send(&journal->wake);
}

static void close_store(struct skd_journal_file *file)
{
    skd_writing_close(&file->writing);
    file->is_open = false;
    file->ahead_since_ns = 0;
}

/* The file is given up: the loop is told before those who wait are. */
static void suspend(struct skd_journal_file *file, const char *reason)
{
    struct queue told;
    queue_init(&told);
    close_store(file);
    (void)snprintf(file->reason, sizeof file->reason, "%s", reason);
    uv_mutex_lock(&file->journal->lock);
    file->has_failed = true;
    uv_mutex_unlock(&file->journal->lock);
    queue_put(&told, &file->suspended);
    give_back(file->journal, &told);
}

static enum skd_status open_store(struct skd_journal_file *file, struct skd_error *error)
{
    if (file->is_open)
        return SKD_OK;
    enum skd_status status = skd_writing_open(&file->writing, file->path, error);
    file->is_open = true; /* there is something to close */
    memcpy(file->writing.state.instance, file->instance, sizeof file->instance);
    return status;
}

static enum skd_status checkpoint(struct skd_journal_file *file, bool truncate,
                                  struct skd_error *error)
{
    enum skd_status status = skd_writing_checkpoint(&file->writing, truncate, error);
    if (status == SKD_OK) {
        file->ahead_since_ns = 0;
        atomic_store(&file->bytes, file->writing.file_bytes);
    }
    return status;
}

/* One transaction with all these records. */
static enum skd_status write_batch(struct skd_journal_file *file, const struct queue *batch,
                                   struct skd_error *error)
{
    struct skd_writing *writing = &file->writing;
    enum skd_status status = open_store(file, error);
    enum skd_durability before = file->written_as;
    for (const struct skd_record *record = batch->first; record != NULL; record = record->next) {
        if (record->kind == SKD_RECORD_SETTINGS)
            file->written_as = record->durability;
    }
    if (status == SKD_OK) /* a change of durability is written with the surer one */
        status = skd_writing_begin(writing, before < file->written_as ? before : file->written_as,
                                   error);
    for (const struct skd_record *record = batch->first; record != NULL && status == SKD_OK;
         record = record->next)
        status = skd_writing_put(writing, record, error);
    if (status == SKD_OK)
        status = skd_writing_commit(writing, error);
    if (status != SKD_OK)
        return status;
    file->written_ns = uv_hrtime();
    if (writing->is_ahead && file->ahead_since_ns == 0)
        file->ahead_since_ns = file->written_ns;
    atomic_store(&file->bytes, writing->file_bytes);
    return SKD_OK;
}

static enum skd_status sync_folder(const char *path)
{
    char folder[SKD_PATH_BYTES_MAX];
    (void)snprintf(folder, sizeof folder, "%s", path);
    char *slash = strrchr(folder, '/');
    if (slash != NULL)
        slash[1] = '\0';
    int fd = open(slash != NULL ? folder : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return SKD_FILE_IO;
    int result = fsync(fd);
    close(fd);
    return result == 0 ? SKD_OK : SKD_FILE_IO;
}

/* A log that could not be folded in is put beside the file's new name before the file goes there,
 * and so at no moment is the file without it. */
static enum skd_status rename_file(const struct skd_journal_file *file, struct skd_error *error)
{
    char log[SKD_PATH_BYTES_MAX], log_to[SKD_PATH_BYTES_MAX];
    struct stat status;
    if (!skd_inspect_beside(file->path, "-wal", log) ||
        !skd_inspect_beside(file->move_to, "-wal", log_to))
        return skd_fail(error, SKD_TOO_LARGE, "\"%.100s...\" is too long", file->move_to);
    bool has_log = stat(log, &status) == 0;
    (void)unlink(log_to);
    if ((has_log && link(log, log_to) != 0) || rename(file->path, file->move_to) != 0)
        return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be renamed: %s", file->path,
                        strerror(errno));
    if (has_log)
        (void)unlink(log);
    if (sync_folder(file->move_to) != SKD_OK || sync_folder(file->path) != SKD_OK)
        return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be brought to the disk", file->move_to);
    return SKD_OK;
}

static void remove_file(const struct skd_journal_file *file)
{
    char log[SKD_PATH_BYTES_MAX];
    (void)unlink(file->path);
    if (skd_inspect_beside(file->path, "-wal", log))
        (void)unlink(log);
    (void)sync_folder(file->path); /* a power cut does not bring it back */
}

/* The last thing that happens to a file. Nobody can be told of a failure any more but the log. */
static void end(struct skd_journal_file *file)
{
    struct skd_error error = {0};
    enum skd_status status = SKD_OK;
    bool is_given_up = file->has_failed; /* written by this thread only */
    file->has_ended = true;
    if (file->move != MOVE_REMOVE && !is_given_up) {
        status = open_store(file, &error);
        if (status == SKD_OK)
            status = checkpoint(file, true, &error);
    }
    close_store(file);
    if (file->move == MOVE_REMOVE) {
        remove_file(file);
    } else if (file->move == MOVE_RENAME) {
        struct skd_error second;
        if (rename_file(file, &second) != SKD_OK)
            skd_log(SKD_LOG_ERROR, "%s", second.text);
    }
    if (status != SKD_OK)
        skd_log(SKD_LOG_ERROR, "\"%s\" is closed with its log beside it: %s", file->path,
                error.text);
}

/* Serves what was taken from a file's queue: at most one transaction, and its end. */
static void serve(struct skd_journal_file *file, struct queue *batch, bool ends)
{
    struct skd_error error;
    struct queue last;
    if (batch->first != NULL && !file->has_failed && write_batch(file, batch, &error) != SKD_OK)
        suspend(file, error.text);
    if (batch->first != NULL)
        give_back(file->journal, batch);
    if (!ends && !file->has_failed && file->writing.log_bytes > LOG_BYTES_MAX &&
        checkpoint(file, false, &error) != SKD_OK)
        suspend(file, error.text);
    if (ends) {
        end(file);
        queue_init(&last);
        queue_put(&last, &file->end);
        give_back(file->journal, &last);
    }
}

/* Takes what waits for a file, up to the end or a transaction's size. Under the lock. */
static bool take_batch(struct skd_journal_file *file, struct queue *batch)
{
    size_t bytes = 0;
    queue_init(batch);
    while (file->waiting.first != NULL && bytes < BATCH_BYTES_MAX) {
        struct skd_record *record = queue_take(&file->waiting);
        if (record->kind == SKD_RECORD_END)
            return true;
        bytes += record->bytes;
        queue_put(batch, record);
    }
    return false;
}

/* The next file with something to write, after the one that was served last. Under the lock. */
static struct skd_journal_file *next_to_serve(struct skd_journal *journal)
{
    struct skd_journal_file *after = NULL, *any = NULL;
    bool is_behind = false;
    for (struct skd_journal_file *file = journal->files; file != NULL; file = file->next) {
        if (file->waiting.first != NULL && any == NULL)
            any = file;
        if (file->waiting.first != NULL && is_behind && after == NULL)
            after = file;
        is_behind |= file == journal->last_served;
    }
    return journal->last_served = after != NULL ? after : any;
}

/* When a file wants something done though nothing waits for it: UINT64_MAX for never. */
static uint64_t due_ns(const struct skd_journal_file *file)
{
    uint64_t due = UINT64_MAX;
    if (!file->is_open || file->has_ended)
        return due;
    if (file->ahead_since_ns != 0)
        due = file->ahead_since_ns + AHEAD_NS_MAX;
    if (file->writing.log_bytes > LOG_BYTES_IDLE && file->written_ns + IDLE_NS < due)
        due = file->written_ns + IDLE_NS;
    return due;
}

/* The file whose turn to be looked after comes first. Under the lock. */
static struct skd_journal_file *first_due(const struct skd_journal *journal, uint64_t *due)
{
    struct skd_journal_file *found = NULL;
    *due = UINT64_MAX;
    for (struct skd_journal_file *file = journal->files; file != NULL; file = file->next) {
        if (due_ns(file) < *due) {
            *due = due_ns(file);
            found = file;
        }
    }
    return found;
}

static void look_after(struct skd_journal_file *file, uint64_t now_ns)
{
    struct skd_error error;
    enum skd_status status;
    if (file->ahead_since_ns != 0 && file->ahead_since_ns + AHEAD_NS_MAX <= now_ns) {
        status = skd_writing_sync(&file->writing, &error);
        file->ahead_since_ns = 0;
    } else {
        status = checkpoint(file, false, &error);
    }
    if (status != SKD_OK)
        suspend(file, error.text);
}

static void write_on(void *user)
{
    struct skd_journal *journal = user;
    struct queue batch;
    uv_mutex_lock(&journal->lock);
    for (;;) {
        uint64_t due, now = uv_hrtime();
        struct skd_journal_file *late = first_due(journal, &due);
        bool is_late = late != NULL && due <= now;
        /* A sync that is due comes before what waits, a checkpoint after it. */
        bool is_urgent = is_late && late->ahead_since_ns != 0;
        struct skd_journal_file *file = is_urgent ? NULL : next_to_serve(journal);
        if (file != NULL) {
            bool ends = take_batch(file, &batch);
            uv_mutex_unlock(&journal->lock);
            serve(file, &batch, ends);
            uv_mutex_lock(&journal->lock);
        } else if (is_late) {
            uv_mutex_unlock(&journal->lock);
            look_after(late, now);
            uv_mutex_lock(&journal->lock);
        } else if (journal->is_stopping) {
            break;
        } else if (late != NULL) {
            (void)uv_cond_timedwait(&journal->work, &journal->lock, due - now);
        } else {
            uv_cond_wait(&journal->work, &journal->lock);
        }
    }
    uv_mutex_unlock(&journal->lock);
}

/* ---- the loop ---------------------------------------------------------------------------------
 */

static void unlist(struct skd_journal_file *file)
{
    struct skd_journal *journal = file->journal;
    uv_mutex_lock(&journal->lock);
    struct skd_journal_file **place = &journal->files;
    while (*place != file)
        place = &(*place)->next;
    *place = file->next;
    if (journal->last_served == file)
        journal->last_served = NULL;
    uv_mutex_unlock(&journal->lock);
    free(file);
}

static void tell(struct skd_journal *journal, struct skd_record *record)
{
    struct skd_journal_file *file = record->file;
    if (record->kind == SKD_RECORD_SUSPENDED) {
        if (file->is_closing)
            skd_log(SKD_LOG_ERROR, "\"%s\" lacks the last changes: %s", file->path, file->reason);
        else
            journal->events.suspended(journal->events.user, file->owner, file->reason);
        return;
    }
    void (*done)(void *user) = record->is_told ? NULL : record->done;
    void *user = record->user;
    if (!record->is_told)
        file->untold--;
    if (record->kind == SKD_RECORD_END)
        unlist(file);
    else
        skd_record_destroy(record);
    if (done != NULL)
        done(user);
}

static void tell_all(struct skd_journal *journal)
{
    struct queue back;
    struct skd_record *record;
    queue_init(&back);
    uv_mutex_lock(&journal->lock);
    queue_append(&back, &journal->back);
    uv_mutex_unlock(&journal->lock);
    while ((record = queue_take(&back)) != NULL)
        tell(journal, record);
}

static void on_wake(uv_async_t *wake)
{
    tell_all(wake->data);
}

static void on_closed(uv_handle_t *handle)
{
    struct skd_journal *journal = handle->data;
    uv_cond_destroy(&journal->work);
    uv_mutex_destroy(&journal->lock);
    free(journal);
}

enum skd_status skd_journal_start(struct skd_journal **result, uv_loop_t *loop,
                                  const struct skd_journal_events *events, struct skd_error *error)
{
    struct skd_journal *journal = calloc(1, sizeof *journal);
    if (journal == NULL)
        return skd_fail_memory(error, "the journal");
    journal->events = *events;
    queue_init(&journal->back);
    if (uv_mutex_init(&journal->lock) != 0)
        goto fail;
    if (uv_cond_init(&journal->work) != 0)
        goto fail_lock;
    if (uv_async_init(loop, &journal->wake, on_wake) != 0)
        goto fail_work;
    journal->wake.data = journal;
    if (uv_thread_create(&journal->thread, write_on, journal) == 0) {
        *result = journal;
        return SKD_OK;
    }
    uv_close((uv_handle_t *)&journal->wake, on_closed);
    return skd_fail(error, SKD_INTERNAL, "the journal's thread cannot be started");
fail_work:
    uv_cond_destroy(&journal->work);
fail_lock:
    uv_mutex_destroy(&journal->lock);
fail:
    free(journal);
    return skd_fail(error, SKD_INTERNAL, "the journal cannot be started");
}

void skd_journal_stop(struct skd_journal *journal)
{
    for (struct skd_journal_file *file = journal->files; file != NULL; file = file->next) {
        if (!file->is_closing)
            skd_journal_close(file, NULL, NULL, NULL);
    }
    uv_mutex_lock(&journal->lock);
    journal->is_stopping = true;
    uv_cond_signal(&journal->work);
    uv_mutex_unlock(&journal->lock);
    uv_thread_join(&journal->thread);
    tell_all(journal);
    uv_close((uv_handle_t *)&journal->wake, on_closed);
}

enum skd_status skd_journal_open(struct skd_journal *journal, const char *path,
                                 enum skd_durability durability, const char *instance, void *owner,
                                 struct skd_journal_file **result, struct skd_error *error)
{
    struct stat status;
    if (strlen(path) >= SKD_PATH_BYTES_MAX || stat(path, &status) != 0)
        return skd_fail(error, SKD_FILE_IO, "\"%.300s\" cannot be appended to: %s", path,
                        strerror(errno));
    struct skd_journal_file *file = calloc(1, sizeof *file);
    if (file == NULL)
        return skd_fail_memory(error, "a session's file");
    memcpy(file->path, path, strlen(path) + 1);
    (void)snprintf(file->instance, sizeof file->instance, "%s", instance);
    file->journal = journal;
    file->owner = owner;
    file->durability = file->written_as = durability;
    file->suspended = (struct skd_record){.kind = SKD_RECORD_SUSPENDED, .file = file};
    file->end = (struct skd_record){.kind = SKD_RECORD_END, .file = file};
    queue_init(&file->waiting);
    atomic_init(&file->bytes, (uint64_t)status.st_size);
    uv_mutex_lock(&journal->lock);
    file->next = journal->files;
    journal->files = file;
    uv_mutex_unlock(&journal->lock);
    *result = file;
    return SKD_OK;
}

static void enqueue(struct skd_journal_file *file, struct skd_record *record)
{
    struct skd_journal *journal = file->journal;
    file->untold += !record->is_told;
    uv_mutex_lock(&journal->lock);
    file->waiting_bytes += record->bytes;
    queue_put(&file->waiting, record);
    uv_cond_signal(&journal->work);
    uv_mutex_unlock(&journal->lock);
}

void skd_journal_close(struct skd_journal_file *file, const char *move_to, void (*done)(void *user),
                       void *user)
{
    file->is_closing = true;
    file->move = move_to == NULL ? MOVE_NONE : move_to[0] == '\0' ? MOVE_REMOVE : MOVE_RENAME;
    if (move_to != NULL)
        (void)snprintf(file->move_to, sizeof file->move_to, "%s", move_to);
    file->end.done = done;
    file->end.user = user;
    enqueue(file, &file->end);
}

bool skd_journal_append(struct skd_journal_file *file, struct skd_record *record,
                        void (*done)(void *user), void *user)
{
    /* Durability itself changes durably: a file that says `full` has all that was told. */
    bool is_full = file->durability == SKD_DURABILITY_FULL;
    if (record->kind == SKD_RECORD_SETTINGS)
        file->durability = record->durability;
    uv_mutex_lock(&file->journal->lock);
    bool is_durable = file->has_failed || (!is_full && file->durability != SKD_DURABILITY_FULL &&
                                           file->waiting_bytes <= WAITING_BYTES_MAX);
    uv_mutex_unlock(&file->journal->lock);
    record->file = file;
    record->done = done;
    record->user = user;
    /* Nobody is told out of turn: whoever waits, those after him wait too. */
    record->is_told = is_durable && file->untold == 0;
    bool waits = !record->is_told;
    enqueue(file, record);
    return waits;
}

uint64_t skd_journal_bytes(const struct skd_journal_file *file)
{
    return atomic_load(&file->bytes);
}
