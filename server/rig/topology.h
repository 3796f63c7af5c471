/* What lies beside what on a mesh: seam twins and neighbours.
 *
 * Stage: rig session. Thread: a worker, before anyone else sees the rig.
 */
#ifndef SKD_RIG_TOPOLOGY_H
#define SKD_RIG_TOPOLOGY_H

#include "rig/rig.h"
#include "rig/scratch.h"

/* Makes mesh->twins (rings of vertices with the same rest bits, skin and influences, in rising
 * order) or leaves it NULL when no vertex has a twin. Time and memory are linear, whatever the
 * positions. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_topology_find_twins(struct skd_mesh *mesh,
                                                       const struct skd_influences *influences,
                                                       struct skd_scratch *scratch,
                                                       struct skd_error *error);

/* Makes mesh->neighbour_offsets and mesh->neighbours from the triangles and the twins.
 * Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_topology_find_neighbours(struct skd_mesh *mesh,
                                                            struct skd_scratch *scratch,
                                                            struct skd_error *error);

/* Takes triangles that name a vertex twice out of the list; returns how many. */
size_t skd_topology_drop_degenerate(struct skd_mesh *mesh);

#endif
