/* Which bones a vertex may use: from the influences of a file to N slots a vertex.
 *
 * Stage: before the first stroke. Thread: any. Pure: scratch and results are the caller's.
 *
 * A vertex of K influences gets N slots: its own bones first (largest weight first, equal weights
 * by bone index), then N - K bones of weight 0 that the solver may raise. Which ones is the fill:
 *
 *   HOP        thesis 7.5.1: bones of largest sum_i w_i 2^-hops(i, j), the top-4 loop mended;
 *              a bone that shares no ancestor with any of the vertex's own is never near
 *   INFECT     thesis 7.5.2: bones spread along mesh edges, nearer ones replace farther ones
 *   NEIGHBOURS bones of the mesh neighbours, by their weight there, ring after ring, 8 rings
 *   NONE       the slots stay empty (SKD_SLOT_EMPTY)
 *
 * What a mesh fill cannot give (an island, a loose vertex) is filled by hops. Only bones of the
 * vertex's own skin are taken; when they run out the slot stays SKD_SLOT_EMPTY.
 */
#ifndef SKD_SOLVER_SLOTS_H
#define SKD_SOLVER_SLOTS_H

#include "solver/solve.h"

enum skd_fill { SKD_FILL_HOP, SKD_FILL_INFECT, SKD_FILL_NEIGHBOURS, SKD_FILL_NONE };

/* Hops between two bones with no common ancestor. */
#define SKD_HOPS_APART UINT8_MAX

/* hops[i * bone_count + j] = edges of the hierarchy between bones i and j through their nearest
 * common ancestor, at most 254, or SKD_HOPS_APART. parents[b] is b's parent or -1; any order, no
 * cycles. */
void skd_hops_build(int bone_count, const int32_t *parents, uint8_t *hops);

struct skd_slots_input {
    size_t vertex_count; /* V */
    int slot_count;      /* N */
    enum skd_fill fill;
    int bone_count;              /* B */
    const uint8_t *hops;         /* [B][B] from skd_hops_build */
    const float *bone_heads;     /* [B][3] where each bone begins, in rest space (INFECT) */
    const uint16_t *bone_skin;   /* [B] skin of each bone */
    const uint16_t *vertex_skin; /* [V] skin of each vertex */
    const float *rest;           /* [V][3] */
    /* Influences, CSR: those of vertex v are [offsets[v], offsets[v+1]), weights > 0 summing to
     * one, no bone twice. */
    const uint32_t *influence_offsets; /* [V+1] */
    const uint16_t *influence_joints;
    const float *influence_weights;
    /* Mesh neighbours, CSR, seam twins already taken together. */
    const uint32_t *neighbour_offsets; /* [V+1] */
    const uint32_t *neighbours;
};

struct skd_slots_report {
    size_t reduced_count; /* vertices that had more than N influences */
    size_t filled_count;  /* slots given a new bone of weight 0 */
    size_t empty_count;   /* slots left SKD_SLOT_EMPTY */
    float largest_cut;    /* the most weight that one vertex lost by the reduction */
};

/* Bytes of scratch that skd_slots_fill needs, aligned as malloc aligns; 0 for HOP and NONE. */
size_t skd_slots_scratch_bytes(const struct skd_slots_input *input);

/* Writes joints_out [V][N] and weights_out [V][N]. A vertex with more than N influences keeps the
 * N largest, scaled to sum to one; whether that is allowed is the caller's question to the user.
 * Each row sums to one within 1e-7 as stored; a row that needs no reduction keeps its weights'
 * bits. The same for any order of neighbours in a ring. */
void skd_slots_fill(const struct skd_slots_input *input, void *scratch, uint16_t *joints_out,
                    float *weights_out, struct skd_slots_report *report);

/* Makes a row of N weights, none negative and their sum above 0, sum to one within 1e-7 as stored.
 * A row that does already keeps its bits. Slots without a bone weigh 0, and stay so. */
void skd_slots_normalise(int slot_count, const uint16_t *joints, float *weights);

#endif
