/* See scratch.h. */
#include "rig/scratch.h"

#include <stdlib.h>

void *skd_scratch_take(struct skd_scratch *scratch, size_t bytes)
{
    if (bytes > scratch->bytes || scratch->memory == NULL) {
        skd_scratch_finish(scratch);
        scratch->memory = malloc(bytes > 0 ? bytes : 1);
        scratch->bytes = scratch->memory != NULL ? bytes : 0;
    }
    return scratch->memory;
}

void skd_scratch_finish(struct skd_scratch *scratch)
{
    free(scratch->memory);
    *scratch = (struct skd_scratch){0};
}
