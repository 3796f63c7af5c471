/* See tcp.h. */
#include "net/tcp.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

enum { BACKLOG = 512 };

static enum skd_status make_token(char token[SKD_TOKEN_DIGITS + 1], struct skd_error *error)
{
    unsigned char bytes[SKD_TOKEN_DIGITS / 2];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return skd_fail(error, SKD_FILE_IO, "no random bytes for a token: %s", strerror(errno));
    for (size_t i = 0; i < sizeof bytes; i++)
        (void)snprintf(token + 2 * i, 3, "%02x", bytes[i]);
    return SKD_OK;
}

/* What a dead daemon left behind is replaced; its name is never written through. */
static enum skd_status write_token(const struct skd_tcp *tcp, struct skd_error *error)
{
    const char *path = tcp->token_path;
    char text[SKD_TOKEN_DIGITS + 16];
    const int length = snprintf(text, sizeof text, "%s\n%d\n", tcp->token, tcp->port);
    if (unlink(path) != 0 && errno != ENOENT)
        return skd_fail(error, SKD_FILE_IO, "cannot replace the token file %s: %s", path,
                        strerror(errno));
    int file = open(path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (file >= 0 && fchmod(file, 0600) == 0 && write(file, text, (size_t)length) == length &&
        close(file) == 0)
        return SKD_OK;
    enum skd_status status =
        skd_fail(error, SKD_FILE_IO, "cannot write the token file %s: %s", path, strerror(errno));
    if (file >= 0) {
        (void)close(file);
        (void)unlink(path);
    }
    return status;
}

static enum skd_status listen_on(struct skd_tcp *tcp, int port, uv_connection_cb on_client,
                                 struct skd_error *error)
{
    struct sockaddr_in address;
    int length = sizeof address;
    int result = uv_ip4_addr("127.0.0.1", port, &address);
    if (result == 0)
        result = uv_tcp_bind(&tcp->handle, (const struct sockaddr *)&address, 0);
    if (result == 0)
        result = uv_listen((uv_stream_t *)&tcp->handle, BACKLOG, on_client);
    if (result == 0)
        result = uv_tcp_getsockname(&tcp->handle, (struct sockaddr *)&address, &length);
    if (result != 0)
        return skd_fail(error, SKD_FILE_IO, "cannot listen on port %d of 127.0.0.1: %s", port,
                        uv_strerror(result));
    tcp->port = ntohs(address.sin_port);
    return SKD_OK;
}

enum skd_status skd_tcp_open(struct skd_tcp *tcp, uv_loop_t *loop, int port,
                             const char *socket_path, uv_connection_cb on_client,
                             struct skd_error *error)
{
    (void)snprintf(tcp->token_path, sizeof tcp->token_path, "%s.token", socket_path);
    enum skd_status status = make_token(tcp->token, error);
    if (status != SKD_OK)
        return status;
    uv_tcp_init(loop, &tcp->handle);
    status = listen_on(tcp, port, on_client, error);
    if (status == SKD_OK)
        status = write_token(tcp, error);
    if (status != SKD_OK)
        uv_close((uv_handle_t *)&tcp->handle, NULL);
    return status;
}

void skd_tcp_close(struct skd_tcp *tcp)
{
    (void)unlink(tcp->token_path);
    uv_close((uv_handle_t *)&tcp->handle, NULL);
}

bool skd_token_matches(const char *token, const char *text)
{
    unsigned char differences = 0;
    if (text == NULL || strlen(text) != SKD_TOKEN_DIGITS)
        return false;
    for (int i = 0; i < SKD_TOKEN_DIGITS; i++)
        differences |= (unsigned char)(token[i] ^ text[i]);
    return differences == 0;
}
