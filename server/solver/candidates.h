/* Which bones a vertex might belong to: a ranked list for the choice of slots by evidence.
 *
 * Stage: before a solve that may change slots. Thread: any. Pure: scratch and lists are the
 * caller's. A vertex's list depends on the start of the session alone, within 8 rings of it, so
 * any split of a batch gives the same lists, and twins at a seam get equal ones.
 *
 * First the vertex's own bones at the start, the largest weight first. Then three rankings take
 * turns, each giving its next bone that the list does not have yet:
 *
 *   diffused  the start's weights after 8 rounds over the mesh, each of which replaces a vertex's
 *             row by the mean of its own and its neighbours'
 *   near      distance from the rest position to the bone's segments (its head to each child's
 *             head; a bone without children is a point)
 *   hops      sum_i w_i 2^-hops(i, j), as the thesis fills slots (7.5.1)
 *
 * No single ranking is safe: the mesh misses bones that have no weight nearby, distance finds the
 * other leg, hops break on flat hierarchies. Only bones of the vertex's own skin are listed.
 */
#ifndef SKD_SOLVER_CANDIDATES_H
#define SKD_SOLVER_CANDIDATES_H

#include "solver/slots.h"

enum { SKD_CANDIDATES_MAX = SKD_SLOT_COUNT_MAX };

struct skd_candidates_input {
    size_t vertex_count;               /* V */
    int slot_count;                    /* N of the start's rows */
    int bone_count;                    /* B */
    const uint8_t *hops;               /* [B][B] from skd_hops_build */
    const float *bone_heads;           /* [B][3] rest space */
    const int32_t *bone_parents;       /* [B] or -1 */
    const uint16_t *bone_skin;         /* [B] */
    const uint16_t *vertex_skin;       /* [V] */
    const float *rest;                 /* [V][3] at the start */
    const uint16_t *start_joints;      /* [V][N] or SKD_SLOT_EMPTY */
    const float *start_weights;        /* [V][N] */
    const uint32_t *neighbour_offsets; /* [V+1] mesh neighbours of the whole ring of twins, CSR */
    const uint32_t *neighbours;
    size_t count;
    const uint32_t *vertices; /* [count] whose lists are wanted, each named once */
};

/* Bytes of scratch that skd_candidates_fill needs, aligned as malloc aligns. */
size_t skd_candidates_scratch_bytes(const struct skd_candidates_input *input);

/* Writes lists [count][SKD_CANDIDATES_MAX] in rank order, SKD_SLOT_EMPTY where bones run out. */
void skd_candidates_fill(const struct skd_candidates_input *input, void *scratch, uint16_t *lists);

#endif
