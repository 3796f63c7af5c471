/* Memory for whole-mesh arrays: large blocks on large pages.
 *
 * Stage: rig session. Thread: a worker.
 * Loading a million vertices touches some 200 MB for the first time; with pages of 4 KiB the
 * faults cost as much as the work (28 ms against 9 for 64 MB).
 */
#ifndef SKD_RIG_LARGE_H
#define SKD_RIG_LARGE_H

#include <stddef.h>

/* Uninitialised, to be freed with free; NULL when there is no memory. */
void *skd_large_alloc(size_t bytes);

#endif
