/* See json_check.h. One pass, no recursion: a stack of one flag a level says whether it is an
 * object. Each check_... moves `at` behind what it read, or says in `trouble` what is wrong. */
#include "protocol/json_check.h"

#include "base/utf8.h"
#include "protocol/limits.h"

#include <string.h>

enum { NUMBER_BYTES_MAX = 63 }; /* cJSON reads numbers through a buffer of 64 bytes */

_Static_assert(SKD_JSON_NESTING_MAX == 32, "a sentence below says so");

struct scan {
    const char *at;
    const char *end;
    int depth;
    bool is_object[SKD_JSON_NESTING_MAX];
    const char *trouble; /* NULL while all is well */
};

static bool fail(struct scan *scan, const char *trouble)
{
    scan->trouble = trouble;
    return false;
}

/* The next byte, or -1 at the end. A NUL is a byte like any other, and fits nowhere. */
static int peek(const struct scan *scan)
{
    return scan->at < scan->end ? (unsigned char)*scan->at : -1;
}

static void skip_space(struct scan *scan)
{
    while (scan->at < scan->end &&
           (*scan->at == ' ' || *scan->at == '\n' || *scan->at == '\t' || *scan->at == '\r'))
        scan->at++;
}

static bool is_digit(int byte)
{
    return byte >= '0' && byte <= '9';
}

static bool skip_digits(struct scan *scan)
{
    if (!is_digit(peek(scan)))
        return fail(scan, "a digit is missing");
    while (is_digit(peek(scan)))
        scan->at++;
    return true;
}

static bool check_number(struct scan *scan)
{
    const char *begin = scan->at;
    if (peek(scan) == '-')
        scan->at++;
    if (peek(scan) == '0') {
        scan->at++;
        if (is_digit(peek(scan)))
            return fail(scan, "a number begins with 0");
    } else if (!skip_digits(scan)) {
        return false;
    }
    if (peek(scan) == '.') {
        scan->at++;
        if (!skip_digits(scan))
            return false;
    }
    if (peek(scan) == 'e' || peek(scan) == 'E') {
        scan->at++;
        if (peek(scan) == '+' || peek(scan) == '-')
            scan->at++;
        if (!skip_digits(scan))
            return false;
    }
    if (scan->at - begin > NUMBER_BYTES_MAX)
        return fail(scan, "a number has more than 63 characters");
    return true;
}

/* Four hexadecimal digits, or -1. */
static int read_hex(struct scan *scan)
{
    int value = 0;
    for (int i = 0; i < 4; i++) {
        int byte = peek(scan);
        int digit;
        if (is_digit(byte))
            digit = byte - '0';
        else if (byte >= 'a' && byte <= 'f')
            digit = byte - 'a' + 10;
        else if (byte >= 'A' && byte <= 'F')
            digit = byte - 'A' + 10;
        else
            return -1;
        value = 16 * value + digit;
        scan->at++;
    }
    return value;
}

static bool check_escape(struct scan *scan)
{
    int byte = peek(scan);
    if (byte <= 0 || strchr("\"\\/bfnrtu", byte) == NULL)
        return fail(scan, "an unknown escape in a string");
    scan->at++;
    if (byte != 'u')
        return true;
    int unit = read_hex(scan);
    if (unit < 0)
        return fail(scan, "\\u wants four hexadecimal digits");
    if (unit == 0)
        return fail(scan, "a string holds a NUL");
    if (unit >= 0xDC00 && unit <= 0xDFFF)
        return fail(scan, "half of a surrogate pair in a string");
    if (unit < 0xD800 || unit > 0xDBFF)
        return true;
    if (scan->end - scan->at < 2 || memcmp(scan->at, "\\u", 2) != 0)
        return fail(scan, "half of a surrogate pair in a string");
    scan->at += 2;
    unit = read_hex(scan);
    return unit >= 0xDC00 && unit <= 0xDFFF ? true
                                            : fail(scan, "half of a surrogate pair in a string");
}

static bool check_string(struct scan *scan)
{
    if (peek(scan) != '"')
        return fail(scan, "a string is missing");
    scan->at++;
    for (;;) {
        int byte = peek(scan);
        if (byte < 0)
            return fail(scan, "a string without an end");
        if (byte == 0)
            return fail(scan, "a string holds a NUL");
        if (byte < 0x20)
            return fail(scan, "a string holds a control character; write it as an escape");
        scan->at++;
        if (byte == '"')
            return true;
        if (byte == '\\' && !check_escape(scan))
            return false;
    }
}

static bool check_word(struct scan *scan, const char *word)
{
    size_t bytes = strlen(word);
    if ((size_t)(scan->end - scan->at) < bytes || memcmp(scan->at, word, bytes) != 0)
        return fail(scan, "no JSON value");
    scan->at += bytes;
    return true;
}

static bool check_key(struct scan *scan)
{
    skip_space(scan);
    if (!check_string(scan))
        return false;
    skip_space(scan);
    if (peek(scan) != ':')
        return fail(scan, "a ':' is missing");
    scan->at++;
    return true;
}

/* Enters an object or array. *is_empty: it was left again at once. */
static bool open_level(struct scan *scan, bool is_object, bool *is_empty)
{
    if (scan->depth == SKD_JSON_NESTING_MAX)
        return fail(scan, "nested too deep; the limit is 32");
    scan->is_object[scan->depth++] = is_object;
    scan->at++;
    skip_space(scan);
    *is_empty = peek(scan) == (is_object ? '}' : ']');
    if (*is_empty) {
        scan->at++;
        scan->depth--;
        return true;
    }
    return is_object ? check_key(scan) : true;
}

/* Reads from the start of a value to its end, or into the first value of what it opens. */
static bool begin_value(struct scan *scan, bool *is_whole)
{
    skip_space(scan);
    *is_whole = true;
    switch (peek(scan)) {
    case '{':
        return open_level(scan, true, is_whole);
    case '[':
        return open_level(scan, false, is_whole);
    case '"':
        return check_string(scan);
    case 't':
        return check_word(scan, "true");
    case 'f':
        return check_word(scan, "false");
    case 'n':
        return check_word(scan, "null");
    case '-':
    case '0':
    case '1':
    case '2':
    case '3':
    case '4':
    case '5':
    case '6':
    case '7':
    case '8':
    case '9':
        return check_number(scan);
    case -1:
        return fail(scan, "it ends too early");
    default:
        return fail(scan, "no JSON value");
    }
}

/* After a value: leaves the levels that end here and goes to the next value. */
static bool end_value(struct scan *scan)
{
    while (scan->depth > 0) {
        bool is_object = scan->is_object[scan->depth - 1];
        skip_space(scan);
        int byte = peek(scan);
        if (byte == ',') {
            scan->at++;
            return is_object ? check_key(scan) : true;
        }
        if (byte != (is_object ? '}' : ']'))
            return fail(scan, is_object ? "a ',' or '}' is missing" : "a ',' or ']' is missing");
        scan->at++;
        scan->depth--;
    }
    return true;
}

static bool check(struct scan *scan)
{
    do {
        bool is_whole;
        if (!begin_value(scan, &is_whole))
            return false;
        if (is_whole && !end_value(scan))
            return false;
    } while (scan->depth > 0);
    skip_space(scan);
    return scan->at == scan->end ? true : fail(scan, "something follows the value");
}

enum skd_status skd_json_check(const char *text, size_t bytes, struct skd_error *error)
{
    size_t valid = skd_utf8_valid_bytes(text, bytes);
    if (valid < bytes)
        return skd_fail(error, SKD_BAD_JSON, "the JSON is not UTF-8 at byte %zu", valid);
    struct scan scan = {.at = text, .end = text + bytes};
    if (!check(&scan))
        return skd_fail(error, SKD_BAD_JSON, "the JSON is broken at byte %zu: %s",
                        (size_t)(scan.at - text), scan.trouble);
    return SKD_OK;
}
