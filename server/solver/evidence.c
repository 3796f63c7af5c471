/* Candidates, elimination, comparison; see evidence.h.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns its stack only.
 * The plain solve comes first, for the whole batch, and its outputs stay unless a vertex finds
 * better slots. Those are solved once more by skd_solve, as a batch of one vertex, so that what is
 * stored is stored in one way only.
 */
#include "solver/evidence.h"

#include "base/error.h"
#include "solver/bone_set.h"
#include "solver/row_choice.h"

#include <string.h>

enum {
    SLOTS_KEPT_MAX = 8, /* all of them and as many candidates fit a set */
    LISTED_FEW = 8,     /* candidates with less than POSES_MANY targets */
    LISTED_MANY = 12,
    POSES_MANY = 4,
};

static const double rank_one_pose = 1e-6, rank_more_poses = 3e-7; /* rho */
static const double reached_one_pose = 1e-3; /* leftover / L with which slots are kept */
static const double probe = 1e-4;            /* kappa of that question */
/* What is left over is explained by 16 candidates where it is more than these. */
static const double left_of_length = 3e-5, left_of_edit = 5e-4;

/* What a choice of slots came to. */
struct choice {
    struct skd_bone_set set; /* the bones chosen, those that are held among them */
    bool lower;              /* than the plain solve */
};

/* ---- candidates ---- */

/* The slots' bones that matter: of weight, or held. */
static void add_slots(const struct skd_subject *subject, const float *plain, double rho,
                      struct skd_bone_set *set)
{
    const struct skd_solve_batch *batch = subject->batch;
    const size_t n = (size_t)batch->slot_count;
    const uint16_t *row = batch->joints + n * subject->vertex;
    for (size_t i = 0; i < n; i++) {
        if (row[i] == SKD_SLOT_EMPTY)
            continue;
        const bool held = batch->bone_locked && batch->bone_locked[row[i]];
        if (!held && !(plain[i] > 0.0F))
            continue;
        const bool own = skd_subject_anchor(subject, row[i]) > 0.0;
        skd_bone_set_add(set, subject, row[i], (double)plain[i], own ? 0.0 : rho);
    }
}

/* A set of the slots' bones and the first `listed` of the list that fit. The prior grows with the
 * rank, for slots' bones too unless they are the start's. */
static void gather(const struct skd_subject *subject, const float *plain, const uint16_t *list,
                   int listed, double rho, struct skd_bone_set *set)
{
    const uint8_t *locked = subject->batch->bone_locked;
    set->count = 0;
    add_slots(subject, plain, rho, set);
    for (int k = 0; k < listed && list[k] != SKD_SLOT_EMPTY; k++) {
        const bool own = skd_subject_anchor(subject, list[k]) > 0.0;
        const double prior = own ? 0.0 : rho * (double)k / SKD_CANDIDATES_MAX;
        for (int i = 0; i < set->count; i++) {
            if (set->bones[i] == list[k])
                set->prior[i] = prior;
        }
        const bool barred = locked && locked[list[k]];
        if (set->count < SKD_SLOT_COUNT_MAX && !barred && !skd_bone_set_has(set, list[k]))
            skd_bone_set_add(set, subject, list[k], 0.0, prior);
    }
}

/* How much the targets' energy falls, at best, by moving the vertex's weight towards a bone. */
static double descent_towards(const struct skd_subject *subject, uint16_t bone)
{
    double slope = 0.0, bend = 0.0;
    for (int p = 0; p < subject->aim_count; p++) {
        const struct skd_aim *aim = &subject->aims[p];
        double d[3];
        row_carry(aim->matrices + SKD_MATRIX_SIZE * (size_t)bone, subject->rest, d);
        for (int axis = 0; axis < 3; axis++) {
            const double way = d[axis] - aim->shown[axis];
            slope += aim->strength * way * (aim->target[axis] - aim->shown[axis]);
            bend += aim->strength * way * way;
        }
    }
    return slope > 0.0 && bend > 0.0 ? slope * slope / bend : 0.0;
}

/* The list's first `listed`, then the bones of steepest descent from what `shown` says. */
static void extend_list(const struct skd_subject *subject, const struct skd_evidence_bones *bones,
                        const uint16_t *list, int listed, uint16_t *extended)
{
    double descents[SKD_CANDIDATES_MAX];
    int first = 0, used;
    while (first < listed && list[first] != SKD_SLOT_EMPTY) {
        extended[first] = list[first];
        first++;
    }
    used = first;
    for (int bone = 0; bone < bones->bone_count; bone++) {
        bool listed_already = bones->bone_skin[bone] != bones->vertex_skin[subject->vertex];
        for (int k = 0; k < first; k++)
            listed_already = listed_already || extended[k] == bone;
        const double descent = listed_already ? 0.0 : descent_towards(subject, (uint16_t)bone);
        if (!(descent > 0.0))
            continue;
        int at = used;
        while (at > first && descent > descents[at - 1])
            at--;
        if (at == SKD_CANDIDATES_MAX)
            continue;
        used += used < SKD_CANDIDATES_MAX;
        for (int k = used - 1; k > at; k--) {
            extended[k] = extended[k - 1];
            descents[k] = descents[k - 1];
        }
        extended[at] = (uint16_t)bone;
        descents[at] = descent;
    }
    while (used < SKD_CANDIDATES_MAX)
        extended[used++] = SKD_SLOT_EMPTY;
}

/* ---- choice ---- */

/* True if w is lower than `plain` beyond what rounding could have made up. */
static bool is_lower(const struct skd_problem *problem, const double *w, const double *plain)
{
    double size = 0.0;
    for (int i = 0; i < problem->count; i++) {
        size = problem->corners[i] > size ? problem->corners[i] : size;
        for (int j = 0; j < i; j++)
            size = problem->pairs[i][j] > size ? problem->pairs[i][j] : size;
    }
    return skd_problem_energy(problem, w) < skd_problem_energy(problem, plain) - 0x1p-44 * size;
}

/* The best `slot_count` bones of the set. */
static void choose(const struct skd_bone_set *set, const struct skd_subject *subject,
                   struct choice *choice)
{
    struct skd_problem problem, with_prior;
    int open[SKD_SLOT_COUNT_MAX];
    double plain[SKD_SLOT_COUNT_MAX], w[SKD_SLOT_COUNT_MAX] = {0.0};
    choice->lower = false;
    choice->set.count = 0;
    if (!skd_bone_set_problem(set, subject, subject->options->stiffness, &problem, open))
        return;
    const int keep = subject->batch->slot_count - (set->count - problem.count);
    if (keep < 1)
        return;
    with_prior = problem;
    for (int r = 0; r < problem.count; r++) {
        plain[r] = w[r] = set->weights[open[r]];
        with_prior.corners[r] += set->prior[open[r]];
    }
    skd_problem_level(&with_prior);
    skd_problem_minimise(&with_prior, false, w);
    skd_problem_eliminate(&with_prior, keep, w);
    choice->lower = is_lower(&problem, w, plain) && is_lower(&with_prior, w, plain);
    for (int i = 0; i < set->count; i++) {
        if (set->held[i])
            skd_bone_set_add(&choice->set, subject, set->bones[i], set->weights[i], 0.0);
    }
    for (int r = 0; r < problem.count; r++) {
        if (w[r] > 0.0)
            skd_bone_set_add(&choice->set, subject, set->bones[open[r]], w[r], 0.0);
    }
}

/* ---- rows ---- */

/* Gives the slots that are free to the list's next bones, for later strokes. */
static void offer_next(const struct skd_bone_set *chosen, const struct skd_subject *subject,
                       const uint16_t *list, uint16_t *joints)
{
    const uint8_t *locked = subject->batch->bone_locked;
    int slot = 0;
    for (int k = 0; k < SKD_CANDIDATES_MAX && list[k] != SKD_SLOT_EMPTY; k++) {
        if (skd_bone_set_has(chosen, list[k]) || (locked && locked[list[k]]))
            continue;
        while (slot < subject->batch->slot_count && joints[slot] != SKD_SLOT_EMPTY)
            slot++;
        if (slot == subject->batch->slot_count)
            return;
        joints[slot] = list[k];
    }
}

/* Lays chosen bones out: each in the slot that it had, new ones in what is free. Weights are
 * rounded as the solver rounds. */
static void lay_row(const struct skd_bone_set *chosen, const struct skd_subject *subject,
                    uint16_t *joints, float *weights)
{
    static const double none[SKD_SLOT_COUNT_MAX];
    const int n = subject->batch->slot_count;
    const uint16_t *row = subject->batch->joints + (size_t)n * subject->vertex;
    const uint8_t *locked = subject->batch->bone_locked;
    double w[SKD_SLOT_COUNT_MAX] = {0.0}, open[SKD_SLOT_COUNT_MAX];
    struct skd_bone_set left = {.count = 0};
    int next = 0;
    for (int i = 0; i < n; i++)
        joints[i] = SKD_SLOT_EMPTY;
    for (int k = 0; k < chosen->count; k++) {
        int at = 0;
        while (at < n && row[at] != chosen->bones[k])
            at++;
        if (at == n) {
            skd_bone_set_add(&left, subject, chosen->bones[k], chosen->weights[k], 0.0);
            continue;
        }
        joints[at] = chosen->bones[k];
        w[at] = chosen->weights[k];
    }
    for (int i = 0; i < n; i++) {
        if (joints[i] == SKD_SLOT_EMPTY && next < left.count) {
            joints[i] = left.bones[next];
            w[i] = left.weights[next++];
        }
        open[i] = joints[i] == SKD_SLOT_EMPTY || (locked && locked[joints[i]]) ? 0.0 : 1.0;
    }
    row_store(n, 1.0, open, none, w);
    for (int i = 0; i < n; i++)
        weights[i] = (float)w[i];
}

/* skd_solve for one vertex whose row is not the batch's; into the batch's outputs. */
static void solve_row(const struct skd_subject *subject, const uint16_t *joints, float *weights)
{
    const struct skd_solve_batch *batch = subject->batch;
    const size_t item = subject->item, n = (size_t)batch->slot_count;
    const uint32_t only = 0;
    struct skd_solve_pose poses[SKD_EVIDENCE_POSES_MAX];
    float anchor[SKD_SLOT_COUNT_MAX], solved[SKD_SLOT_COUNT_MAX], before;
    struct skd_solve_batch one = *batch;
    for (int p = 0; p < batch->pose_count; p++) {
        poses[p] = batch->poses[p];
        poses[p].targets += 3 * item;
        poses[p].strengths += poses[p].strengths ? item : 0;
    }
    for (size_t i = 0; i < n; i++)
        anchor[i] =
            joints[i] == SKD_SLOT_EMPTY ? 0.0F : (float)skd_subject_anchor(subject, joints[i]);
    one.count = 1;
    one.vertices = &only;
    one.poses = poses;
    one.rest += 3 * subject->vertex;
    one.joints = joints;
    one.weights = weights;
    one.anchor = anchor;
    one.vertex_locked = NULL;
    one.start_joints = subject->start_joints;
    one.start_weights = subject->start_weights;
    one.weights_out = solved;
    one.residual_before = &before;
    one.residual_after += item;
    one.leftover_out += one.leftover_out ? item : 0;
    skd_solve(&one, subject->options);
    memcpy(weights, solved, n * sizeof *weights);
}

/* ---- one vertex ---- */

/* Whether one target asks for other slots: with the slots that are there, and hardly any anchor, it
 * is out of reach. */
static bool is_out_of_reach(struct skd_subject *subject)
{
    const struct skd_solve_batch *batch = subject->batch;
    const size_t first = (size_t)batch->slot_count * subject->vertex;
    struct skd_bone_set set = {.count = 0};
    struct skd_problem problem;
    int open[SKD_SLOT_COUNT_MAX];
    double w[SKD_SLOT_COUNT_MAX];
    for (size_t slot = first; slot < first + (size_t)batch->slot_count; slot++) {
        if (batch->joints[slot] != SKD_SLOT_EMPTY)
            skd_bone_set_add(&set, subject, batch->joints[slot], (double)batch->weights[slot], 0.0);
    }
    if (!skd_bone_set_problem(&set, subject, probe, &problem, open))
        return false;
    for (int r = 0; r < problem.count; r++)
        w[r] = set.weights[open[r]];
    skd_problem_minimise(&problem, false, w);
    for (int r = 0; r < problem.count; r++)
        set.weights[open[r]] = w[r];
    return skd_bone_set_show(&set, subject) > reached_one_pose * subject->options->length;
}

/* How far the start's weights are from the targets. */
static double edit_size(struct skd_subject *subject)
{
    struct skd_bone_set start = {.count = 0};
    for (int slot = 0; slot < subject->batch->slot_count; slot++) {
        if (subject->start_joints[slot] != SKD_SLOT_EMPTY)
            skd_bone_set_add(&start, subject, subject->start_joints[slot],
                             (double)subject->start_weights[slot], 0.0);
    }
    return skd_bone_set_show(&start, subject);
}

/* Whether the choice has a bone that no slot of the vertex has: else the plain solve is its best.
 */
static bool has_new_bone(const struct choice *choice, const struct skd_subject *subject)
{
    const size_t n = (size_t)subject->batch->slot_count;
    const uint16_t *row = subject->batch->joints + n * subject->vertex;
    for (int k = 0; k < choice->set.count; k++) {
        size_t i = 0;
        while (i < n && row[i] != choice->set.bones[k])
            i++;
        if (i == n)
            return true;
    }
    return false;
}

/* Looks for better slots than the plain solve's row; true if there are some. */
static bool find_slots(struct skd_subject *subject, const struct skd_evidence_bones *bones,
                       const float *plain, struct choice *choice)
{
    const double length = subject->options->length;
    const uint16_t *list = bones->lists + SKD_CANDIDATES_MAX * subject->item;
    const int listed = subject->aim_count < POSES_MANY ? LISTED_FEW : LISTED_MANY;
    const bool several = subject->aim_count > 1;
    const double rho = (several ? rank_more_poses : rank_one_pose) * length * length;
    struct skd_bone_set set;
    if (subject->aim_count == 0 || (!several && !is_out_of_reach(subject)))
        return false;
    gather(subject, plain, list, listed, rho, &set);
    choose(&set, subject, choice);
    if (several && choice->set.count > 0) {
        const double edit = left_of_edit * edit_size(subject), far = left_of_length * length;
        const double left = skd_bone_set_show(&choice->set, subject);
        if (left > (edit > far ? edit : far)) {
            struct choice wider;
            uint16_t extended[SKD_CANDIDATES_MAX];
            extend_list(subject, bones, list, listed, extended);
            gather(subject, plain, extended, SKD_CANDIDATES_MAX, rho, &set);
            choose(&set, subject, &wider);
            if (wider.lower && skd_bone_set_show(&wider.set, subject) < left)
                *choice = wider;
        }
    }
    return choice->lower && has_new_bone(choice, subject);
}

void skd_evidence_solve(const struct skd_solve_batch *batch,
                        const struct skd_solve_options *options,
                        const struct skd_evidence_bones *bones, uint16_t *joints_out)
{
    const size_t n = (size_t)batch->slot_count;
    SKD_ASSERT(options->method == SKD_METHOD_EXACT && batch->pulls == NULL);
    skd_solve(batch, options);
    for (size_t item = 0; item < batch->count; item++) {
        const size_t vertex = batch->vertices[item];
        struct skd_subject subject;
        struct choice choice;
        uint16_t *joints = joints_out + n * item;
        float *weights = batch->weights_out + n * item;
        memcpy(joints, batch->joints + n * vertex, n * sizeof *joints);
        if (batch->slot_count > SLOTS_KEPT_MAX || options->constraint == SKD_CONSTRAINT_AFFINE ||
            (batch->vertex_locked && batch->vertex_locked[vertex]))
            continue;
        skd_subject_read(batch, options, item, &subject);
        if (!find_slots(&subject, bones, weights, &choice))
            continue;
        lay_row(&choice.set, &subject, joints, weights);
        offer_next(&choice.set, &subject, bones->lists + SKD_CANDIDATES_MAX * item, joints);
        solve_row(&subject, joints, weights);
    }
}
