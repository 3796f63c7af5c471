/* The parts of a rig that are read from an image, in its order; see rig_image.h. Only its readers
 * include this.
 *
 * Stage: rig session. Thread: any. Each function fills its part of a rig that starts zeroed and is
 * destroyed by the caller when one fails.
 */
#ifndef SKD_RIG_RIG_IMAGE_READER_H
#define SKD_RIG_RIG_IMAGE_READER_H

#include "rig/rig_image_cursor.h"

SKD_MUST_CHECK enum skd_status skd_image_read_bones(struct skd_image_reader *reader,
                                                    struct skd_rig *rig);
SKD_MUST_CHECK enum skd_status skd_image_read_nodes(struct skd_image_reader *reader,
                                                    struct skd_rig *rig);
SKD_MUST_CHECK enum skd_status skd_image_read_clips(struct skd_image_reader *reader,
                                                    struct skd_rig *rig);
SKD_MUST_CHECK enum skd_status skd_image_read_mesh(struct skd_image_reader *reader,
                                                   struct skd_rig *rig);
SKD_MUST_CHECK enum skd_status skd_image_read_influences(struct skd_image_reader *reader,
                                                         const struct skd_rig *rig,
                                                         struct skd_influences *influences);
SKD_MUST_CHECK enum skd_status skd_image_read_source(struct skd_image_reader *reader,
                                                     struct skd_rig *rig);
SKD_MUST_CHECK enum skd_status skd_image_read_document(struct skd_image_reader *reader,
                                                       struct skd_gltf_source *source);

#endif
