/* See json_text.h. The checks follow RFC 8259; encoding is left to who reads a string. */
#include "rig/json_text.h"

#include <stdlib.h>
#include <string.h>

static const char *skip_space(const char *at, const char *end)
{
    while (at < end && (*at == ' ' || *at == '\n' || *at == '\r' || *at == '\t'))
        at++;
    return at;
}

/* All of the following return where the value ends, or NULL with *problem set. */

/* Strings can be whole buffers in base64, so they are not walked character by character. */
static const char *skip_string(const char *at, const char *end, const char **problem)
{
    const char *start = at + 1;
    for (at = start;; at++) {
        at = memchr(at, '"', (size_t)(end - at));
        if (at == NULL)
            break;
        const char *escape = at;
        while (escape > start && escape[-1] == '\\')
            escape--;
        if ((at - escape) % 2 == 0)
            break;
    }
    bool has_control = false;
    for (const char *c = start; at != NULL && c < at; c++)
        has_control |= (unsigned char)*c < 0x20;
    if (at != NULL && !has_control)
        return at + 1;
    *problem = start;
    return NULL;
}

static const char *skip_digits(const char *at, const char *end)
{
    while (at < end && *at >= '0' && *at <= '9')
        at++;
    return at;
}

static const char *skip_number(const char *at, const char *end, const char **problem)
{
    const char *digits = at + (at < end && *at == '-');
    const char *next = skip_digits(digits, end);
    bool is_wrong = next == digits || (*digits == '0' && next - digits > 1);
    if (next < end && *next == '.') {
        digits = next + 1;
        next = skip_digits(digits, end);
        is_wrong |= next == digits;
    }
    if (next < end && (*next == 'e' || *next == 'E')) {
        digits = next + 1;
        if (digits < end && (*digits == '+' || *digits == '-'))
            digits++;
        next = skip_digits(digits, end);
        is_wrong |= next == digits;
    }
    if (!is_wrong)
        return next;
    *problem = at;
    return NULL;
}

static const char *skip_word(const char *at, const char *end, const char **problem)
{
    static const char *const words[] = {"true", "false", "null"};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        const size_t length = strlen(words[i]);
        if ((size_t)(end - at) >= length && memcmp(at, words[i], length) == 0)
            return at + length;
    }
    *problem = at;
    return NULL;
}

static const char *skip_value(const char *at, const char *end, int depth, const char **problem);

/* An object or an array, from its opening bracket. */
static const char *skip_group(const char *at, const char *end, int depth, const char **problem)
{
    const bool is_object = *at == '{';
    const char close = is_object ? '}' : ']';
    at = skip_space(at + 1, end);
    if (at < end && *at == close)
        return at + 1;
    while (at < end && depth < SKD_JSON_DEPTH_MAX) {
        if (is_object) {
            at = *at == '"' ? skip_string(at, end, problem) : NULL;
            at = at != NULL ? skip_space(at, end) : NULL;
            if (at == NULL || at == end || *at != ':')
                break;
            at = skip_space(at + 1, end);
        }
        at = skip_value(at, end, depth + 1, problem);
        if (at == NULL)
            return NULL;
        at = skip_space(at, end);
        if (at < end && *at == close)
            return at + 1;
        if (at == end || *at != ',')
            break;
        at = skip_space(at + 1, end);
    }
    if (at != NULL || *problem == NULL)
        *problem = at != NULL ? at : end;
    return NULL;
}

static const char *skip_value(const char *at, const char *end, int depth, const char **problem)
{
    if (at == end) {
        *problem = end;
        return NULL;
    }
    switch (*at) {
    case '{':
    case '[':
        return skip_group(at, end, depth, problem);
    case '"':
        return skip_string(at, end, problem);
    case 't':
    case 'f':
    case 'n':
        return skip_word(at, end, problem);
    default:
        return skip_number(at, end, problem);
    }
}

bool skd_json_whole(const char *text, size_t bytes, struct skd_json *root, const char **problem)
{
    const char *end = text + bytes;
    if (bytes >= 3 && memcmp(text, "\xEF\xBB\xBF", 3) == 0)
        text += 3; /* a byte order mark, which the specification forbids and editors write */
    *problem = NULL;
    root->start = skip_space(text, end);
    root->end = skip_value(root->start, end, 0, problem);
    if (root->end == NULL)
        return false;
    const char *after = skip_space(root->end, end);
    while (after < end && *after == '\0')
        after++; /* padding of careless writers */
    *problem = after;
    return after == end;
}

bool skd_json_next(struct skd_json *at, struct skd_json *key, struct skd_json *value)
{
    const char *ignored = NULL;
    const char *next = at->start;
    if (next >= at->end || (*next != '{' && *next != '[' && *next != ','))
        return false;
    next = skip_space(next + 1, at->end);
    if (next >= at->end || *next == '}' || *next == ']')
        return false;
    /* In an object, each value follows a string and a colon; in an array nothing does. */
    *key = (struct skd_json){next, next};
    *value = (struct skd_json){next, skip_value(next, at->end, 0, &ignored)};
    next = skip_space(value->end, at->end);
    if (next < at->end && *next == ':') {
        *key = *value;
        value->start = skip_space(next + 1, at->end);
        value->end = skip_value(value->start, at->end, 0, &ignored);
        next = skip_space(value->end, at->end);
    }
    at->start = next;
    return true;
}

bool skd_json_member(struct skd_json object, const char *name, struct skd_json *value)
{
    const size_t length = strlen(name);
    struct skd_json key;
    if (object.start == object.end || *object.start != '{')
        return false;
    while (skd_json_next(&object, &key, value))
        if ((size_t)(key.end - key.start) == length + 2 && memcmp(key.start + 1, name, length) == 0)
            return true;
    return false;
}

size_t skd_json_count(struct skd_json array)
{
    struct skd_json key, value;
    size_t count = 0;
    while (skd_json_next(&array, &key, &value))
        count++;
    return count;
}

struct skd_json *skd_json_elements(struct skd_json array, size_t *count)
{
    *count = skd_json_count(array);
    struct skd_json *elements = malloc((*count + 1) * sizeof *elements);
    struct skd_json key;
    for (size_t i = 0; elements != NULL && i < *count; i++)
        (void)skd_json_next(&array, &key, &elements[i]);
    return elements;
}

struct skd_json *skd_json_member_elements(struct skd_json object, const char *name, size_t *count)
{
    struct skd_json array;
    if (!skd_json_member(object, name, &array))
        array = (struct skd_json){object.end, object.end};
    return skd_json_elements(array, count);
}

long skd_json_index(struct skd_json object, const char *name)
{
    struct skd_json value;
    char *end = NULL;
    if (!skd_json_member(object, name, &value))
        return -1;
    const long index = strtol(value.start, &end, 10);
    return end == value.start || index < 0 ? -1 : index;
}
