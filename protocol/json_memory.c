/* See json_memory.h. */
#include "protocol/json_memory.h"

#include <cjson/cJSON.h>
#include <stdlib.h>

static _Thread_local bool ran_out;

static void *allocate(size_t bytes)
{
    void *memory = malloc(bytes);
    if (memory == NULL)
        ran_out = true;
    return memory;
}

void skd_json_memory_watch(void)
{
    cJSON_Hooks hooks = {allocate, free};
    cJSON_InitHooks(&hooks);
}

bool skd_json_memory_ran_out(void)
{
    bool result = ran_out;
    ran_out = false;
    return result;
}
