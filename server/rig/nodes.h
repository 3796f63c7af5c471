/* The node tree of a file, posed.
 *
 * Stage: rig session and request. Thread: any. Pure.
 */
#ifndef SKD_RIG_NODES_H
#define SKD_RIG_NODES_H

#include "rig/rig.h"

/* globals[count][12] = each node's transform to the scene. `items` are rig nodes, with or without
 * a clip applied. */
void skd_nodes_globals(const struct skd_node *items, const int32_t *order, size_t count,
                       double *globals);

/* skin_matrices[bones][12] = global of the bone's node x inverse bind. */
void skd_nodes_skin_matrices(const struct skd_skeleton *skeleton, const double *globals,
                             double *skin_matrices);

#endif
