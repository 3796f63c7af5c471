/* What follows from a rig's own arrays: where bones begin, how large it is, what lies beside what.
 *
 * Stage: rig session. Thread: a worker. Called last by all ways of making a rig.
 */
#ifndef SKD_RIG_RIG_DERIVE_H
#define SKD_RIG_RIG_DERIVE_H

#include "rig/rig.h"
#include "rig/scratch.h"

/* What needs the influences: length; and takes out triangles that name a vertex twice. Needs the
 * skeleton, rest_pose, rest and triangles. */
void skd_rig_measure(struct skd_rig *rig, const struct skd_influences *influences);

/* The rest, heads and neighbours. Needs skd_rig_measure's triangles, and the twins of a file.
 * Errors: SKD_NO_MEMORY, SKD_TOO_LARGE. */
SKD_MUST_CHECK enum skd_status skd_rig_derive(struct skd_rig *rig, struct skd_scratch *scratch,
                                              struct skd_error *error);

#endif
