/* UTF-8: what is text and what is not. Thread: any; no state. */
#ifndef SKD_BASE_UTF8_H
#define SKD_BASE_UTF8_H

#include <stddef.h>

/* Bytes of the longest prefix that is valid UTF-8: `bytes` when all of it is. Overlong forms,
 * surrogates and values above U+10FFFF are not valid (Unicode 15, table 3-7). */
size_t skd_utf8_valid_bytes(const char *text, size_t bytes);

/* Puts '?' for every byte that is not UTF-8 or is a control character. */
void skd_utf8_mend(char *text);

/* For printf's "%.*s": how much of a string to quote in an error, at most `most` bytes, ending
 * between characters. */
int skd_utf8_quote(const char *text, size_t most);

#endif
