/* See link.h. */
#include "clients/cli/link.h"

#include "protocol/errors.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <unistd.h>

enum { HELLO_SECONDS = 10 };

static enum skd_status fail_ended(struct skd_link *link, const char *why, struct skd_error *error)
{
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

static enum skd_status read_more(struct skd_link *link, struct skd_error *error)
{
    unsigned char *space;
    size_t space_bytes;
    enum skd_status status = skd_reader_space(&link->reader, &space, &space_bytes, error);
    if (status != SKD_OK)
        return status;
    ssize_t got;
    do
        got = read(link->fd, space, space_bytes);
    while (got < 0 && errno == EINTR);
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

static enum skd_status say_hello(struct skd_link *link, struct skd_error *error)
{
    struct skd_message answer;
    cJSON *body = cJSON_CreateObject();
    cJSON *protocol = cJSON_AddObjectToObject(body, "protocol");
    cJSON_AddNumberToObject(protocol, "min", SKD_PROTOCOL_MIN);
    cJSON_AddNumberToObject(protocol, "max", SKD_PROTOCOL_MAX);
    cJSON *client = cJSON_AddObjectToObject(body, "client");
    cJSON_AddStringToObject(client, "name", "skinctl");
    cJSON_AddStringToObject(client, "version", SKIND_VERSION);
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

static void limit_reading(const struct skd_link *link, int seconds)
{
    const struct timeval limit = {.tv_sec = seconds};
    (void)setsockopt(link->fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
}

enum skd_link_state skd_link_open(struct skd_link *link, const char *path, struct skd_error *error)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    *link = (struct skd_link){.fd = -1};
    skd_reader_init(&link->reader);
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    link->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (link->fd < 0) {
        (void)skd_fail(error, SKD_FILE_IO, "cannot make a socket: %s", strerror(errno));
        return SKD_LINK_FAILED;
    }
    if (connect(link->fd, (const struct sockaddr *)&address, sizeof address) != 0) {
        bool nobody = errno == ENOENT || errno == ECONNREFUSED || errno == ENOTDIR;
        (void)skd_fail(error, SKD_FILE_IO, "cannot connect to %s: %s", path, strerror(errno));
        skd_link_close(link);
        return nobody ? SKD_LINK_NOBODY : SKD_LINK_FAILED;
    }
    limit_reading(link, HELLO_SECONDS);
    enum skd_status status = say_hello(link, error);
    if (status == SKD_OK) {
        limit_reading(link, 0);
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
