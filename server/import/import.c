/* See import.h. */
#include "import/import.h"

#include "import/answer.h"
#include "import/child.h"
#include "rig/gltf_source.h"
#include "rig/rig_image.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/pidfd.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

enum { LOOK_MS = 20 };

struct skd_import {
    struct skd_importer *importer;
    char *path;
    struct skd_import_wish wish; /* path is not used */
    uv_timer_t timer;            /* first: for a place; then for cancelling and the clock */
    uv_poll_t ending;            /* readable when the process has ended */
    int handles;                 /* of these two, not closed yet */
    int file;                    /* the memory file */
    pid_t process;               /* 0: none */
    int process_fd;
    uint64_t deadline_ms;
    bool was_cancelled, was_late;
    struct skd_error error; /* the result */
    size_t image_bytes;
    void *memory; /* the memory file, while the influences are in it */
};

static size_t memory_bytes(const struct skd_import *import)
{
    return sizeof(struct skd_import_answer) + import->image_bytes;
}

static void free_import(struct skd_import *import)
{
    if (import->memory != NULL)
        (void)munmap(import->memory, memory_bytes(import));
    if (import->file >= 0)
        close(import->file);
    free(import->path);
    free(import);
}

void skd_import_destroy(struct skd_import *import)
{
    if (import == NULL)
        return;
    SKD_ASSERT(import->handles == 0);
    free_import(import);
}

static void on_closed(uv_handle_t *handle)
{
    struct skd_import *import = handle->data;
    if (--import->handles > 0)
        return;
    if (import->process_fd >= 0)
        close(import->process_fd);
    import->process_fd = -1;
    import->wish.done(import->wish.user);
}

/* With import->error filled. */
static void finish(struct skd_import *import)
{
    uv_close((uv_handle_t *)&import->timer, on_closed);
    if (import->handles > 1)
        uv_close((uv_handle_t *)&import->ending, on_closed);
}

/* The words for an import that left no answer. */
static enum skd_status judge_end(const struct skd_import *import, int end, struct skd_error *error)
{
    const int number = WIFSIGNALED(end) ? WTERMSIG(end) : 0;
    if (import->was_cancelled)
        return skd_fail(error, SKD_CANCELLED, "loading \"%s\" was cancelled", import->path);
    if (import->was_late || number == SIGXCPU)
        return skd_fail(error, SKD_TOO_LARGE, "\"%s\" took more than %u seconds to read",
                        import->path, import->wish.seconds);
    if (number == SIGKILL)
        return skd_fail(error, SKD_TOO_LARGE,
                        "reading \"%s\" was ended by the system, which may be out of memory",
                        import->path);
    if (number != 0)
        return skd_fail(error, SKD_BAD_RIG,
                        "reading \"%s\" crashed (%s); the file is damaged, or skind has a bug",
                        import->path, strsignal(number));
    return skd_fail(error, SKD_BAD_RIG, "reading \"%s\" ended without a result", import->path);
}

/* The status of an error that the process tells; one that reading a file cannot have is a lie. */
static enum skd_status told_status(uint32_t status)
{
    switch ((enum skd_status)status) {
    case SKD_NO_FILE:
    case SKD_FILE_IO:
    case SKD_NOT_GLTF:
    case SKD_UNSUPPORTED:
    case SKD_TOO_LARGE:
    case SKD_SOURCE_CHANGED:
        return (enum skd_status)status;
    default:
        return SKD_BAD_RIG;
    }
}

/* From here on nobody can change the memory file: what is checked is what is used. That fails while
 * a process still has it mapped to write. */
static bool seal(const struct skd_import *import, size_t *bytes)
{
    struct stat status;
    if (fcntl(import->file, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE) != 0 ||
        fstat(import->file, &status) != 0)
        return false;
    *bytes = (size_t)status.st_size;
    return true;
}

static enum skd_status judge(struct skd_import *import, int end, struct skd_error *error)
{
    struct skd_import_answer answer;
    size_t bytes = 0;
    if (import->was_cancelled || import->was_late)
        return judge_end(import, end, error);
    if (!seal(import, &bytes))
        return skd_fail(error, SKD_BUSY,
                        "what was read of \"%s\" cannot be taken over yet: %s; load it again",
                        import->path, strerror(errno));
    if (pread(import->file, &answer, sizeof answer, 0) != sizeof answer ||
        answer.magic != SKD_IMPORT_MAGIC)
        return judge_end(import, end, error);
    answer.text[sizeof answer.text - 1] = '\0';
    if (answer.status == SKD_NO_MEMORY)
        return skd_fail(error, SKD_TOO_LARGE,
                        "\"%s\" needs more memory to be read than the %zu MiB that it may have",
                        import->path, import->wish.memory_bytes >> 20);
    if (answer.status != SKD_OK)
        return skd_fail(error, told_status(answer.status), "%s", answer.text);
    if (bytes - sizeof answer != answer.image_bytes)
        return judge_end(import, end, error);
    import->image_bytes = answer.image_bytes;
    return SKD_OK;
}

static void on_ended(uv_poll_t *poll, int status, int events)
{
    struct skd_import *import = poll->data;
    int end = 0;
    (void)status;
    (void)events;
    const pid_t ended = waitpid(import->process, &end, WNOHANG);
    if (ended == 0 || (ended < 0 && errno == EINTR))
        return;
    import->process = 0;
    import->importer->running--;
    import->error.status = judge(import, end, &import->error);
    finish(import);
}

/* Standard input and output lead nowhere, errors (of sanitizers, of the C library) to the daemon's
 * log; nothing else of the daemon's is open there. Returns an errno. */
static int spawn(struct skd_import *import)
{
    char memory[24], seconds[16];
    (void)snprintf(memory, sizeof memory, "%zu", import->wish.memory_bytes);
    (void)snprintf(seconds, sizeof seconds, "%u", import->wish.seconds);
    char *arguments[] = {(char[]){SKD_IMPORT_NAME}, import->path, memory, seconds, NULL};
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    (void)sigemptyset(&none);
    (void)sigfillset(&all);
    if (posix_spawn_file_actions_init(&files) != 0)
        return ENOMEM;
    if (posix_spawnattr_init(&attributes) != 0) {
        posix_spawn_file_actions_destroy(&files);
        return ENOMEM;
    }
    int result = posix_spawn_file_actions_adddup2(&files, import->file, SKD_IMPORT_FD);
    if (result == 0)
        result = posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
    if (result == 0)
        result = posix_spawn_file_actions_addopen(&files, 1, "/dev/null", O_WRONLY, 0);
    if (result == 0)
        result = posix_spawn_file_actions_addclosefrom_np(&files, SKD_IMPORT_FD + 1);
    /* A group of its own: the terminal's interrupt is for the daemon, which kills it then. */
    (void)posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK |
                                                    POSIX_SPAWN_SETPGROUP);
    (void)posix_spawnattr_setsigdefault(&attributes, &all);
    (void)posix_spawnattr_setsigmask(&attributes, &none);
    if (result == 0)
        result = posix_spawn(&import->process, "/proc/self/exe", &files, &attributes, arguments,
                             environ);
    if (result != 0)
        import->process = 0;
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&files);
    return result;
}

/* Ends a process that was just started and cannot be watched. */
static void abandon(struct skd_import *import)
{
    if (import->process == 0)
        return;
    (void)kill(import->process, SIGKILL);
    while (waitpid(import->process, NULL, 0) < 0 && errno == EINTR)
        ;
    import->process = 0;
}

static int begin(struct skd_import *import)
{
    if (!skd_import_was_asked())
        return ENOSYS; /* another main, which would not know what it is started for */
    import->file = memfd_create(SKD_IMPORT_NAME, MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (import->file < 0)
        return errno;
    int result = spawn(import);
    if (result == 0) {
        import->process_fd = pidfd_open(import->process, 0);
        result = import->process_fd < 0 ? errno : 0;
    }
    if (result == 0)
        result = -uv_poll_init(import->importer->loop, &import->ending, import->process_fd);
    if (result != 0) {
        abandon(import);
        return result;
    }
    import->ending.data = import;
    import->handles++;
    uv_poll_start(&import->ending, UV_READABLE, on_ended);
    import->importer->running++;
    import->deadline_ms = uv_now(import->importer->loop) + import->wish.seconds * (uint64_t)1000;
    return 0;
}

static void on_look(uv_timer_t *timer)
{
    struct skd_import *import = timer->data;
    import->was_cancelled = import->was_cancelled || atomic_load(import->wish.cancelled);
    if (import->process != 0) {
        import->was_late =
            import->was_late || uv_now(import->importer->loop) >= import->deadline_ms;
        if (import->was_cancelled || import->was_late)
            (void)kill(import->process, SIGKILL);
        return; /* on_ended is next */
    }
    if (import->was_cancelled) {
        import->error.status = judge_end(import, 0, &import->error);
        finish(import);
        return;
    }
    if (import->importer->running == SKD_IMPORTS_MAX)
        return;
    const int result = begin(import);
    if (result != 0) {
        import->error.status =
            skd_fail(&import->error, SKD_FILE_IO, "no process can be started to read \"%s\": %s",
                     import->path, strerror(result));
        finish(import);
    }
}

struct skd_import *skd_import_start(struct skd_importer *importer,
                                    const struct skd_import_wish *wish)
{
    struct skd_import *import = calloc(1, sizeof *import);
    if (import == NULL)
        return NULL;
    import->importer = importer;
    import->wish = *wish;
    import->file = import->process_fd = -1;
    import->path = strdup(wish->path);
    if (import->path == NULL) {
        free_import(import);
        return NULL;
    }
    uv_timer_init(importer->loop, &import->timer);
    import->timer.data = import;
    import->handles = 1;
    uv_timer_start(&import->timer, on_look, 0, LOOK_MS);
    return import;
}

enum skd_status skd_import_result(const struct skd_import *import, struct skd_error *error)
{
    if (import->error.status != SKD_OK)
        *error = import->error;
    return import->error.status;
}

size_t skd_import_bytes(const struct skd_import *import)
{
    return import->image_bytes;
}

/* The process may say nothing about other files than the one that it was given. */
static enum skd_status open_source(const struct skd_import *import, struct skd_rig *rig,
                                   struct skd_error *error)
{
    if (rig->source == NULL || strcmp(rig->source->path, import->path) != 0)
        return skd_fail(error, SKD_BAD_RIG, "reading \"%s\" gave another file's character",
                        import->path);
    return skd_gltf_source_reopen(rig->source, error);
}

enum skd_status skd_import_read(struct skd_import *import, struct skd_rig **rig,
                                struct skd_influences *influences, struct skd_error *error)
{
    SKD_ASSERT(import->memory == NULL);
    *rig = NULL;
    *influences = (struct skd_influences){0};
    /* Private: kernels before 6.7 let nobody share what is sealed. Nothing is copied by that. */
    void *memory =
        mmap(NULL, memory_bytes(import), PROT_READ, MAP_PRIVATE | MAP_POPULATE, import->file, 0);
    if (memory == MAP_FAILED)
        return skd_fail_memory(error, "what was read from a file");
    import->memory = memory;
    enum skd_status status =
        skd_rig_image_read((const char *)memory + sizeof(struct skd_import_answer),
                           import->image_bytes, rig, influences, error);
    if (status == SKD_OK)
        status = open_source(import, *rig, error);
    if (status != SKD_OK) {
        skd_rig_destroy(*rig);
        *rig = NULL;
        skd_influences_finish(influences);
    }
    return status;
}
