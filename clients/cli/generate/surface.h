/* A smooth surface through the corners of a cage: one bicubic Bezier patch a quad.
 *
 * Pure; any thread. Owns the patches and the list of edges inline (about 1.5 MB: keep it on the
 * heap); borrows the cage while it is made and evaluated.
 *
 * The patches are the geometry patches of Loop and Schaefer, "Approximating Catmull-Clark
 * Subdivision Surfaces with Bicubic Patches" (2008): equal to the Catmull-Clark surface where four
 * quads meet, and without gaps everywhere. Corner k of a face is at (u, v) = (0,0), (1,0), (1,1),
 * (0,1); edge k runs from corner k to corner k + 1.
 */
#ifndef SKD_GENERATE_SURFACE_H
#define SKD_GENERATE_SURFACE_H

#include "cage.h"

enum { CAGE_MAX_EDGES = 2 * CAGE_MAX_FACES };

/* A closed surface: each edge has two faces, which run along it in opposite directions. */
struct surface_edge {
    uint16_t start, end; /* cage corners in the direction of face[0] */
    uint16_t face[2];
    uint8_t side[2]; /* which edge of each face this is */
};

struct surface {
    const struct cage *cage;
    uint32_t edge_count;
    struct surface_edge edge[CAGE_MAX_EDGES];
    uint16_t face_edge[CAGE_MAX_FACES][4];
    uint8_t valence[CAGE_MAX_VERTICES];
    double control[CAGE_MAX_FACES][4][4][VALUE_COUNT]; /* [v][u] */
};

/* Moves the cage's corners until the surface goes (nearly) through where they were, then makes the
 * patches. Marks are smoothed, not met. */
void skd_surface_init(struct surface *surface, struct cage *cage);

/* The values at (u, v) of a face; u, v in 0..1. */
void skd_surface_evaluate(const struct surface *surface, uint32_t face, double u, double v,
                          double value[VALUE_COUNT]);

#endif
