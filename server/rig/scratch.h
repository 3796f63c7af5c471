/* Memory for one whole-mesh pass after the other.
 *
 * Stage: rig session. Thread: a worker.
 * Fresh pages cost more than the passes themselves (64 MB take 28 ms to touch for the first time),
 * so a load goes on with the block that its file was read into.
 */
#ifndef SKD_RIG_SCRATCH_H
#define SKD_RIG_SCRATCH_H

#include <stddef.h>

struct skd_scratch {
    void *memory; /* from malloc, or NULL */
    size_t bytes;
};

/* At least `bytes` of it, with whatever is in there; what was taken before is void. NULL when there
 * is no memory. */
void *skd_scratch_take(struct skd_scratch *scratch, size_t bytes);
void skd_scratch_finish(struct skd_scratch *scratch);

#endif
