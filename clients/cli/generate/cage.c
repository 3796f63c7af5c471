/* See cage.h. The limits are asserted: what is built does not depend on any input. */
#include "cage.h"

#include "base/error.h"

uint16_t skd_cage_add_vertex(struct cage *cage, struct vec3 position, struct cage_marks marks)
{
    SKD_ASSERT(cage->vertex_count < CAGE_MAX_VERTICES);
    double *value = cage->value[cage->vertex_count];
    value[VALUE_X] = position.x;
    value[VALUE_Y] = position.y;
    value[VALUE_Z] = position.z;
    value[VALUE_ARM] = marks.arm;
    value[VALUE_LEG] = marks.leg;
    value[VALUE_THUMB] = marks.thumb;
    value[VALUE_FINGER] = marks.finger;
    value[VALUE_COLUMN] = marks.column;
    return (uint16_t)cage->vertex_count++;
}

void skd_cage_add_face(struct cage *cage, enum cage_part part, uint16_t a, uint16_t b, uint16_t c,
                       uint16_t d)
{
    SKD_ASSERT(cage->face_count < CAGE_MAX_FACES);
    uint32_t index = cage->face_count++;
    uint16_t *face = cage->face[index];
    face[0] = a;
    face[1] = b;
    face[2] = c;
    face[3] = d;
    cage->part[index] = (uint8_t)part;
    cage->is_right[index] = 0;
}

void skd_cage_bridge(struct cage *cage, enum cage_part part, const uint16_t *near,
                     const uint16_t *far, int first, int last, int ring_count)
{
    for (int k = first; k < last; ++k) {
        int a = k % ring_count, b = (k + 1) % ring_count;
        skd_cage_add_face(cage, part, near[a], near[b], far[b], far[a]);
    }
}

void skd_cage_mirror(struct cage *cage)
{
    uint32_t half_vertices = cage->vertex_count, half_faces = cage->face_count;
    for (uint32_t v = 0; v < half_vertices; ++v) {
        const double *value = cage->value[v];
        cage->mirror[v] = (uint16_t)v;
        if (value[VALUE_X] == 0.0)
            continue;
        SKD_ASSERT(cage->vertex_count < CAGE_MAX_VERTICES);
        uint32_t twin = cage->vertex_count++;
        for (int k = 0; k < VALUE_COUNT; ++k)
            cage->value[twin][k] = value[k];
        cage->value[twin][VALUE_X] = -value[VALUE_X];
        cage->mirror[v] = (uint16_t)twin;
        cage->mirror[twin] = (uint16_t)v;
    }
    for (uint32_t f = 0; f < half_faces; ++f) {
        const uint16_t *face = cage->face[f];
        uint32_t twin = cage->face_count;
        skd_cage_add_face(cage, (enum cage_part)cage->part[f], cage->mirror[face[0]],
                          cage->mirror[face[3]], cage->mirror[face[2]], cage->mirror[face[1]]);
        cage->is_right[twin] = 1;
        cage->mirror_face[f] = (uint16_t)twin;
        cage->mirror_face[twin] = (uint16_t)f;
    }
}
