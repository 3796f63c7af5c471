/* Cuts a smooth surface into triangles with an exact number of vertices.
 *
 * Pure; any thread. Owns its tables inline (about 50 kB: keep it on the heap); borrows the surface.
 *
 * A cut across a quad goes on through the opposite edge into the next quad, so edges form chords
 * that share a number of cuts. Chords are refined one by one, the longest pieces first, while the
 * count stays within what was asked for. The rest, less than one chord's worth, becomes vertices in
 * the middle of quads, which are spread evenly:
 *
 *      .---.---.---.        vertices: cage corners, then inside of edges, then inside of faces,
 *      | / | / |\ /|                  then middles
 *      .---.---. x .        triangles: two a quad, four around a middle
 *      | / | / |/ \|
 *      .---.---.---.
 */
#ifndef SKD_GENERATE_TESSELLATION_H
#define SKD_GENERATE_TESSELLATION_H

#include "surface.h"

struct tessellation {
    const struct surface *surface;
    uint32_t vertex_count, triangle_count;
    uint32_t quad_count, middle_count, middle_first;
    uint32_t cuts[CAGE_MAX_EDGES];       /* pieces an edge is cut into */
    uint32_t edge_first[CAGE_MAX_EDGES]; /* the first vertex inside the edge, from its start */
    uint32_t face_first[CAGE_MAX_FACES]; /* the first vertex inside the face, rows along u */
    uint32_t quad_first[CAGE_MAX_FACES];
};

/* vertex_count must not be below the number of cage corners. */
void skd_tessellation_init(struct tessellation *tessellation, const struct surface *surface,
                           uint32_t vertex_count);

/* Calls visit once for each vertex, in order, with a face and a place on it. */
void skd_tessellation_visit(const struct tessellation *tessellation,
                            void (*visit)(uint32_t vertex, uint32_t face, double u, double v,
                                          void *user),
                            void *user);

/* The largest number of triangles of one face. */
uint32_t skd_tessellation_face_limit(const struct tessellation *tessellation);

/* Writes the face's triangles, counter-clockwise from outside, and returns their number. Quads are
 * cut along their shorter diagonal; position is 3 floats a vertex. */
uint32_t skd_tessellation_triangles(const struct tessellation *tessellation, uint32_t face,
                                    const float *position, uint32_t (*triangle)[3]);

#endif
