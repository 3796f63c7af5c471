/* See bone_set.h.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing.
 */
#include "solver/bone_set.h"

#include "base/error.h"
#include "solver/guard.h"
#include "solver/row.h"

void skd_subject_read(const struct skd_solve_batch *batch, const struct skd_solve_options *options,
                      size_t item, struct skd_subject *subject)
{
    SKD_ASSERT(batch->pose_count <= SKD_EVIDENCE_POSES_MAX);
    subject->batch = batch;
    subject->options = options;
    subject->item = item;
    subject->vertex = batch->vertices[item];
    subject->aim_count = 0;
    subject->strength = 0.0;
    const size_t first = (size_t)batch->slot_count * subject->vertex;
    subject->start_joints = (batch->start_joints ? batch->start_joints : batch->joints) + first;
    subject->start_weights = (batch->start_weights ? batch->start_weights : batch->anchor) + first;
    for (size_t axis = 0; axis < 3; axis++)
        subject->rest[axis] = (double)batch->rest[3 * subject->vertex + axis];
    for (int p = 0; p < batch->pose_count; p++) {
        const struct skd_solve_pose *pose = &batch->poses[p];
        const double strength = pose->strengths ? (double)pose->strengths[item] : 1.0;
        if (!(strength > 0.0))
            continue;
        struct skd_aim *aim = &subject->aims[subject->aim_count++];
        aim->matrices = pose->matrices;
        aim->strength = strength;
        for (size_t axis = 0; axis < 3; axis++)
            aim->target[axis] = (double)pose->targets[3 * item + axis];
        subject->strength += strength;
    }
}

double skd_subject_anchor(const struct skd_subject *subject, uint16_t bone)
{
    for (int slot = 0; slot < subject->batch->slot_count; slot++) {
        if (subject->start_joints[slot] == bone)
            return (double)subject->start_weights[slot];
    }
    return 0.0;
}

bool skd_bone_set_has(const struct skd_bone_set *set, uint16_t bone)
{
    for (int i = 0; i < set->count; i++) {
        if (set->bones[i] == bone)
            return true;
    }
    return false;
}

void skd_bone_set_add(struct skd_bone_set *set, const struct skd_subject *subject, uint16_t bone,
                      double weight, double prior)
{
    const uint8_t *locked = subject->batch->bone_locked;
    const int at = set->count++;
    SKD_ASSERT(at < SKD_SLOT_COUNT_MAX);
    set->bones[at] = bone;
    set->weights[at] = weight;
    set->anchor[at] = skd_subject_anchor(subject, bone);
    set->prior[at] = prior;
    set->held[at] = locked && locked[bone];
}

/* lambda mean_q |sum_i w_i d_i - sum_j o_j d_j|^2 with o over the start's bones. */
static void add_guard(const struct skd_bone_set *set, const struct skd_subject *subject,
                      struct skd_problem *problem, const int *open)
{
    const struct skd_solve_batch *batch = subject->batch;
    const double lambda = subject->options->guard;
    for (int r = 0; r < problem->count; r++) {
        const int bone = set->bones[open[r]];
        double apart = 0.0;
        for (int slot = 0; slot < batch->slot_count; slot++) {
            const uint16_t own = subject->start_joints[slot];
            if (own != SKD_SLOT_EMPTY)
                apart += (double)subject->start_weights[slot] *
                         skd_guard_pair(batch->guard, bone, own, subject->rest);
        }
        for (int i = 0; i < set->count; i++) {
            if (set->held[i])
                apart -= set->weights[i] *
                         skd_guard_pair(batch->guard, bone, set->bones[i], subject->rest);
        }
        problem->corners[r] += lambda * apart;
        for (int s = 0; s < problem->count; s++)
            problem->pairs[r][s] +=
                lambda * skd_guard_pair(batch->guard, bone, set->bones[open[s]], subject->rest);
    }
}

bool skd_bone_set_problem(const struct skd_bone_set *set, const struct skd_subject *subject,
                          double kappa, struct skd_problem *problem, int *open)
{
    double anchor[SKD_SLOT_COUNT_MAX], held = 0.0;
    int count = 0;
    for (int i = 0; i < set->count; i++) {
        held += set->held[i] ? set->weights[i] : 0.0;
        if (!set->held[i]) {
            anchor[count] = set->anchor[i];
            open[count++] = i;
        }
    }
    if (count == 0)
        return false;
    const double mass = held < 1.0 ? 1.0 - held : 0.0;
    const double length = subject->options->length;
    const double ridge = length * length * row_kappa_square(kappa);
    skd_problem_begin(problem, count, mass, ridge, anchor);
    for (int p = 0; p < subject->aim_count; p++) {
        const struct skd_aim *aim = &subject->aims[p];
        double carried[SKD_SLOT_COUNT_MAX][3];
        double goal[3] = {aim->target[0], aim->target[1], aim->target[2]};
        for (int i = 0; i < set->count; i++) {
            double d[3];
            if (!set->held[i])
                continue;
            row_carry(aim->matrices + SKD_MATRIX_SIZE * (size_t)set->bones[i], subject->rest, d);
            for (int axis = 0; axis < 3; axis++)
                goal[axis] -= set->weights[i] * d[axis];
        }
        for (int r = 0; r < count; r++)
            row_carry(aim->matrices + SKD_MATRIX_SIZE * (size_t)set->bones[open[r]], subject->rest,
                      carried[r]);
        skd_problem_add_pose(problem, aim->strength, carried, goal);
    }
    if (subject->batch->guard)
        add_guard(set, subject, problem, open);
    skd_problem_level(problem);
    return true;
}

double skd_bone_set_show(const struct skd_bone_set *set, struct skd_subject *subject)
{
    double sum = 0.0;
    for (int p = 0; p < subject->aim_count; p++) {
        struct skd_aim *aim = &subject->aims[p];
        aim->shown[0] = aim->shown[1] = aim->shown[2] = 0.0;
        for (int i = 0; i < set->count; i++) {
            double d[3];
            if (!(set->weights[i] > 0.0))
                continue;
            row_carry(aim->matrices + SKD_MATRIX_SIZE * (size_t)set->bones[i], subject->rest, d);
            for (int axis = 0; axis < 3; axis++)
                aim->shown[axis] += set->weights[i] * d[axis];
        }
        for (int axis = 0; axis < 3; axis++) {
            const double apart = aim->shown[axis] - aim->target[axis];
            sum += aim->strength * apart * apart;
        }
    }
    return subject->aim_count > 0 ? sqrt(sum / subject->strength) : 0.0;
}
