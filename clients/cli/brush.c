/* See brush.h. */
#include "clients/cli/brush.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const skd_falloff_words[] = {"smooth", "linear", "constant", "sphere", "sharp", NULL};

double skd_falloff_at(enum skd_falloff falloff, double t)
{
    double s = 1 - t;
    if (!(s > 0))
        return 0;
    switch (falloff) {
    case SKD_FALLOFF_SMOOTH:
        return s * s * (3 - 2 * s);
    case SKD_FALLOFF_LINEAR:
        return s;
    case SKD_FALLOFF_CONSTANT:
        return 1;
    case SKD_FALLOFF_SPHERE:
        return sqrt(1 - t * t);
    case SKD_FALLOFF_SHARP:
        return s * s;
    }
    return 0;
}

static double distance_to(const float *position, const double centre[3])
{
    double x = (double)position[0] - centre[0];
    double y = (double)position[1] - centre[1];
    double z = (double)position[2] - centre[2];
    return sqrt(x * x + y * y + z * z);
}

/* Twice a triangle's area along its normal. */
static void area_vector(const float *a, const float *b, const float *c, double area[3])
{
    double u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = (double)b[i] - (double)a[i];
        v[i] = (double)c[i] - (double)a[i];
    }
    area[0] = u[1] * v[2] - u[2] * v[1];
    area[1] = u[2] * v[0] - u[0] * v[2];
    area[2] = u[0] * v[1] - u[1] * v[0];
}

/* A vertex under the brush, with its rest position for finding its twins. */
struct touched {
    float rest[3];
    uint32_t index; /* into the brushed vertices */
};

static int compare_rest(const void *left, const void *right)
{
    const struct touched *a = left, *b = right;
    return memcmp(a->rest, b->rest, sizeof a->rest);
}

/* Gives vertices at one rest position the sum of their normals, so that a seam stays closed. */
static bool join_twins(const struct skd_surface *surface, const struct skd_brushed *brushed,
                       double *normals)
{
    struct touched *touched = malloc((brushed->count + 1) * sizeof *touched);
    if (touched == NULL)
        return false;
    for (size_t i = 0; i < brushed->count; i++) {
        const float *rest = surface->rest + 3 * (size_t)brushed->vertices[i];
        for (int k = 0; k < 3; k++)
            touched[i].rest[k] = rest[k] + 0.0f; /* -0 becomes 0 */
        touched[i].index = (uint32_t)i;
    }
    qsort(touched, brushed->count, sizeof *touched, compare_rest);
    for (size_t begin = 0, end; begin < brushed->count; begin = end) {
        double sum[3] = {0, 0, 0};
        for (end = begin; end < brushed->count && compare_rest(&touched[begin], &touched[end]) == 0;
             end++) {
            for (int k = 0; k < 3; k++)
                sum[k] += normals[3 * (size_t)touched[end].index + (size_t)k];
        }
        for (size_t i = begin; i < end; i++)
            memcpy(normals + 3 * (size_t)touched[i].index, sum, sizeof sum);
    }
    free(touched);
    return true;
}

static void normalise(double vector[3])
{
    double length = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    for (int i = 0; i < 3; i++)
        vector[i] = length > DBL_MIN ? vector[i] / length : 0;
}

/* Unit normals of the brushed vertices in the posed surface, each triangle counting with its area.
 * NULL: no memory. */
static double *make_normals(const struct skd_surface *surface, const struct skd_brushed *brushed)
{
    double *normals = calloc(3 * brushed->count + 1, sizeof *normals);
    uint32_t *places = calloc(surface->vertex_count + 1, sizeof *places); /* + 1; 0: not brushed */
    bool is_done = normals != NULL && places != NULL;
    for (size_t i = 0; is_done && i < brushed->count; i++)
        places[brushed->vertices[i]] = (uint32_t)i + 1;
    for (size_t i = 0; is_done && i < surface->triangle_count; i++) {
        const uint32_t *corners = surface->triangles + 3 * i;
        if ((places[corners[0]] | places[corners[1]] | places[corners[2]]) == 0)
            continue;
        double area[3];
        area_vector(surface->posed + 3 * (size_t)corners[0],
                    surface->posed + 3 * (size_t)corners[1],
                    surface->posed + 3 * (size_t)corners[2], area);
        for (int corner = 0; corner < 3; corner++) {
            size_t place = places[corners[corner]];
            for (size_t k = 0; place > 0 && k < 3; k++)
                normals[3 * (place - 1) + k] += area[k];
        }
    }
    free(places);
    if (!is_done || !join_twins(surface, brushed, normals)) {
        free(normals);
        return NULL;
    }
    for (size_t i = 0; i < brushed->count; i++)
        normalise(normals + 3 * i);
    return normals;
}

/* Finds the vertices nearer than the radius. */
static bool select_vertices(const struct skd_brush *brush, const struct skd_surface *surface,
                            struct skd_brushed *brushed)
{
    brushed->nearest = INFINITY;
    brushed->vertices = malloc((surface->vertex_count + 1) * sizeof *brushed->vertices);
    if (brushed->vertices == NULL)
        return false;
    for (size_t i = 0; i < surface->vertex_count; i++) {
        double distance = distance_to(surface->posed + 3 * i, brush->centre);
        brushed->nearest = fmin(brushed->nearest, distance);
        if (distance < brush->radius)
            brushed->vertices[brushed->count++] = (uint32_t)i;
    }
    return true;
}

enum skd_status skd_brush_apply(const struct skd_brush *brush, const struct skd_surface *surface,
                                struct skd_brushed *brushed, struct skd_error *error)
{
    double *normals = NULL;
    *brushed = (struct skd_brushed){0};
    if (!select_vertices(brush, surface, brushed))
        return skd_fail_memory(error, "the brushed vertices");
    brushed->positions = malloc((3 * brushed->count + 1) * sizeof *brushed->positions);
    if (brush->out != 0)
        normals = make_normals(surface, brushed);
    if (brushed->positions == NULL || (brush->out != 0 && normals == NULL)) {
        free(normals);
        return skd_fail_memory(error, "the brushed vertices");
    }
    for (size_t i = 0; i < brushed->count; i++) {
        const float *posed = surface->posed + 3 * (size_t)brushed->vertices[i];
        double share =
            skd_falloff_at(brush->falloff, distance_to(posed, brush->centre) / brush->radius);
        for (size_t k = 0; k < 3; k++) {
            double along = normals != NULL ? brush->out * normals[3 * i + k] : 0;
            brushed->positions[3 * i + k] =
                (float)((double)posed[k] + share * (brush->move[k] + along));
        }
    }
    free(normals);
    return SKD_OK;
}

void skd_brushed_finish(struct skd_brushed *brushed)
{
    free(brushed->vertices);
    free(brushed->positions);
    *brushed = (struct skd_brushed){0};
}

/* The weight of a bone at a vertex. */
static double weight_of(const struct skd_weights *weights, size_t vertex, int bone)
{
    double sum = 0;
    for (size_t slot = vertex * weights->slots; slot < (vertex + 1) * weights->slots; slot++)
        sum += weights->joints[slot] == bone ? (double)weights->weights[slot] : 0;
    return sum;
}

/* How much a vertex counts: both weights' product; with parent -1 the bone's own. */
static double share_of(const struct skd_weights *weights, size_t vertex, int bone, int parent)
{
    double own = weight_of(weights, vertex, bone);
    return parent < 0 || !(own > 0) ? own : own * weight_of(weights, vertex, parent);
}

bool skd_bone_centre(const struct skd_weights *weights, const float *posed, int bone, int parent,
                     double centre[3])
{
    double sum = 0, middle[3] = {0, 0, 0}, nearest = INFINITY;
    for (size_t i = 0; i < weights->vertex_count; i++) {
        double share = share_of(weights, i, bone, parent);
        sum += share;
        for (size_t k = 0; k < 3; k++)
            middle[k] += share * (double)posed[3 * i + k];
    }
    if (!(sum > 0))
        return parent >= 0 && skd_bone_centre(weights, posed, bone, -1, centre);
    for (int k = 0; k < 3; k++)
        middle[k] /= sum;
    for (size_t i = 0; i < weights->vertex_count; i++) {
        if (!(share_of(weights, i, bone, parent) > 0))
            continue;
        double distance = distance_to(posed + 3 * i, middle);
        if (distance < nearest) {
            nearest = distance;
            for (size_t k = 0; k < 3; k++)
                centre[k] = (double)posed[3 * i + k];
        }
    }
    return true;
}
