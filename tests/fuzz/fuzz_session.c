/* Fuzz target: whole conversations with a daemon (daemon.h), which runs on a thread of its own.
 *
 * Input: what clients send. "~~~~" ends a segment; segments go, in order, over three connections in
 * turn, so that inputs find what happens between clients too. Then all hang up, every answer is
 * read, and all sessions are deleted, so that each input begins with an empty daemon.
 *
 * Handlers that reach outside the daemon are wrapped (CMakeLists.txt: --wrap): a shutdown is
 * answered and not done, and files are those of a private folder.
 */
#include "fuzz.h"

#include "base/log.h"
#include "daemon.h"
#include "protocol/message.h"
#include "requests/handlers.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

enum { CONNECTIONS = 3, PATIENCE_MS = 20000, CHUNK = 1 << 16 };

static const char separator[] = "~~~~";
static char folder[] = "/tmp/skind-fuzz-XXXXXX";
static struct sockaddr_un address = {.sun_family = AF_UNIX};

/* ---- handlers that are kept from doing harm ---- */

void __real_skd_handle_shutdown(struct skd_call *call);
void __wrap_skd_handle_shutdown(struct skd_call *call);

void __wrap_skd_handle_shutdown(struct skd_call *call)
{
    skd_call_answer(call, cJSON_CreateObject());
}

/* A path of a file in our folder, or none. */
static bool is_ours(const char *path)
{
    size_t length = strlen(folder);
    return path == NULL || (strncmp(path, folder, length) == 0 && path[length] == '/' &&
                            strchr(path + length + 1, '/') == NULL);
}

static void refuse(struct skd_call *call)
{
    struct skd_error error;
    (void)skd_fail(&error, SKD_FILE_IO, "not in the fuzzer's folder");
    skd_call_fail(call, &error);
}

#define CONFINE(name, path)                                                                        \
    void __real_##name(struct skd_call *call);                                                     \
    void __wrap_##name(struct skd_call *call);                                                     \
    void __wrap_##name(struct skd_call *call)                                                      \
    {                                                                                              \
        if (is_ours(call->request.params.path))                                                    \
            __real_##name(call);                                                                   \
        else                                                                                       \
            refuse(call);                                                                          \
    }

CONFINE(skd_handle_session_create, session_create.file)
CONFINE(skd_handle_session_export, session.path)
CONFINE(skd_handle_session_save, session_keep.path)
CONFINE(skd_handle_session_open, session_keep.path)
CONFINE(skd_handle_session_verify, session_keep.path)

/* ---- the daemon ---- */

static void *serve(void *user)
{
    const struct skd_daemon_options options = {
        .socket_path = address.sun_path,
        .worker_count = 2,
        .stall_timeout_s = 30,
        .tcp_port = -1,
    };
    struct skd_error error;
    (void)user;
    enum skd_status status = skd_daemon_run(&options, &error);
    fprintf(stderr, "the daemon ended: %s\n", status == SKD_OK ? "clean" : error.text);
    abort();
}

static int connect_to_it(void)
{
    int descriptor = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    SKD_ASSERT(descriptor >= 0);
    for (int tries = 0; tries < 5000; tries++) {
        if (connect(descriptor, (const struct sockaddr *)&address, sizeof address) == 0)
            return descriptor;
        usleep(1000);
    }
    fputs("the daemon cannot be reached\n", stderr);
    abort();
}

/* All that it keeps goes with this folder. */
static void remove_folder(void)
{
    char command[sizeof folder + 16];
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    if (system(command) != 0)
        fprintf(stderr, "%s is left\n", folder);
}

static void start(void)
{
    pthread_t thread;
    char state[sizeof folder + 8];
    sigset_t clock; /* libFuzzer's would break off what waits; we have our own patience */
    sigemptyset(&clock);
    sigaddset(&clock, SIGALRM);
    SKD_ASSERT(pthread_sigmask(SIG_BLOCK, &clock, NULL) == 0);
    SKD_ASSERT(mkdtemp(folder) != NULL);
    atexit(remove_folder);
    skd_log_set_level(SKD_LOG_ERROR); /* inputs break off all the time */
    (void)snprintf(state, sizeof state, "%s/state", folder);
    SKD_ASSERT(setenv("XDG_STATE_HOME", state, 1) == 0);
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s/s", folder);
    SKD_ASSERT(pthread_create(&thread, NULL, serve, NULL) == 0);
    pthread_detach(thread);
}

/* ---- one input ---- */

struct guest {
    int descriptor;
    bool ended; /* the daemon sends no more */
};

/* Reads what is there; the daemon's bytes are its own affair. */
static void drain(struct guest *guest)
{
    char bytes[CHUNK];
    ssize_t got = recv(guest->descriptor, bytes, sizeof bytes, MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EAGAIN))
        guest->ended = true;
}

/* Waits until one of them can be read, or written if it is `sender`. Returns whether it can. */
static bool wait_for(struct guest guests[CONNECTIONS], int sender)
{
    struct pollfd polled[CONNECTIONS];
    for (int i = 0; i < CONNECTIONS; i++)
        polled[i] = (struct pollfd){guests[i].ended ? -1 : guests[i].descriptor,
                                    (short)(POLLIN | (i == sender ? POLLOUT : 0)), 0};
    int ready = poll(polled, CONNECTIONS, PATIENCE_MS);
    SKD_ASSERT(ready > 0); /* else an answer is missing */
    for (int i = 0; i < CONNECTIONS; i++) {
        if ((polled[i].revents & ~POLLOUT) != 0)
            drain(&guests[i]);
    }
    return sender >= 0 && (polled[sender].revents & POLLOUT) != 0;
}

static void send_segment(struct guest guests[CONNECTIONS], int sender, const uint8_t *data,
                         size_t size)
{
    while (size > 0 && !guests[sender].ended) {
        if (!wait_for(guests, sender))
            continue;
        ssize_t sent = send(guests[sender].descriptor, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0 && errno != EAGAIN)
            return; /* it hung up on us */
        data += sent > 0 ? sent : 0;
        size -= sent > 0 ? (size_t)sent : 0;
    }
}

/* A request in a line, and its answer (free it). Other messages are passed over. */
static char *ask(FILE *stream, const char *method, const char *params)
{
    char *line = NULL;
    size_t room = 0;
    fprintf(stream, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}\n", method,
            params);
    fflush(stream);
    do
        SKD_ASSERT(getline(&line, &room, stream) > 0);
    while (strstr(line, "\"id\":1,") == NULL);
    return line;
}

static const cJSON *find_list(const cJSON *answer, const char *name)
{
    const cJSON *result = cJSON_GetObjectItemCaseSensitive(answer, "result");
    return cJSON_GetObjectItemCaseSensitive(result, name);
}

/* Closes every session of a list; the daemon may still be loading one. Returns how many it had. */
static int end_sessions(FILE *stream, const char *list, const char *method)
{
    char *line = ask(stream, "session.list", "{}");
    cJSON *answer = cJSON_Parse(line);
    const cJSON *rows = find_list(answer, list), *row;
    int count = cJSON_GetArraySize(rows);
    cJSON_ArrayForEach(row, rows)
    {
        char params[256];
        const cJSON *name = cJSON_GetObjectItemCaseSensitive(row, "session");
        SKD_ASSERT(cJSON_IsString(name));
        (void)snprintf(params, sizeof params, "{\"session\":\"%s\"}", name->valuestring);
        free(ask(stream, method, params));
    }
    cJSON_Delete(answer);
    free(line);
    return count;
}

static void clean_up(void)
{
    const struct timeval patience = {.tv_sec = PATIENCE_MS / 1000};
    int descriptor = connect_to_it();
    FILE *stream = fdopen(descriptor, "r+");
    SKD_ASSERT(stream != NULL);
    SKD_ASSERT(setsockopt(descriptor, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) == 0);
    char *answer = ask(stream, "hello", "{\"protocol\":{\"min\":1,\"max\":1}}");
    bool keeps = strstr(answer, "\"session.save\"") != NULL;
    free(answer);
    while (end_sessions(stream, "sessions", keeps ? "session.delete" : "session.close") > 0)
        continue;
    while (keeps && end_sessions(stream, "closed", "session.delete") > 0)
        continue;
    fclose(stream);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static bool is_started;
    struct guest guests[CONNECTIONS];
    if (!is_started) {
        start();
        is_started = true;
    }
    for (int i = 0; i < CONNECTIONS; i++)
        guests[i] = (struct guest){connect_to_it(), false};
    for (int turn = 0; size > 0; turn = (turn + 1) % CONNECTIONS) {
        const uint8_t *end = memmem(data, size, separator, sizeof separator - 1);
        size_t count = end != NULL ? (size_t)(end - data) : size;
        send_segment(guests, turn, data, count);
        size_t used = end != NULL ? count + sizeof separator - 1 : count;
        data += used;
        size -= used;
    }
    for (int i = 0; i < CONNECTIONS; i++)
        shutdown(guests[i].descriptor, SHUT_WR);
    while (!guests[0].ended || !guests[1].ended || !guests[2].ended)
        (void)wait_for(guests, -1);
    for (int i = 0; i < CONNECTIONS; i++)
        close(guests[i].descriptor);
    clean_up();
    return 0;
}
