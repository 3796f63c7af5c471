/* See tessellation.h. */
#include "tessellation.h"

#include <string.h>

#include "base/error.h"

/* ---- chords -------------------------------------------------------------------------------- */

struct chords {
    uint16_t parent[CAGE_MAX_EDGES]; /* a forest; the root names the chord */
    double length[CAGE_MAX_EDGES];   /* of roots: the root mean square of their edges */
    uint32_t edge_count[CAGE_MAX_EDGES];
    uint32_t cuts[CAGE_MAX_EDGES];
    uint8_t is_full[CAGE_MAX_EDGES];
};

static uint32_t chord_of(struct chords *chords, uint32_t edge)
{
    while (chords->parent[edge] != edge) {
        chords->parent[edge] = chords->parent[chords->parent[edge]];
        edge = chords->parent[edge];
    }
    return edge;
}

static void join(struct chords *chords, uint32_t a, uint32_t b)
{
    uint32_t one = chord_of(chords, a), two = chord_of(chords, b);
    chords->parent[one > two ? one : two] = (uint16_t)(one > two ? two : one);
}

static double edge_length_squared(const struct surface *surface, uint32_t edge)
{
    static const uint8_t corner[4][2] = {{0, 0}, {0, 3}, {3, 3}, {3, 0}};
    uint32_t face = surface->edge[edge].face[0], side = surface->edge[edge].side[0];
    const uint8_t *start = corner[side], *end = corner[(side + 1) % 4];
    const double *a = surface->control[face][start[0]][start[1]];
    const double *b = surface->control[face][end[0]][end[1]];
    return vec3_length(
        vec3(b[VALUE_X] - a[VALUE_X], b[VALUE_Y] - a[VALUE_Y], b[VALUE_Z] - a[VALUE_Z]));
}

/* A chord and its mirror image are one, so that both halves get the same triangles. */
static void find_chords(struct chords *chords, const struct surface *surface)
{
    const struct cage *cage = surface->cage;
    for (uint32_t e = 0; e < surface->edge_count; ++e)
        chords->parent[e] = (uint16_t)e;
    for (uint32_t f = 0; f < cage->face_count; ++f) {
        const uint16_t *edges = surface->face_edge[f];
        const uint16_t *mirrored = surface->face_edge[cage->mirror_face[f]];
        join(chords, edges[0], edges[2]);
        join(chords, edges[1], edges[3]);
        join(chords, edges[0], mirrored[3]);
        join(chords, edges[1], mirrored[2]);
    }
    for (uint32_t e = 0; e < surface->edge_count; ++e) {
        uint32_t chord = chord_of(chords, e);
        chords->length[chord] += edge_length_squared(surface, e);
        chords->edge_count[chord]++;
        chords->cuts[chord] = 1;
    }
    for (uint32_t e = 0; e < surface->edge_count; ++e)
        if (chords->edge_count[e] > 0)
            chords->length[e] = sqrt(chords->length[e] / chords->edge_count[e]);
}

static void apply_cuts(struct tessellation *t, struct chords *chords)
{
    for (uint32_t e = 0; e < t->surface->edge_count; ++e)
        t->cuts[e] = chords->cuts[chord_of(chords, e)];
}

static uint64_t count_grid(const struct tessellation *t)
{
    const struct surface *surface = t->surface;
    uint64_t count = surface->cage->vertex_count;
    for (uint32_t e = 0; e < surface->edge_count; ++e)
        count += t->cuts[e] - 1;
    for (uint32_t f = 0; f < surface->cage->face_count; ++f)
        count += (uint64_t)(t->cuts[surface->face_edge[f][0]] - 1) *
                 (t->cuts[surface->face_edge[f][1]] - 1);
    return count;
}

static void refine(struct tessellation *t, struct chords *chords, uint32_t vertex_count)
{
    uint32_t edge_count = t->surface->edge_count;
    for (;;) {
        uint32_t longest = edge_count;
        double length = 0.0;
        for (uint32_t e = 0; e < edge_count; ++e) {
            if (chords->edge_count[e] == 0 || chords->is_full[e])
                continue;
            double piece = chords->length[e] / chords->cuts[e];
            if (piece > length) {
                length = piece;
                longest = e;
            }
        }
        if (longest == edge_count)
            return;
        chords->cuts[longest]++;
        apply_cuts(t, chords);
        if (count_grid(t) > vertex_count) {
            chords->cuts[longest]--;
            chords->is_full[longest] = 1;
            apply_cuts(t, chords);
        }
    }
}

/* ---- numbering ----------------------------------------------------------------------------- */

static uint32_t cuts_u(const struct tessellation *t, uint32_t face)
{
    return t->cuts[t->surface->face_edge[face][0]];
}

static uint32_t cuts_v(const struct tessellation *t, uint32_t face)
{
    return t->cuts[t->surface->face_edge[face][1]];
}

static void number_vertices(struct tessellation *t, uint32_t vertex_count)
{
    const struct surface *surface = t->surface;
    uint32_t next = surface->cage->vertex_count, quads = 0;
    for (uint32_t e = 0; e < surface->edge_count; ++e) {
        t->edge_first[e] = next;
        next += t->cuts[e] - 1;
    }
    for (uint32_t f = 0; f < surface->cage->face_count; ++f) {
        t->face_first[f] = next;
        t->quad_first[f] = quads;
        next += (cuts_u(t, f) - 1) * (cuts_v(t, f) - 1);
        quads += cuts_u(t, f) * cuts_v(t, f);
    }
    t->vertex_count = vertex_count;
    t->middle_first = next;
    t->middle_count = vertex_count - next;
    t->quad_count = quads;
    t->triangle_count = 2 * quads + 2 * t->middle_count;
    SKD_ASSERT(t->middle_count <= quads);
}

void skd_tessellation_init(struct tessellation *t, const struct surface *surface,
                           uint32_t vertex_count)
{
    SKD_ASSERT(vertex_count >= surface->cage->vertex_count);
    struct chords chords;
    memset(&chords, 0, sizeof chords);
    memset(t, 0, sizeof *t);
    t->surface = surface;
    find_chords(&chords, surface);
    apply_cuts(t, &chords);
    refine(t, &chords, vertex_count);
    number_vertices(t, vertex_count);
}

/* How many of the quads before this one have a middle: Bresenham's even spread. */
static uint32_t middles_before(const struct tessellation *t, uint32_t quad)
{
    return (uint32_t)((uint64_t)quad * t->middle_count / t->quad_count);
}

/* The vertex `step` pieces along side k of the face. */
static uint32_t side_vertex(const struct tessellation *t, uint32_t face, uint32_t k, uint32_t step)
{
    const struct surface *surface = t->surface;
    uint32_t e = surface->face_edge[face][k], cuts = t->cuts[e];
    if (step == 0)
        return surface->cage->face[face][k];
    if (step == cuts)
        return surface->cage->face[face][(k + 1) % 4];
    const struct surface_edge *edge = &surface->edge[e];
    int is_forward = edge->face[0] == face && edge->side[0] == k;
    return t->edge_first[e] + (is_forward ? step : cuts - step) - 1;
}

static uint32_t grid_vertex(const struct tessellation *t, uint32_t face, uint32_t i, uint32_t j)
{
    uint32_t nu = cuts_u(t, face), nv = cuts_v(t, face);
    if (j == 0)
        return side_vertex(t, face, 0, i);
    if (j == nv)
        return side_vertex(t, face, 2, nu - i);
    if (i == 0)
        return side_vertex(t, face, 3, nv - j);
    if (i == nu)
        return side_vertex(t, face, 1, j);
    return t->face_first[face] + (j - 1) * (nu - 1) + i - 1;
}

/* ---- output -------------------------------------------------------------------------------- */

typedef void visit_function(uint32_t vertex, uint32_t face, double u, double v, void *user);

static void visit_corners(const struct tessellation *t, visit_function *visit, void *user)
{
    const struct cage *cage = t->surface->cage;
    uint16_t face_of[CAGE_MAX_VERTICES];
    uint8_t corner_of[CAGE_MAX_VERTICES];
    for (uint32_t f = 0; f < cage->face_count; ++f) {
        for (uint8_t k = 0; k < 4; ++k) {
            face_of[cage->face[f][k]] = (uint16_t)f;
            corner_of[cage->face[f][k]] = k;
        }
    }
    for (uint32_t c = 0; c < cage->vertex_count; ++c)
        visit(c, face_of[c], corner_of[c] == 1 || corner_of[c] == 2 ? 1.0 : 0.0,
              corner_of[c] >= 2 ? 1.0 : 0.0, user);
}

static void visit_edges(const struct tessellation *t, visit_function *visit, void *user)
{
    for (uint32_t e = 0; e < t->surface->edge_count; ++e) {
        const struct surface_edge *edge = &t->surface->edge[e];
        for (uint32_t step = 1; step < t->cuts[e]; ++step) {
            double along = (double)step / t->cuts[e];
            const double u[4] = {along, 1.0, 1.0 - along, 0.0};
            const double v[4] = {0.0, along, 1.0, 1.0 - along};
            visit(t->edge_first[e] + step - 1, edge->face[0], u[edge->side[0]], v[edge->side[0]],
                  user);
        }
    }
}

void skd_tessellation_visit(const struct tessellation *t, visit_function *visit, void *user)
{
    visit_corners(t, visit, user);
    visit_edges(t, visit, user);
    uint32_t face_count = t->surface->cage->face_count;
    uint32_t vertex = t->middle_first;
    for (uint32_t f = 0; f < face_count; ++f) {
        uint32_t nu = cuts_u(t, f), nv = cuts_v(t, f);
        for (uint32_t j = 1; j < nv; ++j)
            for (uint32_t i = 1; i < nu; ++i)
                visit(t->face_first[f] + (j - 1) * (nu - 1) + i - 1, f, (double)i / nu,
                      (double)j / nv, user);
    }
    for (uint32_t f = 0; f < face_count; ++f) {
        uint32_t nu = cuts_u(t, f), nv = cuts_v(t, f), quad = t->quad_first[f];
        for (uint32_t j = 0; j < nv; ++j)
            for (uint32_t i = 0; i < nu; ++i, ++quad)
                if (middles_before(t, quad + 1) > middles_before(t, quad))
                    visit(vertex++, f, (i + 0.5) / nu, (j + 0.5) / nv, user);
    }
}

uint32_t skd_tessellation_face_limit(const struct tessellation *t)
{
    uint32_t largest = 0;
    for (uint32_t f = 0; f < t->surface->cage->face_count; ++f) {
        uint32_t quads = cuts_u(t, f) * cuts_v(t, f);
        largest = quads > largest ? quads : largest;
    }
    return 4 * largest;
}

static double distance_squared(const float *position, uint32_t a, uint32_t b)
{
    double sum = 0.0;
    for (size_t i = 0; i < 3; ++i) {
        double difference = (double)position[3 * (size_t)a + i] - position[3 * (size_t)b + i];
        sum += difference * difference;
    }
    return sum;
}

uint32_t skd_tessellation_triangles(const struct tessellation *t, uint32_t face,
                                    const float *position, uint32_t (*triangle)[3])
{
    uint32_t nu = cuts_u(t, face), nv = cuts_v(t, face);
    uint32_t quad = t->quad_first[face], count = 0;
    for (uint32_t j = 0; j < nv; ++j) {
        for (uint32_t i = 0; i < nu; ++i, ++quad) {
            const uint32_t corner[4] = {grid_vertex(t, face, i, j), grid_vertex(t, face, i + 1, j),
                                        grid_vertex(t, face, i + 1, j + 1),
                                        grid_vertex(t, face, i, j + 1)};
            uint32_t middle = middles_before(t, quad);
            if (middles_before(t, quad + 1) > middle) {
                for (uint32_t k = 0; k < 4; ++k) {
                    uint32_t *out = triangle[count++];
                    out[0] = corner[k];
                    out[1] = corner[(k + 1) % 4];
                    out[2] = t->middle_first + middle;
                }
                continue;
            }
            uint32_t turn = distance_squared(position, corner[1], corner[3]) <
                            distance_squared(position, corner[0], corner[2]);
            for (uint32_t half = 0; half < 2; ++half) {
                uint32_t *out = triangle[count++];
                out[0] = corner[(turn + 2 * half) % 4];
                out[1] = corner[(turn + 2 * half + 1) % 4];
                out[2] = corner[(turn + 2 * half + 2) % 4];
            }
        }
    }
    return count;
}
