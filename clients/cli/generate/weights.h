/* Skin weights of a point of the figure's surface.
 *
 * Pure; any thread; owns nothing beyond itself; borrows the skeleton.
 *
 * Every bone has a reach: the share of a point that moves with the bone or with what hangs on it.
 * reach(bone) = reach(parent) * smooth_step(signed distance past the bone's cutting plane), held
 * back by the marks of the surface where limbs meet. The bone's weight is its reach less its
 * children's; the arm's reach is taken from all of the trunk's bones alike. So weights sum to one
 * and are smooth, and only bones of the point's part (and of the neighbours it blends with) are
 * looked at, so that fingers and legs do not touch each other.
 */
#ifndef SKD_GENERATE_WEIGHTS_H
#define SKD_GENERATE_WEIGHTS_H

#include "cage.h"
#include "skeleton.h"

enum { INFLUENCE_COUNT = 4 };

/* The plane through origin where a bone takes over, over half_band on both sides. */
struct weight_cut {
    struct vec3 origin, normal;
    double half_band;
};

/* Bones that can move a part, parents first; what comes before root reaches all of it. */
struct weight_list {
    uint8_t root, count;
    uint8_t bone[SKELETON_MAX_BONES];
};

struct weight_model {
    const struct skeleton *skeleton;
    struct weight_cut cut[SKELETON_MAX_BONES];
    struct weight_list list[PART_COUNT][2]; /* [part][is_right] */
};

void skd_weights_init(struct weight_model *model, const struct skeleton *skeleton);

/* The weights at a point with the cage's marks (value[VALUE_ARM..]). They sum to one in float32;
 * free places are joint 0 with weight 0. */
void skd_weights_at(const struct weight_model *model, enum cage_part part, int is_right,
                    struct vec3 point, const double value[VALUE_COUNT],
                    uint8_t joint[INFLUENCE_COUNT], float weight[INFLUENCE_COUNT]);

#endif
