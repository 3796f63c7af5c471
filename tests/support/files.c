/* See files.h. */
#include "support/files.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

enum { NAME_BYTES = 1024 };

struct bytes take_file(const char *path, const char *suffix)
{
    char name[NAME_BYTES];
    struct bytes bytes = {0};
    (void)snprintf(name, sizeof name, "%s%s", path, suffix);
    FILE *file = fopen(name, "rb");
    if (file == NULL)
        return bytes;
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    bytes.count = (size_t)ftell(file);
    bytes.data = malloc(bytes.count + 1);
    rewind(file);
    assert_int_equal(fread(bytes.data, 1, bytes.count, file), bytes.count);
    assert_int_equal(fclose(file), 0);
    return bytes;
}

void put_file(const char *path, const char *suffix, const uint8_t *data, size_t count)
{
    char name[NAME_BYTES];
    (void)snprintf(name, sizeof name, "%s%s", path, suffix);
    FILE *file = fopen(name, "wb");
    assert_non_null(file);
    if (count > 0)
        assert_int_equal(fwrite(data, 1, count, file), count);
    assert_int_equal(fclose(file), 0);
}

size_t count_files(const char *folder)
{
    char command[NAME_BYTES + 64];
    unsigned count = 0;
    (void)snprintf(command, sizeof command, "ls -A '%s' | wc -l", folder);
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    assert_int_equal(fscanf(pipe, "%u", &count), 1);
    (void)pclose(pipe);
    return count;
}
