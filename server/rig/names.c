/* See names.h. */
#include "rig/names.h"

#include "base/hash.h"
#include "rig/rig.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SUFFIX_BYTES_MAX = 24 };

struct taken {
    const char *name; /* the caller's string */
    UT_hash_handle hh;
};

static bool is_taken(struct taken *set, const char *name)
{
    struct taken *found = NULL;
    HASH_FIND_STR(set, name, found);
    return found != NULL;
}

/* Cuts before a UTF-8 continuation byte never happens: the cut moves back to a first byte. */
static size_t cut_length(const char *name, size_t most)
{
    size_t length = strnlen(name, most + 1);
    if (length <= most)
        return length;
    length = most;
    while (length > 0 && ((unsigned char)name[length] & 0xC0) == 0x80)
        length--;
    return length;
}

static char *free_name(struct taken *set, const char *wanted, const char *fallback, size_t index)
{
    char name[SKD_NAME_BYTES_MAX + 1];
    if (wanted == NULL || wanted[0] == '\0')
        (void)snprintf(name, sizeof name, "%s%zu", fallback, index);
    else
        (void)snprintf(name, sizeof name, "%.*s", (int)cut_length(wanted, SKD_NAME_BYTES_MAX),
                       wanted);
    const size_t stem = cut_length(name, SKD_NAME_BYTES_MAX - SUFFIX_BYTES_MAX);
    for (size_t number = index; is_taken(set, name); number++)
        (void)snprintf(name + stem, sizeof name - stem, "_%zu", number);
    return strdup(name);
}

enum skd_status skd_names_make_unique(char **names, size_t count, const char *fallback,
                                      struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    struct taken *set = NULL;
    struct taken *entries = calloc(count + 1, sizeof *entries);
    if (entries == NULL)
        return skd_fail_memory(error, "names");
    for (size_t i = 0; i < count; i++) {
        char *name = free_name(set, names[i], fallback, i);
        if (name == NULL) {
            status = skd_fail_memory(error, "names");
            break;
        }
        free(names[i]);
        names[i] = name;
        struct taken *entry = &entries[i];
        entry->name = name;
        HASH_ADD_KEYPTR(hh, set, entry->name, strlen(entry->name), entry);
        if (!skd_hash_added(entry)) {
            status = skd_fail_memory(error, "names");
            break;
        }
    }
    HASH_CLEAR(hh, set);
    free(entries);
    return status;
}
