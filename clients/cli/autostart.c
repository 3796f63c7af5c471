/* See autostart.h.
 *
 *     connect ──up──────────────────────────────────────────► done
 *        └─nobody─► lock ─► connect ─up──────────────────────► done (somebody else was faster)
 *                             └─nobody─► spawn ─► connect ... ► done
 *
 * The lock is only about who spawns. The daemon's own lock decides which daemon serves.
 */
#include "clients/cli/autostart.h"

#include "clients/cli/options.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum {
    PATIENCE_MS = 60000,
    TELL_MS = 2000,
    PAUSE_MS = 10,
    RESPAWN_MS = 200, /* before another try, when a daemon on its way out holds the lock */
    SKIND_EXIT_BUSY = 3,
    LOG_TAIL_BYTES = 300,
};

struct starting {
    struct skd_start *start;
    char folder[SKD_SOCKET_PATH_BYTES];
    char log[SKD_SOCKET_PATH_BYTES + 16];
    off_t log_begin; /* where this start's lines begin */
    int lock;
    pid_t child;   /* 0: none runs */
    long begun_ms; /* when we first looked */
    bool told;     /* that it takes long */
};

static long now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (long)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

static void pause_ms(long ms)
{
    const struct timespec pause = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000};
    nanosleep(&pause, NULL);
}

/* The program to run. */
static void find_daemon(char program[SKD_PATH_BYTES_MAX])
{
    const char *chosen = getenv("SKIND_BIN");
    ssize_t length = readlink("/proc/self/exe", program, SKD_PATH_BYTES_MAX - sizeof "skind");
    if (chosen != NULL && chosen[0] != '\0') {
        (void)snprintf(program, SKD_PATH_BYTES_MAX, "%s", chosen);
        return;
    }
    if (length > 0) {
        program[length] = '\0';
        strcpy(strrchr(program, '/') + 1, "skind");
        if (access(program, X_OK) == 0)
            return;
    }
    strcpy(program, "skind"); /* posix_spawnp looks on PATH */
}

static int make_file(const char *path)
{
    return open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
}

/* The folder, the lock and the log, for nobody but us. */
static enum skd_status make_files(struct starting *starting, struct skd_error *error)
{
    const char *path = starting->start->path;
    const char *slash = strrchr(path, '/');
    (void)snprintf(starting->folder, sizeof starting->folder, "%.*s",
                   slash > path ? (int)(slash - path) : 1, path);
    if (mkdir(starting->folder, 0700) != 0 && errno != EEXIST)
        return skd_fail(error, SKD_FILE_IO, "cannot make the socket's folder %s: %s",
                        starting->folder, strerror(errno));
    (void)snprintf(starting->log, sizeof starting->log, "%s/skind.log", starting->folder);
    char lock[SKD_SOCKET_PATH_BYTES + 16];
    (void)snprintf(lock, sizeof lock, "%s.start.lock", path);
    starting->lock = make_file(lock);
    if (starting->lock < 0)
        return skd_fail(error, SKD_FILE_IO, "cannot open the lock file %s: %s", lock,
                        strerror(errno));
    int log = make_file(starting->log);
    if (log < 0)
        return skd_fail(error, SKD_FILE_IO, "cannot open the daemon's log %s: %s", starting->log,
                        strerror(errno));
    close(log);
    return SKD_OK;
}

/* The caller's umask is the daemon's too, for what it exports. */
static enum skd_status prepare(struct starting *starting, struct skd_error *error)
{
    const mode_t before = umask(0077);
    enum skd_status status = make_files(starting, error);
    (void)umask(before);
    return status;
}

/* What the daemon is started with, and the numbers in it. */
struct arguments {
    const char *list[16];
    char workers[16], idle_exit[16], tcp_port[16];
};

static void list_arguments(const struct skd_start *start, struct arguments *arguments)
{
    const char **next = arguments->list;
    *arguments = (struct arguments){0};
    (void)snprintf(arguments->workers, sizeof arguments->workers, "%d", start->workers);
    (void)snprintf(arguments->idle_exit, sizeof arguments->idle_exit, "%d", start->idle_exit_s);
    (void)snprintf(arguments->tcp_port, sizeof arguments->tcp_port, "%d", start->tcp_port);
    const struct {
        const char *name, *value;
        bool is_given;
    } options[] = {
        {"--socket", start->path, true},
        {"--state", start->state, start->state != NULL},
        {"--tcp", arguments->tcp_port, start->tcp_port != SKD_NO_PORT},
        {"--workers", arguments->workers, start->workers > 0},
        {"--idle-exit", arguments->idle_exit, start->idle_exit_s > 0},
    };
    *next++ = "skind";
    for (size_t i = 0; i < sizeof options / sizeof *options; i++) {
        if (options[i].is_given) {
            *next++ = options[i].name;
            *next++ = options[i].value;
        }
    }
}

/* Detached: a session of its own, nothing of ours left open, at home in /. */
static enum skd_status spawn(struct starting *starting, struct skd_error *error)
{
    extern char **environ;
    char program[SKD_PATH_BYTES_MAX];
    struct arguments arguments;
    list_arguments(starting->start, &arguments);
    find_daemon(program);
    struct stat info;
    starting->log_begin = stat(starting->log, &info) == 0 ? info.st_size : 0;
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t nothing, everything;
    sigemptyset(&nothing);
    sigfillset(&everything);
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, 1, starting->log, O_WRONLY | O_APPEND | O_NOFOLLOW,
                                     0);
    posix_spawn_file_actions_adddup2(&actions, 1, 2);
    posix_spawn_file_actions_addclosefrom_np(&actions, 3);
    if (strchr(program, '/') == NULL || program[0] == '/')
        posix_spawn_file_actions_addchdir_np(&actions, "/");
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    posix_spawnattr_setsigmask(&attributes, &nothing);
    posix_spawnattr_setsigdefault(&attributes, &everything);
    int result = posix_spawnp(&starting->child, program, &actions, &attributes,
                              (char *const *)(uintptr_t)arguments.list, environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    if (result == 0)
        return SKD_OK;
    starting->child = 0;
    return skd_fail(error, SKD_FILE_IO,
                    "cannot run %s: %s (install it, or set SKIND_BIN to the program; its log is "
                    "%s)",
                    program, strerror(result), starting->log);
}

/* The last lines that this start wrote into the log, on one line. */
static void read_log_tail(const struct starting *starting, char tail[LOG_TAIL_BYTES])
{
    FILE *log = fopen(starting->log, "re");
    size_t got = 0;
    tail[0] = '\0';
    if (log == NULL)
        return;
    long end = fseek(log, 0, SEEK_END) == 0 ? ftell(log) : 0;
    long begin = end - (LOG_TAIL_BYTES - 1);
    if (begin < (long)starting->log_begin)
        begin = (long)starting->log_begin;
    if (fseek(log, begin, SEEK_SET) == 0)
        got = fread(tail, 1, LOG_TAIL_BYTES - 1, log);
    fclose(log);
    while (got > 0 && tail[got - 1] == '\n')
        got--;
    tail[got] = '\0';
    for (char *newline = tail; (newline = strchr(newline, '\n')) != NULL;)
        *newline = ';';
}

static enum skd_status fail_with_log(const struct starting *starting, const char *what,
                                     struct skd_error *error)
{
    char tail[LOG_TAIL_BYTES];
    read_log_tail(starting, tail);
    return skd_fail(error, SKD_FILE_IO, "%s: %s", what, tail[0] != '\0' ? tail : "it said nothing");
}

/* Looks after the child. False when it died for good; *busy when another daemon has the socket. */
static bool child_lives(struct starting *starting, bool *busy)
{
    int state;
    *busy = false;
    if (starting->child == 0 || waitpid(starting->child, &state, WNOHANG) != starting->child)
        return true;
    starting->child = 0;
    *busy = WIFEXITED(state) && WEXITSTATUS(state) == SKIND_EXIT_BUSY;
    return *busy;
}

/* A short while before the next try. False when there were enough of them. */
static bool wait_on(struct starting *starting)
{
    long waited = now_ms() - starting->begun_ms;
    if (waited >= TELL_MS && !starting->told) {
        skd_cli_say("waiting for skind to start ...");
        starting->told = true;
    }
    pause_ms(PAUSE_MS);
    return waited < PATIENCE_MS;
}

/* With the start lock held: spawns, and connects as soon as hello is answered. */
static enum skd_status spawn_and_wait(struct starting *starting, struct skd_link *link,
                                      struct skd_error *error)
{
    long next_spawn = 0;
    do {
        bool busy;
        switch (skd_link_open(link, starting->start->path, error)) {
        case SKD_LINK_UP:
            starting->start->started = starting->child != 0;
            return SKD_OK;
        case SKD_LINK_FAILED:
            return error->status;
        case SKD_LINK_NOBODY:
            break;
        }
        if (!child_lives(starting, &busy))
            return fail_with_log(starting, "skind could not start", error);
        if (busy)
            next_spawn = now_ms() + RESPAWN_MS;
        if (starting->child == 0 && now_ms() >= next_spawn) {
            enum skd_status status = spawn(starting, error);
            if (status != SKD_OK)
                return status;
        }
    } while (wait_on(starting));
    return fail_with_log(starting, "skind was started but does not answer within a minute", error);
}

enum skd_status skd_autostart(struct skd_link *link, struct skd_start *start,
                              struct skd_error *error)
{
    struct starting starting = {.start = start, .lock = -1, .begun_ms = now_ms()};
    enum skd_status status = SKD_OK;
    start->started = false;
    for (;;) {
        enum skd_link_state state = skd_link_open(link, start->path, error);
        if (state != SKD_LINK_NOBODY) {
            status = state == SKD_LINK_UP ? SKD_OK : error->status;
            break;
        }
        if (starting.lock < 0 && (status = prepare(&starting, error)) != SKD_OK)
            break;
        if (flock(starting.lock, LOCK_EX | LOCK_NB) == 0) {
            status = spawn_and_wait(&starting, link, error);
            break;
        }
        if (!wait_on(&starting)) {
            status = skd_fail(error, SKD_BUSY,
                              "another program has been starting skind for a minute; try again, "
                              "or look into %s",
                              starting.log);
            break;
        }
    }
    if (starting.lock >= 0)
        close(starting.lock);
    return status;
}
