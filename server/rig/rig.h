/* A rigged character: skeleton, mesh, clips and where it came from. Immutable once made.
 *
 * Stage: rig session. Thread: made by one worker, then read by any; no locks.
 * A rig owns all its arrays; skd_rig_destroy frees them. Weights are not here: a rig session holds
 * them (session/), and skd_influences carries them from the file to it.
 *
 * Spaces: `rest` is bind space; a bone's skin matrix M_b = posed bone x inverse bind takes it to
 * posed space. For glTF, posed space is the scene's (mesh node transforms are ignored, as the
 * specification says). All matrices are 3x4, row by row, float64.
 */
#ifndef SKD_RIG_RIG_H
#define SKD_RIG_RIG_H

#include "base/error.h"
#include "solver/solve.h"

#include <stddef.h>
#include <stdint.h>

enum {
    SKD_BONES_MAX = 4096,
    SKD_INFLUENCES_MAX = 64, /* of one vertex in a file */
    SKD_NAME_BYTES_MAX = 256,
    SKD_CLIPS_MAX = 4096,
    SKD_NODES_MAX = 1 << 18,
};
#define SKD_VERTICES_MAX ((size_t)8 * 1000 * 1000)
#define SKD_TRIANGLES_MAX ((size_t)32 * 1000 * 1000)
#define SKD_KEY_VALUES_MAX ((size_t)128 * 1000 * 1000) /* numbers in the keys of all clips */

/* The joints of all skins, one after the other. */
struct skd_skeleton {
    int bone_count;
    char **names;          /* [bones] UTF-8, unique within their skin */
    int32_t *parents;      /* [bones] nearest ancestor that is a bone of the same skin, or -1 */
    uint16_t *skins;       /* [bones] */
    double *inverse_binds; /* [bones][12] */
    float *heads;          /* [bones][3] origin of the bone at bind, in rest space */
    int32_t *nodes; /* [bones] node that moves the bone, or NULL when there is no node tree */
};

enum skd_interpolation { SKD_STEP, SKD_LINEAR, SKD_CUBICSPLINE };
enum skd_channel_path { SKD_TRANSLATION, SKD_ROTATION, SKD_SCALE };

struct skd_channel {
    int32_t node;
    enum skd_channel_path path;
    enum skd_interpolation interpolation;
    size_t key_count;
    float *times;  /* [keys] seconds, rising */
    float *values; /* [keys][3 or 4], cubic spline: [keys][3][3 or 4] in, value, out */
};

struct skd_clip {
    char *name;      /* unique in the rig */
    double duration; /* seconds: the last key's time */
    size_t channel_count;
    struct skd_channel *channels;
};

/* What a file moves its bones by. Empty for a rig that came as arrays. */
struct skd_node {
    int32_t parent; /* or -1 */
    int has_matrix; /* not 0: local holds; else translation, rotation, scale */
    double local[SKD_MATRIX_SIZE];
    double translation[3];
    double rotation[4]; /* quaternion x, y, z, w, unit */
    double scale[3];
};

struct skd_nodes {
    size_t count;
    struct skd_node *items;
    int32_t *order; /* [count] parents before children */
    size_t clip_count;
    struct skd_clip *clips;
};

/* A run of vertices that came from one glTF primitive. */
struct skd_part {
    size_t first_vertex;
    size_t vertex_count;
    uint16_t skin;
    int32_t mesh;      /* index in the file, or -1 */
    int32_t primitive; /* index in that mesh, or -1 */
    char *name;        /* of the mesh node, or "" */
};

struct skd_mesh {
    size_t vertex_count; /* V: the file's vertices, part after part */
    float *rest;         /* [V][3] */
    size_t triangle_count;
    uint32_t *triangles; /* [triangles][3] */
    uint16_t *skins;     /* [V] skin of each vertex */
    /* Vertices that a file split at seams: same rest position, skin and influences. twins[v] is
     * the next one of v's ring (v itself when alone); NULL when no vertex is split, and for arrays.
     */
    uint32_t *twins; /* [V] or NULL */
    /* Mesh neighbours of each vertex's whole ring of twins, CSR, rising, the first vertex of each
     * ring standing for the ring. */
    uint32_t *neighbour_offsets; /* [V+1] */
    uint32_t *neighbours;
    size_t part_count;
    struct skd_part *parts;
};

/* Influences as they came, mended: weights > 0, each vertex's sum to one within 1e-7 as stored, no
 * bone twice; the largest weight first, equal ones by bone. */
struct skd_influences {
    uint32_t *offsets; /* [V+1] */
    uint16_t *joints;
    float *weights;
    int most;         /* of one vertex */
    bool is_borrowed; /* the arrays are another's: only to be read, and not freed */
};

/* What was mended on the way in, one policy each; X(name, wire name, sentence with %zu). */
#define SKD_NOTES(X)                                                                               \
    X(WEIGHTS_NORMALISED, "weights_normalised",                                                    \
      "weights of %zu vertices did not sum to one and were scaled")                                \
    X(WEIGHTS_INVALID, "weights_invalid", "%zu negative, infinite or NaN weights were taken as 0") \
    X(WEIGHTS_MISSING, "weights_missing",                                                          \
      "%zu vertices had no weight and were given to the root bone of their skin")                  \
    X(JOINTS_MERGED, "joints_merged", "%zu influences named a bone twice and were added up")       \
    X(JOINTS_DUPLICATE, "joints_duplicate",                                                        \
      "%zu joints stand twice in their skin; the first of each is used")                           \
    X(BINDS_MISSING, "binds_missing",                                                              \
      "%zu skins have no inverse bind matrices; identity was used")                                \
    X(BINDS_AFFINE, "binds_affine",                                                                \
      "%zu inverse bind matrices had a last row other than 0 0 0 1, which was set")                \
    X(ROTATIONS_NORMALISED, "rotations_normalised",                                                \
      "%zu rotations were not unit quaternions and were scaled")                                   \
    X(MORPH_TARGETS, "morph_targets", "%zu morph targets are kept in the file and not solved")     \
    X(MESHES_SHARED, "meshes_shared",                                                              \
      "%zu more uses of a mesh share the weights of its first skin")                               \
    X(PARTS_UNSKINNED, "parts_unskinned", "%zu primitives have no skin and are kept as they are")  \
    X(TRIANGLES_DROPPED, "triangles_dropped",                                                      \
      "%zu triangles named a vertex twice and were left out of the topology")

enum skd_note {
#define SKD_NOTE_ENUM(name, wire, text) SKD_NOTE_##name,
    SKD_NOTES(SKD_NOTE_ENUM)
#undef SKD_NOTE_ENUM
        SKD_NOTE_COUNT
};

struct skd_rig {
    struct skd_skeleton skeleton;
    struct skd_nodes nodes;
    struct skd_mesh mesh;
    int skin_count;
    double length;     /* L: diagonal of the bounding box in the rest pose, posed space, > 0 */
    double *rest_pose; /* [bones][12] skin matrices of the file's own pose; bind for arrays */
    size_t notes[SKD_NOTE_COUNT];
    struct skd_gltf_source *source; /* what export writes from; NULL for arrays */
};

/* The lower-case wire name of a note ("weights_normalised") and its sentence. */
const char *skd_note_name(enum skd_note note);
void skd_note_text(enum skd_note note, size_t count, char *text, size_t text_bytes);

void skd_rig_destroy(struct skd_rig *rig); /* NULL is fine */
void skd_influences_finish(struct skd_influences *influences);

/* Resident bytes of the rig's arrays. */
size_t skd_rig_bytes(const struct skd_rig *rig);

/* Bone, clip by name; -1 when there is none. A name that two skins share finds the first. */
int skd_rig_find_bone(const struct skd_rig *rig, const char *name);
int skd_rig_find_clip(const struct skd_rig *rig, const char *name);

#endif
