/* The JSON of a glTF file as plain arrays: what gltf_import.cpp makes out of tinygltf's model.
 *
 * Stage: rig session and export. Thread: a worker.
 * Nothing here is checked: every index, offset and count is as the file says. Who follows one
 * checks it first. All arrays live and die with the document.
 */
#ifndef SKD_RIG_GLTF_DOCUMENT_H
#define SKD_RIG_GLTF_DOCUMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    SKD_SETS_MAX = 16, /* SKD_INFLUENCES_MAX / 4 */
    SKD_GLTF_BYTE = 5120,
    SKD_GLTF_UNSIGNED_BYTE = 5121,
    SKD_GLTF_SHORT = 5122,
    SKD_GLTF_UNSIGNED_SHORT = 5123,
    SKD_GLTF_UNSIGNED_INT = 5125,
    SKD_GLTF_FLOAT = 5126,
    SKD_GLTF_TRIANGLES = 4,
    SKD_GLTF_TRIANGLE_STRIP = 5,
    SKD_GLTF_TRIANGLE_FAN = 6,
};

struct skd_gltf_view {
    int32_t buffer;
    size_t offset;
    size_t bytes;
    size_t stride; /* 0: elements lie one after the other */
};

struct skd_gltf_accessor {
    int32_t view; /* -1: all zero */
    size_t offset;
    size_t count;
    int component;
    int width; /* numbers in one element: 1, 2, 3, 4, 9 or 16 */
    bool is_normalized;
    bool is_sparse;
    bool has_bounds; /* min or max */
    int use_count;   /* in attributes, morph targets, indices, skins and samplers */
    size_t sparse_count;
    int32_t index_view;
    size_t index_offset;
    int index_component;
    int32_t value_view;
    size_t value_offset;
};

struct skd_gltf_primitive {
    int32_t position; /* accessors, -1: none */
    int32_t indices;
    int mode;
    int set_count; /* sets of JOINTS_n or WEIGHTS_n; SKD_SETS_MAX + 1 stands for more */
    int32_t joints[SKD_SETS_MAX];
    int32_t weights[SKD_SETS_MAX];
    size_t target_count;
};

struct skd_gltf_mesh {
    size_t primitive_count;
    struct skd_gltf_primitive *primitives;
};

struct skd_gltf_node {
    const char *name;
    int32_t mesh;
    int32_t skin;
    size_t child_count;
    int32_t *children;
    /* How many numbers the file gives, and up to 16 of them. */
    size_t matrix_count, translation_count, rotation_count, scale_count;
    double matrix[16];
    double translation[3];
    double rotation[4];
    double scale[3];
};

struct skd_gltf_skin {
    size_t joint_count;
    int32_t *joints;
    int32_t inverse_binds;
};

struct skd_gltf_sampler {
    int32_t input;
    int32_t output;
    const char *interpolation;
};

struct skd_gltf_channel {
    int32_t sampler;
    int32_t node;
    const char *path;
};

struct skd_gltf_animation {
    const char *name;
    size_t sampler_count;
    struct skd_gltf_sampler *samplers;
    size_t channel_count;
    struct skd_gltf_channel *channels;
};

struct skd_gltf_document {
    size_t view_count;
    struct skd_gltf_view *views;
    size_t accessor_count;
    struct skd_gltf_accessor *accessors;
    size_t mesh_count;
    struct skd_gltf_mesh *meshes;
    size_t node_count;
    struct skd_gltf_node *nodes;
    size_t skin_count;
    struct skd_gltf_skin *skins;
    size_t animation_count;
    struct skd_gltf_animation *animations;
    struct skd_gltf_block *blocks; /* all of the above */
};

/* Zeroed memory that lives as long as the document; NULL when there is none. */
void *skd_gltf_document_alloc(struct skd_gltf_document *document, size_t count, size_t bytes);
/* Bytes of all that; NULL is fine. */
size_t skd_gltf_document_bytes(const struct skd_gltf_document *document);
void skd_gltf_document_destroy(struct skd_gltf_document *document); /* NULL is fine */

enum skd_gltf_parsed { SKD_GLTF_PARSED, SKD_GLTF_INVALID, SKD_GLTF_NO_MEMORY };

/* Parses with tinygltf. `json` is the part of a file that skind reads: asset, extensions, views,
 * accessors, meshes, nodes, skins, animations; it names no buffer and no image, so that nothing is
 * copied, decoded or opened. SKD_GLTF_INVALID comes with one line in `problem`. */
enum skd_gltf_parsed skd_gltf_document_parse(const char *json, size_t json_bytes,
                                             struct skd_gltf_document **document, char *problem,
                                             size_t problem_bytes);

/* For a process that does nothing else: end() (which does not return) is called where there is no
 * memory and no way to say so. A destructor of tinygltf's JSON allocates, and may not throw. */
void skd_gltf_on_no_memory(void (*end)(void));

#ifdef __cplusplus
}
#endif

#endif
