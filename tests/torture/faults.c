/* A library for LD_PRELOAD that makes the n-th allocation, or the n-th change of a file, fail.
 *
 * What fails is said in a file that the test and the process share (SKIND_FAULTS names it), so that
 * the test can begin and end to count while the process runs. Memory: malloc, calloc, realloc and
 * their aligned kin, also those inside libraries. Files: write, pwrite, writev, fsync, fdatasync,
 * ftruncate, fallocate, rename, link, unlink, mkdir, and open for writing; sockets, pipes and
 * the log (descriptor 2) are left alone.
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum kind { MEMORY, FILES, KIND_COUNT };

/* faults.py writes the first five and reads the rest. */
struct control {
    _Atomic uint64_t kind;
    _Atomic uint64_t first;  /* the first one that fails, from 1; 0: count alone */
    _Atomic uint64_t count;  /* how many do */
    _Atomic uint64_t number; /* errno */
    _Atomic uint64_t armed;
    _Atomic uint64_t counted[KIND_COUNT]; /* while armed */
    _Atomic uint64_t failed;
};

static struct control *control;

__attribute__((constructor)) static void map_control(void)
{
    const char *path = getenv("SKIND_FAULTS");
    int file = path == NULL ? -1 : open(path, O_RDWR | O_CLOEXEC);
    if (file < 0)
        return;
    void *shared = mmap(NULL, sizeof *control, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (shared != MAP_FAILED)
        control = shared;
}

static bool fails(enum kind kind)
{
    if (control == NULL || atomic_load(&control->armed) == 0)
        return false;
    uint64_t number = atomic_fetch_add(&control->counted[kind], 1) + 1;
    uint64_t first = atomic_load(&control->first);
    if (first == 0 || (uint64_t)kind != atomic_load(&control->kind) || number < first ||
        number - first >= atomic_load(&control->count))
        return false;
    atomic_fetch_add(&control->failed, 1);
    errno = kind == MEMORY ? ENOMEM : (int)atomic_load(&control->number);
    return true;
}

/* ---- memory: glibc's own functions are behind these names ---- */

extern void *__libc_malloc(size_t bytes);
extern void *__libc_calloc(size_t count, size_t bytes);
extern void *__libc_realloc(void *memory, size_t bytes);
extern void *__libc_memalign(size_t alignment, size_t bytes);

void *malloc(size_t bytes)
{
    return fails(MEMORY) ? NULL : __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes)
{
    return fails(MEMORY) ? NULL : __libc_calloc(count, bytes);
}

void *realloc(void *memory, size_t bytes)
{
    return fails(MEMORY) ? NULL : __libc_realloc(memory, bytes);
}

void *aligned_alloc(size_t alignment, size_t bytes)
{
    return fails(MEMORY) ? NULL : __libc_memalign(alignment, bytes);
}

void *memalign(size_t alignment, size_t bytes)
{
    return fails(MEMORY) ? NULL : __libc_memalign(alignment, bytes);
}

int posix_memalign(void **memory, size_t alignment, size_t bytes)
{
    int before = errno;
    void *made = fails(MEMORY) ? NULL : __libc_memalign(alignment, bytes);
    errno = before;
    if (made == NULL)
        return ENOMEM;
    *memory = made;
    return 0;
}

/* ---- files ---- */

/* Calls the function that this one stands before. */
#define NEXT(name, ...)                                                                            \
    (((__typeof__(&name))dlsym(RTLD_NEXT, #name))(__VA_ARGS__)) /* NOLINT: POSIX allows it */

static bool is_file(int descriptor)
{
    struct stat info;
    return descriptor > 2 && fstat(descriptor, &info) == 0 && S_ISREG(info.st_mode);
}

static bool file_fails(int descriptor)
{
    int before = errno;
    bool counts = is_file(descriptor);
    errno = before;
    return counts && fails(FILES);
}

ssize_t write(int descriptor, const void *data, size_t bytes)
{
    return file_fails(descriptor) ? -1 : NEXT(write, descriptor, data, bytes);
}

ssize_t pwrite(int descriptor, const void *data, size_t bytes, off_t offset)
{
    return file_fails(descriptor) ? -1 : NEXT(pwrite, descriptor, data, bytes, offset);
}

ssize_t pwrite64(int descriptor, const void *data, size_t bytes, off64_t offset)
{
    return file_fails(descriptor) ? -1 : NEXT(pwrite64, descriptor, data, bytes, offset);
}

ssize_t writev(int descriptor, const struct iovec *pieces, int count)
{
    return file_fails(descriptor) ? -1 : NEXT(writev, descriptor, pieces, count);
}

int fsync(int descriptor)
{
    return fails(FILES) ? -1 : NEXT(fsync, descriptor);
}

int fdatasync(int descriptor)
{
    return fails(FILES) ? -1 : NEXT(fdatasync, descriptor);
}

int ftruncate(int descriptor, off_t bytes)
{
    return file_fails(descriptor) ? -1 : NEXT(ftruncate, descriptor, bytes);
}

int ftruncate64(int descriptor, off64_t bytes)
{
    return file_fails(descriptor) ? -1 : NEXT(ftruncate64, descriptor, bytes);
}

int fallocate64(int descriptor, int mode, off64_t offset, off64_t bytes)
{
    return file_fails(descriptor) ? -1 : NEXT(fallocate64, descriptor, mode, offset, bytes);
}

int rename(const char *from, const char *to)
{
    return fails(FILES) ? -1 : NEXT(rename, from, to);
}

int link(const char *from, const char *to)
{
    return fails(FILES) ? -1 : NEXT(link, from, to);
}

int unlink(const char *path)
{
    return fails(FILES) ? -1 : NEXT(unlink, path);
}

int mkdir(const char *path, mode_t mode)
{
    return fails(FILES) ? -1 : NEXT(mkdir, path, mode);
}

#define FOR_WRITING (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC)

static mode_t mode_of(int flags, va_list list)
{
    return (flags & O_CREAT) != 0 ? (mode_t)va_arg(list, unsigned) : 0;
}

/* The four names of open. */
#define OPEN(name, before, ...)                                                                    \
    {                                                                                              \
        va_list list;                                                                              \
        va_start(list, flags);                                                                     \
        mode_t mode = mode_of(flags, list);                                                        \
        va_end(list);                                                                              \
        if ((flags & FOR_WRITING) != 0 && fails(FILES))                                            \
            return -1;                                                                             \
        return ((int (*)(before, int, ...))dlsym(RTLD_NEXT, #name))(__VA_ARGS__, flags, mode);     \
    }
#define AT int, const char *

int open(const char *path, int flags, ...) OPEN(open, const char *, path)

    int open64(const char *path, int flags, ...) OPEN(open64, const char *, path)

        int openat(int folder, const char *path, int flags, ...) OPEN(openat, AT, folder, path)

            int openat64(int folder, const char *path, int flags, ...)
                OPEN(openat64, AT, folder, path)
