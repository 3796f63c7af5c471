/* Chooses the code for a batch: method, number of slots, instruction set. Skinning.
 *
 * Stage: [pure solve]. Thread: any. Owns nothing.
 */
#include "solver/solve.h"

#include "base/error.h"
#include "solver/active_set.h"
#include "solver/four_slots.h"
#include "solver/row_choice.h"
#include "solver/thesis.h"

/* Below this kappa^2 the anchor no longer makes every problem well posed in float64. */
static const double ridge_least = 1e-12;

struct skd_solve_options skd_solve_defaults(void)
{
    const struct skd_solve_options options = {
        .method = SKD_METHOD_EXACT,
        .constraint = SKD_CONSTRAINT_SIMPLEX,
        .simd = SKD_SIMD_AUTO,
        .stiffness = 0.008,
        .thesis_k = 0.05,
        .thesis_h = 1.2,
    };
    return options;
}

static skd_four_slots_solve *choose_four_slots(enum skd_simd simd)
{
#ifdef SKD_SOLVER_WIDE
    const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
    if (avx512 && (simd == SKD_SIMD_AUTO || simd == SKD_SIMD_AVX512))
        return skd_four_slots_avx512;
    if (__builtin_cpu_supports("avx2") && (simd == SKD_SIMD_AUTO || simd == SKD_SIMD_AVX2))
        return skd_four_slots_avx2;
#else
    (void)simd;
#endif
    return skd_four_slots_plain;
}

static bool has_closed_slot(const struct skd_solve_batch *batch, size_t item)
{
    const uint16_t *joints = batch->joints + 4 * (size_t)batch->vertices[item];
    for (int i = 0; i < 4; i++) {
        if (joints[i] == SKD_SLOT_EMPTY || (batch->bone_locked && batch->bone_locked[joints[i]]))
            return true;
    }
    return false;
}

static void solve_four_slots(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                             enum skd_simd simd)
{
    choose_four_slots(simd)(batch, plan);
    if (!plan->affine)
        return;
    /* Without bounds the lanes have no way to leave a slot out; such vertices are few. */
    for (size_t item = 0; item < batch->count; item++) {
        if (has_closed_slot(batch, item))
            skd_active_set_solve(batch, plan, item);
    }
}

static void keep(const struct skd_solve_batch *batch, size_t item)
{
    struct skd_row row;
    double e[SKD_SLOT_COUNT_MAX][3], r[3];
    const int n = batch->slot_count;
    row_gather(n, batch, item, &row);
    const double rest_size = row_edges(n, &row, e);
    const struct skd_scene scene = row_scene(n, e, row.carried[0], row.target, rest_size, 0.0);
    row_residual(n, e, &scene, row.before, r);
    for (int i = 0; i < n; i++)
        batch->weights_out[(size_t)n * item + (size_t)i] = (float)row.before[i];
    batch->residual_before[item] = batch->residual_after[item] = (float)row_length(r);
}

void skd_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options)
{
    SKD_ASSERT(batch->slot_count >= 1 && batch->slot_count <= SKD_SLOT_COUNT_MAX);
    SKD_ASSERT(options->length > 0.0 && options->stiffness >= 0.0);
    const double kappa_square = options->stiffness * options->stiffness;
    const struct skd_plan plan = {
        .ridge = options->length * options->length *
                 (kappa_square > ridge_least ? kappa_square : ridge_least),
        .affine = options->constraint == SKD_CONSTRAINT_AFFINE,
    };
    if (options->method == SKD_METHOD_EXACT && batch->slot_count == 4) {
        solve_four_slots(batch, &plan, options->simd);
        return;
    }
    for (size_t item = 0; item < batch->count; item++) {
        if (options->method == SKD_METHOD_EXACT)
            skd_active_set_solve(batch, &plan, item);
        else if (batch->slot_count == 4)
            skd_thesis_solve(batch, options, item);
        else
            keep(batch, item);
    }
}

void skd_skin(size_t count, const uint32_t *vertices, int slot_count, const float *rest,
              const uint16_t *joints, const float *weights, const double *matrices, float *out)
{
    for (size_t item = 0; item < count; item++) {
        const size_t vertex = vertices ? vertices[item] : item;
        const float *from = rest + 3 * vertex;
        const double v[3] = {(double)from[0], (double)from[1], (double)from[2]};
        double sum[3] = {0.0, 0.0, 0.0};
        for (size_t slot = (size_t)slot_count * vertex; slot < (size_t)slot_count * (vertex + 1);
             slot++) {
            double d[3];
            if (joints[slot] == SKD_SLOT_EMPTY)
                continue;
            row_carry(matrices + (size_t)SKD_MATRIX_SIZE * joints[slot], v, d);
            for (int axis = 0; axis < 3; axis++)
                sum[axis] += (double)weights[slot] * d[axis];
        }
        for (int axis = 0; axis < 3; axis++)
            out[3 * item + (size_t)axis] = (float)sum[axis];
    }
}
