/* The exact solve for four slots, a tile of vertices at a time. One source, four_slots.c, is
 * compiled once for each instruction set; the bits are the same.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#ifndef SKD_SOLVER_FOUR_SLOTS_H
#define SKD_SOLVER_FOUR_SLOTS_H

#include "solver/row.h"

/* Solves the whole batch (slot_count is 4) and writes all its outputs. With an affine plan,
 * vertices that have a locked or empty slot keep their weights. */
typedef void skd_four_slots_solve(const struct skd_solve_batch *batch, const struct skd_plan *plan);

skd_four_slots_solve skd_four_slots_plain;
skd_four_slots_solve skd_four_slots_avx2;
skd_four_slots_solve skd_four_slots_avx512;

#endif
