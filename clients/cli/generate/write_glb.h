/* Writes the figure as one binary glTF 2.0 file.
 *
 * Thread: the caller's. Owns nothing after it returns. Arrays go out as they are; triangles are
 * made again face by face, so that the indices never stand in memory.
 *
 *   12 bytes header | JSON chunk | BIN chunk: positions, normals, joints, weights, indices,
 *                                              inverse binds, clip times and values
 */
#ifndef SKD_GENERATE_WRITE_GLB_H
#define SKD_GENERATE_WRITE_GLB_H

#include "clips.h"
#include "mesh.h"

struct glb_content {
    const struct mesh *mesh;
    const struct skeleton *skeleton;
    const struct clip *clips; /* CLIP_COUNT */
};

/* Writes beside path and renames. Errors: SKD_FILE_IO, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_write_glb(const struct glb_content *content, const char *path,
                                             struct skd_error *error);

#endif
