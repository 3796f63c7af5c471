/* The figure's cage: rings around trunk, limbs and fingers, joined into one closed surface, and
 * the small forms (face, muscles) that are laid over the smooth surface.
 *
 * Pure; any thread; owns nothing.
 */
#ifndef SKD_GENERATE_BODY_H
#define SKD_GENERATE_BODY_H

#include "anatomy.h"
#include "cage.h"

/* Fills an empty (zeroed) cage with both halves of the figure. */
void skd_body_build(struct cage *cage, const struct anatomy *anatomy);

/* Raises or lowers a point of the smooth surface to its place on the skin; nothing below y = 0. */
struct vec3 skd_body_detail(struct vec3 point);

#endif
