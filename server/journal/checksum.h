/* Checksums of rows: XXH3, 64 bits, each piece seeded with what came before it.
 *
 * Stage: journal. Thread: any; no state. They find what a disk or a crash did to a file, not what a
 * person did: a file made on purpose is held against the session's own rules (session/restore.h).
 */
#ifndef SKD_JOURNAL_CHECKSUM_H
#define SKD_JOURNAL_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <xxhash.h>

static inline uint64_t skd_sum_bytes(uint64_t sum, const void *bytes, size_t count)
{
    return XXH3_64bits_withSeed(bytes, count, sum);
}

static inline uint64_t skd_sum_number(uint64_t sum, uint64_t number)
{
    return skd_sum_bytes(sum, &number, sizeof number);
}

static inline uint64_t skd_sum_text(uint64_t sum, const char *text)
{
    return skd_sum_bytes(sum, text, strlen(text) + 1);
}

#endif
