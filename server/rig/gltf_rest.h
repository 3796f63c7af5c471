/* Rest positions that moved, into a file's POSITION.
 *
 * Stage: export. Thread: a worker.
 * A vertex that stays keeps its bytes. What moves is written in place where the accessor is
 * float32 and its bytes are its own; else (integers of KHR_mesh_quantization, sparse, shared with
 * what stays) the primitive gets a new float32 accessor. min and max follow. Normals and tangents
 * stay: skind knows the surface's positions and not how its shading was made.
 */
#ifndef SKD_RIG_GLTF_REST_H
#define SKD_RIG_GLTF_REST_H

#include "rig/gltf.h"
#include "rig/gltf_claims.h"
#include "rig/gltf_patch.h"

/* Writes content->rest, when there is one; adds to report->positions.
 * Errors: SKD_NOT_FINITE, SKD_UNSUPPORTED (no buffer), SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_gltf_rest_write(const struct skd_rig *rig, const struct skd_gltf_container *container,
                    const struct skd_gltf_claims *claims, const struct skd_gltf_content *content,
                    struct skd_gltf_patch *patch, struct skd_gltf_export_report *report,
                    struct skd_error *error);

#endif
