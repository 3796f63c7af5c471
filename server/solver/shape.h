/* What weights cannot reach in one pose, as offsets of the rest position for that pose alone: a
 * corrective shape.
 *
 * Stage: [pure solve]. Thread: any. Pure, a vertex at a time.
 */
#ifndef SKD_SOLVER_SHAPE_H
#define SKD_SOLVER_SHAPE_H

#include "solver/solve.h"

/* Writes offsets_out [count][3] (bind space): skinned from rest + offset, the vertex lies at its
 * target. With B = sum_i w_i R_i, R_i the linear part of M_i, B offset = target - skinned(rest).
 *
 * Where a blend all but collapses (a twist of 180 degrees) an exact offset would be huge or none:
 * least squares with a ridge of 1e-4 of B's mean square, its bias taken out by three more rounds.
 * So directions that B shrinks to less than a hundredth get a part of the way at most.
 *
 * All arrays follow the order of the vertices: rest [count][3], joints and weights [count][N]
 * (SKD_SLOT_EMPTY is skipped), targets [count][3]; matrices [bones][12] of the pose. */
void skd_shape_solve(size_t count, int slot_count, const float *rest, const uint16_t *joints,
                     const float *weights, const double *matrices, const float *targets,
                     float *offsets_out);

#endif
