/* What an import process leaves behind: an answer, and the image of the rig behind it, in a memory
 * file that it gets as a descriptor.
 *
 *     [struct skd_import_answer, 512 bytes][rig image, rig/rig_image.h]
 *
 * The answer is written last: a process that was stopped on the way has left zeros there. Nothing
 * in it is believed (import.c).
 */
#ifndef SKD_IMPORT_ANSWER_H
#define SKD_IMPORT_ANSWER_H

#include "base/error.h"

#include <stdint.h>

/* argv[0] of an import process; argv[1..3] are the file, bytes of memory and seconds. */
#define SKD_IMPORT_NAME "skind-import"

#define SKD_IMPORT_MAGIC 0x5452504D49444B53u /* "SKDIMPRT" */

enum { SKD_IMPORT_FD = 3 };

struct skd_import_answer {
    uint64_t magic;
    uint64_t image_bytes;
    uint32_t status; /* enum skd_status */
    char text[SKD_ERROR_TEXT_BYTES];
    char zeros[512 - 20 - SKD_ERROR_TEXT_BYTES];
};

_Static_assert(sizeof(struct skd_import_answer) == 512, "the image begins at a multiple of 8");

#endif
