/* See memory_reserve.h.
 *
 * The reserve is handed out from front to end and is empty again once all of it was given back,
 * which is soon: a table that grows again moves to ordinary memory, when there is some.
 */
#include "memory_reserve.h"

#include "base/error.h"

#include <malloc.h>
#include <stdalign.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <uv.h>

enum { RESERVE_BYTES = 256 * 1024, ALIGNMENT = alignof(max_align_t) };

/* Before each block of the reserve. */
struct head {
    alignas(max_align_t) size_t bytes; /* of the block */
};

static struct {
    uv_mutex_t lock;
    size_t used;
    size_t blocks; /* that were not given back */
    alignas(max_align_t) unsigned char bytes[RESERVE_BYTES];
} reserve;

static bool is_reserved(const void *memory)
{
    uintptr_t at = (uintptr_t)memory, begin = (uintptr_t)reserve.bytes;
    return at >= begin && at < begin + RESERVE_BYTES;
}

static void *take(size_t bytes)
{
    struct head *head = NULL;
    if (bytes >= RESERVE_BYTES)
        return NULL;
    size_t wanted = sizeof *head + (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    uv_mutex_lock(&reserve.lock);
    if (wanted <= RESERVE_BYTES - reserve.used) {
        head = (struct head *)(void *)(reserve.bytes + reserve.used);
        head->bytes = bytes;
        reserve.used += wanted;
        reserve.blocks++;
    }
    uv_mutex_unlock(&reserve.lock);
    return head != NULL ? head + 1 : NULL;
}

static void *allocate(size_t bytes)
{
    void *memory = malloc(bytes);
    return memory != NULL ? memory : take(bytes);
}

static void *allocate_zeroed(size_t count, size_t bytes)
{
    void *memory = calloc(count, bytes);
    if (memory != NULL || __builtin_mul_overflow(count, bytes, &bytes))
        return memory;
    memory = take(bytes);
    return memory != NULL ? memset(memory, 0, bytes) : NULL;
}

static void release(void *memory)
{
    if (!is_reserved(memory)) {
        free(memory);
        return;
    }
    uv_mutex_lock(&reserve.lock);
    if (--reserve.blocks == 0)
        reserve.used = 0;
    uv_mutex_unlock(&reserve.lock);
}

static void *reallocate(void *memory, size_t bytes)
{
    if (memory == NULL)
        return allocate(bytes);
    size_t held;
    void *moved;
    if (is_reserved(memory)) {
        held = ((struct head *)memory)[-1].bytes;
        moved = allocate(bytes);
    } else {
        moved = realloc(memory, bytes);
        if (moved != NULL)
            return moved;
        held = malloc_usable_size(memory);
        moved = take(bytes);
    }
    if (moved == NULL)
        return NULL;
    memcpy(moved, memory, bytes < held ? bytes : held);
    release(memory);
    return moved;
}

void skd_memory_reserve_start(void)
{
    int result = uv_mutex_init(&reserve.lock);
    SKD_ASSERT(result == 0);
    result = uv_replace_allocator(allocate, reallocate, allocate_zeroed, release);
    SKD_ASSERT(result == 0);
}
