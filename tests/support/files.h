/* Whole files in memory: to damage them, to compare them, to put them back. Fails the test where a
 * file cannot be read or written.
 */
#ifndef SKD_TESTS_FILES_H
#define SKD_TESTS_FILES_H

#include <stddef.h>
#include <stdint.h>

struct bytes {
    uint8_t *data;
    size_t count;
};

/* The file of that name and suffix; the caller's to free. {NULL, 0}: there is none. */
struct bytes take_file(const char *path, const char *suffix);

void put_file(const char *path, const char *suffix, const uint8_t *data, size_t count);

/* Those of a folder, links and folders too. */
size_t count_files(const char *folder);

#endif
