/* See uri.h. */
#include "rig/uri.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char alphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

bool skd_uri_is_data(const char *uri)
{
    return strncmp(uri, "data:", 5) == 0;
}

bool skd_uri_has_scheme(const char *uri)
{
    return uri[strcspn(uri, ":/?#")] == ':';
}

/* Writes to bytes, which has room for 3/4 of the text; false when a character does not belong. */
static bool decode_base64(const char *text, size_t length, uint8_t *bytes, size_t *count)
{
    uint8_t values[256];
    memset(values, 0xFF, sizeof values);
    for (uint8_t i = 0; i < 64; i++)
        values[(unsigned char)alphabet[i]] = i;
    values['-'] = 62; /* the alphabet for URLs */
    values['_'] = 63;
    while (length > 0 && text[length - 1] == '=')
        length--;
    if (length % 4 == 1)
        return false;
    uint8_t *to = bytes;
    uint32_t bad = 0;
    for (size_t i = 0; i < length; i += 4) {
        const size_t digits = length - i < 4 ? length - i : 4;
        uint32_t group = 0;
        for (size_t k = 0; k < 4; k++) {
            const uint32_t value = k < digits ? values[(unsigned char)text[i + k]] : 0;
            bad |= value & 0xC0;
            group = group << 6 | value;
        }
        for (size_t k = 0; k + 1 < digits; k++)
            *to++ = (uint8_t)(group >> (16 - 8 * k));
    }
    *count = (size_t)(to - bytes);
    return !bad;
}

enum skd_status skd_uri_decode_data(const char *uri, uint8_t **bytes, size_t *count,
                                    struct skd_error *error)
{
    const char *comma = strchr(uri, ',');
    static const char mark[] = ";base64";
    const size_t mark_length = sizeof mark - 1;
    if (comma == NULL || (size_t)(comma - uri) < mark_length ||
        strncmp(comma - mark_length, mark, mark_length) != 0)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "a buffer is a data URI that is not base64; save the file as .glb");
    const size_t length = strlen(comma + 1);
    *bytes = malloc(length / 4 * 3 + 4);
    if (*bytes == NULL)
        return skd_fail_memory(error, "a buffer");
    if (decode_base64(comma + 1, length, *bytes, count))
        return SKD_OK;
    free(*bytes);
    *bytes = NULL;
    return skd_fail(error, SKD_NOT_GLTF, "a buffer is a data URI that is not valid base64");
}

char *skd_uri_encode_base64(const uint8_t *bytes, size_t count)
{
    char *text = malloc((count + 2) / 3 * 4 + 1), *to = text;
    if (text == NULL)
        return NULL;
    for (size_t i = 0; i < count; i += 3) {
        const size_t left = count - i;
        const uint32_t group = (uint32_t)bytes[i] << 16 |
                               (left > 1 ? (uint32_t)bytes[i + 1] << 8 : 0) |
                               (left > 2 ? (uint32_t)bytes[i + 2] : 0);
        *to++ = alphabet[group >> 18];
        *to++ = alphabet[group >> 12 & 63];
        *to++ = left > 1 ? alphabet[group >> 6 & 63] : '=';
        *to++ = left > 2 ? alphabet[group & 63] : '=';
    }
    *to = '\0';
    return text;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* False for "%00", which would end the path early. */
static bool decode_percent(const char *uri, char *path)
{
    for (; *uri != '\0'; uri++) {
        const int high = *uri == '%' ? hex_digit(uri[1]) : -1;
        const int low = high >= 0 ? hex_digit(uri[2]) : -1;
        if (low >= 0) {
            if (high == 0 && low == 0)
                return false;
            *path++ = (char)(high * 16 + low);
            uri += 2;
        } else {
            *path++ = *uri;
        }
    }
    *path = '\0';
    return true;
}

static bool stays_inside(const char *path)
{
    if (path[0] == '/' || path[0] == '\0')
        return false;
    for (const char *at = path; *at != '\0';) {
        const size_t length = strcspn(at, "/");
        if (length == 2 && at[0] == '.' && at[1] == '.')
            return false;
        at += length;
        at += *at == '/';
    }
    return true;
}

enum skd_status skd_uri_to_path(const char *uri, char **path, struct skd_error *error)
{
    *path = malloc(strlen(uri) + 1);
    if (*path == NULL)
        return skd_fail_memory(error, "a path");
    if (!skd_uri_has_scheme(uri) && decode_percent(uri, *path) && stays_inside(*path))
        return SKD_OK;
    free(*path);
    *path = NULL;
    return skd_fail(error, SKD_UNSUPPORTED,
                    "\"%.200s\" does not lie beside the glTF file; put it into the same folder or "
                    "save the file as .glb",
                    uri);
}

char *skd_uri_from_name(const char *name)
{
    static const char safe[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~";
    char *uri = malloc(strlen(name) * 3 + 1), *to = uri;
    if (uri == NULL)
        return NULL;
    for (; *name != '\0'; name++) {
        if (strchr(safe, *name) != NULL)
            *to++ = *name;
        else
            to += sprintf(to, "%%%02X", (unsigned char)*name);
    }
    *to = '\0';
    return uri;
}
