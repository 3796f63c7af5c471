/* What follows from a rig's own arrays: where bones begin, how large it is, what lies beside what.
 *
 * Stage: rig session. Thread: a worker. Called last by both ways of making a rig.
 */
#ifndef SKD_RIG_RIG_DERIVE_H
#define SKD_RIG_RIG_DERIVE_H

#include "rig/rig.h"
#include "rig/scratch.h"

/* Needs the skeleton, rest_pose, rest, skins, triangles, twins (of a file) and influences; makes
 * heads, length and neighbours. Errors: SKD_NO_MEMORY, SKD_TOO_LARGE. */
SKD_MUST_CHECK enum skd_status skd_rig_derive(struct skd_rig *rig,
                                              const struct skd_influences *influences,
                                              struct skd_scratch *scratch, struct skd_error *error);

#endif
