/* See mesh.h. */
#include "mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "body.h"

struct vertex_writer {
    struct mesh *mesh;
    const struct weight_model *weights;
};

static void write_vertex(uint32_t vertex, uint32_t face, double u, double v, void *user)
{
    struct vertex_writer *writer = user;
    struct mesh *mesh = writer->mesh;
    const struct surface *surface = mesh->tessellation->surface;
    double value[VALUE_COUNT];
    skd_surface_evaluate(surface, face, u, v, value);
    struct vec3 point = skd_body_detail(vec3(value[VALUE_X], value[VALUE_Y], value[VALUE_Z]));
    float *position = &mesh->position[3 * (size_t)vertex];
    position[0] = (float)point.x;
    position[1] = (float)point.y;
    position[2] = (float)point.z;
    for (int i = 0; i < 3; ++i) {
        mesh->lowest[i] = fminf(mesh->lowest[i], position[i]);
        mesh->highest[i] = fmaxf(mesh->highest[i], position[i]);
    }
    skd_weights_at(writer->weights, (enum cage_part)surface->cage->part[face],
                   surface->cage->is_right[face], point, value,
                   &mesh->joint[INFLUENCE_COUNT * (size_t)vertex],
                   &mesh->weight[INFLUENCE_COUNT * (size_t)vertex]);
}

static struct vec3 read_position(const struct mesh *mesh, uint32_t vertex)
{
    const float *position = &mesh->position[3 * (size_t)vertex];
    return vec3(position[0], position[1], position[2]);
}

/* The mean of the triangles' normals around a vertex, by area. */
static void write_normals(struct mesh *mesh)
{
    const struct tessellation *t = mesh->tessellation;
    memset(mesh->normal, 0, 3 * (size_t)t->vertex_count * sizeof *mesh->normal);
    for (uint32_t face = 0; face < t->surface->cage->face_count; ++face) {
        uint32_t count = skd_tessellation_triangles(t, face, mesh->position, mesh->triangle);
        for (uint32_t i = 0; i < count; ++i) {
            const uint32_t *corner = mesh->triangle[i];
            struct vec3 a = read_position(mesh, corner[0]);
            struct vec3 n = vec3_cross(vec3_sub(read_position(mesh, corner[1]), a),
                                       vec3_sub(read_position(mesh, corner[2]), a));
            for (int k = 0; k < 3; ++k) {
                float *normal = &mesh->normal[3 * (size_t)corner[k]];
                normal[0] += (float)n.x;
                normal[1] += (float)n.y;
                normal[2] += (float)n.z;
            }
        }
    }
    for (uint32_t vertex = 0; vertex < t->vertex_count; ++vertex) {
        float *normal = &mesh->normal[3 * (size_t)vertex];
        struct vec3 n = vec3(normal[0], normal[1], normal[2]);
        double length = vec3_length(n);
        SKD_ASSERT(length > 0.0);
        normal[0] = (float)(n.x / length);
        normal[1] = (float)(n.y / length);
        normal[2] = (float)(n.z / length);
    }
}

enum skd_status skd_mesh_init(struct mesh *mesh, const struct tessellation *tessellation,
                              const struct weight_model *weights, struct skd_error *error)
{
    size_t count = tessellation->vertex_count;
    memset(mesh, 0, sizeof *mesh);
    mesh->tessellation = tessellation;
    mesh->position = malloc(3 * count * sizeof *mesh->position);
    mesh->normal = malloc(3 * count * sizeof *mesh->normal);
    mesh->joint = malloc(INFLUENCE_COUNT * count * sizeof *mesh->joint);
    mesh->weight = malloc(INFLUENCE_COUNT * count * sizeof *mesh->weight);
    mesh->triangle = malloc(skd_tessellation_face_limit(tessellation) * sizeof *mesh->triangle);
    if (mesh->position == NULL || mesh->normal == NULL || mesh->joint == NULL ||
        mesh->weight == NULL || mesh->triangle == NULL)
        return skd_fail_memory(error, "the figure's vertices");
    for (int i = 0; i < 3; ++i) {
        mesh->lowest[i] = INFINITY;
        mesh->highest[i] = -INFINITY;
    }
    struct vertex_writer writer = {mesh, weights};
    skd_tessellation_visit(tessellation, write_vertex, &writer);
    write_normals(mesh);
    return SKD_OK;
}

void skd_mesh_finish(struct mesh *mesh)
{
    free(mesh->position);
    free(mesh->normal);
    free(mesh->joint);
    free(mesh->weight);
    free(mesh->triangle);
}
