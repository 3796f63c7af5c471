/* See damage.h. */
#include "journal/damage.h"

#include "journal/inspect.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { TRIES_MAX = 1000 }; /* names within the same second */

/* FOLDER/NAME-TIME.skind, or FOLDER/NAME-TIME-2.skind, ... */
static bool name_it(const char *path, const char *folder, int number, char out[SKD_PATH_BYTES_MAX])
{
    const char *slash = strrchr(path, '/'), *name = slash != NULL ? slash + 1 : path;
    const char *dot = strrchr(name, '.');
    char when[32], suffix[16] = "";
    time_t now = time(NULL);
    struct tm parts;
    (void)strftime(when, sizeof when, "%Y%m%dT%H%M%SZ", gmtime_r(&now, &parts));
    if (number > 1)
        (void)snprintf(suffix, sizeof suffix, "-%d", number);
    return snprintf(out, SKD_PATH_BYTES_MAX - 16, "%s/%.*s-%s%s.skind", folder,
                    (int)(dot != NULL ? (size_t)(dot - name) : strlen(name)), name, when,
                    suffix) < SKD_PATH_BYTES_MAX - 16;
}

static enum skd_status fail_io(const char *path, struct skd_error *error)
{
    return skd_fail(error, SKD_FILE_IO, "\"%s\" cannot be set aside: %s", path, strerror(errno));
}

enum skd_status skd_set_aside(const char *path, const char *folder, bool move,
                              struct skd_error *error)
{
    char log[SKD_PATH_BYTES_MAX], to[SKD_PATH_BYTES_MAX], log_to[SKD_PATH_BYTES_MAX];
    struct stat status;
    int number = 1;
    if (mkdir(folder, 0700) == 0)
        (void)chmod(folder, 0700); /* whatever the umask */
    else if (errno != EEXIST)
        return fail_io(folder, error);
    for (; number <= TRIES_MAX; number++) {
        if (!name_it(path, folder, number, to) || !skd_inspect_beside(to, "-wal", log_to) ||
            !skd_inspect_beside(path, "-wal", log))
            return skd_fail(error, SKD_TOO_LARGE, "the path \"%.100s...\" is too long", path);
        if (link(path, to) == 0)
            break;
        if (errno != EEXIST)
            return fail_io(path, error);
    }
    if (stat(log, &status) == 0 && link(log, log_to) != 0)
        return fail_io(log, error);
    if (move && unlink(path) != 0)
        return fail_io(path, error);
    if (move)
        (void)unlink(log);
    return SKD_OK;
}
