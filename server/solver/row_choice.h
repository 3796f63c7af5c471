/* From a minimum to what is stored: float32, and never worse than it was. The words are row.h's.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#ifndef SKD_SOLVER_ROW_CHOICE_H
#define SKD_SOLVER_ROW_CHOICE_H

#include "solver/row_extra.h"

/* x rounded to float32's 24 bits, in float64 (Veltkamp's splitting): a conversion there and back
 * would halve the width of the loops that this is used in. */
SKD_ROW double row_round(double x)
{
    const double scaled = 536870913.0 * x; /* 2^29 + 1 */
    return scaled - (scaled - x);
}

/* Makes a solution what float32 can hold: still summing to `plane`, closed slots untouched.
 *
 * A solution that is the anchor within half a step of a stored weight is the anchor, bit for bit;
 * a single weight within 1e-9 of the anchor's takes its bits too, so that nothing changes that the
 * stroke does not ask for. Else the largest takes `plane` minus the others, and what its own
 * rounding leaves goes to smaller ones, whose steps are finer. The sum is nearly always exact after
 * that, and so a gain in energy cannot come from, or be lost to, a row that sums to a little more
 * or less than the row before. */
SKD_ROW void row_store(int n, double plane, const double *open, const double *anchor, double *w)
{
    double largest = -1.0, apart = 0.0;
    for (int i = 0; i < n; i++) {
        const double off = fabs(w[i] - anchor[i]);
        const double near = off <= 1e-9 ? anchor[i] : row_round(w[i]);
        apart = off > apart ? off : apart;
        w[i] = open[i] > 0.0 ? near : w[i];
        const double size = open[i] > 0.0 ? fabs(w[i]) : -1.0;
        largest = size > largest ? size : largest;
    }
    double left = plane - row_sum(n, w);
    for (int i = 0; i < n; i++) {
        /* Of equal ones the first only. */
        const double size = open[i] > 0.0 ? fabs(w[i]) : -2.0;
        const double with = row_round(w[i] + left);
        w[i] = size == largest ? with : w[i];
        largest = size == largest ? INFINITY : largest;
    }
    left = plane - row_sum(n, w);
    for (int i = 0; i < n; i++) {
        const double size = open[i] > 0.0 ? fabs(w[i]) : 0.0;
        const double with = row_round(w[i] + left);
        const double taken = fabs(left) <= 0.5 * size ? with : w[i];
        left -= taken - w[i];
        w[i] = taken;
    }
    for (int i = 0; i < n; i++)
        w[i] = apart <= 0x1p-25 ? anchor[i] : w[i];
}

/* 1 if the row may be stored: sums to one, and no weight is negative unless the plan is affine.
 * 0 also for a row that holds a NaN. */
SKD_ROW double row_is_valid(int n, const double *w, double affine)
{
    double least = 0.0;
    for (int i = 0; i < n; i++)
        least = w[i] < least ? w[i] : least;
    const double signs = affine > 0.0 ? 0.0 : least;
    const double summed = fabs(row_sum(n, w) - 1.0) <= 1e-7 ? 1.0 : 0.0;
    return signs >= 0.0 ? summed : 0.0;
}

/* 1 if the anchor agrees with the row in every closed slot: then the stroke may go back to it. */
SKD_ROW double row_is_return(int n, const double *open, const double *anchor, const double *before)
{
    double apart = 0.0;
    for (int i = 0; i < n; i++)
        apart += open[i] > 0.0 ? 0.0 : fabs(anchor[i] - before[i]);
    return apart > 0.0 ? 0.0 : 1.0;
}

/* What the choice between weights looks at. */
struct skd_scene {
    double base[3];   /* d_0 */
    double target[3]; /* t */
    double strength;  /* omega */
    double size;      /* what the rounding errors of d_i and t are proportional to */
    double ridge;
    const double *centre;
    const struct skd_extra *extra; /* NULL: no further terms */
};

SKD_ROW struct skd_scene row_scene(int n, double e[][3], const double base[3],
                                   const double target[3], double rest_size)
{
    struct skd_scene scene = {.size = rest_size, .strength = 1.0};
    for (int axis = 0; axis < 3; axis++) {
        scene.base[axis] = base[axis];
        scene.target[axis] = target[axis];
        scene.size += 2.0 * fabs(base[axis]) + fabs(target[axis]);
        for (int i = 1; i < n; i++)
            scene.size += fabs(e[i][axis]);
    }
    return scene;
}

/* r = sum_i w_i d_i - t */
SKD_ROW void row_residual(int n, double e[][3], const struct skd_scene *scene, const double *w,
                          double r[3])
{
    const double sum = row_sum(n, w);
    for (int axis = 0; axis < 3; axis++) {
        double carried = 0.0;
        for (int i = 0; i < n; i++)
            carried += w[i] * e[i][axis];
        r[axis] = carried + (sum * scene->base[axis] - scene->target[axis]);
    }
}

struct skd_gain {
    double energy;   /* f(before) - f(after) */
    double distance; /* |r(before)|^2 - |r(after)|^2 */
    double noise;    /* what rounding may have added to either */
};

/* How much `after` gains on `before`, from differences: two rows that differ little are told apart
 * far below the rounding error of their energies. `r` is before's residual. */
SKD_ROW struct skd_gain row_gain(int n, double e[][3], const struct skd_scene *scene,
                                 const double *before, const double r[3], const double *after)
{
    double sum = 0.0, moved = 0.0, drawn = 0.0;
    double step[3] = {0.0, 0.0, 0.0};
    double z[SKD_SLOT_COUNT_MAX];
    for (int i = 0; i < n; i++) {
        z[i] = before[i] - after[i];
        sum += z[i];
        moved += fabs(z[i]);
        drawn += z[i] * ((before[i] - scene->centre[i]) + (after[i] - scene->centre[i]));
        step[0] += z[i] * e[i][0];
        step[1] += z[i] * e[i][1];
        step[2] += z[i] * e[i][2];
    }
    double distance = 0.0, reach = 0.0, length = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const double s = step[axis] + sum * scene->base[axis];
        const double both = 2.0 * r[axis] - s;
        distance += s * both;
        reach += fabs(both);
        length += fabs(s);
    }
    struct skd_gain gain;
    gain.distance = distance;
    gain.energy = scene->strength * distance + scene->ridge * drawn;
    gain.noise = scene->strength * (scene->size * (moved * reach + length)) + scene->ridge * moved;
    if (scene->extra) {
        double noise;
        gain.energy += extra_gain(n, scene->extra, z, &noise);
        gain.noise += noise;
    }
    gain.noise *= 0x1p-46; /* 64 ulp */
    return gain;
}

/* Of the weights before, the anchor and the solution the one of lowest energy, as stored; what
 * gains no more than rounding could have made up is no gain. Leaves the choice in `solution` and
 * the distances to the target, squared, in `squares` (before, after). */
SKD_ROW void row_choose(int n, double e[][3], const struct skd_scene *scene, const double *anchor,
                        const double *before, double anchor_ok, double solution_ok,
                        double *solution, double squares[2])
{
    double r[3], after[3];
    row_residual(n, e, scene, before, r);
    const struct skd_gain back = row_gain(n, e, scene, before, r, anchor);
    const struct skd_gain there = row_gain(n, e, scene, before, r, solution);
    const double back_least = back.energy - back.noise;
    const double use_anchor = back_least > 0.0 ? anchor_ok : 0.0;
    const double best = use_anchor > 0.0 ? back.energy + back.noise : 0.0;
    const double use_solution = there.energy - there.noise > best ? solution_ok : 0.0;
    for (int i = 0; i < n; i++) {
        const double kept = use_anchor > 0.0 ? anchor[i] : before[i];
        solution[i] = use_solution > 0.0 ? solution[i] : kept;
    }
    row_residual(n, e, scene, solution, after);
    const double square_before = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
    const double square_after = after[0] * after[0] + after[1] * after[1] + after[2] * after[2];
    /* A move that is shorter beyond doubt is not to be reported longer by a last bit. */
    const double kept_distance = use_anchor > 0.0 ? back.distance : 0.0;
    const double distance = use_solution > 0.0 ? there.distance : kept_distance;
    const double capped = square_after < square_before ? square_after : square_before;
    squares[0] = square_before;
    squares[1] = distance >= 0.0 ? capped : square_after;
}

#endif
