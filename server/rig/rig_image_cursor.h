/* Taking a rig image apart, array by array. Only its readers include this.
 *
 * Stage: rig session. Thread: any. Sizes are checked before memory is asked for, so that an image
 * can claim no more memory than it has bytes (times a small number).
 */
#ifndef SKD_RIG_RIG_IMAGE_CURSOR_H
#define SKD_RIG_RIG_IMAGE_CURSOR_H

#include "rig/rig.h"
#include "rig/rig_image_layout.h"

struct skd_image_reader {
    const uint8_t *at;
    size_t left;
    const struct skd_image_head *head; /* its counts are within the limits of rig.h */
    struct skd_error *error;
};

/* Fails with SKD_BAD_RIG: the image is damaged, `what` (a clause) is wrong. */
enum skd_status skd_image_wrong(const struct skd_image_reader *reader, const char *what);

/* The next array, in place, or NULL with the error set. Never NULL when it is there. */
const void *skd_image_take(struct skd_image_reader *reader, size_t count, size_t size);

/* A copy of the next array in memory of its own, or NULL with the error set. */
void *skd_image_copy(struct skd_image_reader *reader, size_t count, size_t size);

/* The next `count` strings, each in memory of its own at texts + i * stride bytes (a char *).
 * At least 1 and at most `most` bytes of UTF-8 each where `most` is not 0. */
SKD_MUST_CHECK enum skd_status skd_image_strings(struct skd_image_reader *reader, size_t count,
                                                 size_t most, void *texts, size_t stride);

/* That no string is there twice within its group; groups may be NULL. */
SKD_MUST_CHECK enum skd_status skd_image_check_unique(const struct skd_image_reader *reader,
                                                      char *const *names, const uint16_t *groups,
                                                      size_t count);

#endif
