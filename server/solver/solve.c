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

struct skd_solve_options skd_solve_defaults(void)
{
    const struct skd_solve_options options = {
        .method = SKD_METHOD_EXACT,
        .constraint = SKD_CONSTRAINT_SIMPLEX,
        .simd = SKD_SIMD_AUTO,
        .stiffness = 0.008,
        .guard = 0.3,
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

static void solve_four_slots(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                             enum skd_simd simd)
{
    choose_four_slots(simd)(batch, plan);
    /* Without bounds the lanes have no way to leave a slot out; such vertices are few. */
    if (plan->affine)
        skd_active_set_solve(batch, plan, true);
}

static void keep(const struct skd_solve_batch *batch, size_t item)
{
    struct skd_row row;
    double e[SKD_SLOT_COUNT_MAX][3], r[3];
    const int n = batch->slot_count;
    SKD_ASSERT(n >= 1);
    row_gather(n, batch, item, &row);
    const double rest_size = row_edges(n, &row, e);
    const struct skd_scene scene = row_scene(n, e, row.carried[0], row.target, rest_size);
    row_residual(n, e, &scene, row.before, r);
    for (int i = 0; i < n; i++)
        batch->weights_out[(size_t)n * item + (size_t)i] = (float)row.before[i];
    batch->residual_before[item] = batch->residual_after[item] = (float)row_length(r);
}

/* |r|^2 of a vertex in one pose, with the weights just found. */
static double leftover_square(const struct skd_solve_batch *batch,
                              const struct skd_solve_pose *pose, size_t item)
{
    const size_t n = (size_t)batch->slot_count;
    const size_t vertex = batch->vertices[item];
    const uint16_t *joints = batch->joints + n * vertex;
    const float *from = batch->rest + 3 * vertex;
    const double v[3] = {(double)from[0], (double)from[1], (double)from[2]};
    double r[3];
    for (int axis = 0; axis < 3; axis++)
        r[axis] = -(double)pose->targets[3 * item + (size_t)axis];
    for (size_t i = 0; i < n; i++) {
        double d[3];
        if (joints[i] == SKD_SLOT_EMPTY)
            continue;
        row_carry(pose->matrices + (size_t)SKD_MATRIX_SIZE * joints[i], v, d);
        for (int axis = 0; axis < 3; axis++)
            r[axis] += (double)batch->weights_out[n * item + i] * d[axis];
    }
    return r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
}

static void tell_leftover(const struct skd_solve_batch *batch, size_t item)
{
    double squares = 0.0, strengths = 0.0;
    for (int p = 0; p < batch->pose_count; p++) {
        const struct skd_solve_pose *pose = batch->poses + p;
        const double strength = pose->strengths ? (double)pose->strengths[item] : 1.0;
        if (strength > 0.0) {
            squares += strength * leftover_square(batch, pose, item);
            strengths += strength;
        }
    }
    batch->leftover_out[item] = strengths > 0.0 ? (float)sqrt(squares / strengths) : 0.0F;
}

static struct skd_plan make_plan(const struct skd_solve_batch *batch,
                                 const struct skd_solve_options *options)
{
    const double anchor = row_kappa_square(options->stiffness);
    const double pull = batch->pulls ? options->smooth * options->smooth : 0.0;
    const struct skd_plan plan = {
        .ridge = options->length * options->length * (anchor + pull),
        .pull = pull / (anchor + pull),
        .guard = batch->guard ? options->guard : 0.0,
        .affine = options->constraint == SKD_CONSTRAINT_AFFINE,
        .is_simple = batch->pose_count == 1 && !batch->poses[0].strengths && !batch->guard &&
                     !batch->pulls && !batch->start_joints,
    };
    return plan;
}

void skd_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options)
{
    SKD_ASSERT(batch->slot_count >= 1 && batch->slot_count <= SKD_SLOT_COUNT_MAX);
    SKD_ASSERT(batch->pose_count >= 1 && batch->poses);
    SKD_ASSERT(!batch->start_joints == !batch->start_weights);
    SKD_ASSERT(options->length > 0.0 && options->stiffness >= 0.0);
    SKD_ASSERT(options->guard >= 0.0 && options->smooth >= 0.0);
    const struct skd_plan plan = make_plan(batch, options);
    if (options->method == SKD_METHOD_EXACT && batch->slot_count == 4) {
        solve_four_slots(batch, &plan, options->simd);
    } else if (options->method == SKD_METHOD_EXACT) {
        skd_active_set_solve(batch, &plan, false);
    } else {
        for (size_t item = 0; item < batch->count; item++) {
            if (batch->slot_count == 4)
                skd_thesis_solve(batch, options, item);
            else
                keep(batch, item);
        }
    }
    for (size_t item = 0; batch->leftover_out && item < batch->count; item++)
        tell_leftover(batch, item);
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
