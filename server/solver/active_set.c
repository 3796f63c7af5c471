/* Any number of slots, exactly: minimise sum w_i F_i - sum w_i w_j L_ij over the open slots.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns its stack only.
 * A primal active set, as Lawson and Hanson's for non-negative least squares, with the sum as one
 * more condition. The face is the set of slots that may be above zero. Starting from the weights
 * before the stroke:
 *
 *     descend   to the minimum over the face's plane; a slot that would go below zero stops the
 *               step there and leaves the face; again, until nothing stops it
 *     enter     the slot outside of the face whose slope is lowest, if it is below the face's
 *
 * The energy falls with every slot that enters and stays, so no face comes twice. A slot that
 * enters and is put out at once (rounding) is barred until another stays, and rounds are counted,
 * so it ends whatever the numbers are; row_choose() then takes nothing worse than what was there.
 */
#include "solver/active_set.h"

#include "solver/row_choice.h"
#include "solver/row_energy.h"

enum { SLOTS_MAX = SKD_SLOT_COUNT_MAX };

struct problem {
    int count; /* open slots, numbered 0..count-1 here */
    double mass;
    double ridge;
    double corners[SLOTS_MAX];
    double pairs[SLOTS_MAX][SLOTS_MAX]; /* symmetric, 0 on the diagonal */
};

struct face {
    int count;
    int slots[SLOTS_MAX];
};

static void face_remove(struct face *face, int at)
{
    face->count--;
    for (int i = at; i < face->count; i++)
        face->slots[i] = face->slots[i + 1];
}

/* The minimum over the face's plane, in the order of the face's slots. With base b the others'
 * weights solve A x = c, A_ij = 1/2 (L_ib + L_jb - L_ij), c_i = 1/2 (mass L_ib + F_b - F_i). */
static void face_minimum(const struct problem *problem, const struct face *face, double *x)
{
    double lower[SLOTS_MAX][SLOTS_MAX], pivots[SLOTS_MAX];
    const int base = face->slots[0];
    const double *to_base = problem->pairs[base];
    const int size = face->count - 1;
    double *y = x + 1;
    for (int r = 0; r < size; r++) {
        const int i = face->slots[r + 1];
        double left =
            0.5 * (problem->mass * to_base[i] + (problem->corners[base] - problem->corners[i]));
        double pivot = to_base[i];
        for (int s = 0; s < r; s++) {
            const int j = face->slots[s + 1];
            double entry = 0.5 * (to_base[i] + to_base[j] - problem->pairs[i][j]);
            for (int k = 0; k < s; k++)
                entry -= lower[r][k] * lower[s][k] * pivots[k];
            lower[r][s] = entry / pivots[s];
            pivot -= lower[r][s] * entry;
            left -= lower[r][s] * y[s];
        }
        /* No pivot of a ridged matrix is below the ridge, except by rounding. */
        pivots[r] = pivot > problem->ridge ? pivot : problem->ridge;
        y[r] = left;
    }
    double rest = problem->mass;
    for (int r = size - 1; r >= 0; r--) {
        y[r] /= pivots[r];
        for (int s = r + 1; s < size; s++)
            y[r] -= lower[s][r] * y[s];
        rest -= y[r];
    }
    x[0] = rest;
}

/* Moves w to the minimum over the face, putting out slots that reach zero on the way. */
static void descend(const struct problem *problem, struct face *face, double *w)
{
    while (face->count > 0) {
        double x[SLOTS_MAX];
        double step = 1.0;
        int stop = -1;
        face_minimum(problem, face, x);
        for (int i = 0; i < face->count; i++) {
            const double here = w[face->slots[i]];
            if (x[i] < 0.0 && here <= step * (here - x[i])) {
                step = here / (here - x[i]);
                stop = i;
            }
        }
        for (int i = 0; i < face->count; i++) {
            double *here = &w[face->slots[i]];
            *here = stop < 0 ? x[i] : *here + step * (x[i] - *here);
        }
        if (stop < 0)
            return;
        w[face->slots[stop]] = 0.0;
        face_remove(face, stop);
        for (int i = face->count - 1; i >= 0; i--) {
            if (w[face->slots[i]] <= 0.0) {
                w[face->slots[i]] = 0.0;
                face_remove(face, i);
            }
        }
    }
}

/* The slot outside of the face that lowers the energy fastest, or -1. */
static int find_entering(const struct problem *problem, const struct face *face, const bool *barred,
                         const double *w)
{
    double slopes[SLOTS_MAX], level = INFINITY, size = 0.0;
    bool inside[SLOTS_MAX] = {false};
    for (int i = 0; i < problem->count; i++) {
        double bent = 0.0;
        for (int k = 0; k < face->count; k++)
            bent += w[face->slots[k]] * problem->pairs[i][face->slots[k]];
        slopes[i] = problem->corners[i] - bent;
        size = bent > size ? bent : size;
    }
    for (int k = 0; k < face->count; k++) {
        const int i = face->slots[k];
        inside[i] = true;
        level = slopes[i] < level ? slopes[i] : level;
    }
    int entering = -1;
    double lowest = level - 0x1p-50 * (size + fabs(level));
    for (int i = 0; i < problem->count; i++) {
        if (!inside[i] && !barred[i] && slopes[i] < lowest) {
            lowest = slopes[i];
            entering = i;
        }
    }
    return entering;
}

/* Starts at the given weights, which need not be feasible, and ends at the minimum. */
static void minimise(const struct problem *problem, bool affine, double *w)
{
    struct face face = {0};
    bool barred[SLOTS_MAX] = {false};
    double sum = 0.0;
    for (int i = 0; i < problem->count; i++) {
        w[i] = w[i] > 0.0 ? w[i] : 0.0;
        sum += w[i];
        if (affine || w[i] > 0.0)
            face.slots[face.count++] = i;
    }
    if (affine) {
        double x[SLOTS_MAX];
        face_minimum(problem, &face, x);
        for (int i = 0; i < problem->count; i++)
            w[i] = x[i];
        return;
    }
    if (!(sum > 0.0)) {
        face.slots[face.count++] = 0;
        w[0] = sum = problem->mass;
    }
    for (int i = 0; i < problem->count; i++)
        w[i] *= problem->mass / sum;
    descend(problem, &face, w);
    for (int round = 0; round < 8 * SLOTS_MAX; round++) {
        const int entering = find_entering(problem, &face, barred, w);
        if (entering < 0)
            return;
        face.slots[face.count++] = entering;
        descend(problem, &face, w);
        if (w[entering] > 0.0) {
            for (int i = 0; i < problem->count; i++)
                barred[i] = false;
        } else {
            barred[entering] = true;
        }
    }
}

/* Solves for the open slots of a row; closed ones come out as they went in. */
static void solve_open(int n, double e[][3], const struct skd_row *row, double plane,
                       const struct skd_plan *plan, double *w)
{
    struct problem problem;
    double goal[3], corners[SLOTS_MAX], pairs[SKD_PAIR_COUNT_MAX], open[SLOTS_MAX];
    int slots[SLOTS_MAX];
    problem.count = 0;
    problem.ridge = plan->ridge;
    problem.mass =
        row_goal(n, e, row->carried[0], row->target, plane, row->open, row->before, goal);
    row_assemble(n, e, goal, problem.mass, plan->ridge, row->anchor, corners, pairs);
    double lowest = INFINITY;
    for (int i = 0; i < n; i++) {
        if (row->open[i] > 0.0) {
            lowest = corners[i] < lowest ? corners[i] : lowest;
            slots[problem.count++] = i;
        }
    }
    for (int r = 0; r < problem.count; r++) {
        const int i = slots[r];
        open[r] = row->before[i];
        problem.corners[r] = corners[i] - lowest;
        problem.pairs[r][r] = 0.0;
        for (int s = 0; s < r; s++)
            problem.pairs[r][s] = problem.pairs[s][r] = pairs[row_pair(n, slots[s], i)];
    }
    minimise(&problem, plan->affine, open);
    for (int r = 0; r < problem.count; r++)
        w[slots[r]] = open[r];
}

void skd_active_set_solve(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                          size_t item)
{
    const int n = batch->slot_count;
    struct skd_row row;
    double e[SLOTS_MAX][3], w[SLOTS_MAX], squares[2];
    row_gather(n, batch, item, &row);
    const double rest_size = row_edges(n, &row, e);
    const struct skd_scene scene =
        row_scene(n, e, row.carried[0], row.target, rest_size, plan->ridge);
    const double usable = row.locked || row.open_count == 0 ? 0.0 : 1.0;
    for (int i = 0; i < n; i++)
        w[i] = row.before[i];
    if (usable > 0.0) {
        const double plane = row_plane(n, row.before);
        solve_open(n, e, &row, plane, plan, w);
        row_store(n, plane, row.open, row.anchor, w);
    }
    row_choose(n, e, &scene, row.anchor, row.before,
               usable * row_is_return(n, row.open, row.anchor, row.before),
               usable * row_is_valid(n, w, plan->affine ? 1.0 : 0.0), w, squares);
    for (int i = 0; i < n; i++)
        batch->weights_out[(size_t)n * item + (size_t)i] = (float)w[i];
    batch->residual_before[item] = (float)sqrt(squares[0]);
    batch->residual_after[item] = (float)sqrt(squares[1]);
}
