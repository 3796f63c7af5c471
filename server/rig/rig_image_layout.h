/* The fixed parts of a rig image; see rig_image.h. Only its writer, its reader and their fuzz
 * target include this.
 *
 * Everything begins at a multiple of 8 bytes, with zeros up to there. In this order:
 *
 *     head
 *     notes         uint64 [note_count]
 *     bones         names, parents, skins, inverse_binds, rest_pose, nodes (with a source)
 *     nodes         struct skd_node [node_count], order
 *     clips         names, channel counts uint32, channels of all, then times and values of each
 *     parts         names, struct skd_image_part
 *     mesh          rest, triangles, twins (flag)
 *     influences    offsets, joints, weights (flag)
 *     source        (flag) paths of main and externals, struct skd_image_file of each, skin_joints,
 *                   bone_of_joint, joint_of_bone; the path that was given is the main file's
 *     document      (with a source) struct skd_image_view, struct skd_image_accessor, uint64
 *                   primitives of each mesh, struct skd_gltf_primitive of all, int32 mesh of each
 * node
 *
 * Strings: their lengths as uint32, then their bytes one after the other.
 */
#ifndef SKD_RIG_RIG_IMAGE_LAYOUT_H
#define SKD_RIG_RIG_IMAGE_LAYOUT_H

#include "rig/gltf_document.h"
#include "rig/rig.h"

/* Its last byte is the version. */
#define SKD_IMAGE_MAGIC "SKD.RIG\x01"

enum {
    SKD_IMAGE_HAS_TWINS = 1,
    SKD_IMAGE_HAS_INFLUENCES = 2,
    SKD_IMAGE_HAS_SOURCE = 4,
};

struct skd_image_head {
    char magic[8];
    uint64_t bytes; /* of the whole image */
    uint64_t vertex_count;
    uint64_t triangle_count;
    uint64_t influence_count;
    uint64_t node_count;
    uint64_t clip_count;
    uint64_t channel_count; /* of all clips */
    uint64_t part_count;
    uint64_t external_count;
    uint64_t view_count;
    uint64_t accessor_count;
    uint64_t mesh_count;
    uint64_t primitive_count; /* of all meshes */
    uint32_t bone_count;
    uint32_t skin_count;
    uint32_t flags;
    uint32_t note_count;
    double length;
};

struct skd_image_channel {
    int32_t node;
    uint16_t path;
    uint16_t interpolation;
    uint64_t key_count;
};

struct skd_image_part {
    uint64_t vertex_count;
    uint32_t skin;
    int32_t mesh;
    int32_t primitive;
    uint32_t zero;
};

struct skd_image_view {
    uint64_t offset;
    uint64_t bytes;
    uint64_t stride;
    int32_t buffer;
    uint32_t zero;
};

struct skd_image_file {
    uint64_t bytes;
    uint64_t digest[2];
    uint32_t is_file; /* an external that is no file has no path */
    uint32_t is_read;
};

struct skd_image_accessor {
    uint64_t offset;
    uint64_t count;
    uint64_t sparse_count;
    uint64_t index_offset;
    uint64_t value_offset;
    int32_t view;
    int32_t component;
    int32_t width;
    int32_t use_count;
    int32_t index_view;
    int32_t index_component;
    int32_t value_view;
    uint16_t is_normalized;
    uint8_t is_sparse;
    uint8_t has_bounds;
};

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "images are little-endian");
_Static_assert(sizeof(struct skd_image_head) == 136, "no holes");
_Static_assert(sizeof(struct skd_image_accessor) == 72, "no holes");
_Static_assert(sizeof(struct skd_gltf_primitive) == 16 + 8 * SKD_SETS_MAX + 8, "no holes");
_Static_assert(sizeof(struct skd_node) == 8 + 8 * (SKD_MATRIX_SIZE + 3 + 4 + 3), "no holes");

#endif
