/* Fuzz target: bytes that claim to be the image of a rig (rig/rig_image.h): what an import process
 * hands over, what a journal keeps.
 *
 * Input: an image. Its length is put right, so that every change is about the rest of it. What is
 * accepted must be a whole rig, and is written and read once more.
 */
#include "fuzz.h"
#include "rig_checks.h"

#include "rig/pose.h"
#include "rig/rig_image.h"
#include "rig/rig_image_layout.h"

#include <stdlib.h>
#include <string.h>

static bool append(void *user, const void *bytes, size_t count)
{
    uint8_t **to = user;
    memcpy(*to, bytes, count);
    *to += count;
    return true;
}

static void write_again(const struct skd_rig *rig, const struct skd_influences *influences)
{
    const size_t count = skd_rig_image_bytes(rig, influences);
    uint8_t *bytes = malloc(count), *to = bytes;
    const struct skd_image_sink sink = {append, &to};
    struct skd_rig *again;
    struct skd_influences rows;
    SKD_ASSERT(bytes != NULL && skd_rig_image_write(rig, influences, &sink));
    SKD_ASSERT(to == bytes + count);
    SKD_ASSERT(skd_rig_image_read(bytes, count, &again, influences != NULL ? &rows : NULL, NULL) ==
               SKD_OK);
    skd_rig_destroy(again);
    free(bytes);
}

static void sample_clips(const struct skd_rig *rig)
{
    double *pose = malloc((size_t)rig->skeleton.bone_count * SKD_MATRIX_SIZE * sizeof *pose);
    SKD_ASSERT(pose != NULL);
    for (int clip = 0; clip < (int)rig->nodes.clip_count && clip < 4; clip++)
        SKD_ASSERT(skd_pose_from_clip(rig, clip, rig->nodes.clips[clip].duration / 3, pose, NULL) ==
                   SKD_OK);
    free(pose);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct skd_image_head head;
    struct skd_rig *rig;
    struct skd_influences influences;
    struct skd_error error = {0};
    if (size < sizeof head)
        return 0;
    uint8_t *image = malloc(size); /* of its own size: reading behind it is seen */
    SKD_ASSERT(image != NULL);
    memcpy(image, data, size);
    memcpy(&head, image, sizeof head);
    head.bytes = size;
    memcpy(image, &head, sizeof head);
    struct skd_influences *rows = head.flags & SKD_IMAGE_HAS_INFLUENCES ? &influences : NULL;
    if (skd_rig_image_read(image, size, &rig, rows, &error) == SKD_OK) {
        if (rows != NULL)
            check_influences(rig, rows);
        check_mesh(rig);
        sample_clips(rig);
        write_again(rig, rows);
        skd_rig_destroy(rig);
    } else {
        SKD_ASSERT(error.text[0] != '\0');
    }
    free(image);
    return 0;
}
