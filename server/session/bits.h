/* A bit a vertex: what was named, what was walked. Zeroed memory of skd_bits_bytes holds `count`.
 *
 * Stage: job. Thread: any.
 */
#ifndef SKD_SESSION_BITS_H
#define SKD_SESSION_BITS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

static inline size_t skd_bits_bytes(size_t count)
{
    return count / 8 + 1;
}

static inline bool skd_bits_has(const uint8_t *bits, uint32_t index)
{
    return (bits[index >> 3] >> (index & 7) & 1) != 0;
}

/* Sets a bit; true when it was set already. */
static inline bool skd_bits_take(uint8_t *bits, uint32_t index)
{
    bool taken = skd_bits_has(bits, index);
    bits[index >> 3] |= (uint8_t)(1u << (index & 7));
    return taken;
}

#endif
