/* Slots chosen by what the targets say, instead of by where the vertex lies.
 *
 * Stage: [pure solve]. Thread: any; no allocation, no state. Every vertex is a problem of its own,
 * so any split of a batch gives the same bits.
 *
 * Of a vertex's candidate bones (candidates.h) the N that serve its targets best: solve for all of
 * them together, then drop, again and again, the bone without which the energy rises least. The
 * largest N of the joint solve are not the best N where bones move together.
 *
 *   candidates  8 with 1 to 3 target poses, 12 from 4. Where, from two poses on, more than
 *               max(3e-5 L, 0.05 % of the edit) is left after that, 16 with the bones of steepest
 *               descent among all of the skin's: the best step towards one, not the slope.
 *   prior       rho L^2 rank/16 on F_i of bones that the start does not have (rho = 1e-6 with one
 *               target pose, 3e-7 from two): of bones that explain the targets alike, the
 *               likelier. A slot's bone that is on no list counts as rank 16.
 *   one pose    says little about bones: slots are kept unless they leave more than 1e-3 L of the
 *               target at kappa = 1e-4, whatever kappa the solve itself has.
 *
 * The result is compared with the plain solve on the slots that the vertex has, under the energy of
 * solve.h: what is not lower is not taken.
 */
#ifndef SKD_SOLVER_EVIDENCE_H
#define SKD_SOLVER_EVIDENCE_H

#include "solver/candidates.h"

enum { SKD_EVIDENCE_POSES_MAX = 512 }; /* of a batch */

struct skd_evidence_bones {
    int bone_count;
    const uint16_t *bone_skin;   /* [B] */
    const uint16_t *vertex_skin; /* [V] */
    const uint16_t *lists;       /* [count][SKD_CANDIDATES_MAX] by item, from skd_candidates_fill */
};

/* Solves the batch as skd_solve does (SKD_METHOD_EXACT; pulls must be NULL) and writes all its
 * outputs, the weights laid out by joints_out [count][N].
 *
 * A vertex that is better served by its own slots, is locked, or has no target keeps its row of
 * `joints` bit for bit. In a row that changes, locked bones keep slot and weight, and slots that
 * are not needed get the next candidates with weight 0 (SKD_SLOT_EMPTY where the list ends), so
 * that later strokes can use them. Rows of more than 8 slots, and an affine solve, keep theirs. */
void skd_evidence_solve(const struct skd_solve_batch *batch,
                        const struct skd_solve_options *options,
                        const struct skd_evidence_bones *bones, uint16_t *joints_out);

#endif
