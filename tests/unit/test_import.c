/* Imports whose process crashes, hangs, runs away, lies or is not there: one error each, and the
 * loop goes on. This program is started again as the process, as skind is; what the file is called
 * says what it then does. */
#include "clients/cli/generate/generate.h"
#include "import/answer.h"
#include "import/child.h"
#include "import/import.h"
#include "rig/gltf.h"
#include "rig/gltf_source.h"
#include "rig/rig_image.h"

#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#define MIB ((size_t)1 << 20)

static uv_loop_t loop;
static char sample[] = "/tmp/skind-test-import-XXXXXX.glb";

/* ----------------------------------------------------------------------------- the processes */

static void answer(enum skd_status status, uint64_t image_bytes, const char *text)
{
    struct skd_import_answer answer = {
        .magic = SKD_IMPORT_MAGIC, .status = (uint32_t)status, .image_bytes = image_bytes};
    (void)snprintf(answer.text, sizeof answer.text, "%s", text);
    if (pwrite(SKD_IMPORT_FD, &answer, sizeof answer, 0) != sizeof answer)
        _exit(9);
}

static bool append(void *user, const void *bytes, size_t count)
{
    return write(*(int *)user, bytes, count) == (ssize_t)count;
}

/* A good image, but of a file with another name. */
static void answer_with_other_file(void)
{
    struct skd_rig *rig;
    struct skd_influences influences;
    int fd = SKD_IMPORT_FD;
    const struct skd_image_sink sink = {append, &fd};
    if (skd_gltf_parse(getenv("SKIND_TEST_SAMPLE"), &rig, &influences, NULL) != SKD_OK)
        _exit(8);
    (void)lseek(fd, sizeof(struct skd_import_answer), SEEK_SET);
    if (!skd_rig_image_write(rig, &influences, &sink))
        _exit(7);
    answer(SKD_OK, skd_rig_image_bytes(rig, &influences), "");
}

/* Descriptors that should not be there. */
static void answer_what_is_open(void)
{
    char text[64];
    int count = 0;
    for (int fd = SKD_IMPORT_FD + 1; fd < 1024; fd++)
        count += fcntl(fd, F_GETFD) >= 0;
    (void)snprintf(text, sizeof text, "%d open, group %s, %d pending", count,
                   getpgrp() == getpid() ? "own" : "shared",
                   (int)(signal(SIGTERM, SIG_DFL) == SIG_IGN));
    answer(SKD_UNSUPPORTED, 0, text);
}

/* Does what the file's name says; returns where it is none of these. */
static void misbehave(const char *name)
{
    static const char garbage[1 << 16];
    if (strcmp(name, "crash") == 0) {
        (void)signal(SIGSEGV, SIG_DFL); /* a sanitizer would catch it */
        (void)raise(SIGSEGV);
    }
    if (strcmp(name, "abort") == 0)
        abort();
    if (strcmp(name, "killed") == 0)
        (void)raise(SIGKILL);
    if (strcmp(name, "quit") == 0)
        _exit(0);
    if (strcmp(name, "hang") == 0)
        for (;;)
            pause();
    if (strcmp(name, "answer and hang") == 0) {
        answer(SKD_BAD_RIG, 0, "never heard");
        for (;;)
            pause();
    }
    if (strcmp(name, "lie about bytes") == 0)
        answer(SKD_OK, SIZE_MAX - 511, "");
    if (strcmp(name, "garbage") == 0) {
        if (pwrite(SKD_IMPORT_FD, garbage, sizeof garbage, 512) != sizeof garbage)
            _exit(6);
        answer(SKD_OK, sizeof garbage, "");
    }
    if (strcmp(name, "lie about status") == 0)
        answer(SKD_SHUTTING_DOWN, 0, "no file gives this");
    if (strcmp(name, "endless text") == 0) {
        struct skd_import_answer all = {.magic = SKD_IMPORT_MAGIC, .status = SKD_BAD_RIG};
        memset(all.text, '\xFE', sizeof all.text);
        (void)pwrite(SKD_IMPORT_FD, &all, sizeof all, 0);
    }
    if (strcmp(name, "other file") == 0)
        answer_with_other_file();
    if (strcmp(name, "open") == 0)
        answer_what_is_open();
    if (strcmp(name, "keeps it mapped") == 0) {
        answer(SKD_OK, 1 << 12, "");
        (void)ftruncate(SKD_IMPORT_FD, 512 + (1 << 12));
        (void)mmap(NULL, 1 << 12, PROT_READ | PROT_WRITE, MAP_SHARED, SKD_IMPORT_FD, 0);
        if (fork() == 0) /* outlives the process, and could write while the daemon reads */
            sleep(1);
    }
    if (strncmp(name, "/", 1) != 0)
        _exit(5);
}

/* Spins; the limit is the one of a real process, shortened. */
static void run_away(const char *name)
{
    const struct rlimit limit = {1, 2};
    if (strcmp(name, "spin") == 0) {
        (void)setrlimit(RLIMIT_CPU, &limit);
        for (volatile unsigned i = 0;; i = i + 1)
            ;
    }
}

/* ----------------------------------------------------------------------------------- imports */

struct outcome {
    bool is_done;
    enum skd_status status;
    struct skd_error error;
};

static void on_done(void *user)
{
    ((struct outcome *)user)->is_done = true;
}

static struct skd_import *begin(struct skd_importer *importer, const char *path, unsigned seconds,
                                const atomic_bool *cancelled, struct outcome *outcome)
{
    const struct skd_import_wish wish = {path, 512 * MIB, seconds, cancelled, on_done, outcome};
    *outcome = (struct outcome){.status = SKD_OK};
    struct skd_import *import = skd_import_start(importer, &wish);
    assert_non_null(import);
    assert_false(outcome->is_done);
    return import;
}

/* One import to its end; what it says when its rig is asked for as well. */
static struct outcome run(const char *path, unsigned seconds)
{
    struct skd_importer importer = {.loop = &loop};
    const atomic_bool cancelled = false;
    struct outcome outcome;
    struct skd_import *import = begin(&importer, path, seconds, &cancelled, &outcome);
    uv_run(&loop, UV_RUN_DEFAULT);
    assert_true(outcome.is_done);
    assert_int_equal(importer.running, 0);
    outcome.status = skd_import_result(import, &outcome.error);
    if (outcome.status == SKD_OK) {
        struct skd_rig *rig;
        struct skd_influences influences;
        outcome.status = skd_import_read(import, &rig, &influences, &outcome.error);
        skd_rig_destroy(rig);
        skd_influences_finish(&influences);
    }
    skd_import_destroy(import);
    errno = 0;
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1); /* no process is left behind */
    assert_int_equal(errno, ECHILD);
    return outcome;
}

static void assert_refused(const char *path, enum skd_status status, const char *words)
{
    const struct outcome outcome = run(path, 20);
    assert_int_equal(outcome.status, status);
    if (strstr(outcome.error.text, words) == NULL)
        fail_msg("\"%s\" does not say \"%s\"", outcome.error.text, words);
}

static int descriptors(void)
{
    int count = 0;
    for (int fd = 0; fd < 1024; fd++)
        count += fcntl(fd, F_GETFD) >= 0;
    return count;
}

static void test_a_file_is_read(void **state)
{
    struct skd_importer importer = {.loop = &loop};
    const atomic_bool cancelled = false;
    struct outcome outcome;
    struct skd_error error;
    struct skd_rig *rig, *direct;
    struct skd_influences influences, direct_influences;
    (void)state;
    const int before = descriptors();
    struct skd_import *import = begin(&importer, sample, 20, &cancelled, &outcome);
    uv_run(&loop, UV_RUN_DEFAULT);
    if (skd_import_result(import, &error) != SKD_OK ||
        skd_import_read(import, &rig, &influences, &error) != SKD_OK ||
        skd_gltf_import(sample, &direct, &direct_influences, &error) != SKD_OK)
        fail_msg("%s", error.text);
    assert_int_equal(skd_import_bytes(import), skd_rig_image_bytes(direct, &direct_influences));
    assert_int_equal(rig->mesh.vertex_count, direct->mesh.vertex_count);
    assert_memory_equal(rig->mesh.neighbour_offsets, direct->mesh.neighbour_offsets,
                        (rig->mesh.vertex_count + 1) * sizeof(uint32_t));
    uint8_t *bytes;
    assert_int_equal(skd_gltf_file_read(&rig->source->main, &bytes, NULL), SKD_OK); /* open again */
    free(bytes);
    skd_import_destroy(import);
    skd_rig_destroy(rig);
    skd_rig_destroy(direct);
    skd_influences_finish(&influences);
    skd_influences_finish(&direct_influences);
    assert_int_equal(descriptors(), before);
}

static void test_refusals_are_the_files_own(void **state)
{
    (void)state;
    assert_refused("/nowhere/at/all.glb", SKD_NO_FILE, "/nowhere/at/all.glb");
    assert_refused("/tmp", SKD_NOT_GLTF, "is not a file");
    assert_refused("/dev/zero", SKD_NOT_GLTF, "is not a file");
}

static void test_crashes(void **state)
{
    (void)state;
    const int before = descriptors();
    assert_refused("quit", SKD_BAD_RIG, "without a result");
    assert_refused("crash", SKD_BAD_RIG, "crashed (Segmentation fault)");
    assert_refused("abort", SKD_BAD_RIG, "crashed (Aborted)");
    assert_refused("killed", SKD_TOO_LARGE, "out of memory");
    assert_int_equal(descriptors(), before);
}

static void test_lies(void **state)
{
    (void)state;
    const int before = descriptors();
    assert_refused("lie about bytes", SKD_BAD_RIG, "without a result");
    assert_refused("garbage", SKD_BAD_RIG, "damaged");
    assert_refused("lie about status", SKD_BAD_RIG, "no file gives this");
    assert_refused("endless text", SKD_BAD_RIG, "??");
    assert_refused("other file", SKD_BAD_RIG, "another file's character");
    assert_refused("keeps it mapped", SKD_BUSY, "cannot be taken over yet");
    assert_int_equal(descriptors(), before);
}

static void test_what_the_process_gets(void **state)
{
    (void)state;
    (void)signal(SIGTERM, SIG_IGN);
    assert_refused("open", SKD_UNSUPPORTED, "0 open, group own, 0 pending");
    (void)signal(SIGTERM, SIG_DFL);
}

static void test_clock(void **state)
{
    (void)state;
    const uint64_t start = uv_hrtime();
    struct outcome outcome = run("hang", 1);
    assert_int_equal(outcome.status, SKD_TOO_LARGE);
    assert_non_null(strstr(outcome.error.text, "more than 1 seconds"));
    outcome = run("answer and hang", 1); /* an answer counts when its process is gone */
    assert_int_equal(outcome.status, SKD_TOO_LARGE);
    assert_true(uv_hrtime() - start < (uint64_t)20 * 1000 * 1000 * 1000);
}

static void test_processor_time(void **state)
{
    (void)state;
    const struct outcome outcome = run("spin", 20);
    assert_int_equal(outcome.status, SKD_TOO_LARGE);
    assert_non_null(strstr(outcome.error.text, "to read"));
}

static void cancel_later(uv_timer_t *timer)
{
    atomic_store((atomic_bool *)timer->data, true);
    uv_close((uv_handle_t *)timer, NULL);
}

/* More imports than places: all are cancelled, those that run and those that wait. */
static void test_cancel(void **state)
{
    enum { IMPORTS = SKD_IMPORTS_MAX + 3 };
    struct skd_importer importer = {.loop = &loop};
    struct skd_import *imports[IMPORTS];
    struct outcome outcomes[IMPORTS];
    atomic_bool cancelled = false;
    uv_timer_t timer;
    (void)state;
    const int before = descriptors();
    const uint64_t start = uv_hrtime();
    for (int i = 0; i < IMPORTS; i++)
        imports[i] = begin(&importer, "hang", 60, &cancelled, &outcomes[i]);
    uv_timer_init(&loop, &timer);
    timer.data = &cancelled;
    uv_timer_start(&timer, cancel_later, 200, 0);
    uv_run(&loop, UV_RUN_DEFAULT);
    assert_true(uv_hrtime() - start < (uint64_t)20 * 1000 * 1000 * 1000);
    for (int i = 0; i < IMPORTS; i++) {
        struct skd_error error;
        assert_int_equal(skd_import_result(imports[i], &error), SKD_CANCELLED);
        skd_import_destroy(imports[i]);
    }
    assert_int_equal(importer.running, 0);
    assert_int_equal(descriptors(), before);
}

/* One that hangs in each place but one: others still get through there. */
static void test_others_go_on(void **state)
{
    struct skd_importer importer = {.loop = &loop};
    struct skd_import *hanging[SKD_IMPORTS_MAX - 1], *good[3];
    struct outcome hung[SKD_IMPORTS_MAX - 1], outcomes[3];
    atomic_bool stop = false;
    const atomic_bool never = false;
    (void)state;
    for (int i = 0; i < SKD_IMPORTS_MAX - 1; i++)
        hanging[i] = begin(&importer, "hang", 60, &stop, &hung[i]);
    for (int i = 0; i < 3; i++)
        good[i] = begin(&importer, sample, 60, &never, &outcomes[i]);
    while (!outcomes[0].is_done || !outcomes[1].is_done || !outcomes[2].is_done)
        uv_run(&loop, UV_RUN_ONCE);
    assert_false(hung[0].is_done);
    atomic_store(&stop, true);
    uv_run(&loop, UV_RUN_DEFAULT);
    for (int i = 0; i < 3; i++) {
        struct skd_error error;
        assert_int_equal(skd_import_result(good[i], &error), SKD_OK);
        skd_import_destroy(good[i]);
    }
    for (int i = 0; i < SKD_IMPORTS_MAX - 1; i++)
        skd_import_destroy(hanging[i]);
}

/* The same program, asked for less memory than the file needs. */
static void test_memory(void **state)
{
    struct skd_importer importer = {.loop = &loop};
    const atomic_bool cancelled = false;
    struct outcome outcome = {.is_done = false};
    struct skd_error error;
    const struct skd_import_wish wish = {sample, 4096, 20, &cancelled, on_done, &outcome};
    (void)state;
    struct skd_import *import = skd_import_start(&importer, &wish);
    uv_run(&loop, UV_RUN_DEFAULT);
    assert_int_equal(skd_import_result(import, &error), SKD_TOO_LARGE);
    assert_non_null(strstr(error.text, "more memory"));
    skd_import_destroy(import);
}

/* No descriptor is left for the memory file. */
static void test_no_descriptors(void **state)
{
    struct rlimit limit, none;
    (void)state;
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    none = limit;
    none.rlim_cur = 0;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    const struct outcome outcome = run(sample, 20);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
    assert_int_equal(outcome.status, SKD_FILE_IO);
    assert_int_equal(run(sample, 20).status, SKD_OK);
}

int main(int argc, const char **argv)
{
    if (skd_import_is_child(argc, argv)) {
        run_away(argv[1]);
        misbehave(argv[1]);
        skd_import_child(argc, argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_file_is_read),
        cmocka_unit_test(test_refusals_are_the_files_own),
        cmocka_unit_test(test_crashes),
        cmocka_unit_test(test_lies),
        cmocka_unit_test(test_what_the_process_gets),
        cmocka_unit_test(test_clock),
        cmocka_unit_test(test_processor_time),
        cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_others_go_on),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_no_descriptors),
    };
    const struct skd_generate_options options = {.vertex_count = 1000, .bone_count = 20};
    const int fd = mkstemps(sample, 4);
    if (fd < 0 || skd_generate_humanoid(&options, sample, NULL) != SKD_OK)
        return 1;
    close(fd);
    setenv("SKIND_TEST_SAMPLE", sample, 1);
    uv_loop_init(&loop);
    const int result = cmocka_run_group_tests(tests, NULL, NULL);
    (void)uv_loop_close(&loop);
    (void)unlink(sample);
    return result;
}
