/* Any number of slots, exactly: minimise sum w_i F_i - sum w_i w_j L_ij over the open slots.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns its stack only.
 * Reads a vertex, assembles its problem and lets problem.c find the minimum, starting from the
 * weights before the stroke; row_choose() then takes nothing worse than what was there.
 */
#include "solver/active_set.h"

#include "solver/problem.h"
#include "solver/row_choice.h"
#include "solver/row_energy.h"
#include "solver/row_guard.h"
#include "solver/row_poses.h"

enum { SLOTS_MAX = SKD_SLOT_COUNT_MAX };

/* What the energy of one vertex is made of. */
struct terms {
    struct skd_row row;
    double e[SLOTS_MAX][3];
    struct skd_scene scene;
    struct skd_extra extra; /* what scene.extra points to, if it does */
};

/* Solves for the open slots of a row; closed ones come out as they went in. */
static void solve_open(int n, struct terms *terms, double plane, const struct skd_plan *plan,
                       double *w)
{
    const struct skd_row *row = &terms->row;
    struct skd_problem problem;
    double goal[3], corners[SLOTS_MAX], pairs[SKD_PAIR_COUNT_MAX], open[SLOTS_MAX];
    int slots[SLOTS_MAX];
    problem.count = 0;
    problem.ridge = plan->ridge;
    problem.mass =
        row_goal(n, terms->e, row->carried[0], row->target, plane, row->open, row->before, goal);
    row_assemble(n, terms->e, goal, problem.mass, terms->scene.strength, plan->ridge,
                 terms->scene.centre, corners, pairs);
    if (!plan->is_simple)
        extra_assemble(n, &terms->extra, plane, problem.mass, row->open, row->before, corners,
                       pairs);
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
    skd_problem_minimise(&problem, plan->affine, open);
    for (int r = 0; r < problem.count; r++)
        w[slots[r]] = open[r];
}

static void gather(const struct skd_solve_batch *batch, const struct skd_plan *plan, size_t item,
                   struct skd_pose_cache *cache, struct terms *terms)
{
    const int n = batch->slot_count;
    struct skd_row *row = &terms->row;
    row_gather(n, batch, item, row);
    row->is_cut = false;
    const double rest_size = row_edges(n, row, terms->e);
    terms->scene = row_scene(n, terms->e, row->carried[0], row->target, rest_size);
    terms->scene.ridge = plan->ridge;
    terms->scene.centre = row->anchor;
    if (plan->is_simple)
        return;
    row_gather_terms(n, batch, plan, item, row);
    terms->scene.strength = row->strength;
    terms->scene.centre = row->centre;
    terms->scene.extra = &terms->extra;
    extra_clear(n, &terms->extra);
    if (batch->guard)
        guard_add(n, batch, plan->guard, item, row, &terms->extra);
    if (batch->pose_count > 1)
        poses_add(n, batch, item, row, cache, &terms->extra);
}

static void solve_item(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                       size_t item, struct skd_pose_cache *cache)
{
    const int n = batch->slot_count;
    struct terms terms;
    const struct skd_row *row = &terms.row;
    double w[SLOTS_MAX], squares[2];
    gather(batch, plan, item, cache, &terms);
    const double usable = row->locked || row->open_count == 0 ? 0.0 : 1.0;
    for (int i = 0; i < n; i++)
        w[i] = row->before[i];
    if (usable > 0.0) {
        const double plane = row_plane(n, row->before);
        solve_open(n, &terms, plane, plan, w);
        row_store(n, plane, row->open, row->anchor, w);
    }
    row_choose(n, terms.e, &terms.scene, row->anchor, row->before,
               row->is_cut ? 0.0 : usable * row_is_return(n, row->open, row->anchor, row->before),
               usable * row_is_valid(n, w, plan->affine ? 1.0 : 0.0), w, squares);
    for (int i = 0; i < n; i++)
        batch->weights_out[(size_t)n * item + (size_t)i] = (float)w[i];
    batch->residual_before[item] = (float)sqrt(squares[0]);
    batch->residual_after[item] = (float)sqrt(squares[1]);
}

static bool has_closed_slot(const struct skd_solve_batch *batch, size_t item)
{
    const size_t n = (size_t)batch->slot_count;
    const uint16_t *joints = batch->joints + n * batch->vertices[item];
    for (size_t i = 0; i < n; i++) {
        if (joints[i] == SKD_SLOT_EMPTY || (batch->bone_locked && batch->bone_locked[joints[i]]))
            return true;
    }
    return false;
}

void skd_active_set_solve(const struct skd_solve_batch *batch, const struct skd_plan *plan,
                          bool closed_only)
{
    struct skd_pose_cache cache;
    if (batch->pose_count > 1)
        pose_cache_clear(&cache);
    for (size_t item = 0; item < batch->count; item++) {
        if (!closed_only || has_closed_slot(batch, item))
            solve_item(batch, plan, item, &cache);
    }
}
