/* One channel of a clip at one time: the interpolations of the glTF 2.0 specification, appendix C.
 *
 * Stage: request. Thread: any. Pure.
 */
#ifndef SKD_RIG_CLIP_H
#define SKD_RIG_CLIP_H

#include "rig/rig.h"

/* Writes 3 numbers, or a unit quaternion of 4 for SKD_ROTATION. Times outside the keys are clamped
 * to them. */
void skd_channel_sample(const struct skd_channel *channel, double time, double *out);

/* Numbers in one key's value: 4 for a rotation, else 3. */
int skd_channel_width(const struct skd_channel *channel);

/* Numbers that one key has in values: a cubic spline's has two tangents as well. */
size_t skd_channel_step(const struct skd_channel *channel);

#endif
