/* Memory for JSON trees, which remembers that it ran out.
 *
 * Stage: result -> reply. Thread: any; each thread remembers for itself.
 * cJSON leaves a member out when there is no memory for it, and a tree that lacks a member looks
 * whole. So whoever turns a tree into a message asks here whether anything was missing while it was
 * built (encode.c), and no handler has to look at every call.
 */
#ifndef SKD_PROTOCOL_JSON_MEMORY_H
#define SKD_PROTOCOL_JSON_MEMORY_H

#include <stdbool.h>

/* Makes cJSON take its memory here. Once a process, before its other threads. */
void skd_json_memory_watch(void);

/* Whether memory for JSON ran out in this thread since the last time that this was asked. */
bool skd_json_memory_ran_out(void);

#endif
