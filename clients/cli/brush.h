/* A sculpting brush: from a posed surface to the vertices that it moves.
 *
 * Pure: arrays in, arrays out; no wire, no files. Thread: any. Lengths are scene units.
 */
#ifndef SKD_CLI_BRUSH_H
#define SKD_CLI_BRUSH_H

#include "base/error.h"

#include <stddef.h>
#include <stdint.h>

enum skd_falloff {
    SKD_FALLOFF_SMOOTH,   /* 3s^2 - 2s^3, s = 1 - distance / radius */
    SKD_FALLOFF_LINEAR,   /* s */
    SKD_FALLOFF_CONSTANT, /* 1 */
    SKD_FALLOFF_SPHERE,   /* sqrt(1 - (1 - s)^2) */
    SKD_FALLOFF_SHARP,    /* s^2 */
};
extern const char *const skd_falloff_words[]; /* in the order of the enum, then NULL */

/* The share of a brush's displacement at distance / radius = t, t >= 0; 0 from t = 1 on. */
double skd_falloff_at(enum skd_falloff falloff, double t);

struct skd_brush {
    double centre[3];
    double radius;
    enum skd_falloff falloff;
    double move[3]; /* the displacement at the centre */
    double out;     /* ... and along each vertex's own normal, to the outside */
};

/* A surface in a pose. Vertices at one and the same rest position share a normal. */
struct skd_surface {
    size_t vertex_count;
    const float *rest;  /* [vertex_count][3]; needed where out is not 0 */
    const float *posed; /* [vertex_count][3] */
    size_t triangle_count;
    const uint32_t *triangles; /* [triangle_count][3], in range; needed where out is not 0 */
};

/* The vertices that move, in ascending order, and where to. */
struct skd_brushed {
    size_t count;
    uint32_t *vertices; /* [count], owned */
    float *positions;   /* [count][3], owned */
    double nearest;     /* distance from the centre to the nearest vertex */
};

/* Applies the brush: position + falloff(distance / radius) * (move + out * normal) for each vertex
 * nearer than the radius. A vertex whose surroundings have no area has no normal, and `out` leaves
 * it. Finish *brushed in any case. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_brush_apply(const struct skd_brush *brush,
                                               const struct skd_surface *surface,
                                               struct skd_brushed *brushed,
                                               struct skd_error *error);
void skd_brushed_finish(struct skd_brushed *brushed);

/* Weights as the daemon tells them: `slots` a vertex; joint 65535 is no bone. */
struct skd_weights {
    size_t vertex_count;
    size_t slots;
    const uint16_t *joints; /* [vertex_count][slots] */
    const float *weights;   /* [vertex_count][slots] */
};

/* Where a bone bends the surface: the vertex nearest to the middle of those that the bone shares
 * with its parent (each counts with the product of both weights), or to the middle of the bone's
 * own vertices when it shares none (parent -1: it has no parent). False when the bone moves no
 * vertex. */
bool skd_bone_centre(const struct skd_weights *weights, const float *posed, int bone, int parent,
                     double centre[3]);

#endif
