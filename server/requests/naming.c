/* See naming.h. */
#include "requests/naming.h"

#include "requests/live.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

/* The file's stem, with '_' for what a name may not hold. */
static void stem_of(const char *file, char name[SKD_SESSION_NAME_BYTES_MAX + 1])
{
    const char *slash = strrchr(file, '/');
    const char *stem = slash != NULL ? slash + 1 : file;
    const char *dot = strrchr(stem, '.');
    size_t length = dot != NULL ? (size_t)(dot - stem) : strlen(stem);
    size_t used = 0;
    for (size_t i = 0; i < length && used < SKD_SESSION_NAME_BYTES_MAX - 4; i++) {
        unsigned char letter = (unsigned char)stem[i];
        bool plain = letter < 128 && (isalnum(letter) || letter == '_' || letter == '-');
        name[used++] = plain ? (char)letter : '_';
    }
    name[used] = '\0';
    if (used == 0)
        (void)snprintf(name, SKD_SESSION_NAME_BYTES_MAX, "rig");
}

enum skd_status skd_reserve_name(struct skd_daemon *daemon, const char *name, const char *file,
                                 struct skd_live **live, struct skd_error *error)
{
    if (name != NULL)
        return skd_live_reserve(daemon, name, live, error);
    char stem[SKD_SESSION_NAME_BYTES_MAX + 1], numbered[SKD_SESSION_NAME_BYTES_MAX + 16];
    stem_of(file != NULL ? file : "rig", stem);
    (void)snprintf(numbered, sizeof numbered, "%s", stem);
    enum skd_status status = skd_live_reserve(daemon, numbered, live, error);
    for (int number = 2; status == SKD_NAME_TAKEN && number <= SKD_SESSIONS_MAX + 1; number++) {
        (void)snprintf(numbered, sizeof numbered, "%s-%d", stem, number);
        status = skd_live_reserve(daemon, numbered, live, error);
    }
    return status;
}
