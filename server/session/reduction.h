/* What cutting influences costs: how far the cut vertices move in poses of the rig's own.
 *
 * Stage: rig session. Thread: a worker, before the session is shared.
 */
#ifndef SKD_SESSION_REDUCTION_H
#define SKD_SESSION_REDUCTION_H

#include "session/session.h"

/* Compares the vertices that had more influences than slots, skinned with all of them and with
 * what was kept, in at most 16 poses: spread over the clips, or joint rotations of 25 degrees when
 * the rig has none. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_reduction_measure(const struct skd_session *session,
                                                     const struct skd_influences *influences,
                                                     struct skd_reduction *reduction,
                                                     struct skd_error *error);

#endif
