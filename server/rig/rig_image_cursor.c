/* See rig_image_cursor.h. */
#include "rig/rig_image_cursor.h"

#include "base/utf8.h"

#include <stdlib.h>
#include <string.h>

enum skd_status skd_image_wrong(const struct skd_image_reader *reader, const char *what)
{
    return skd_fail(reader->error, SKD_BAD_RIG, "the image of the rig is damaged: %s", what);
}

const void *skd_image_take(struct skd_image_reader *reader, size_t count, size_t size)
{
    const uint8_t *at = reader->at;
    if (count > reader->left / size) {
        (void)skd_image_wrong(reader, "it is too short");
        return NULL;
    }
    const size_t padded = (count * size + 7) & ~(size_t)7;
    if (padded > reader->left) {
        (void)skd_image_wrong(reader, "it is too short");
        return NULL;
    }
    reader->at += padded;
    reader->left -= padded;
    return at;
}

void *skd_image_copy(struct skd_image_reader *reader, size_t count, size_t size)
{
    const void *from = skd_image_take(reader, count, size);
    if (from == NULL)
        return NULL;
    void *to = malloc(count > 0 ? count * size : 1);
    if (to == NULL)
        (void)skd_fail_memory(reader->error, "a rig");
    else
        memcpy(to, from, count * size);
    return to;
}

enum skd_status skd_image_strings(struct skd_image_reader *reader, size_t count, size_t most,
                                  void *texts, size_t stride)
{
    const uint32_t *lengths = skd_image_take(reader, count, sizeof *lengths);
    if (lengths == NULL)
        return SKD_BAD_RIG;
    size_t bytes = 0;
    for (size_t i = 0; i < count; i++)
        bytes += lengths[i];
    const char *from = skd_image_take(reader, bytes, 1);
    if (from == NULL)
        return SKD_BAD_RIG;
    for (size_t i = 0; i < count; i++) {
        const size_t length = lengths[i];
        if (memchr(from, 0, length) != NULL)
            return skd_image_wrong(reader, "a string has a 0 byte");
        if (most > 0 &&
            (length == 0 || length > most || skd_utf8_valid_bytes(from, length) != length))
            return skd_image_wrong(reader, "a name is empty, too long or no UTF-8");
        char *text = strndup(from, length);
        if (text == NULL)
            return skd_fail_memory(reader->error, "names");
        memcpy((char *)texts + i * stride, &text, sizeof text);
        from += length;
    }
    return SKD_OK;
}

struct name_in_group {
    const char *name;
    uint16_t group;
};

static int compare_names(const void *a, const void *b)
{
    const struct name_in_group *x = a, *y = b;
    if (x->group != y->group)
        return x->group < y->group ? -1 : 1;
    return strcmp(x->name, y->name);
}

enum skd_status skd_image_check_unique(const struct skd_image_reader *reader, char *const *names,
                                       const uint16_t *groups, size_t count)
{
    struct name_in_group *sorted = malloc((count + 1) * sizeof *sorted);
    if (sorted == NULL)
        return skd_fail_memory(reader->error, "names");
    for (size_t i = 0; i < count; i++)
        sorted[i] = (struct name_in_group){names[i], groups != NULL ? groups[i] : 0};
    qsort(sorted, count, sizeof *sorted, compare_names);
    bool is_unique = true;
    for (size_t i = 1; i < count; i++)
        is_unique = is_unique && compare_names(&sorted[i - 1], &sorted[i]) != 0;
    free(sorted);
    return is_unique ? SKD_OK : skd_image_wrong(reader, "a name is there twice");
}

/* Bones stand skin after skin, and no skin is without. */
