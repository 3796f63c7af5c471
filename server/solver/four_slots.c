/* Four slots, exactly, one vertex per SIMD lane.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns only its tile, on the stack.
 * Compiled once for each instruction set with its own SKD_FOUR_SLOTS_SOLVE as the function's name.
 * All arithmetic is float64 add, multiply, divide and compare in one fixed order, never contracted,
 * so every build gives the same bits. Lanes know nothing of each other: chunks may be cut
 * anywhere, and a last tile is filled up with its last vertex again.
 *
 * A tile is a structure of arrays. Each stage is one loop over its lanes without branches:
 *
 *     gather    vertices -> d_i, weights, what is locked          (scalar: it follows indexes)
 *     assemble  -> ten numbers a vertex: F_0..F_3, L_01..L_23     (row.h)
 *     minimise  -> weights                                        (knows nothing but those ten)
 *     finish    -> float32 weights of lowest energy, residuals    (row.h)
 *     scatter   -> the batch's outputs
 *
 * With w = mass on the open slots the energy is sum w_i F_i - sum w_i w_j L_ij: the nearest point
 * of a tetrahedron, lifted by the anchor. Inside, on each of 4 triangles and each of 6 edges its
 * minimum is a small linear system. The inside's is the answer if its weights are all >= 0, else
 * the lowest of the feasible triangles' and the clamped edges' (they cover the corners). Closed
 * slots get a huge F, which makes every face that has them infeasible or clamps them to 0.
 */
#include "solver/four_slots.h"

#define SKD_ROW_UNROLL _Pragma("GCC unroll 4")
#include "solver/row_choice.h"
#include "solver/row_energy.h"

enum { SLOTS = 4, PAIRS = 6, LANES = 16 };

/* F of a closed slot: above any energy of a scene, and its square is still finite. */
static const double closed_corner = 1e60;

struct tile {
    double carried[SLOTS][3][LANES];
    double target[3][LANES];
    double rest_size[LANES];
    double before[SLOTS][LANES];
    double anchor[SLOTS][LANES];
    double open[SLOTS][LANES];
    double kept[LANES]; /* 1: leave the vertex as it is */
    double plane[LANES];
    double mass[LANES];
    double corners[SLOTS][LANES];
    double pairs[PAIRS][LANES];
    double weights[SLOTS][LANES];
    double distances[2][LANES]; /* to the target, before and after */
};

static void gather(struct tile *tile, int lane, const struct skd_solve_batch *batch, size_t item,
                   bool affine)
{
    struct skd_row row;
    row_gather(SLOTS, batch, item, &row);
    for (int i = 0; i < SLOTS; i++) {
        for (int axis = 0; axis < 3; axis++)
            tile->carried[i][axis][lane] = row.carried[i][axis];
        tile->before[i][lane] = row.before[i];
        tile->anchor[i][lane] = row.anchor[i];
        tile->open[i][lane] = row.open[i];
    }
    for (int axis = 0; axis < 3; axis++)
        tile->target[axis][lane] = row.target[axis];
    tile->rest_size[lane] = fabs(row.rest[0]) + fabs(row.rest[1]) + fabs(row.rest[2]);
    const bool kept = row.locked || row.open_count == 0 || (affine && row.open_count < SLOTS);
    tile->kept[lane] = kept ? 1.0 : 0.0;
}

/* Lane `l` of a tile's rows, as the plain array that row.h works on. */
#define LOAD3(rows, l)                                                                             \
    {                                                                                              \
        (rows)[0][l], (rows)[1][l], (rows)[2][l]                                                   \
    }
#define LOAD4(rows, l)                                                                             \
    {                                                                                              \
        (rows)[0][l], (rows)[1][l], (rows)[2][l], (rows)[3][l]                                     \
    }

SKD_ROW void load_edges(const struct tile *tile, int l, double e[SLOTS][3])
{
    for (int i = 0; i < SLOTS; i++) {
        for (int axis = 0; axis < 3; axis++)
            e[i][axis] = tile->carried[i][axis][l] - tile->carried[0][axis][l];
    }
}

static void assemble(struct tile *tile, double ridge)
{
    for (int l = 0; l < LANES; l++) {
        double e[SLOTS][3], goal[3], corners[SLOTS], pairs[PAIRS];
        const double open[SLOTS] = LOAD4(tile->open, l);
        const double before[SLOTS] = LOAD4(tile->before, l);
        const double anchor[SLOTS] = LOAD4(tile->anchor, l);
        const double base[3] = LOAD3(tile->carried[0], l);
        const double target[3] = LOAD3(tile->target, l);
        load_edges(tile, l, e);
        const double plane = row_plane(SLOTS, before);
        const double mass = row_goal(SLOTS, e, base, target, plane, open, before, goal);
        row_assemble(SLOTS, e, goal, mass, ridge, anchor, corners, pairs);
        tile->plane[l] = plane;
        tile->mass[l] = mass;
        for (int i = 0; i < SLOTS; i++)
            tile->corners[i][l] = corners[i];
        for (int p = 0; p < PAIRS; p++)
            tile->pairs[p][l] = pairs[p];
    }
}

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
    double w[SLOTS];
    double energy;
};

SKD_ROW void take_lower(struct best *best, struct face face, int b, int i, int j)
{
    const bool lower = face.energy < best->energy;
    for (int slot = 0; slot < SLOTS; slot++) {
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

static void minimise(struct tile *tile, double ridge, double affine)
{
    for (int l = 0; l < LANES; l++) {
        const double mass = tile->mass[l];
        double f[SLOTS] = LOAD4(tile->corners, l);
        const double l01 = tile->pairs[0][l], l02 = tile->pairs[1][l], l03 = tile->pairs[2][l];
        const double l12 = tile->pairs[3][l], l13 = tile->pairs[4][l], l23 = tile->pairs[5][l];

        /* Only differences of F count. From the lowest, energies near the answer are of the size
         * of the edges however far the target is, and so are their rounding errors. */
        double lowest = closed_corner;
        for (int i = 0; i < SLOTS; i++) {
            f[i] = tile->open[i][l] > 0.0 ? f[i] : closed_corner;
            lowest = f[i] < lowest ? f[i] : lowest;
        }
        for (int i = 0; i < SLOTS; i++)
            f[i] = tile->open[i][l] > 0.0 ? f[i] - lowest : closed_corner;

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
        take_lower(&best, triangle_minimum(mass, f012, l01, l02, l12, s012, i01, a012, q012), 0, 1,
                   2);
        take_lower(&best, triangle_minimum(mass, f013, l01, l03, l13, s013, i01, a013, 1.0 / p013),
                   0, 1, 3);
        take_lower(&best, triangle_minimum(mass, f023, l02, l03, l23, s023, i02, a023, 1.0 / p023),
                   0, 2, 3);
        take_lower(&best, triangle_minimum(mass, f123, l12, l13, l23, s123, i12, a123, 1.0 / p123),
                   1, 2, 3);

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
        tile->weights[0][l] = inside ? w0 : best.w[0];
        tile->weights[1][l] = inside ? w1 : best.w[1];
        tile->weights[2][l] = inside ? w2 : best.w[2];
        tile->weights[3][l] = inside ? w3 : best.w[3];
    }
}

static void finish(struct tile *tile, double ridge, double affine)
{
    for (int l = 0; l < LANES; l++) {
        double e[SLOTS][3], squares[2];
        const double open[SLOTS] = LOAD4(tile->open, l);
        const double before[SLOTS] = LOAD4(tile->before, l);
        const double anchor[SLOTS] = LOAD4(tile->anchor, l);
        double w[SLOTS] = LOAD4(tile->weights, l);
        load_edges(tile, l, e);
        const double base[3] = LOAD3(tile->carried[0], l);
        const double target[3] = LOAD3(tile->target, l);
        const struct skd_scene scene = row_scene(SLOTS, e, base, target, tile->rest_size[l], ridge);
        row_close(SLOTS, open, before, w);
        row_store(SLOTS, tile->plane[l], open, anchor, w);
        const double usable = tile->kept[l] > 0.0 ? 0.0 : 1.0;
        row_choose(SLOTS, e, &scene, anchor, before,
                   usable * row_is_return(SLOTS, open, anchor, before),
                   usable * row_is_valid(SLOTS, w, affine), w, squares);
        for (int i = 0; i < SLOTS; i++)
            tile->weights[i][l] = w[i];
        tile->distances[0][l] = sqrt(squares[0]);
        tile->distances[1][l] = sqrt(squares[1]);
    }
}

void SKD_FOUR_SLOTS_SOLVE(const struct skd_solve_batch *batch, const struct skd_plan *plan)
{
    struct tile tile;
    const double affine = plan->affine ? 1.0 : 0.0;
    for (size_t first = 0; first < batch->count; first += LANES) {
        const size_t left = batch->count - first;
        const int used = left < LANES ? (int)left : LANES;
        for (int lane = 0; lane < LANES; lane++) {
            const int from = lane < used ? lane : used - 1;
            gather(&tile, lane, batch, first + (size_t)from, plan->affine);
        }
        assemble(&tile, plan->ridge);
        minimise(&tile, plan->ridge, affine);
        finish(&tile, plan->ridge, affine);
        for (int lane = 0; lane < used; lane++) {
            const size_t item = first + (size_t)lane;
            for (int i = 0; i < SLOTS; i++)
                batch->weights_out[SLOTS * item + (size_t)i] = (float)tile.weights[i][lane];
            batch->residual_before[item] = (float)tile.distances[0][lane];
            batch->residual_after[item] = (float)tile.distances[1][lane];
        }
    }
}
