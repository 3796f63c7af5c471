/* From posed targets to skin weights, one vertex at a time: the pure core of skind.
 *
 * Stage: [pure solve]. Thread: any; calls share nothing but what they read.
 * Arrays in, arrays out: no allocation, no I/O, no clock, no state. Every vertex is a problem of
 * its own, so any split of a batch, any number of workers and any instruction set give the same
 * bits.
 *
 * For a vertex with rest position v, slots i = 0..N-1 (a bone b_i and a weight w_i), carried
 * rigidly to d_i(p) = M_bi(p) v in pose p, with L the size of the character:
 *
 *     f(w) = sum_p omega_p |sum_i w_i d_i(p) - t_p|^2           every pose with a target t_p
 *          + lambda mean_q |sum_i w_i d_i(q) - sum_j o_j d_j(q)|^2   every guard pose (guard.h)
 *          + (kappa L)^2 |w - o|^2                              the anchor
 *          + (mu L)^2 |w - u|^2                                 the pull of smoothing
 *
 * is minimised over { w >= 0, sum w = 1 } (SIMPLEX) or { sum w = 1 } (AFFINE). o are the weights at
 * the start of the session: over the start's bones for the guard, and for the anchor laid out by
 * the slots of today, 0 for a bone that the start did not have. A bone of the start that has no
 * slot any more weighs 0 today. Locked slots keep their weight and the others share what is left.
 * A slot without a bone (SKD_SLOT_EMPTY) weighs 0. A bone has one slot of a vertex at most.
 *
 * What is stored is float32: w >= 0 (SIMPLEX), |sum w - 1| <= 1e-7, and never a higher energy than
 * the weights before the call or the anchor had; when rounding or a hopeless target leaves no
 * better choice, the weights from before come back bit for bit. A row keeps the sum that it had,
 * to the last bit where float32 can: else rounding of the sum would decide about small strokes.
 * An anchor that differs in a locked slot, or lacks a bone of the start, is no choice for that row.
 * With one target and the anchor as the weights before, no vertex ends farther from the target than
 * it was (unless pulls ask for it).
 *
 * SKD_METHOD_THESIS is Rubino's solver of 2020 (chapters 6.4 and 7.6: k = 0.05 and h = 1.2 in
 * squared scene units, penalties for negative weights, the min-max step) for comparison. It knows
 * the first pose only and no other term, and is defined for exactly four slots, each with a bone
 * that is not locked; other vertices it leaves as they are.
 */
#ifndef SKD_SOLVER_SOLVE_H
#define SKD_SOLVER_SOLVE_H

#include <stddef.h>
#include <stdint.h>

enum {
    SKD_SLOT_COUNT_MAX = 16, /* what the exact solve takes; users are offered 4 and 8 */
    SKD_MATRIX_SIZE = 12     /* doubles of a 3x4 matrix, row by row */
};

/* What stands in `joints` for a slot without a bone (the status SKD_NO_BONE is something else). */
#define SKD_SLOT_EMPTY UINT16_MAX

enum skd_method { SKD_METHOD_EXACT, SKD_METHOD_THESIS };
enum skd_constraint { SKD_CONSTRAINT_SIMPLEX, SKD_CONSTRAINT_AFFINE };

/* Which code solves four slots. All give the same bits; AUTO takes the widest this CPU has.
 * The others are for tests and benchmarks. An instruction set that the CPU or the build lacks
 * falls back to PLAIN. */
enum skd_simd { SKD_SIMD_AUTO, SKD_SIMD_PLAIN, SKD_SIMD_AVX2, SKD_SIMD_AVX512 };

struct skd_solve_options {
    enum skd_method method;
    enum skd_constraint constraint;
    enum skd_simd simd;
    double stiffness; /* kappa, without unit; kappa^2 counts as 1e-12 at least */
    double length;    /* L > 0, scene units */
    double guard;     /* lambda, without unit; counts where the batch has a guard */
    double smooth;    /* mu, without unit; counts where the batch has pulls */
    double thesis_k;  /* 0.05 in the thesis, scene units */
    double thesis_h;  /* 1.2 in the thesis, squared scene units */
};

/* The defaults: exact, simplex, kappa = 0.008, lambda = 0.3, mu = 0, the thesis's k and h. length
 * is left at 0. */
struct skd_solve_options skd_solve_defaults(void);

struct skd_guard;

/* A pose in which vertices have targets; arrays follow the order of the batch's vertices. */
struct skd_solve_pose {
    const double *matrices; /* [bones][12] posed bone x inverse bind */
    const float *targets;   /* [count][3] posed positions wanted, finite everywhere */
    const float *strengths; /* [count] omega; 0: no target in this pose; NULL: all 1 */
};

/* A run of vertices to solve. Arrays marked [V] belong to the session and are indexed by vertex;
 * those marked [count] follow the order of `vertices`. Nothing is kept after the call. */
struct skd_solve_batch {
    size_t count;
    int slot_count;           /* N: 1..SKD_SLOT_COUNT_MAX */
    const uint32_t *vertices; /* [count] indexes into the [V] arrays, each named once */
    int pose_count;           /* >= 1 */
    const struct skd_solve_pose *poses;

    const float *rest;             /* [V][3] bind space */
    const uint16_t *joints;        /* [V][N] bone of each slot, or SKD_SLOT_EMPTY */
    const float *weights;          /* [V][N] before this stroke */
    const float *anchor;           /* [V][N] at the session's start */
    const uint8_t *vertex_locked;  /* [V] not 0: leave as it is; NULL: none */
    const uint8_t *bone_locked;    /* [bones] not 0: its weights stay; NULL: none */
    const uint16_t *start_joints;  /* [V][N] the slots at the session's start; NULL: `joints` */
    const float *start_weights;    /* [V][N] and what they weighed; NULL: `anchor` */
    const struct skd_guard *guard; /* poses to keep as they were; NULL: none */
    const float *pulls;            /* [count][N] what smoothing draws to; NULL: nothing */

    float *weights_out;     /* [count][N] */
    float *residual_before; /* [count] distance to the first pose's target with `weights`,
                               scene units */
    float *residual_after;  /* [count] the same with weights_out */
    float *leftover_out;    /* [count] root of the mean of omega |r|^2 over the vertex's targets,
                               with weights_out; NULL: not wanted */
};

/* Solves the batch. Input must have been checked: indexes in range, all numbers finite. */
void skd_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options);

/* Moves `count` vertices by linear blend skinning: out[i] = sum_j w_ij M_bj v_i, in float64,
 * stored as float32. `vertices` NULL means 0..count-1. Slots without a bone are skipped. */
void skd_skin(size_t count, const uint32_t *vertices, int slot_count, const float *rest,
              const uint16_t *joints, const float *weights, const double *matrices, float *out);

#endif
