/* Hops between bones: edges of the hierarchy through the nearest common ancestor.
 *
 * Stage: before the first stroke. Thread: any. Pure: the table is the caller's.
 */
#include "solver/slots.h"

#include <string.h>

enum { HOPS_MOST = 254 };

static uint8_t farther(size_t hops)
{
    return hops < HOPS_MOST ? (uint8_t)hops : (uint8_t)HOPS_MOST;
}

/* Fills the row of one bone. A bone is as far as its parent plus one, unless the way up from `from`
 * passes through it. The row itself says what is known already. */
static void build_row(int bone_count, const int32_t *parents, int32_t from, uint8_t *row)
{
    size_t up = 0;
    memset(row, SKD_HOPS_APART, (size_t)bone_count);
    for (int32_t bone = from; bone >= 0; bone = parents[bone])
        row[bone] = farther(up++);
    for (int32_t bone = 0; bone < bone_count; bone++) {
        size_t hops = 0;
        int32_t known = bone;
        while (known >= 0 && row[known] == SKD_HOPS_APART) {
            known = parents[known];
            hops++;
        }
        if (known < 0)
            continue;
        hops += row[known];
        for (int32_t at = bone; at != known; at = parents[at])
            row[at] = farther(hops--);
    }
}

void skd_hops_build(int bone_count, const int32_t *parents, uint8_t *hops)
{
    for (int32_t bone = 0; bone < bone_count; bone++)
        build_row(bone_count, parents, bone, hops + (size_t)bone * (size_t)bone_count);
}
