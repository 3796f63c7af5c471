/* See recovering.h. */
#include "requests/recovering.h"

#include "base/log.h"
#include "journal/read.h"
#include "journal/whole.h"
#include "requests/keeping.h"
#include "requests/live.h"
#include "requests/named_poses.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct recovery {
    const struct skd_daemon *daemon;
    uv_loop_t loop; /* of its own: the daemon's has clients waiting, who are to find all sessions */
    struct recovering *items; /* [count] */
    size_t count;
};

struct recovering {
    uv_work_t work;
    struct recovery *recovery;
    struct skd_state_file file;
    char path[SKD_STATE_PATH_BYTES];
    struct skd_session *session;
    struct skd_journal_report report;
    enum skd_status status;
    struct skd_error error;
};

static void read_in_worker(uv_work_t *work)
{
    struct recovering *item = work->data;
    char aside[SKD_STATE_PATH_BYTES];
    const char *folder = item->recovery->daemon->keeping.folder;
    item->status = skd_state_path(folder, SKD_STATE_DAMAGED, "", aside, &item->error);
    if (item->status == SKD_OK)
        item->status =
            skd_journal_read(item->path, aside, &item->session, &item->report, &item->error);
    if (item->status != SKD_OK || !item->report.rewrite)
        return;
    /* What was lost is copied aside already; from here on the session has a whole file again. */
    char file[SKD_STATE_FILE_BYTES];
    item->status =
        skd_keeping_write_first(item->recovery->daemon, item->session, file, &item->error);
    if (item->status != SKD_OK)
        return;
    skd_state_remove(item->path);
    memcpy(item->file.name, file, sizeof file);
}

static bool is_ours(const struct recovering *item)
{
    return strcmp(item->file.session, item->session->name) == 0;
}

/* No session was made of it. It stays where it is, unless it was set aside. */
static void refuse(struct skd_daemon *daemon, const struct recovering *item)
{
    skd_log(SKD_LOG_ERROR, "%s is not opened: %s", item->path, item->error.text);
    if (access(item->path, F_OK) != 0)
        return;
    cJSON *told = cJSON_CreateObject();
    cJSON_AddStringToObject(told, "file", item->file.name);
    cJSON_AddStringToObject(told, "text", item->error.text);
    cJSON_AddItemToArray(daemon->keeping.unopened, told);
}

/* Another file of the same name, before this one in the order of opening, or NULL. */
static const struct recovering *find_opened(const struct recovering *item)
{
    const struct recovering *other = item->recovery->items;
    for (; other != item; other++) {
        if (other->session != NULL && strcmp(other->session->name, item->session->name) == 0)
            return other;
    }
    return NULL;
}

static enum skd_status put_with_closed(struct skd_daemon *daemon, struct recovering *item)
{
    char path[SKD_STATE_PATH_BYTES];
    struct skd_named_poses poses;
    const char *folder = daemon->keeping.folder;
    enum skd_status status =
        skd_state_path(folder, SKD_STATE_CLOSED, item->file.name, path, &item->error);
    if (status == SKD_OK)
        status = skd_named_poses_all(item->session, &poses, &item->error);
    if (status != SKD_OK)
        return status;
    status = skd_journal_write(path, item->session, NULL, poses.items, poses.count, &item->error);
    skd_named_poses_finish(&poses);
    if (status != SKD_OK)
        return status;
    skd_state_remove(item->path);
    skd_state_closed(folder, item->file.name);
    skd_log(SKD_LOG_WARNING, "there are two files of session \"%s\": %s went among the closed ones",
            item->session->name, item->file.name);
    return SKD_OK;
}

/* A session that cannot be opened beside those that are. One that was being written anew when the
 * daemon died is there twice, and the older file goes, unless the session became another line of
 * revisions meanwhile. What we did not put here stays. */
static void leave(struct skd_daemon *daemon, struct recovering *item)
{
    const struct recovering *opened = find_opened(item);
    bool is_older = is_ours(item) && opened != NULL &&
                    strcmp(opened->report.instance, item->report.instance) == 0;
    if (is_older)
        skd_state_remove(item->path);
    else if (!is_ours(item) || opened == NULL || put_with_closed(daemon, item) != SKD_OK)
        refuse(daemon, item);
    skd_session_destroy(item->session);
    item->session = NULL;
}

static void open_session(struct skd_daemon *daemon, struct recovering *item)
{
    struct skd_live *live;
    if (item->session == NULL) {
        refuse(daemon, item);
        return;
    }
    if (item->session->damage[0] != '\0')
        skd_log(SKD_LOG_WARNING, "session \"%s\": %s", item->session->name, item->session->damage);
    if (skd_live_reserve(daemon, item->session->name, &live, &item->error) != SKD_OK) {
        leave(daemon, item);
        return;
    }
    live->session = item->session;
    live->durable_revision = item->session->revision;
    skd_keeping_begin(daemon, live, item->file.name, item->status != SKD_OK ? &item->error : NULL);
    if (!item->report.rewrite)
        live->file_bytes -=
            live->file_bytes < item->report.spent ? live->file_bytes : item->report.spent;
    skd_log(SKD_LOG_INFO, "session \"%s\" is open again at revision %llu", live->name,
            (unsigned long long)live->session->revision);
}

/* The order of opening: files that hold no session, then the highest revision, and of equal ones
 * that which we wrote. */
static int best_first(const void *a, const void *b)
{
    const struct recovering *one = a, *other = b;
    if (one->session == NULL || other->session == NULL)
        return (one->session != NULL) - (other->session != NULL);
    uint64_t x = one->session->revision, y = other->session->revision;
    return x != y ? (x < y ? 1 : -1) : is_ours(other) - is_ours(one);
}

static bool start_reading(struct skd_daemon *daemon, const struct skd_state_files *files,
                          struct recovery *recovery)
{
    *recovery = (struct recovery){.daemon = daemon,
                                  .items = calloc(files->count + 1, sizeof(struct recovering))};
    if (recovery->items == NULL || uv_loop_init(&recovery->loop) != 0) {
        free(recovery->items);
        return false;
    }
    for (size_t i = 0; i < files->count; i++) {
        struct recovering *item = &recovery->items[recovery->count];
        item->file = files->items[i];
        if (skd_state_path(daemon->keeping.folder, SKD_STATE_OPEN, item->file.name, item->path,
                           &item->error) != SKD_OK)
            continue;
        item->recovery = recovery;
        item->work.data = item;
        recovery->count++;
        int result = uv_queue_work(&recovery->loop, &item->work, read_in_worker, NULL);
        SKD_ASSERT(result == 0);
    }
    return true;
}

void skd_recover_sessions(struct skd_daemon *daemon)
{
    struct skd_state_files files;
    struct recovery recovery;
    struct skd_error error;
    if (skd_state_list(daemon->keeping.folder, SKD_STATE_OPEN, &files, &error) != SKD_OK) {
        skd_log(SKD_LOG_ERROR, "%s", error.text);
        return;
    }
    if (start_reading(daemon, &files, &recovery)) {
        uv_run(&recovery.loop, UV_RUN_DEFAULT);
        int left = uv_loop_close(&recovery.loop);
        SKD_ASSERT(left == 0);
        qsort(recovery.items, recovery.count, sizeof *recovery.items, best_first);
        daemon->keeping.unopened = cJSON_CreateArray();
        for (size_t i = 0; i < recovery.count; i++)
            open_session(daemon, &recovery.items[i]);
        free(recovery.items);
    }
    free(files.items);
}
