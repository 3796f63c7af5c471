/* See surface.h. */
#include "surface.h"

#include <string.h>

#include "base/error.h"

/* More passes follow the corners more closely and let the surface wave between them. */
enum { FIT_PASSES = 8 };

static void link_edges(struct surface *surface)
{
    const struct cage *cage = surface->cage;
    for (uint32_t f = 0; f < cage->face_count; ++f) {
        for (uint32_t k = 0; k < 4; ++k) {
            uint16_t start = cage->face[f][k], end = cage->face[f][(k + 1) % 4];
            uint32_t e = 0;
            while (e < surface->edge_count &&
                   !(surface->edge[e].start == end && surface->edge[e].end == start))
                ++e;
            struct surface_edge *edge = &surface->edge[e];
            int second = e < surface->edge_count;
            if (!second) {
                SKD_ASSERT(e < CAGE_MAX_EDGES);
                ++surface->edge_count;
                edge->start = start;
                edge->end = end;
            }
            edge->face[second] = (uint16_t)f;
            edge->side[second] = (uint8_t)k;
            surface->face_edge[f][k] = (uint16_t)e;
            surface->valence[start]++;
        }
    }
    SKD_ASSERT(surface->edge_count == 2 * cage->face_count);
}

/* The patch's inner control point next to corner k: Loop and Schaefer's interior mask. */
static void inner_point(const struct surface *surface, uint32_t f, uint32_t k,
                        double out[VALUE_COUNT])
{
    const struct cage *cage = surface->cage;
    const uint16_t *face = cage->face[f];
    const double *corner = cage->value[face[k]], *opposite = cage->value[face[(k + 2) % 4]];
    const double *next = cage->value[face[(k + 1) % 4]], *last = cage->value[face[(k + 3) % 4]];
    double n = surface->valence[face[k]];
    for (int i = 0; i < VALUE_COUNT; ++i)
        out[i] = (n * corner[i] + 2.0 * (next[i] + last[i]) + opposite[i]) / (n + 5.0);
}

/* The surface's point at each corner is the mean of the inner points around it. */
static void limit_points(const struct surface *surface, double (*limit)[VALUE_COUNT])
{
    const struct cage *cage = surface->cage;
    memset(limit, 0, cage->vertex_count * sizeof *limit);
    for (uint32_t f = 0; f < cage->face_count; ++f) {
        for (uint32_t k = 0; k < 4; ++k) {
            double inner[VALUE_COUNT];
            inner_point(surface, f, k, inner);
            uint16_t corner = cage->face[f][k];
            for (int i = 0; i < VALUE_COUNT; ++i)
                limit[corner][i] += inner[i] / surface->valence[corner];
        }
    }
}

static void fit_positions(const struct surface *surface, struct cage *cage)
{
    static const int position[] = {VALUE_X, VALUE_Y, VALUE_Z};
    double target[CAGE_MAX_VERTICES][3];
    double limit[CAGE_MAX_VERTICES][VALUE_COUNT];
    for (uint32_t v = 0; v < cage->vertex_count; ++v)
        for (int i = 0; i < 3; ++i)
            target[v][i] = cage->value[v][position[i]];
    for (int pass = 0; pass < FIT_PASSES; ++pass) {
        limit_points(surface, limit);
        for (uint32_t v = 0; v < cage->vertex_count; ++v)
            for (int i = 0; i < 3; ++i)
                cage->value[v][position[i]] += target[v][i] - limit[v][position[i]];
    }
}

/* Where corner k's inner point lies in control[v][u], and where the edge points beside it do. */
struct corner_place {
    uint8_t inner[2], corner[2], next[2], last[2];
};

static const struct corner_place corner_places[4] = {
    {{1, 1}, {0, 0}, {0, 1}, {1, 0}},
    {{1, 2}, {0, 3}, {1, 3}, {0, 2}},
    {{2, 2}, {3, 3}, {3, 2}, {2, 3}},
    {{2, 1}, {3, 0}, {2, 0}, {3, 1}},
};

static void make_patches(struct surface *surface)
{
    const struct cage *cage = surface->cage;
    double limit[CAGE_MAX_VERTICES][VALUE_COUNT];
    limit_points(surface, limit);
    for (uint32_t f = 0; f < cage->face_count; ++f) {
        for (uint32_t k = 0; k < 4; ++k) {
            const struct corner_place *place = &corner_places[k];
            double *inner = surface->control[f][place->inner[0]][place->inner[1]];
            inner_point(surface, f, k, inner);
            memcpy(surface->control[f][place->corner[0]][place->corner[1]], limit[cage->face[f][k]],
                   sizeof *limit);
        }
    }
    /* An edge's control points are the means of the inner points on its two sides. */
    for (uint32_t e = 0; e < surface->edge_count; ++e) {
        const struct surface_edge *edge = &surface->edge[e];
        for (uint32_t end = 0; end < 2; ++end) {
            const struct corner_place *a = &corner_places[(edge->side[0] + end) % 4];
            const struct corner_place *b = &corner_places[(edge->side[1] + 1 - end) % 4];
            const uint8_t *to_a = end ? a->last : a->next, *to_b = end ? b->next : b->last;
            double(*one)[4][VALUE_COUNT] = surface->control[edge->face[0]];
            double(*two)[4][VALUE_COUNT] = surface->control[edge->face[1]];
            const double *inner_a = one[a->inner[0]][a->inner[1]];
            const double *inner_b = two[b->inner[0]][b->inner[1]];
            for (int i = 0; i < VALUE_COUNT; ++i) {
                double mean = 0.5 * (inner_a[i] + inner_b[i]);
                one[to_a[0]][to_a[1]][i] = mean;
                two[to_b[0]][to_b[1]][i] = mean;
            }
        }
    }
}

void skd_surface_init(struct surface *surface, struct cage *cage)
{
    memset(surface, 0, sizeof *surface);
    surface->cage = cage;
    link_edges(surface);
    fit_positions(surface, cage);
    make_patches(surface);
}

static void bernstein(double t, double basis[4])
{
    double s = 1.0 - t;
    basis[0] = s * s * s;
    basis[1] = 3.0 * s * s * t;
    basis[2] = 3.0 * s * t * t;
    basis[3] = t * t * t;
}

void skd_surface_evaluate(const struct surface *surface, uint32_t face, double u, double v,
                          double value[VALUE_COUNT])
{
    double along_u[4], along_v[4];
    bernstein(u, along_u);
    bernstein(v, along_v);
    for (int i = 0; i < VALUE_COUNT; ++i)
        value[i] = 0.0;
    for (int row = 0; row < 4; ++row) {
        for (int column = 0; column < 4; ++column) {
            const double *control = surface->control[face][row][column];
            double basis = along_v[row] * along_u[column];
            for (int i = 0; i < VALUE_COUNT; ++i)
                value[i] += basis * control[i];
        }
    }
}
