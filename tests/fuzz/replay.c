/* Runs a fuzz target over kept inputs: replay FILE-OR-FOLDER...
 *
 * Exit status: 0 when all were taken, 1 when one could not be read or there was none. A finding
 * ends the program the way it does under the fuzzer.
 */
#include "fuzz.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

static int take_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    struct stat info;
    if (file == NULL || fstat(fileno(file), &info) != 0) {
        fprintf(stderr, "cannot read %s\n", path);
        exit(1);
    }
    size_t size = (size_t)info.st_size;
    uint8_t *data = malloc(size + 1); /* one more, so that an empty file has an address too */
    SKD_ASSERT(data != NULL);
    if (fread(data, 1, size, file) != size) {
        fprintf(stderr, "cannot read %s\n", path);
        exit(1);
    }
    fclose(file);
    /* Exactly `size` bytes, so that a sanitizer sees one read too far. */
    uint8_t *exact = realloc(data, size > 0 ? size : 1);
    SKD_ASSERT(exact != NULL);
    fprintf(stderr, "%s\n", path);
    (void)LLVMFuzzerTestOneInput(exact, size);
    free(exact);
    return 1;
}

static int take(const char *path)
{
    DIR *folder = opendir(path);
    if (folder == NULL)
        return take_file(path);
    int count = 0;
    struct dirent *entry;
    while ((entry = readdir(folder)) != NULL) {
        char name[4096];
        if (entry->d_name[0] == '.')
            continue;
        (void)snprintf(name, sizeof name, "%s/%s", path, entry->d_name);
        count += take_file(name);
    }
    closedir(folder);
    return count;
}

int main(int argc, char **argv)
{
    int count = 0;
    for (int i = 1; i < argc; i++)
        count += take(argv[i]);
    printf("%d inputs\n", count);
    return count > 0 ? 0 : 1;
}
