/* See nearest.h. */
#include "session/nearest.h"

enum { LEAF_POINTS = 8 };

static int widest_axis(size_t count, const struct skd_point *points)
{
    double widest = -1;
    int axis = 0;
    for (int i = 0; i < 3; i++) {
        float least = points[0].at[i], most = points[0].at[i];
        for (size_t k = 1; k < count; k++) {
            least = points[k].at[i] < least ? points[k].at[i] : least;
            most = points[k].at[i] > most ? points[k].at[i] : most;
        }
        if ((double)most - (double)least > widest) {
            widest = (double)most - (double)least;
            axis = i;
        }
    }
    return axis;
}

/* No two points are alike in this order, so that equal coordinates do not slow the search down. */
static int precedes(const struct skd_point *a, const struct skd_point *b, int axis)
{
    return a->at[axis] < b->at[axis] || (a->at[axis] <= b->at[axis] && a->vertex < b->vertex);
}

static void swap(struct skd_point *a, struct skd_point *b)
{
    struct skd_point kept = *a;
    *a = *b;
    *b = kept;
}

/* Puts the point that belongs at `wanted` there, smaller ones before it (Hoare's selection). */
static void select_point(struct skd_point *points, size_t count, size_t wanted, int axis)
{
    size_t low = 0, high = count; /* it lies in [low, high) */
    uint32_t chance = 0x9e3779b9u;
    while (high - low > 1) {
        chance = chance * 1664525u + 1013904223u; /* no file can foresee a bad pivot twice */
        swap(&points[low], &points[low + (chance >> 8) % (high - low)]);
        const struct skd_point pivot = points[low];
        size_t first = low, last = high;
        for (;;) {
            do
                first++;
            while (first < high && precedes(&points[first], &pivot, axis));
            do
                last--;
            while (precedes(&pivot, &points[last], axis));
            if (first >= last)
                break;
            swap(&points[first], &points[last]);
        }
        swap(&points[low], &points[last]);
        if (last == wanted)
            return;
        if (last < wanted)
            low = last + 1;
        else
            high = last;
    }
}

void skd_nearest_build(size_t count, struct skd_point *points, uint8_t *axes)
{
    while (count > LEAF_POINTS) {
        size_t middle = count / 2;
        int axis = widest_axis(count, points);
        select_point(points, count, middle, axis);
        axes[middle] = (uint8_t)axis;
        skd_nearest_build(middle, points, axes);
        points += middle + 1;
        axes += middle + 1;
        count -= middle + 1;
    }
}

static const struct skd_point *nearer(const struct skd_point *point, const double at[3],
                                      const struct skd_point *best, double *square)
{
    double distance = 0;
    for (int i = 0; i < 3; i++) {
        double apart = (double)point->at[i] - at[i];
        distance += apart * apart;
    }
    if (!(distance < *square))
        return best;
    *square = distance;
    return point;
}

static const struct skd_point *look(size_t count, const struct skd_point *points,
                                    const uint8_t *axes, const double at[3],
                                    const struct skd_point *best, double *square)
{
    if (count <= LEAF_POINTS) {
        for (size_t i = 0; i < count; i++)
            best = nearer(&points[i], at, best, square);
        return best;
    }
    size_t middle = count / 2, after = middle + 1;
    int axis = axes[middle];
    double apart = at[axis] - (double)points[middle].at[axis];
    best = nearer(&points[middle], at, best, square);
    if (apart < 0)
        best = look(middle, points, axes, at, best, square);
    if (apart >= 0 || apart * apart < *square)
        best = look(count - after, points + after, axes + after, at, best, square);
    if (apart >= 0 && apart * apart < *square)
        best = look(middle, points, axes, at, best, square);
    return best;
}

const struct skd_point *skd_nearest_find(size_t count, const struct skd_point *points,
                                         const uint8_t *axes, const double at[3], double *square)
{
    return look(count, points, axes, at, NULL, square);
}
