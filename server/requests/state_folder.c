/* See state_folder.h. */
#include "requests/state_folder.h"

#include "base/log.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { TAG_DIGITS = 16 };

static const char suffix[] = ".skind";

static const char *part_folder(enum skd_state_part part)
{
    static const char *const folders[] = {"", "/closed", "/damaged"};
    return folders[part];
}

/* One folder, ours alone. A new one gets its mode whatever the umask. */
static enum skd_status need_folder(const char *path, struct skd_error *error)
{
    struct stat info;
    if (mkdir(path, 0700) == 0)
        (void)chmod(path, 0700);
    else if (errno != EEXIST)
        return skd_fail(error, SKD_FILE_IO,
                        "cannot make the state folder %s: %s (choose another with --state)", path,
                        strerror(errno));
    if (lstat(path, &info) != 0)
        return skd_fail(error, SKD_FILE_IO, "cannot look at the state folder %s: %s", path,
                        strerror(errno));
    if (!S_ISDIR(info.st_mode))
        return skd_fail(error, SKD_FILE_IO, "the state folder %s is no folder (a symlink?)", path);
    if (info.st_uid != geteuid() || (info.st_mode & 077) != 0)
        return skd_fail(error, SKD_FILE_IO,
                        "the state folder %s must be yours and closed to others: it belongs to "
                        "user %ld and has mode %04o; chmod 700 it, or choose another with --state",
                        path, (long)info.st_uid, (unsigned)(info.st_mode & 07777));
    return SKD_OK;
}

/* The folders above it, which may be of any mode and owner, as a home's are. */
static void make_parents(const char *folder)
{
    char path[SKD_STATE_PATH_BYTES];
    (void)snprintf(path, sizeof path, "%s", folder);
    for (char *slash = strchr(path + 1, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        if (mkdir(path, 0700) == 0)
            (void)chmod(path, 0700);
        *slash = '/';
    }
}

static enum skd_status take_lock(const char *folder, int *lock, struct skd_error *error)
{
    char path[SKD_STATE_PATH_BYTES];
    enum skd_status status = skd_state_path(folder, SKD_STATE_OPEN, "lock", path, error);
    if (status != SKD_OK)
        return status;
    *lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (*lock < 0 || fchmod(*lock, 0600) != 0)
        return skd_fail(error, SKD_FILE_IO, "cannot open the lock file %s: %s", path,
                        strerror(errno));
    if (flock(*lock, LOCK_EX | LOCK_NB) == 0)
        return SKD_OK;
    close(*lock);
    *lock = -1;
    return skd_fail(error, SKD_BUSY,
                    "another skind keeps its sessions in %s; stop it, or choose another folder "
                    "with --state",
                    folder);
}

enum skd_status skd_state_folder_take(const char *folder, int *lock, struct skd_error *error)
{
    *lock = -1;
    make_parents(folder);
    for (int part = SKD_STATE_OPEN; part <= SKD_STATE_DAMAGED; part++) {
        char path[SKD_STATE_PATH_BYTES];
        int length =
            snprintf(path, sizeof path, "%s%s", folder, part_folder((enum skd_state_part)part));
        if (length < 0 || (size_t)length >= sizeof path)
            return skd_fail(error, SKD_TOO_LARGE, "the state folder's path is too long");
        enum skd_status status = need_folder(path, error);
        if (status != SKD_OK)
            return status;
    }
    return take_lock(folder, lock, error);
}

enum skd_status skd_state_path(const char *folder, enum skd_state_part part, const char *file,
                               char path[SKD_STATE_PATH_BYTES], struct skd_error *error)
{
    int length = snprintf(path, SKD_STATE_PATH_BYTES, "%s%s/%s", folder, part_folder(part), file);
    if (length < 0 || length >= SKD_STATE_PATH_BYTES)
        return skd_fail(error, SKD_TOO_LARGE, "the state folder's path is too long");
    return SKD_OK;
}

void skd_state_new_file(const char *session, char file[SKD_STATE_FILE_BYTES])
{
    uint64_t tag;
    ssize_t got = getrandom(&tag, sizeof tag, 0);
    SKD_ASSERT(got == (ssize_t)sizeof tag);
    (void)snprintf(file, SKD_STATE_FILE_BYTES, "%s-%0*llx%s", session, TAG_DIGITS,
                   (unsigned long long)tag, suffix);
}

void skd_state_remove(const char *path)
{
    static const char *const tails[] = {"-wal", "-shm", ""};
    for (size_t i = 0; i < sizeof tails / sizeof *tails; i++) {
        char name[SKD_STATE_PATH_BYTES + 8];
        (void)snprintf(name, sizeof name, "%s%s", path, tails[i]);
        (void)unlink(name);
    }
}

/* "Knight" from "Knight-0123456789abcdef.skind", and from what that was set aside as, with the time
 * behind it. */
static void read_session_name(const char *file, char session[SKD_SESSION_NAME_BYTES_MAX + 1])
{
    size_t length = strlen(file) - (sizeof suffix - 1);
    session[0] = '\0';
    for (size_t at = length > TAG_DIGITS ? length - TAG_DIGITS - 1 : 0; at > 0; at--) {
        const char *tag = file + at + 1;
        bool is_tag = file[at] == '-' && strspn(tag, "0123456789abcdef") == TAG_DIGITS &&
                      (tag[TAG_DIGITS] == '.' || tag[TAG_DIGITS] == '-');
        if (!is_tag || at > SKD_SESSION_NAME_BYTES_MAX)
            continue;
        memcpy(session, file, at);
        session[at] = '\0';
        return;
    }
}

static int newest_first(const void *a, const void *b)
{
    const struct skd_state_file *one = a, *other = b;
    if (one->changed_s != other->changed_s)
        return one->changed_s < other->changed_s ? 1 : -1;
    return strcmp(one->name, other->name);
}

static bool add_file(DIR *folder, const struct dirent *entry, struct skd_state_files *files,
                     size_t *capacity)
{
    struct stat info;
    size_t length = strlen(entry->d_name);
    if (length < sizeof suffix || length >= sizeof files->items->name ||
        strcmp(entry->d_name + length - (sizeof suffix - 1), suffix) != 0 ||
        fstatat(dirfd(folder), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0 ||
        !S_ISREG(info.st_mode))
        return true;
    if (files->count == *capacity) {
        *capacity = *capacity == 0 ? 16 : 2 * *capacity;
        struct skd_state_file *items = realloc(files->items, *capacity * sizeof *items);
        if (items == NULL)
            return false;
        files->items = items;
    }
    struct skd_state_file *file = &files->items[files->count++];
    memcpy(file->name, entry->d_name, length + 1);
    read_session_name(file->name, file->session);
    file->bytes = (uint64_t)info.st_size;
    file->changed_s = (int64_t)info.st_mtime;
    return true;
}

enum skd_status skd_state_list(const char *folder, enum skd_state_part part,
                               struct skd_state_files *files, struct skd_error *error)
{
    char path[SKD_STATE_PATH_BYTES];
    size_t capacity = 0;
    *files = (struct skd_state_files){0};
    enum skd_status status = skd_state_path(folder, part, "", path, error);
    if (status != SKD_OK)
        return status;
    DIR *open = opendir(path);
    if (open == NULL)
        return skd_fail(error, SKD_FILE_IO, "cannot read the state folder %s: %s", path,
                        strerror(errno));
    bool room = true;
    for (const struct dirent *entry; room && (entry = readdir(open)) != NULL;)
        room = add_file(open, entry, files, &capacity);
    closedir(open);
    if (!room) {
        free(files->items);
        *files = (struct skd_state_files){0};
        return skd_fail_memory(error, "the list of kept sessions");
    }
    if (files->count > 0)
        qsort(files->items, files->count, sizeof *files->items, newest_first);
    return SKD_OK;
}

/* The file is newer than all others there, whatever the clock says and whenever it was written. */
static void make_newest(const struct skd_state_files *files, const char *path)
{
    struct timespec now, times[2];
    if (clock_gettime(CLOCK_REALTIME, &now) != 0)
        return;
    for (size_t i = 0; i < files->count; i++) {
        if (files->items[i].changed_s >= now.tv_sec)
            now = (struct timespec){.tv_sec = files->items[i].changed_s + 1};
    }
    times[0] = times[1] = now;
    if (utimensat(AT_FDCWD, path, times, AT_SYMLINK_NOFOLLOW) != 0)
        skd_log(SKD_LOG_WARNING, "%s may be forgotten early: %s", path, strerror(errno));
}

/* Removes the oldest, up to so many. */
static void forget(const char *folder, const struct skd_state_files *files, size_t most)
{
    char path[SKD_STATE_PATH_BYTES];
    struct skd_error error;
    for (size_t i = most; i < files->count; i++) {
        if (skd_state_path(folder, SKD_STATE_CLOSED, files->items[i].name, path, &error) == SKD_OK)
            skd_state_remove(path);
    }
}

static void list_closed(const char *folder, struct skd_state_files *files)
{
    struct skd_error error;
    if (skd_state_list(folder, SKD_STATE_CLOSED, files, &error) != SKD_OK)
        skd_log(SKD_LOG_WARNING, "%s", error.text);
}

void skd_state_closed(const char *folder, const char *file)
{
    struct skd_state_files files;
    char path[SKD_STATE_PATH_BYTES];
    struct skd_error error;
    list_closed(folder, &files);
    if (skd_state_path(folder, SKD_STATE_CLOSED, file, path, &error) == SKD_OK &&
        access(path, F_OK) == 0)
        make_newest(&files, path);
    free(files.items);
    list_closed(folder, &files);
    forget(folder, &files, SKD_CLOSED_FILES_MAX);
    free(files.items);
}

static bool is_same(const struct stat *one, const struct stat *other)
{
    return one->st_dev == other->st_dev && one->st_ino == other->st_ino;
}

bool skd_state_has(const char *folder, const char *path)
{
    char parent[SKD_PATH_BYTES_MAX], part[SKD_STATE_PATH_BYTES];
    struct stat theirs, ours;
    struct skd_error error;
    (void)snprintf(parent, sizeof parent, "%.*s/", (int)(strrchr(path, '/') - path), path);
    if (stat(parent, &theirs) != 0)
        return false;
    for (int i = SKD_STATE_OPEN; i <= SKD_STATE_DAMAGED; i++) {
        if (skd_state_path(folder, (enum skd_state_part)i, "", part, &error) == SKD_OK &&
            stat(part, &ours) == 0 && is_same(&theirs, &ours))
            return true;
    }
    return false;
}
