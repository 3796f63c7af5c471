/* The thesis's method as it stands in chapters 6.4 and 7.6.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns its stack only.
 * The first three weights are the unknowns and the fourth is what they leave of one, so the order
 * of the slots matters. A quadratic w'A w + b.w + c is kept as A and b (c moves no minimum):
 *
 *     A = D'D + k^2 I + k^2 J        D = [d_0 - d_3, d_1 - d_3, d_2 - d_3]
 *     b = -2 D'(t - d_3) - 2 k^2 o_012 + 2 k^2 (o_3 - 1) j
 *
 * with o the weights before the stroke. Its minimum is -1/2 A^-1 b. Then, in the order x, y, z, w,
 * each weight that is below -1.2e-8 at that moment gets its penalty h added and everything is
 * solved again; penalties stay. Last comes normalizeVector: shift by the smallest if it is
 * negative, divide by the range if the largest is above one, divide by the sum.
 *
 * Where the thesis is silent: A is inverted by elimination in float64, which a singular matrix
 * stops (the weights stay); a row with locked or empty slots has no meaning here and stays.
 */
#include "solver/thesis.h"

#include "solver/row_choice.h"

static const double epsilon = 0.000000012;

struct quadratic {
    double a[3][3];
    double b[3];
};

/* Fills w with the minimum and the dependent fourth weight. False if A has no inverse. */
static bool minimise(const struct quadratic *q, double w[4])
{
    double l10 = q->a[1][0] / q->a[0][0];
    double l20 = q->a[2][0] / q->a[0][0];
    const double p0 = q->a[0][0];
    const double p1 = q->a[1][1] - l10 * q->a[1][0];
    const double s21 = q->a[2][1] - l20 * q->a[1][0];
    const double l21 = s21 / p1;
    const double p2 = q->a[2][2] - l20 * q->a[2][0] - l21 * s21;
    if (!(p0 > 0.0 && p1 > 0.0 && p2 > 0.0))
        return false;
    const double y0 = -0.5 * q->b[0];
    const double y1 = -0.5 * q->b[1] - l10 * y0;
    const double y2 = -0.5 * q->b[2] - l20 * y0 - l21 * y1;
    w[2] = y2 / p2;
    w[1] = y1 / p1 - l21 * w[2];
    w[0] = y0 / p0 - l10 * w[1] - l20 * w[2];
    w[3] = 1.0 - (w[0] + w[1] + w[2]);
    return isfinite(w[0]) && isfinite(w[1]) && isfinite(w[2]);
}

/* Quadratics 0, 1 and 2: reach the target, stay near the first three, stay near the fourth. */
static void compose(const struct skd_row *row, double k, struct quadratic *q)
{
    double d[3][3], p[3];
    for (int axis = 0; axis < 3; axis++) {
        p[axis] = row->target[axis] - row->carried[3][axis];
        for (int i = 0; i < 3; i++)
            d[i][axis] = row->carried[i][axis] - row->carried[3][axis];
    }
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            q->a[i][j] = d[i][0] * d[j][0] + d[i][1] * d[j][1] + d[i][2] * d[j][2] +
                         (i == j ? 2.0 : 1.0) * k * k;
        }
        q->b[i] = -2.0 * (d[i][0] * p[0] + d[i][1] * p[1] + d[i][2] * p[2]) -
                  2.0 * k * k * row->before[i] + 2.0 * k * k * (row->before[3] - 1.0);
    }
}

/* Adds h times the square of weight i, the fourth being 1 - x - y - z. */
static void penalise(struct quadratic *q, int i, double h)
{
    if (i < 3) {
        q->a[i][i] += h;
        return;
    }
    for (int r = 0; r < 3; r++) {
        q->b[r] -= 2.0 * h;
        for (int s = 0; s < 3; s++)
            q->a[r][s] += h;
    }
}

/* normalizeVector of chapter 7.6.2. */
static void normalise(double w[4])
{
    double least = 0.0, most = 1.0, sum = 0.0;
    for (int i = 0; i < 4; i++) {
        least = w[i] < least ? w[i] : least;
        most = w[i] > most ? w[i] : most;
    }
    for (int i = 0; i < 4; i++) {
        w[i] = (w[i] - least) / (most - least);
        sum += w[i];
    }
    for (int i = 0; i < 4; i++)
        w[i] /= sum;
}

static bool solve_row(const struct skd_row *row, double k, double h, double w[4])
{
    struct quadratic q;
    compose(row, k, &q);
    if (!minimise(&q, w))
        return false;
    for (int i = 0; i < 4; i++) {
        if (w[i] < -epsilon) {
            penalise(&q, i, h);
            if (!minimise(&q, w))
                return false;
        }
    }
    normalise(w);
    return isfinite(row_sum(4, w));
}

void skd_thesis_solve(const struct skd_solve_batch *batch, const struct skd_solve_options *options,
                      size_t item)
{
    struct skd_row row;
    double e[SKD_SLOT_COUNT_MAX][3], w[4], r[2][3];
    row_gather(4, batch, item, &row);
    const double rest_size = row_edges(4, &row, e);
    const struct skd_scene scene = row_scene(4, e, row.carried[0], row.target, rest_size);
    const bool solved = !row.locked && row.open_count == 4 &&
                        solve_row(&row, options->thesis_k, options->thesis_h, w);
    if (solved)
        row_store(4, 1.0, row.open, row.before, w);
    for (int i = 0; i < 4; i++) {
        w[i] = solved ? w[i] : row.before[i];
        batch->weights_out[4 * item + (size_t)i] = (float)w[i];
    }
    row_residual(4, e, &scene, row.before, r[0]);
    row_residual(4, e, &scene, w, r[1]);
    batch->residual_before[item] = (float)row_length(r[0]);
    batch->residual_after[item] = (float)row_length(r[1]);
}
