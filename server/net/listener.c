/* See listener.h. */
#include "net/listener.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

enum { BACKLOG = 512 };

static enum skd_status check_folder(const char *path, struct skd_error *error)
{
    char folder[SKD_SOCKET_PATH_BYTES];
    struct stat info;
    const char *slash = strrchr(path, '/');
    int length = slash > path ? (int)(slash - path) : 1;
    (void)snprintf(folder, sizeof folder, "%.*s", length, path);
    const bool made = mkdir(folder, 0700) == 0;
    if (!made && errno != EEXIST)
        return skd_fail(error, SKD_FILE_IO, "cannot make the socket's folder %s: %s", folder,
                        strerror(errno));
    if (made && chmod(folder, 0700) != 0) /* the umask may have taken our own rights */
        return skd_fail(error, SKD_FILE_IO, "cannot set the mode of the socket's folder %s: %s",
                        folder, strerror(errno));
    if (lstat(folder, &info) != 0)
        return skd_fail(error, SKD_FILE_IO, "cannot look at the socket's folder %s: %s", folder,
                        strerror(errno));
    if (!S_ISDIR(info.st_mode))
        return skd_fail(error, SKD_FILE_IO, "the socket's folder %s is no folder (a symlink?)",
                        folder);
    if (info.st_uid != geteuid() || (info.st_mode & 077) != 0)
        return skd_fail(error, SKD_FILE_IO,
                        "the socket's folder %s must be yours and closed to others: it belongs to "
                        "user %ld and has mode %04o; chmod 700 it, or choose another with --socket",
                        folder, (long)info.st_uid, (unsigned)(info.st_mode & 07777));
    return SKD_OK;
}

static enum skd_status take_lock(struct skd_listener *listener, struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES + 8], pid[32] = "";
    (void)snprintf(path, sizeof path, "%s.lock", listener->path);
    listener->lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (listener->lock < 0)
        return skd_fail(error, SKD_FILE_IO, "cannot open the lock file %s: %s", path,
                        errno == ELOOP ? "it is a symlink; remove it" : strerror(errno));
    struct stat info;
    if (fstat(listener->lock, &info) != 0 || !S_ISREG(info.st_mode) || info.st_uid != geteuid() ||
        fchmod(listener->lock, 0600) != 0)
        return skd_fail(error, SKD_FILE_IO,
                        "the lock file %s must be a file of yours; remove it, or choose another "
                        "socket with --socket",
                        path);
    if (flock(listener->lock, LOCK_EX | LOCK_NB) != 0) {
        ssize_t got = read(listener->lock, pid, sizeof pid - 1);
        pid[got > 0 ? strcspn(pid, "\n") : 0] = '\0';
        close(listener->lock);
        listener->lock = -1;
        return skd_fail(error, SKD_BUSY, "another skind (pid %s) serves %s already",
                        pid[0] != '\0' ? pid : "unknown", listener->path);
    }
    int length = snprintf(pid, sizeof pid, "%ld\n", (long)getpid());
    if (ftruncate(listener->lock, 0) != 0 ||
        pwrite(listener->lock, pid, (size_t)length, 0) != length)
        return skd_fail(error, SKD_FILE_IO, "cannot write the lock file %s: %s", path,
                        strerror(errno));
    return SKD_OK;
}

/* A socket that is there belongs to a dead daemon: we hold the lock. Anything else stays. */
static enum skd_status remove_stale(const char *path, struct skd_error *error)
{
    struct stat info;
    if (lstat(path, &info) != 0)
        return errno == ENOENT
                   ? SKD_OK
                   : skd_fail(error, SKD_FILE_IO, "cannot look at %s: %s", path, strerror(errno));
    if (!S_ISSOCK(info.st_mode))
        return skd_fail(error, SKD_FILE_IO,
                        "%s is there and is no socket; remove it, or choose another with --socket",
                        path);
    if (unlink(path) != 0)
        return skd_fail(error, SKD_FILE_IO, "cannot remove the stale socket %s: %s", path,
                        strerror(errno));
    return SKD_OK;
}

enum skd_status skd_listener_open(struct skd_listener *listener, uv_loop_t *loop, const char *path,
                                  uv_connection_cb on_client, struct skd_error *error)
{
    enum skd_status status;
    listener->lock = -1;
    (void)snprintf(listener->path, sizeof listener->path, "%s", path);
    if ((status = check_folder(path, error)) != SKD_OK ||
        (status = take_lock(listener, error)) != SKD_OK ||
        (status = remove_stale(path, error)) != SKD_OK)
        goto fail;
    uv_pipe_init(loop, &listener->pipe, 0);
    mode_t before = umask(0177);
    int result = uv_pipe_bind(&listener->pipe, path);
    umask(before);
    if (result == 0 && chmod(path, 0600) != 0)
        result = uv_translate_sys_error(errno);
    if (result == 0)
        result = uv_listen((uv_stream_t *)&listener->pipe, BACKLOG, on_client);
    if (result == 0)
        return SKD_OK;
    status = skd_fail(error, SKD_FILE_IO, "cannot listen on %s: %s", path, uv_strerror(result));
    uv_close((uv_handle_t *)&listener->pipe, NULL);
fail:
    if (listener->lock >= 0)
        close(listener->lock);
    return status;
}

void skd_listener_close(struct skd_listener *listener)
{
    /* libuv removes the socket's name when it closes a pipe that it bound. */
    uv_close((uv_handle_t *)&listener->pipe, NULL);
    close(listener->lock);
    listener->lock = -1;
}
