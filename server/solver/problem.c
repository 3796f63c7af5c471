/* The minimum of a problem, by an active set; and how to do with fewer weights.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns its stack only.
 * A primal active set, as Lawson and Hanson's for non-negative least squares, with the sum as one
 * more condition. The face is the set of weights that may be above zero. From where it starts:
 *
 *     descend   to the minimum over the face's plane; a weight that would go below zero stops the
 *               step there and leaves the face; again, until nothing stops it
 *     enter     the weight outside of the face whose slope is lowest, if it is below the face's
 *
 * The energy falls with every weight that enters and stays, so no face comes twice. One that enters
 * and is put out at once (rounding) is barred until another stays, and rounds are counted, so it
 * ends whatever the numbers are.
 */
#include "solver/problem.h"

#include <math.h>
#include <string.h>

enum { SLOTS_MAX = SKD_SLOT_COUNT_MAX };

void skd_problem_begin(struct skd_problem *problem, int count, double mass, double ridge,
                       const double *anchor)
{
    problem->count = count;
    problem->mass = mass;
    problem->ridge = ridge;
    for (int i = 0; i < count; i++) {
        problem->corners[i] = -2.0 * ridge * anchor[i];
        for (int j = 0; j < count; j++)
            problem->pairs[i][j] = i == j ? 0.0 : 2.0 * ridge;
    }
}

void skd_problem_add_pose(struct skd_problem *problem, double omega, double carried[][3],
                          const double goal[3])
{
    double e[SLOTS_MAX][3], ahead[3];
    for (int axis = 0; axis < 3; axis++) {
        ahead[axis] = goal[axis] - problem->mass * carried[0][axis];
        for (int i = 0; i < problem->count; i++)
            e[i][axis] = carried[i][axis] - carried[0][axis];
    }
    for (int i = 0; i < problem->count; i++) {
        const double square = e[i][0] * e[i][0] + e[i][1] * e[i][1] + e[i][2] * e[i][2];
        const double along = ahead[0] * e[i][0] + ahead[1] * e[i][1] + ahead[2] * e[i][2];
        problem->corners[i] += omega * (problem->mass * square - 2.0 * along);
        for (int j = 0; j < i; j++) {
            const double x = e[i][0] - e[j][0], y = e[i][1] - e[j][1], z = e[i][2] - e[j][2];
            problem->pairs[i][j] += omega * (x * x + y * y + z * z);
            problem->pairs[j][i] = problem->pairs[i][j];
        }
    }
}

void skd_problem_level(struct skd_problem *problem)
{
    double lowest = INFINITY;
    for (int i = 0; i < problem->count; i++)
        lowest = problem->corners[i] < lowest ? problem->corners[i] : lowest;
    for (int i = 0; i < problem->count; i++)
        problem->corners[i] -= lowest;
}

double skd_problem_energy(const struct skd_problem *problem, const double *w)
{
    double flat = 0.0, bent = 0.0;
    for (int i = 0; i < problem->count; i++) {
        flat += w[i] * problem->corners[i];
        for (int j = 0; j < i; j++)
            bent += w[i] * w[j] * problem->pairs[i][j];
    }
    return flat - bent;
}

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
static void face_minimum(const struct skd_problem *problem, const struct face *face, double *x)
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
static void descend(const struct skd_problem *problem, struct face *face, double *w)
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
        /* What else is at zero leaves too, but for a slot that has only entered and is to rise:
         * after a step of no length it is still there. */
        w[face->slots[stop]] = 0.0;
        x[stop] = -1.0;
        for (int i = face->count - 1; i >= 0; i--) {
            if (w[face->slots[i]] <= 0.0 && !(x[i] > 0.0)) {
                w[face->slots[i]] = 0.0;
                face_remove(face, i);
            }
        }
    }
}

/* The slot outside of the face that lowers the energy fastest, or -1. */
static int find_entering(const struct skd_problem *problem, const struct face *face,
                         const bool *barred, const double *w)
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

void skd_problem_minimise(const struct skd_problem *problem, bool affine, double *w)
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

/* The minimum over the weights that are `alive`, from w; the others become 0. */
static void minimise_some(const struct skd_problem *problem, const bool *alive, double *w)
{
    struct skd_problem some = {.mass = problem->mass, .ridge = problem->ridge};
    double x[SLOTS_MAX];
    int places[SLOTS_MAX];
    for (int i = 0; i < problem->count; i++) {
        if (alive[i])
            places[some.count++] = i;
    }
    for (int r = 0; r < some.count; r++) {
        const int i = places[r];
        some.corners[r] = problem->corners[i];
        x[r] = w[i];
        for (int s = 0; s < some.count; s++)
            some.pairs[r][s] = problem->pairs[i][places[s]];
    }
    skd_problem_minimise(&some, false, x);
    for (int i = 0; i < problem->count; i++)
        w[i] = 0.0;
    for (int r = 0; r < some.count; r++)
        w[places[r]] = x[r];
}

static int count_used(const struct skd_problem *problem, const double *w)
{
    int used = 0;
    for (int i = 0; i < problem->count; i++)
        used += w[i] > 0.0;
    return used;
}

void skd_problem_eliminate(const struct skd_problem *problem, int keep, double *w)
{
    bool alive[SLOTS_MAX];
    for (int i = 0; i < problem->count; i++)
        alive[i] = true;
    while (count_used(problem, w) > keep) {
        double best[SLOTS_MAX], least = INFINITY;
        int drop = -1;
        for (int i = 0; i < problem->count; i++) {
            if (!(w[i] > 0.0))
                continue;
            double x[SLOTS_MAX];
            memcpy(x, w, sizeof x);
            alive[i] = false;
            minimise_some(problem, alive, x);
            alive[i] = true;
            const double energy = skd_problem_energy(problem, x);
            if (drop < 0 || energy < least) {
                least = energy;
                drop = i;
                memcpy(best, x, sizeof best);
            }
        }
        alive[drop] = false;
        memcpy(w, best, sizeof best);
    }
}
