/* See utf8.h. */
#include "base/utf8.h"

#include <string.h>

/* Bytes of the character at `text`, or 0 when there is none that is valid and whole. The second
 * byte's range is what tells overlong forms and surrogates. */
static size_t character_bytes(const unsigned char *text, size_t bytes)
{
    unsigned lead = text[0];
    unsigned low = 0x80;
    unsigned high = 0xBF;
    size_t length;
    if (lead < 0x80)
        return 1;
    if (lead >= 0xC2 && lead <= 0xDF) {
        length = 2;
    } else if (lead >= 0xE0 && lead <= 0xEF) {
        length = 3;
        low = lead == 0xE0 ? 0xA0 : 0x80;
        high = lead == 0xED ? 0x9F : 0xBF;
    } else if (lead >= 0xF0 && lead <= 0xF4) {
        length = 4;
        low = lead == 0xF0 ? 0x90 : 0x80;
        high = lead == 0xF4 ? 0x8F : 0xBF;
    } else {
        return 0;
    }
    if (bytes < length || text[1] < low || text[1] > high)
        return 0;
    for (size_t i = 2; i < length; i++)
        if ((text[i] & 0xC0u) != 0x80)
            return 0;
    return length;
}

size_t skd_utf8_valid_bytes(const char *text, size_t bytes)
{
    const unsigned char *at = (const unsigned char *)text;
    size_t valid = 0;
    while (valid < bytes) {
        size_t length = character_bytes(at + valid, bytes - valid);
        if (length == 0)
            break;
        valid += length;
    }
    return valid;
}

void skd_utf8_mend(char *text)
{
    size_t bytes = strlen(text);
    size_t length;
    for (unsigned char *at = (unsigned char *)text; bytes > 0; at += length, bytes -= length) {
        length = character_bytes(at, bytes);
        if (length == 0 || *at < 0x20 || *at == 0x7F) {
            *at = '?';
            length = 1;
        }
    }
}

int skd_utf8_quote(const char *text, size_t most)
{
    return (int)skd_utf8_valid_bytes(text, strnlen(text, most));
}
