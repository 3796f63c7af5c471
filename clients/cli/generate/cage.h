/* The coarse cage of quads that stands behind the skin: a closed surface of some thousand corners.
 *
 * Pure; any thread. Owns its arrays inline (about 150 kB: keep it on the heap). Knows nothing of
 * what it depicts; body.c fills it.
 *
 * Only the left half (x >= 0) is built by hand; corners on x = 0 are shared with the mirror image.
 * Rings are named by arrays of corner numbers, in the order that makes bridges face outwards.
 */
#ifndef SKD_GENERATE_CAGE_H
#define SKD_GENERATE_CAGE_H

#include <stdbool.h>
#include <stdint.h>

#include "geometry.h"

enum { CAGE_MAX_VERTICES = 1000, CAGE_MAX_FACES = 1024, CAGE_MAX_RING = 16 };

/* What a point of the surface carries. After the position come marks, smooth over the surface, by
 * which the weights tell limbs apart: all are 0 on the trunk. */
enum cage_value {
    VALUE_X,
    VALUE_Y,
    VALUE_Z,
    VALUE_ARM,    /* 1 on the arm */
    VALUE_LEG,    /* 1 on the leg */
    VALUE_THUMB,  /* 1 on the thumb, some on its ball */
    VALUE_FINGER, /* 1 on the fingers past the web */
    VALUE_COLUMN, /* across the hand: 0 before the index finger .. 4 behind the little finger */
    VALUE_COUNT
};

enum cage_part {
    PART_TORSO,
    PART_ARM,
    PART_HAND,
    PART_LEG,
    PART_FINGER_FIRST, /* + finger, 0 the thumb */
    PART_COUNT = PART_FINGER_FIRST + 5
};

struct cage {
    uint32_t vertex_count, face_count;
    double value[CAGE_MAX_VERTICES][VALUE_COUNT];
    uint16_t mirror[CAGE_MAX_VERTICES]; /* the corner's mirror image; itself on x = 0 */
    uint16_t face[CAGE_MAX_FACES][4];   /* counter-clockwise from outside */
    uint8_t part[CAGE_MAX_FACES];
    uint8_t is_right[CAGE_MAX_FACES];
    uint16_t mirror_face[CAGE_MAX_FACES];
};

/* The marks that new corners get. */
struct cage_marks {
    double arm, leg, thumb, finger, column;
};

uint16_t skd_cage_add_vertex(struct cage *cage, struct vec3 position, struct cage_marks marks);

void skd_cage_add_face(struct cage *cage, enum cage_part part, uint16_t a, uint16_t b, uint16_t c,
                       uint16_t d);

/* Quads between near[first..last] and far[first..last]; indices wrap at ring_count. They face
 * outwards when the ring turns to the right about the way from near to far. */
void skd_cage_bridge(struct cage *cage, enum cage_part part, const uint16_t *near,
                     const uint16_t *far, int first, int last, int ring_count);

/* Adds the right half: the mirror image of all there is. */
void skd_cage_mirror(struct cage *cage);

#endif
