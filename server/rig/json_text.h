/* Finding values in JSON text without making objects of them.
 *
 * Stage: rig session and export. Thread: a worker. Pure; nothing is copied.
 * A glTF file's JSON is kept to the byte on export, so values have to be found where they stand;
 * and on import only a part of it has to be understood.
 */
#ifndef SKD_RIG_JSON_TEXT_H
#define SKD_RIG_JSON_TEXT_H

#include <stdbool.h>
#include <stddef.h>

enum { SKD_JSON_DEPTH_MAX = 128 };

/* One value in the text, from its first character up to (not with) the one after its last. */
struct skd_json {
    const char *start;
    const char *end;
};

/* The whole text as one value; false when it is not JSON, or nested deeper than
 * SKD_JSON_DEPTH_MAX; *problem is where then. The other functions take what came out of this. */
bool skd_json_whole(const char *text, size_t bytes, struct skd_json *root, const char **problem);

/* Walks the members of an object or the elements of an array:
 *     struct skd_json at = object, key, value;
 *     while (skd_json_next(&at, &key, &value)) ...
 * key keeps its quotes and has no meaning in an array. Other values have no elements. */
bool skd_json_next(struct skd_json *at, struct skd_json *key, struct skd_json *value);

/* The member of that name (the first, written without escapes); false when it is not there. */
bool skd_json_member(struct skd_json object, const char *name, struct skd_json *value);

size_t skd_json_count(struct skd_json array);

/* All elements of an array, the caller's to free; NULL: no memory. */
struct skd_json *skd_json_elements(struct skd_json array, size_t *count);

/* The same of a member; none when it is not there. */
struct skd_json *skd_json_member_elements(struct skd_json object, const char *name, size_t *count);

/* A member that is an index; -1 when it is not there or no whole number of 0 or more. */
long skd_json_index(struct skd_json object, const char *name);

#endif
