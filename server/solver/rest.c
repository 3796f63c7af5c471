/* See rest.h.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns its stack only.
 */
#include "solver/rest.h"

#include "solver/bone_set.h"
#include "solver/guard.h"
#include "solver/row_choice.h"
#include "solver/symmetric3.h"

#include <string.h>

enum { ROUNDS = 40 };

static const double ridge_root = 1e-3; /* eta */
static const double reach_growth = 2.0;
static const double told_apart_least = 1e-3; /* of a weight's effect, what no offset could do */

/* A vertex on its way. */
struct state {
    struct skd_bone_set set;
    double rest[3];
};

/* B of a pose, row by row. */
static void blend(const struct skd_bone_set *set, const struct skd_aim *aim, double linear[3][3])
{
    memset(linear, 0, 9 * sizeof linear[0][0]);
    for (int i = 0; i < set->count; i++) {
        const double *matrix = aim->matrices + SKD_MATRIX_SIZE * (size_t)set->bones[i];
        for (int axis = 0; axis < 3; axis++) {
            for (int k = 0; k < 3; k++)
                linear[axis][k] += set->weights[i] * matrix[4 * axis + k];
        }
    }
}

/* Adds omega B^T B and omega B^T x. */
static void add_normal(double linear[3][3], double omega, const double x[3], double normal[3][3],
                       double right[3])
{
    for (int i = 0; i < 3; i++) {
        for (int axis = 0; axis < 3; axis++) {
            right[i] += omega * linear[axis][i] * x[axis];
            for (int j = 0; j < 3; j++)
                normal[i][j] += omega * linear[axis][i] * linear[axis][j];
        }
    }
}

static void move_rest(struct skd_subject *subject, const double origin[3], struct state *state)
{
    const double ridge = ridge_root * ridge_root * subject->strength;
    double normal[3][3] = {{ridge, 0, 0}, {0, ridge, 0}, {0, 0, ridge}};
    double right[3], step[3];
    memcpy(subject->rest, state->rest, sizeof subject->rest);
    skd_bone_set_show(&state->set, subject);
    for (int axis = 0; axis < 3; axis++)
        right[axis] = ridge * (origin[axis] - state->rest[axis]);
    for (int p = 0; p < subject->aim_count; p++) {
        const struct skd_aim *aim = &subject->aims[p];
        double linear[3][3], missing[3];
        blend(&state->set, aim, linear);
        for (int axis = 0; axis < 3; axis++)
            missing[axis] = aim->target[axis] - aim->shown[axis];
        add_normal(linear, aim->strength, missing, normal, right);
    }
    skd_symmetric3_solve(normal, right, step);
    for (int axis = 0; axis < 3; axis++)
        state->rest[axis] += step[axis];
}

static void move_weights(struct skd_subject *subject, struct state *state)
{
    struct skd_problem problem;
    int open[SKD_SLOT_COUNT_MAX];
    double w[SKD_SLOT_COUNT_MAX];
    memcpy(subject->rest, state->rest, sizeof subject->rest);
    if (!skd_bone_set_problem(&state->set, subject, subject->options->stiffness, &problem, open))
        return;
    for (int r = 0; r < problem.count; r++)
        w[r] = state->set.weights[open[r]];
    skd_problem_minimise(&problem, subject->options->constraint == SKD_CONSTRAINT_AFFINE, w);
    for (int r = 0; r < problem.count; r++)
        state->set.weights[open[r]] = w[r];
}

/* lambda mean_q |sum_i z_i d_i|^2 for z the change since the start. */
static double guard_energy(const struct skd_subject *subject, const struct state *state)
{
    const struct skd_solve_batch *batch = subject->batch;
    uint16_t bones[2 * SKD_SLOT_COUNT_MAX];
    double z[2 * SKD_SLOT_COUNT_MAX], sum = 0.0;
    int count = 0;
    for (int i = 0; i < state->set.count; i++) {
        bones[count] = state->set.bones[i];
        z[count++] = state->set.weights[i];
    }
    for (int slot = 0; slot < batch->slot_count; slot++) {
        if (subject->start_joints[slot] == SKD_SLOT_EMPTY)
            continue;
        bones[count] = subject->start_joints[slot];
        z[count++] = -(double)subject->start_weights[slot];
    }
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < i; j++)
            sum -= z[i] * z[j] * skd_guard_pair(batch->guard, bones[i], bones[j], state->rest);
    }
    return subject->options->guard * sum;
}

/* E up to what neither weights nor rest change. */
static double energy_of(struct skd_subject *subject, const double origin[3],
                        const struct state *state)
{
    const double length = subject->options->length;
    const double ridge = length * length * row_kappa_square(subject->options->stiffness);
    double drawn = 0.0, moved = 0.0;
    memcpy(subject->rest, state->rest, sizeof subject->rest);
    const double left = skd_bone_set_show(&state->set, subject);
    for (int i = 0; i < state->set.count; i++) {
        const double apart = state->set.weights[i] - state->set.anchor[i];
        drawn += apart * apart;
    }
    for (int axis = 0; axis < 3; axis++)
        moved += (state->rest[axis] - origin[axis]) * (state->rest[axis] - origin[axis]);
    const double guarded = subject->batch->guard ? guard_energy(subject, state) : 0.0;
    return subject->strength * (left * left + ridge_root * ridge_root * moved) + ridge * drawn +
           guarded;
}

/* Whether some weight does next to nothing that an offset could not do as well: the stacked edge
 * e_i(p) of a slot, relative to the heaviest, lies in the columns of the stacked B_p. */
static bool is_doubtful(const struct skd_subject *subject, const struct state *state)
{
    const struct skd_bone_set *set = &state->set;
    int base = 0;
    if (subject->aim_count < 3)
        return true;
    for (int i = 1; i < set->count; i++)
        base = set->weights[i] > set->weights[base] ? i : base;
    for (int i = 0; i < set->count; i++) {
        double normal[3][3] = {{0}}, right[3] = {0}, offset[3], all = 0.0, explained = 0.0;
        if (i == base || !(set->weights[i] > 0.0))
            continue;
        for (int p = 0; p < subject->aim_count; p++) {
            const struct skd_aim *aim = &subject->aims[p];
            double linear[3][3], from[3], to[3];
            blend(set, aim, linear);
            row_carry(aim->matrices + SKD_MATRIX_SIZE * (size_t)set->bones[base], state->rest,
                      from);
            row_carry(aim->matrices + SKD_MATRIX_SIZE * (size_t)set->bones[i], state->rest, to);
            for (int axis = 0; axis < 3; axis++) {
                to[axis] -= from[axis];
                all += aim->strength * to[axis] * to[axis];
            }
            add_normal(linear, aim->strength, to, normal, right);
        }
        for (int axis = 0; axis < 3; axis++)
            normal[axis][axis] += 1e-12 * subject->strength;
        skd_symmetric3_solve(normal, right, offset);
        for (int axis = 0; axis < 3; axis++)
            explained += offset[axis] * right[axis];
        if (!(all - explained > told_apart_least * all))
            return true;
    }
    return false;
}

/* Where an offset and weights pull at each other, a round goes a small part of a long straight way:
 * so each looks further along what the offset just did, further still the next time if that paid.
 */
static void alternate(struct skd_subject *subject, const double origin[3], struct state *state)
{
    double reach = 1.0;
    for (int round = 0; round < ROUNDS; round++) {
        const double from[3] = {state->rest[0], state->rest[1], state->rest[2]};
        move_rest(subject, origin, state);
        move_weights(subject, state);
        struct state further = *state;
        for (int axis = 0; axis < 3; axis++)
            further.rest[axis] += reach * (state->rest[axis] - from[axis]);
        move_weights(subject, &further);
        const bool pays = energy_of(subject, origin, &further) < energy_of(subject, origin, state);
        if (pays)
            *state = further;
        reach = pays ? reach * reach_growth : 1.0;
    }
}

/* Rounds as stored. */
static void store(struct state *state, const struct skd_subject *subject, double plane)
{
    static const double none[SKD_SLOT_COUNT_MAX];
    const uint8_t *locked = subject->batch->bone_locked;
    double open[SKD_SLOT_COUNT_MAX];
    for (int i = 0; i < state->set.count; i++)
        open[i] = locked && locked[state->set.bones[i]] ? 0.0 : 1.0;
    row_store(state->set.count, plane, open, none, state->set.weights);
    for (int axis = 0; axis < 3; axis++)
        state->rest[axis] = (double)(float)state->rest[axis];
}

static void solve_item(struct skd_subject *subject, const uint16_t *joints, float *weights,
                       float *rest, uint8_t *doubtful)
{
    const int n = subject->batch->slot_count;
    const double origin[3] = {(double)rest[0], (double)rest[1], (double)rest[2]};
    struct state before = {.rest = {origin[0], origin[1], origin[2]}}, after;
    for (int i = 0; i < n; i++) {
        if (joints[i] != SKD_SLOT_EMPTY)
            skd_bone_set_add(&before.set, subject, joints[i], (double)weights[i], 0.0);
    }
    if (before.set.count == 0)
        return;
    after = before;
    alternate(subject, origin, &after);
    store(&after, subject, row_plane(before.set.count, before.set.weights));
    const bool affine = subject->options->constraint == SKD_CONSTRAINT_AFFINE;
    if (!(row_is_valid(after.set.count, after.set.weights, affine ? 1.0 : 0.0) > 0.0) ||
        !(energy_of(subject, origin, &after) < energy_of(subject, origin, &before)))
        return;
    for (int i = 0, k = 0; i < n; i++) {
        if (joints[i] != SKD_SLOT_EMPTY)
            weights[i] = (float)after.set.weights[k++];
    }
    for (int axis = 0; axis < 3; axis++)
        rest[axis] = (float)after.rest[axis];
    *doubtful = is_doubtful(subject, &after);
}

void skd_rest_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options,
                    const uint16_t *joints, float *weights, float *rest_out, uint8_t *doubtful_out)
{
    const size_t n = (size_t)batch->slot_count;
    for (size_t item = 0; item < batch->count; item++) {
        struct skd_subject subject;
        doubtful_out[item] = 0;
        if (batch->vertex_locked && batch->vertex_locked[batch->vertices[item]])
            continue;
        skd_subject_read(batch, options, item, &subject);
        if (subject.aim_count >= 2)
            solve_item(&subject, joints + n * item, weights + n * item, rest_out + 3 * item,
                       &doubtful_out[item]);
    }
}
