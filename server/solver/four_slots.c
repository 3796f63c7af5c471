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
 *               and further terms: their numbers, see row_extra.h
 *     assemble  -> ten numbers a vertex: F_0..F_3, L_01..L_23     (row_energy.h, row_extra.h)
 *     minimise  -> weights                                        (four_faces.h)
 *     finish    -> float32 weights of lowest energy, residuals    (row_choice.h)
 *     scatter   -> the batch's outputs
 *
 * With w = mass on the open slots the energy is sum w_i F_i - sum w_i w_j L_ij: the nearest point
 * of a tetrahedron, lifted by the anchor. All of it is compiled twice, with and without further
 * terms, so that a stroke in one pose pays nothing for what it does not use.
 */
#define SKD_ROW_UNROLL _Pragma("GCC unroll 8")
#include "solver/four_slots.h"

#include "solver/four_faces.h"
#include "solver/row_choice.h"
#include "solver/row_energy.h"
#include "solver/row_guard.h"
#include "solver/row_poses.h"

enum { SLOTS = 4, PAIRS = 6, LANES = 16 };

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
    /* Only where there are further terms: */
    double is_cut[LANES]; /* 1: the anchor is no whole row */
    double strength[LANES];
    double centre[SLOTS][LANES];
    struct {
        double pairs[PAIRS][LANES];
        double slopes[SLOTS][LANES];
        double cross[SLOTS][LANES];
        double square[LANES];
        double size[LANES];
        double flat[LANES];
    } extra;
};

SKD_ROW void gather(struct tile *tile, int lane, const struct skd_plan *plan,
                    const struct skd_row *row)
{
    for (int i = 0; i < SLOTS; i++) {
        for (int axis = 0; axis < 3; axis++)
            tile->carried[i][axis][lane] = row->carried[i][axis];
        tile->before[i][lane] = row->before[i];
        tile->anchor[i][lane] = row->anchor[i];
        tile->open[i][lane] = row->open[i];
    }
    for (int axis = 0; axis < 3; axis++)
        tile->target[axis][lane] = row->target[axis];
    tile->rest_size[lane] = fabs(row->rest[0]) + fabs(row->rest[1]) + fabs(row->rest[2]);
    const bool kept =
        row->locked || row->open_count == 0 || (plan->affine && row->open_count < SLOTS);
    tile->kept[lane] = kept ? 1.0 : 0.0;
}

/* The further terms of a lane. */
static void gather_extra(struct tile *tile, int lane, const struct skd_solve_batch *batch,
                         const struct skd_plan *plan, size_t item, struct skd_row *row,
                         struct skd_pose_cache *cache)
{
    struct skd_extra extra;
    row_gather_terms(SLOTS, batch, plan, item, row);
    extra_clear(SLOTS, &extra);
    if (batch->guard)
        guard_add(SLOTS, batch, plan->guard, item, row, &extra);
    if (batch->pose_count > 1)
        poses_add(SLOTS, batch, item, row, cache, &extra);
    tile->is_cut[lane] = row->is_cut ? 1.0 : 0.0;
    tile->strength[lane] = row->strength;
    for (int p = 0; p < PAIRS; p++)
        tile->extra.pairs[p][lane] = extra.pairs[p];
    for (int i = 0; i < SLOTS; i++) {
        tile->centre[i][lane] = row->centre[i];
        tile->extra.slopes[i][lane] = extra.slopes[i];
        tile->extra.cross[i][lane] = extra.cross[i];
    }
    tile->extra.square[lane] = extra.square;
    tile->extra.size[lane] = extra.size;
    tile->extra.flat[lane] = extra.flat;
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

SKD_ROW void load_extra(const struct tile *tile, int l, struct skd_extra *extra)
{
    SKD_ROW_UNROLL
    for (int p = 0; p < PAIRS; p++)
        extra->pairs[p] = tile->extra.pairs[p][l];
    for (int i = 0; i < SLOTS; i++) {
        extra->slopes[i] = tile->extra.slopes[i][l];
        extra->cross[i] = tile->extra.cross[i][l];
    }
    extra->square = tile->extra.square[l];
    extra->size = tile->extra.size[l];
    extra->flat = tile->extra.flat[l];
}

SKD_ROW void assemble(struct tile *tile, double ridge, bool is_simple)
{
    for (int l = 0; l < LANES; l++) {
        double e[SLOTS][3], goal[3], corners[SLOTS], pairs[PAIRS];
        const double open[SLOTS] = LOAD4(tile->open, l);
        const double before[SLOTS] = LOAD4(tile->before, l);
        const double centre[SLOTS] = LOAD4(is_simple ? tile->anchor : tile->centre, l);
        const double base[3] = LOAD3(tile->carried[0], l);
        const double target[3] = LOAD3(tile->target, l);
        load_edges(tile, l, e);
        const double plane = row_plane(SLOTS, before);
        const double mass = row_goal(SLOTS, e, base, target, plane, open, before, goal);
        row_assemble(SLOTS, e, goal, mass, is_simple ? 1.0 : tile->strength[l], ridge, centre,
                     corners, pairs);
        if (!is_simple) {
            struct skd_extra extra;
            load_extra(tile, l, &extra);
            extra_assemble(SLOTS, &extra, plane, mass, open, before, corners, pairs);
        }
        tile->plane[l] = plane;
        tile->mass[l] = mass;
        for (int i = 0; i < SLOTS; i++)
            tile->corners[i][l] = corners[i];
        for (int p = 0; p < PAIRS; p++)
            tile->pairs[p][l] = pairs[p];
    }
}

SKD_ROW void minimise(struct tile *tile, double ridge, double affine)
{
    for (int l = 0; l < LANES; l++) {
        double corners[SLOTS] = LOAD4(tile->corners, l), w[SLOTS];
        const double open[SLOTS] = LOAD4(tile->open, l);
        const double pairs[PAIRS] = {tile->pairs[0][l], tile->pairs[1][l], tile->pairs[2][l],
                                     tile->pairs[3][l], tile->pairs[4][l], tile->pairs[5][l]};
        four_minimum(corners, pairs, open, tile->mass[l], ridge, affine, w);
        for (int i = 0; i < SLOTS; i++)
            tile->weights[i][l] = w[i];
    }
}

SKD_ROW void finish(struct tile *tile, double ridge, double affine, bool is_simple)
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
        const double centre[SLOTS] = LOAD4(is_simple ? tile->anchor : tile->centre, l);
        struct skd_scene scene = row_scene(SLOTS, e, base, target, tile->rest_size[l]);
        struct skd_extra extra;
        scene.ridge = ridge;
        scene.centre = centre;
        if (!is_simple) {
            load_extra(tile, l, &extra);
            scene.strength = tile->strength[l];
            scene.extra = &extra;
        }
        row_close(SLOTS, open, before, w);
        row_store(SLOTS, tile->plane[l], open, anchor, w);
        const double usable = tile->kept[l] > 0.0 ? 0.0 : 1.0;
        const double whole = is_simple || tile->is_cut[l] == 0.0 ? usable : 0.0;
        row_choose(SLOTS, e, &scene, anchor, before,
                   whole * row_is_return(SLOTS, open, anchor, before),
                   usable * row_is_valid(SLOTS, w, affine), w, squares);
        for (int i = 0; i < SLOTS; i++)
            tile->weights[i][l] = w[i];
        tile->distances[0][l] = sqrt(squares[0]);
        tile->distances[1][l] = sqrt(squares[1]);
    }
}

/* One tile of the batch, compiled with and without further terms. */
SKD_ROW void solve_tile(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                        size_t first, int used, struct skd_pose_cache *cache, bool is_simple)
{
    struct tile tile;
    const double affine = plan->affine ? 1.0 : 0.0;
    for (int lane = 0; lane < LANES; lane++) {
        struct skd_row row;
        const size_t item = first + (size_t)(lane < used ? lane : used - 1);
        row_gather(SLOTS, batch, item, &row);
        gather(&tile, lane, plan, &row);
        if (!is_simple)
            gather_extra(&tile, lane, batch, plan, item, &row, cache);
    }
    assemble(&tile, plan->ridge, is_simple);
    minimise(&tile, plan->ridge, affine);
    finish(&tile, plan->ridge, affine, is_simple);
    for (int lane = 0; lane < used; lane++) {
        const size_t item = first + (size_t)lane;
        for (int i = 0; i < SLOTS; i++)
            batch->weights_out[SLOTS * item + (size_t)i] = (float)tile.weights[i][lane];
        batch->residual_before[item] = (float)tile.distances[0][lane];
        batch->residual_after[item] = (float)tile.distances[1][lane];
    }
}

static void solve_simple(const struct skd_solve_batch *batch, const struct skd_plan *plan)
{
    for (size_t first = 0; first < batch->count; first += LANES) {
        const size_t left = batch->count - first;
        solve_tile(batch, plan, first, left < LANES ? (int)left : LANES, NULL, true);
    }
}

static void solve_all_terms(const struct skd_solve_batch *batch, const struct skd_plan *plan)
{
    struct skd_pose_cache cache;
    if (batch->pose_count > 1)
        pose_cache_clear(&cache);
    for (size_t first = 0; first < batch->count; first += LANES) {
        const size_t left = batch->count - first;
        solve_tile(batch, plan, first, left < LANES ? (int)left : LANES, &cache, false);
    }
}

void SKD_FOUR_SLOTS_SOLVE(const struct skd_solve_batch *batch, const struct skd_plan *plan)
{
    if (plan->is_simple)
        solve_simple(batch, plan);
    else
        solve_all_terms(batch, plan);
}
