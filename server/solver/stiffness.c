/* The anchor's strength from a first solve's leftovers.
 *
 * Stage: before a solve, inside solver/. Thread: any. Owns nothing.
 */
#include "solver/stiffness.h"

static const double ceiling = 0.03, share = 2.0;
static const double floor_one_pose = 5e-4, floor_more_poses = 1e-4;

static int count_targets(const struct skd_solve_batch *batch, size_t item)
{
    int count = 0;
    for (int p = 0; p < batch->pose_count; p++) {
        const float *strengths = batch->poses[p].strengths;
        count += !strengths || strengths[item] > 0.0F;
    }
    return count;
}

static void swap(float *a, float *b)
{
    const float kept = *a;
    *a = *b;
    *b = kept;
}

/* Puts the value that sorting would put at `rank` there, none larger before it (Hoare). */
static float select_rank(float *values, size_t count, size_t rank)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        const float pivot = values[low + (high - low) / 2];
        size_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (pivot < values[j])
                j--;
            if (i > j)
                break;
            swap(&values[i++], &values[j]);
            if (j == 0)
                break;
            j--;
        }
        if (rank <= j)
            high = j;
        else if (rank >= i)
            low = i;
        else
            break;
    }
    return values[rank];
}

static double median(float *values, size_t count)
{
    const double upper = (double)select_rank(values, count, count / 2);
    if (count % 2 == 1)
        return upper;
    float lower = values[0];
    for (size_t i = 1; i < count / 2; i++)
        lower = values[i] > lower ? values[i] : lower;
    return 0.5 * ((double)lower + upper);
}

double skd_stiffness_choose(const struct skd_solve_batch *solved, double length, float *leftovers)
{
    size_t used = 0, several = 0;
    for (size_t item = 0; item < solved->count; item++) {
        const int targets = count_targets(solved, item);
        if (targets == 0 ||
            (solved->vertex_locked && solved->vertex_locked[solved->vertices[item]]))
            continue;
        several += targets >= 2;
        leftovers[used++] = leftovers[item];
    }
    const double floor = used > 0 && 2 * several >= used ? floor_more_poses : floor_one_pose;
    if (used == 0)
        return floor;
    const double wanted = share * median(leftovers, used) / length;
    const double raised = wanted > floor ? wanted : floor;
    return raised < ceiling ? raised : ceiling;
}
