/* The minimum over a tetrahedron, exactly and without branches: ten numbers in, four weights out.
 * Knows nothing of where the numbers come from.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing. Included by four_slots.c only.
 * Inside, on each of 4 triangles and each of 6 edges the minimum is a small linear system. The
 * inside's is the answer if its weights are all >= 0, else the lowest of the feasible triangles'
 * and the clamped edges' (they cover the corners). Closed slots get a huge F, which makes every
 * face that has them infeasible or clamps them to 0.
 */
#ifndef SKD_SOLVER_FOUR_FACES_H
#define SKD_SOLVER_FOUR_FACES_H

#include "solver/row.h"

/* F of a closed slot: above any energy of a scene, and its square is still finite. */
static const double closed_corner = 1e60;

/* A face's minimum: weights of its slots, first slot first, and the energy there. */
struct face {
    double w[3];
    double energy;
};

SKD_ROW struct face edge_minimum(double mass, double fb, double fi, double pair, double slope,
                                 double inverse)
{
    const double raised = slope * inverse > 0.0 ? slope * inverse : 0.0;
    const double x = raised < mass ? raised : mass;
    const double rest = mass - x;
    const struct face face = {{rest, x, 0.0}, rest * fb + x * fi - rest * x * pair};
    return face;
}

/* The minimum over a triangle's plane by elimination: slot b is the base, i is eliminated by its
 * edge, `pivot` is what is left of j's. An infeasible one gets an energy that loses. */
SKD_ROW struct face triangle_minimum(double mass, const double f[3], double bi, double bj,
                                     double ij, const double slopes[2], double inverse_bi,
                                     double across, double inverse_pivot)
{
    const double wj = (slopes[1] - across * inverse_bi * slopes[0]) * inverse_pivot;
    const double wi = (slopes[0] - across * wj) * inverse_bi;
    const double wb = mass - wi - wj;
    const double least_two = wi < wj ? wi : wj;
    const double least = wb < least_two ? wb : least_two;
    const double energy =
        wb * f[0] + wi * f[1] + wj * f[2] - (wb * (wi * bi + wj * bj) + wi * wj * ij);
    const struct face face = {{wb, wi, wj}, least >= 0.0 ? energy : INFINITY};
    return face;
}

struct best {
    double w[4];
    double energy;
};

SKD_ROW void take_lower(struct best *best, struct face face, int b, int i, int j)
{
    const bool lower = face.energy < best->energy;
    for (int slot = 0; slot < 4; slot++) {
        const double w = slot == b   ? face.w[0]
                         : slot == i ? face.w[1]
                         : slot == j ? face.w[2]
                                     : 0.0;
        best->w[slot] = lower ? w : best->w[slot];
    }
    best->energy = lower ? face.energy : best->energy;
}

SKD_ROW double at_least(double floor, double x)
{
    return x > floor ? x : floor;
}

/* Minimises sum w_i f_i - sum w_i w_j L_ij for sum w = mass over the open slots, w >= 0 unless
 * `affine` (and then only where all four are open). `pairs` as row_pair() counts them. */
SKD_ROW void four_minimum(double f[4], const double pairs[6], const double open[4], double mass,
                          double ridge, double affine, double w[4])
{
    const double l01 = pairs[0], l02 = pairs[1], l03 = pairs[2];
    const double l12 = pairs[3], l13 = pairs[4], l23 = pairs[5];

    /* Only differences of F count. From the lowest, energies near the answer are of the size
     * of the edges however far the target is, and so are their rounding errors. */
    double lowest = closed_corner;
    for (int i = 0; i < 4; i++) {
        f[i] = open[i] > 0.0 ? f[i] : closed_corner;
        lowest = f[i] < lowest ? f[i] : lowest;
    }
    for (int i = 0; i < 4; i++)
        f[i] = open[i] > 0.0 ? f[i] - lowest : closed_corner;

    /* c_i for base b: half the slope at corner b towards corner i, times mass. */
    const double c01 = 0.5 * (mass * l01 + (f[0] - f[1]));
    const double c02 = 0.5 * (mass * l02 + (f[0] - f[2]));
    const double c03 = 0.5 * (mass * l03 + (f[0] - f[3]));
    const double c12 = 0.5 * (mass * l12 + (f[1] - f[2]));
    const double c13 = 0.5 * (mass * l13 + (f[1] - f[3]));
    const double c23 = 0.5 * (mass * l23 + (f[2] - f[3]));
    const double i01 = 1.0 / l01, i02 = 1.0 / l02, i03 = 1.0 / l03;
    const double i12 = 1.0 / l12, i13 = 1.0 / l13, i23 = 1.0 / l23;
    /* Products of two edges from a base, a_b_ij = 1/2 (L_bi + L_bj - L_ij). */
    const double a012 = 0.5 * (l01 + l02 - l12), a013 = 0.5 * (l01 + l03 - l13);
    const double a023 = 0.5 * (l02 + l03 - l23), a123 = 0.5 * (l12 + l13 - l23);
    /* No pivot of a ridged matrix is below the ridge, except by rounding. */
    const double p012 = at_least(ridge, l02 - a012 * i01 * a012);
    const double p013 = at_least(ridge, l03 - a013 * i01 * a013);
    const double p023 = at_least(ridge, l03 - a023 * i02 * a023);
    const double p123 = at_least(ridge, l13 - a123 * i12 * a123);
    const double q012 = 1.0 / p012;

    struct best best = {{0.0, 0.0, 0.0, 0.0}, INFINITY};
    take_lower(&best, edge_minimum(mass, f[0], f[1], l01, c01, i01), 0, 1, -1);
    take_lower(&best, edge_minimum(mass, f[0], f[2], l02, c02, i02), 0, 2, -1);
    take_lower(&best, edge_minimum(mass, f[0], f[3], l03, c03, i03), 0, 3, -1);
    take_lower(&best, edge_minimum(mass, f[1], f[2], l12, c12, i12), 1, 2, -1);
    take_lower(&best, edge_minimum(mass, f[1], f[3], l13, c13, i13), 1, 3, -1);
    take_lower(&best, edge_minimum(mass, f[2], f[3], l23, c23, i23), 2, 3, -1);
    const double f012[3] = {f[0], f[1], f[2]}, s012[2] = {c01, c02};
    const double f013[3] = {f[0], f[1], f[3]}, s013[2] = {c01, c03};
    const double f023[3] = {f[0], f[2], f[3]}, s023[2] = {c02, c03};
    const double f123[3] = {f[1], f[2], f[3]}, s123[2] = {c12, c13};
    take_lower(&best, triangle_minimum(mass, f012, l01, l02, l12, s012, i01, a012, q012), 0, 1, 2);
    take_lower(&best, triangle_minimum(mass, f013, l01, l03, l13, s013, i01, a013, 1.0 / p013), 0,
               1, 3);
    take_lower(&best, triangle_minimum(mass, f023, l02, l03, l23, s023, i02, a023, 1.0 / p023), 0,
               2, 3);
    take_lower(&best, triangle_minimum(mass, f123, l12, l13, l23, s123, i12, a123, 1.0 / p123), 1,
               2, 3);

    /* Inside: base 0, eliminating 1, then 2. */
    const double across = a023 - a012 * i01 * a013;
    const double pivot = at_least(ridge, (l03 - a013 * i01 * a013) - across * q012 * across);
    const double y2 = c02 - a012 * i01 * c01;
    const double w3 = (c03 - a013 * i01 * c01 - across * q012 * y2) / pivot;
    const double w2 = (y2 - across * w3) * q012;
    const double w1 = (c01 - a012 * w2 - a013 * w3) * i01;
    const double w0 = mass - w1 - w2 - w3;
    const double least01 = w0 < w1 ? w0 : w1;
    const double least23 = w2 < w3 ? w2 : w3;
    const double least = least01 < least23 ? least01 : least23;
    const bool inside = (affine > 0.0 ? 0.0 : least) >= 0.0;
    w[0] = inside ? w0 : best.w[0];
    w[1] = inside ? w1 : best.w[1];
    w[2] = inside ? w2 : best.w[2];
    w[3] = inside ? w3 : best.w[3];
}

#endif
