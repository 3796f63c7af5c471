/* See large.h. */
#include "rig/large.h"

#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>

#define HUGE_PAGE ((size_t)2 << 20)

void *skd_large_alloc(size_t bytes)
{
    if (bytes < 2 * HUGE_PAGE || bytes > SIZE_MAX - HUGE_PAGE)
        return malloc(bytes > 0 ? bytes : 1);
    const size_t rounded = (bytes + HUGE_PAGE - 1) / HUGE_PAGE * HUGE_PAGE;
    void *block = aligned_alloc(HUGE_PAGE, rounded);
    if (block != NULL)
        (void)madvise(block, rounded, MADV_HUGEPAGE); /* a wish: small pages do too */
    return block;
}
