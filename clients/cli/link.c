/* See link.h. */
#include "clients/cli/link.h"

#include "base/paths.h"
#include "clients/cli/options.h"
#include "protocol/errors.h"

#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <unistd.h>

enum { HELLO_S = 60, HELLO_TELL_S = 2, PORT_MAX = 65535 };

static const char port_prefix[] = "tcp:";

static enum skd_status fail_ended(struct skd_link *link, const char *why, struct skd_error *error)
{
    link->has_ended = true;
    if (link->bye[0] != '\0')
        why = link->bye;
    return skd_fail(error, SKD_SHUTTING_DOWN, "the connection to skind ended: %s", why);
}

/* Sends all of the pieces. MSG_NOSIGNAL: a daemon that died is an error, not a signal. */
static enum skd_status send_pieces(struct skd_link *link, struct iovec *pieces, size_t count,
                                   struct skd_error *error)
{
    while (count > 0) {
        struct msghdr message = {.msg_iov = pieces, .msg_iovlen = count};
        ssize_t sent = sendmsg(link->fd, &message, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR)
            continue;
        if (sent < 0)
            return fail_ended(link, strerror(errno), error);
        size_t left = (size_t)sent;
        while (count > 0 && left >= pieces->iov_len) {
            left -= pieces->iov_len;
            pieces++;
            count--;
        }
        if (count > 0) {
            pieces->iov_base = (char *)pieces->iov_base + left;
            pieces->iov_len -= left;
        }
    }
    return SKD_OK;
}

/* sendmsg takes iovecs of non-const memory, which it does not write to. */
static struct iovec piece_of(const void *data, size_t bytes)
{
    return (struct iovec){(void *)(uintptr_t)data, bytes};
}

static enum skd_status send_encoded(struct skd_link *link, const struct skd_encoded *encoded,
                                    struct skd_error *error)
{
    struct iovec pieces[1 + 2 * SKD_ARRAYS_MAX];
    size_t count = 0;
    pieces[count++] = piece_of(encoded->head, encoded->head_bytes);
    for (int i = 0; i < encoded->piece_count; i++) {
        pieces[count++] = piece_of(encoded->pieces[i].data, encoded->pieces[i].bytes);
        pieces[count++] = piece_of(skd_zeros, encoded->pieces[i].padding);
    }
    return send_pieces(link, pieces, count, error);
}

/* read, told once when it takes long. While the link is patient each try takes HELLO_TELL_S. */
static ssize_t read_patiently(struct skd_link *link, void *space, size_t space_bytes)
{
    for (;;) {
        ssize_t got = read(link->fd, space, space_bytes);
        if (got >= 0 || (errno != EINTR && errno != EAGAIN))
            return got;
        if (errno == EINTR)
            continue;
        if (link->patience_s == HELLO_S)
            skd_cli_say("waiting for skind, which is busy, perhaps with reading its sessions ...");
        link->patience_s -= HELLO_TELL_S;
        if (link->patience_s <= 0) {
            errno = EAGAIN;
            return -1;
        }
    }
}

static enum skd_status read_more(struct skd_link *link, struct skd_error *error)
{
    unsigned char *space;
    size_t space_bytes;
    enum skd_status status = skd_reader_space(&link->reader, &space, &space_bytes, error);
    if (status != SKD_OK)
        return status;
    ssize_t got = read_patiently(link, space, space_bytes);
    if (got == 0)
        return fail_ended(link, "it closed it", error);
    if (got < 0 && errno == EAGAIN)
        return skd_fail(error, SKD_BUSY, "skind (or what listens there) does not answer");
    if (got < 0)
        return fail_ended(link, strerror(errno), error);
    return skd_reader_advance(&link->reader, (size_t)got, error);
}

static void remember_bye(struct skd_link *link, const struct skd_message *message)
{
    const cJSON *reason = cJSON_GetObjectItemCaseSensitive(message->params, "reason");
    (void)snprintf(link->bye, sizeof link->bye, "%s",
                   cJSON_IsString(reason) ? reason->valuestring : "it said goodbye");
}

enum skd_status skd_link_next(struct skd_link *link, struct skd_message *message,
                              struct skd_error *error)
{
    struct skd_frame frame;
    *message = (struct skd_message){0};
    while (!skd_reader_take(&link->reader, &frame)) {
        enum skd_status status = read_more(link, error);
        if (status != SKD_OK)
            return status;
    }
    enum skd_status status = skd_message_parse(&frame, message, error);
    if (status == SKD_OK && message->method != NULL && strcmp(message->method, "bye") == 0)
        remember_bye(link, message);
    return status;
}

/* The daemon's error as ours: its sentence, and its hint if both fit. */
static enum skd_status fail_as_told(const cJSON *told, struct skd_error *error)
{
    const cJSON *code = cJSON_GetObjectItemCaseSensitive(told, "code");
    const cJSON *message = cJSON_GetObjectItemCaseSensitive(told, "message");
    const cJSON *data = cJSON_GetObjectItemCaseSensitive(told, "data");
    const cJSON *hint = cJSON_GetObjectItemCaseSensitive(data, "hint");
    const char *sentence =
        cJSON_IsString(message) ? message->valuestring : "the request was refused without a reason";
    enum skd_status status = SKD_INTERNAL;
    if (cJSON_IsNumber(code))
        status = skd_error_entry_by_number(code->valueint)->status;
    if (cJSON_IsString(hint) && hint->valuestring[0] != '\0' &&
        strlen(sentence) + strlen(hint->valuestring) + 4 < SKD_ERROR_TEXT_BYTES)
        return skd_fail(error, status, "%s (%s)", sentence, hint->valuestring);
    return skd_fail(error, status, "%s", sentence);
}

enum skd_status skd_link_call(struct skd_link *link, const char *method, cJSON *body,
                              const struct skd_array_out *arrays, int array_count,
                              struct skd_message *answer, struct skd_error *error)
{
    struct skd_encoded encoded;
    int64_t id = ++link->last_id;
    *answer = (struct skd_message){0};
    enum skd_status status =
        skd_encode_request(SKD_WIRE_FRAMES, id, method, body, arrays, array_count, &encoded, error);
    if (status != SKD_OK)
        return status;
    status = send_encoded(link, &encoded, error);
    skd_encoded_finish(&encoded);
    /* A daemon that refuses us says why before it closes: read also when sending failed. */
    for (;;) {
        struct skd_error reading;
        enum skd_status got = skd_link_next(link, answer, &reading);
        if (got != SKD_OK) {
            if (status == SKD_OK || link->bye[0] != '\0')
                *error = reading;
            return error->status;
        }
        bool is_ours = answer->id.kind == SKD_ID_NUMBER && answer->id.number == id;
        if (answer->method == NULL && (is_ours || answer->error != NULL))
            break;
        if (answer->method != NULL && link->notify != NULL)
            link->notify(link->user, answer);
        skd_message_finish(answer);
    }
    return answer->error != NULL ? fail_as_told(answer->error, error) : SKD_OK;
}

bool skd_address_is_port(const char *address)
{
    return strncmp(address, port_prefix, sizeof port_prefix - 1) == 0;
}

bool skd_link_is_lost(const struct skd_link *link)
{
    return link->has_ended && link->bye[0] == '\0';
}

enum skd_status skd_token_read(const char *socket_path, char token[SKD_TOKEN_DIGITS + 1], int *port,
                               struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES + 16];
    (void)snprintf(path, sizeof path, "%s.token", socket_path);
    FILE *file = fopen(path, "re");
    if (file == NULL)
        return skd_fail(error, SKD_NO_FILE,
                        "cannot read the daemon's token in %s: %s (skinctl start --tcp PORT makes "
                        "it; one that is elsewhere goes into SKIND_TOKEN)",
                        path, strerror(errno));
    bool is_read = fscanf(file, "%64[0-9a-f] %d", token, port) == 2;
    fclose(file);
    if (is_read && strlen(token) == SKD_TOKEN_DIGITS)
        return SKD_OK;
    return skd_fail(error, SKD_BAD_TOKEN, "%s does not hold a token and a port", path);
}

/* The token for a port: said, or the user's own daemon's if it is the one that listens there. */
static enum skd_status find_token(int port, char token[SKD_TOKEN_DIGITS + 1],
                                  struct skd_error *error)
{
    char path[SKD_SOCKET_PATH_BYTES];
    const char *said = getenv("SKIND_TOKEN");
    int found;
    if (said != NULL && said[0] != '\0') {
        (void)snprintf(token, SKD_TOKEN_DIGITS + 1, "%s", said);
        return SKD_OK;
    }
    enum skd_status status = skd_socket_path("", path, error);
    if (status == SKD_OK)
        status = skd_token_read(path, token, &found, error);
    if (status == SKD_OK && found != port)
        status =
            skd_fail(error, SKD_BAD_TOKEN,
                     "the token in %s.token is for port %d; set SKIND_TOKEN to that of port %d",
                     path, found, port);
    return status;
}

/* Who asks: the tool by a name of this terminal, so that undo finds what was done here, and the
 * person. */
static void add_client(cJSON *body)
{
    char id[32], user[SKD_USER_BYTES_MAX + 1];
    const char *said = getenv("SKIND_CLIENT");
    const struct passwd *person = getpwuid(getuid());
    cJSON *client = cJSON_AddObjectToObject(body, "client");
    (void)snprintf(id, sizeof id, "skinctl-%ld", (long)getsid(0));
    cJSON_AddStringToObject(client, "name", "skinctl");
    cJSON_AddStringToObject(client, "version", SKIND_VERSION);
    cJSON_AddStringToObject(client, "id", said != NULL && said[0] != '\0' ? said : id);
    if (person != NULL) {
        (void)snprintf(user, sizeof user, "%s", person->pw_name);
        cJSON_AddStringToObject(client, "user", user);
    }
}

/* port: 0 for a socket, which asks for no token. */
static enum skd_status say_hello(struct skd_link *link, int port, struct skd_error *error)
{
    char token[SKD_TOKEN_DIGITS + 1];
    if (port != 0 && find_token(port, token, error) != SKD_OK)
        return error->status;
    struct skd_message answer;
    cJSON *body = cJSON_CreateObject();
    cJSON *protocol = cJSON_AddObjectToObject(body, "protocol");
    cJSON_AddNumberToObject(protocol, "min", SKD_PROTOCOL_MIN);
    cJSON_AddNumberToObject(protocol, "max", SKD_PROTOCOL_MAX);
    add_client(body);
    if (port != 0)
        cJSON_AddStringToObject(body, "token", token);
    enum skd_status status = skd_link_call(link, "hello", body, NULL, 0, &answer, error);
    if (status == SKD_OK) {
        const cJSON *server = cJSON_GetObjectItemCaseSensitive(answer.result, "server");
        const cJSON *pid = cJSON_GetObjectItemCaseSensitive(server, "pid");
        const cJSON *version = cJSON_GetObjectItemCaseSensitive(server, "version");
        link->pid = cJSON_IsNumber(pid) ? (long)pid->valuedouble : 0;
        (void)snprintf(link->version, sizeof link->version, "%s",
                       cJSON_IsString(version) ? version->valuestring : "?");
    }
    skd_message_finish(&answer);
    return status;
}

/* While it is patient, a read ends now and then without anything. */
static void be_patient(struct skd_link *link, int seconds)
{
    const struct timeval step = {.tv_sec = seconds > 0 ? HELLO_TELL_S : 0};
    link->patience_s = seconds;
    (void)setsockopt(link->fd, SOL_SOCKET, SO_RCVTIMEO, &step, sizeof step);
}

/* The port of an address, or 0 for a path. */
static enum skd_status read_port(const char *address, int *port, struct skd_error *error)
{
    *port = 0;
    if (!skd_address_is_port(address))
        return SKD_OK;
    char *end;
    long number = strtol(address + sizeof port_prefix - 1, &end, 10);
    if (*end != '\0' || number < 1 || number > PORT_MAX)
        return skd_fail(error, SKD_BAD_PARAMS, "\"%.40s\" is not tcp: and a port, 1 to %d", address,
                        PORT_MAX);
    *port = (int)number;
    return SKD_OK;
}

/* 0, or the error of connect. */
static int connect_to(int fd, const char *path, int port)
{
    struct sockaddr_un local = {.sun_family = AF_UNIX};
    const struct sockaddr_in near = {.sin_family = AF_INET,
                                     .sin_port = htons((uint16_t)port),
                                     .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    (void)snprintf(local.sun_path, sizeof local.sun_path, "%s", path);
    int result = port == 0 ? connect(fd, (const struct sockaddr *)&local, sizeof local)
                           : connect(fd, (const struct sockaddr *)&near, sizeof near);
    return result == 0 ? 0 : errno;
}

/* A socket in /tmp may be somebody else's, who made it before us. */
static enum skd_status check_owner(int fd, const char *path, struct skd_error *error)
{
    struct ucred owner;
    socklen_t bytes = sizeof owner;
    if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &owner, &bytes) != 0)
        return skd_fail(error, SKD_FILE_IO, "it cannot be seen whose %s is: %s", path,
                        strerror(errno));
    if (owner.uid != geteuid())
        return skd_fail(error, SKD_FILE_IO,
                        "%s is a socket of user %ld and not yours; choose another with "
                        "SKIND_SOCKET",
                        path, (long)owner.uid);
    return SKD_OK;
}

enum skd_link_state skd_link_open(struct skd_link *link, const char *address,
                                  struct skd_error *error)
{
    int port;
    *link = (struct skd_link){.fd = -1};
    skd_reader_init(&link->reader);
    if (read_port(address, &port, error) != SKD_OK)
        return SKD_LINK_FAILED;
    link->fd = socket(port == 0 ? AF_UNIX : AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (link->fd < 0) {
        (void)skd_fail(error, SKD_FILE_IO, "cannot make a socket: %s", strerror(errno));
        return SKD_LINK_FAILED;
    }
    int refused = connect_to(link->fd, address, port);
    if (refused != 0) {
        bool nobody = refused == ENOENT || refused == ECONNREFUSED || refused == ENOTDIR;
        (void)skd_fail(error, SKD_FILE_IO, "cannot connect to %s: %s", address, strerror(refused));
        skd_link_close(link);
        return nobody ? SKD_LINK_NOBODY : SKD_LINK_FAILED;
    }
    if (port == 0 && check_owner(link->fd, address, error) != SKD_OK) {
        skd_link_close(link);
        return SKD_LINK_FAILED;
    }
    be_patient(link, HELLO_S);
    enum skd_status status = say_hello(link, port, error);
    if (status == SKD_OK) {
        be_patient(link, 0);
        return SKD_LINK_UP;
    }
    skd_link_close(link);
    /* A daemon on its way out closes what it had not yet greeted. */
    return status == SKD_SHUTTING_DOWN ? SKD_LINK_NOBODY : SKD_LINK_FAILED;
}

void skd_link_close(struct skd_link *link)
{
    if (link->fd < 0)
        return;
    skd_reader_finish(&link->reader);
    close(link->fd);
    link->fd = -1;
}
