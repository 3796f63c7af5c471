/* What the tests of requests share: decoding of JSON, and what is refused with which words.
 * Header only; each test program includes it once. */
#ifndef SKD_TESTS_REQUEST_HELPERS_H
#define SKD_TESTS_REQUEST_HELPERS_H

#include "protocol/request.h"
#include "protocol_helpers.h"

#include <stdio.h>

/* Decodes a request for `method`; `members` go behind the params ("" or ",\"buffers\":..."). */
static inline enum skd_status decode_with(struct skd_request *request, struct skd_error *error,
                                          const char *method, const char *params,
                                          const char *members, const void *tail, size_t tail_bytes)
{
    const char *id = strcmp(method, "cancel") == 0 ? "" : "\"id\":7,";
    size_t bytes = strlen(params) + strlen(members) + strlen(method) + 80;
    char *json = malloc(bytes);
    assert_non_null(json);
    (void)snprintf(json, bytes, "{\"jsonrpc\":\"2.0\",%s\"method\":\"%s\",\"params\":%s%s}", id,
                   method, params, members);
    struct skd_frame frame = frame_of(json, strlen(json), tail, tail_bytes);
    free(json);
    *error = (struct skd_error){0};
    return skd_request_decode(&frame, request, error);
}

static inline enum skd_status decode(struct skd_request *request, const char *method,
                                     const char *params)
{
    struct skd_error error;
    enum skd_status status = decode_with(request, &error, method, params, "", NULL, 0);
    if (status != SKD_OK)
        print_message("%s\n", error.text);
    return status;
}

/* Params that are refused, with which code, and words that the sentence must hold. */
struct refusal {
    const char *method;
    const char *params;
    enum skd_status status;
    const char *words;
};

static inline void check_refused(const struct refusal *refused, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        struct skd_request request;
        struct skd_error error;
        enum skd_status status =
            decode_with(&request, &error, refused[i].method, refused[i].params, "", NULL, 0);
        if (status != refused[i].status || strstr(error.text, refused[i].words) == NULL)
            fail_msg("%s %s: status %d, \"%s\"", refused[i].method, refused[i].params, status,
                     error.text);
        if (strcmp(refused[i].method, "cancel") != 0)
            assert_true(request.message.id.kind == SKD_ID_NUMBER && request.message.id.number == 7);
        skd_request_finish(&request);
    }
}

/* A string that begins with `first`, one byte below, at and above its limit. */
static inline void check_text_limit(const char *method, const char *before, char first,
                                    const char *after, size_t most)
{
    for (size_t bytes = most - 1; bytes <= most + 1; bytes++) {
        struct skd_request request;
        struct skd_error error;
        char text[SKD_PATH_BYTES_MAX + 2];
        char params[SKD_PATH_BYTES_MAX + 128];
        memset(text, 'a', bytes);
        text[0] = first;
        text[bytes] = '\0';
        (void)snprintf(params, sizeof params, "{%s\"%s\"%s}", before, text, after);
        assert_int_equal(decode_with(&request, &error, method, params, "", NULL, 0),
                         bytes <= most ? SKD_OK : SKD_BAD_PARAMS);
        skd_request_finish(&request);
    }
}

#endif
