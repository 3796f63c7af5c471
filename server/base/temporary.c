/* See temporary.h. */
#include "base/temporary.h"

#include "base/error.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define PREFIX ".skind-"
#define SUFFIX ".tmp" /* behind which SQLite may have added its own */

char *skd_temporary_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    uint64_t number;
    ssize_t got = getrandom(&number, sizeof number, 0); /* eight bytes come whole or not at all */
    SKD_ASSERT(got == (ssize_t)sizeof number);
    char *name;
    if (asprintf(&name, "%.*s" PREFIX "%016llx" SUFFIX, slash == NULL ? 0 : (int)(slash - path) + 1,
                 path, (unsigned long long)number) < 0)
        return NULL;
    return name;
}

static bool is_left(int folder_fd, const char *name, int idle_s)
{
    struct stat info;
    return strncmp(name, PREFIX, sizeof PREFIX - 1) == 0 && strstr(name, SUFFIX) != NULL &&
           fstatat(folder_fd, name, &info, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(info.st_mode) &&
           (idle_s == 0 || time(NULL) - info.st_mtime >= idle_s);
}

void skd_temporary_sweep(int folder_fd, int idle_s)
{
    const struct dirent *entry;
    int fd = openat(folder_fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *entries = fd >= 0 ? fdopendir(fd) : NULL;
    if (entries == NULL) {
        if (fd >= 0)
            close(fd);
        return;
    }
    while ((entry = readdir(entries)) != NULL) {
        if (is_left(folder_fd, entry->d_name, idle_s))
            (void)unlinkat(folder_fd, entry->d_name, 0);
    }
    closedir(entries);
}
