/* See child.h. */
#include "import/child.h"

#include "import/answer.h"
#include "rig/gltf.h"
#include "rig/gltf_document.h"
#include "rig/rig_image.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

enum { FILES_MAX = 128 }; /* a .gltf with as many buffers as it may have, and what is open anyway */

/* What the program itself takes of the address space, before it has read anything. */
#define OWN_BYTES ((rlim_t)256 << 20)

static bool was_asked;

bool skd_import_was_asked(void)
{
    return was_asked;
}

bool skd_import_is_child(int argc, const char *const *argv)
{
    was_asked = true;
    return argc == 4 && strcmp(argv[0], SKD_IMPORT_NAME) == 0;
}

/* A limit that was lower already stays. */
static void lower(int resource, rlim_t soft, rlim_t hard)
{
    struct rlimit limit;
    if (getrlimit((__rlimit_resource_t)resource, &limit) != 0)
        return;
    limit.rlim_max = limit.rlim_max < hard ? limit.rlim_max : hard; /* no limit is the largest */
    limit.rlim_cur = limit.rlim_cur < soft ? limit.rlim_cur : soft;
    (void)setrlimit((__rlimit_resource_t)resource, &limit);
}

static void lower_limits(rlim_t memory, rlim_t seconds)
{
    lower(RLIMIT_CORE, 0, 0);
    lower(RLIMIT_CPU, seconds, seconds + 1); /* SIGXCPU first, which says what it was */
    lower(RLIMIT_FSIZE, memory, memory);
    lower(RLIMIT_NOFILE, FILES_MAX, FILES_MAX);
    lower(RLIMIT_NPROC, 0, 0);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    lower(RLIMIT_AS, memory + OWN_BYTES, memory + OWN_BYTES); /* sanitizers reserve terabytes */
#endif
    (void)signal(SIGXFSZ, SIG_IGN); /* an image beyond FSIZE is a write that fails */
    (void)prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
    (void)prctl(PR_SET_NAME, SKD_IMPORT_NAME, 0, 0, 0);
}

static bool write_all(int fd, const void *bytes, size_t count)
{
    const char *from = bytes;
    while (count > 0) {
        const ssize_t put = write(fd, from, count);
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            return false;
        from += put;
        count -= (size_t)put;
    }
    return true;
}

static bool write_image(void *user, const void *bytes, size_t count)
{
    return write_all(*(const int *)user, bytes, count);
}

/* Fills the answer; the image is written on the way. */
static void import(const char *path, struct skd_import_answer *answer)
{
    int fd = SKD_IMPORT_FD;
    const struct skd_image_sink sink = {write_image, &fd};
    struct skd_rig *rig = NULL;
    struct skd_influences influences;
    struct skd_error error = {.status = SKD_OK};
    enum skd_status status = skd_gltf_parse(path, &rig, &influences, &error);
    if (status == SKD_OK) {
        answer->image_bytes = skd_rig_image_bytes(rig, &influences);
        if (lseek(fd, sizeof *answer, SEEK_SET) < 0 ||
            !skd_rig_image_write(rig, &influences, &sink))
            status = skd_fail(&error, SKD_NO_MEMORY, "what was read cannot be handed over: %s",
                              strerror(errno));
    }
    answer->status = (uint32_t)status;
    memcpy(answer->text, error.text, sizeof answer->text);
    /* The rig is not freed: the process ends. */
}

_Noreturn static void end(struct skd_import_answer *answer)
{
    answer->magic = SKD_IMPORT_MAGIC;
    const ssize_t put = pwrite(SKD_IMPORT_FD, answer, sizeof *answer, 0);
    _exit(put == sizeof *answer ? EXIT_SUCCESS : EXIT_FAILURE);
}

_Noreturn static void end_without_memory(void)
{
    static struct skd_import_answer answer = {.status = SKD_NO_MEMORY};
    end(&answer);
}

_Noreturn void skd_import_child(int argc, const char *const *argv)
{
    static struct skd_import_answer answer;
    SKD_ASSERT(argc == 4);
    lower_limits(strtoull(argv[2], NULL, 10), strtoull(argv[3], NULL, 10));
    skd_gltf_on_no_memory(end_without_memory);
    import(argv[1], &answer);
    end(&answer);
}
