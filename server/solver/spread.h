/* Bones that come to a vertex along the mesh: the fills INFECT and NEIGHBOURS.
 *
 * Stage: before the first stroke, inside solver/. Thread: any. Pure: scratch is the caller's.
 * Both find `joints` [V][N] with each vertex's own bones in its first slots and SKD_SLOT_EMPTY in
 * the others, and fill of the others what the mesh can give, from the left.
 */
#ifndef SKD_SOLVER_SPREAD_H
#define SKD_SOLVER_SPREAD_H

#include "solver/slots.h"

#include <stdbool.h>

/* Bytes of scratch for input->fill, 0 if that is no mesh fill. */
size_t skd_spread_scratch_bytes(const struct skd_slots_input *input);

void skd_spread_infect(const struct skd_slots_input *input, void *scratch, uint16_t *joints);
void skd_spread_neighbours(const struct skd_slots_input *input, void *scratch, uint16_t *joints);

/* How many of a vertex's slots are its own bones'. */
static inline int skd_own_count(const struct skd_slots_input *input, size_t vertex)
{
    const uint32_t count = input->influence_offsets[vertex + 1] - input->influence_offsets[vertex];
    return count < (uint32_t)input->slot_count ? (int)count : input->slot_count;
}

static inline bool skd_row_has(const uint16_t *row, int count, uint16_t bone)
{
    for (int i = 0; i < count; i++) {
        if (row[i] == bone)
            return true;
    }
    return false;
}

#endif
