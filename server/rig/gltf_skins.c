/* See gltf_read.h: nodes and skins. */
#include "rig/gltf_read.h"

#include "rig/elements.h"
#include "rig/matrix.h"
#include "rig/names.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The file's order of a matrix is column by column; its last row is 0 0 0 1. */
static void read_matrix(const double *columns, double *matrix)
{
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++)
            matrix[row * 4 + column] = columns[column * 4 + row];
}

static enum skd_status read_transform(const struct skd_gltf_node *from, size_t index,
                                      struct skd_node *to, size_t *notes, struct skd_error *error)
{
    if ((from->matrix_count != 0 && from->matrix_count != 16) ||
        (from->translation_count != 0 && from->translation_count != 3) ||
        (from->rotation_count != 0 && from->rotation_count != 4) ||
        (from->scale_count != 0 && from->scale_count != 3))
        return skd_fail(error, SKD_BAD_RIG,
                        "node %zu has a transform with the wrong number of values", index);
    *to = (struct skd_node){.parent = -1, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    to->has_matrix = from->matrix_count == 16;
    if (to->has_matrix)
        read_matrix(from->matrix, to->local);
    if (from->translation_count == 3)
        memcpy(to->translation, from->translation, sizeof to->translation);
    if (from->scale_count == 3)
        memcpy(to->scale, from->scale, sizeof to->scale);
    if (from->rotation_count == 4) {
        memcpy(to->rotation, from->rotation, sizeof to->rotation);
        if (fabs(skd_quaternion_normalise(to->rotation) - 1) > SKD_ROTATION_VALID)
            notes[SKD_NOTE_ROTATIONS_NORMALISED]++;
    }
    return SKD_OK;
}

static enum skd_status read_parents(const struct skd_gltf_document *document,
                                    struct skd_nodes *nodes, struct skd_error *error)
{
    for (size_t n = 0; n < nodes->count; n++)
        for (size_t c = 0; c < document->nodes[n].child_count; c++) {
            const int32_t child = document->nodes[n].children[c];
            if (child < 0 || (size_t)child >= nodes->count)
                return skd_fail(error, SKD_BAD_RIG, "node %zu has child %d, which is not there", n,
                                child);
            if (nodes->items[child].parent != -1)
                return skd_fail(error, SKD_BAD_RIG, "node %d is the child of two nodes", child);
            nodes->items[child].parent = (int32_t)n;
        }
    return SKD_OK;
}

/* Parents before children, breadth first; nodes on a cycle are reached from no root. */
static enum skd_status find_order(const struct skd_gltf_document *document, struct skd_nodes *nodes,
                                  struct skd_error *error)
{
    size_t listed = 0;
    for (size_t n = 0; n < nodes->count; n++)
        if (nodes->items[n].parent < 0)
            nodes->order[listed++] = (int32_t)n;
    for (size_t i = 0; i < listed; i++) {
        const struct skd_gltf_node *node = &document->nodes[nodes->order[i]];
        for (size_t c = 0; c < node->child_count; c++)
            nodes->order[listed++] = node->children[c];
    }
    if (listed < nodes->count)
        return skd_fail(error, SKD_BAD_RIG, "%zu nodes are their own ancestors",
                        nodes->count - listed);
    return SKD_OK;
}

enum skd_status skd_gltf_read_nodes(const struct skd_gltf_container *container, struct skd_rig *rig,
                                    struct skd_error *error)
{
    const struct skd_gltf_document *document = container->document;
    struct skd_nodes *nodes = &rig->nodes;
    if (document->node_count > SKD_NODES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "the file has %zu nodes, more than %d",
                        document->node_count, (int)SKD_NODES_MAX);
    nodes->items = malloc((document->node_count + 1) * sizeof *nodes->items);
    nodes->order = malloc((document->node_count + 1) * sizeof *nodes->order);
    if (nodes->items == NULL || nodes->order == NULL)
        return skd_fail_memory(error, "the nodes");
    nodes->count = document->node_count;
    for (size_t n = 0; n < nodes->count; n++) {
        const enum skd_status status =
            read_transform(&document->nodes[n], n, &nodes->items[n], rig->notes, error);
        if (status != SKD_OK)
            return status;
    }
    const enum skd_status status = read_parents(document, nodes, error);
    return status != SKD_OK ? status : find_order(document, nodes, error);
}

/* Reads the inverse bind matrix of one joint and sets its last row right. */
static enum skd_status read_bind(const struct skd_elements *binds, size_t skin, size_t joint,
                                 double *inverse_bind, bool *is_affine, struct skd_error *error)
{
    float columns[16];
    double wide[16];
    *is_affine = true;
    skd_elements_floats(binds, joint, 1, columns);
    for (int i = 0; i < 16; i++) {
        if (!isfinite(columns[i]))
            return skd_fail(error, SKD_BAD_RIG,
                            "the inverse bind matrix of joint %zu of skin %zu is not finite", joint,
                            skin);
        wide[i] = (double)columns[i];
    }
    read_matrix(wide, inverse_bind);
    *is_affine = wide[3] == 0 && wide[7] == 0 && wide[11] == 0 && wide[15] == 1;
    return SKD_OK;
}

/* The bone of this skin with the same node and bind matrix, or -1: then the joint is a bone. */
static int find_same_bone(const struct skd_skeleton *skeleton, int first_bone, int32_t node,
                          const double *inverse_bind)
{
    for (int b = first_bone; b < skeleton->bone_count; b++)
        if (skeleton->nodes[b] == node &&
            memcmp(skeleton->inverse_binds + b * SKD_MATRIX_SIZE, inverse_bind,
                   SKD_MATRIX_SIZE * sizeof *inverse_bind) == 0)
            return b;
    return -1;
}

static enum skd_status read_joints(const struct skd_gltf_container *container, size_t skin_index,
                                   const struct skd_elements *binds, struct skd_gltf_source *source,
                                   struct skd_rig *rig, struct skd_error *error)
{
    const struct skd_gltf_skin *skin = &container->document->skins[skin_index];
    struct skd_skeleton *skeleton = &rig->skeleton;
    const int first_bone = skeleton->bone_count;
    uint16_t *bone_of_joint = source->bone_of_joint + source->skin_joints[skin_index];
    for (size_t j = 0; j < skin->joint_count; j++) {
        const int32_t node = skin->joints[j];
        double inverse_bind[SKD_MATRIX_SIZE];
        bool is_affine = true;
        if (node < 0 || (size_t)node >= rig->nodes.count)
            return skd_fail(error, SKD_BAD_RIG,
                            "joint %zu of skin %zu is node %d, which is not there", j, skin_index,
                            node);
        skd_matrix_identity(inverse_bind);
        if (binds->count > 0) {
            const enum skd_status status =
                read_bind(binds, skin_index, j, inverse_bind, &is_affine, error);
            if (status != SKD_OK)
                return status;
        }
        rig->notes[SKD_NOTE_BINDS_AFFINE] += !is_affine;
        const int same = find_same_bone(skeleton, first_bone, node, inverse_bind);
        rig->notes[SKD_NOTE_JOINTS_DUPLICATE] += same >= 0;
        const int bone = same >= 0 ? same : skeleton->bone_count++;
        bone_of_joint[j] = (uint16_t)bone;
        if (same >= 0)
            continue;
        source->joint_of_bone[bone] = (uint16_t)j;
        skeleton->nodes[bone] = node;
        skeleton->skins[bone] = (uint16_t)skin_index;
        memcpy(skeleton->inverse_binds + bone * SKD_MATRIX_SIZE, inverse_bind, sizeof inverse_bind);
        const char *name = container->document->nodes[node].name;
        skeleton->names[bone] = strdup(name);
        if (skeleton->names[bone] == NULL)
            return skd_fail_memory(error, "the bones");
    }
    return skd_names_make_unique(skeleton->names + first_bone,
                                 (size_t)(skeleton->bone_count - first_bone), "joint", error);
}

/* Parents of a skin's bones, through nodes that are no bones of it. nearest[] is scratch. */
static void find_bone_parents(struct skd_rig *rig, int first_bone, int32_t *nearest)
{
    struct skd_skeleton *skeleton = &rig->skeleton;
    const struct skd_nodes *nodes = &rig->nodes;
    for (size_t n = 0; n < nodes->count; n++)
        nearest[n] = -1;
    for (int b = skeleton->bone_count - 1; b >= first_bone; b--)
        nearest[skeleton->nodes[b]] = b; /* of two bones on one node, the first is the parent */
    for (size_t i = 0; i < nodes->count; i++) {
        const int32_t node = nodes->order[i], parent = nodes->items[node].parent;
        if (nearest[node] < 0 && parent >= 0)
            nearest[node] = nearest[parent];
    }
    for (int b = first_bone; b < skeleton->bone_count; b++) {
        const int32_t parent = nodes->items[skeleton->nodes[b]].parent;
        skeleton->parents[b] = parent >= 0 ? nearest[parent] : -1;
    }
}

static enum skd_status read_skin(const struct skd_gltf_container *container, size_t index,
                                 struct skd_gltf_source *source, struct skd_rig *rig,
                                 int32_t *nearest, struct skd_error *error)
{
    const struct skd_gltf_skin *skin = &container->document->skins[index];
    const int first_bone = rig->skeleton.bone_count;
    struct skd_elements binds = {0};
    char what[64];
    if (skin->joint_count == 0)
        return skd_fail(error, SKD_BAD_RIG, "skin %zu has no joints", index);
    if (skin->inverse_binds >= 0) {
        (void)snprintf(what, sizeof what, "inverseBindMatrices of skin %zu", index);
        enum skd_status status =
            skd_elements_open(container, skin->inverse_binds, 16, what, &binds, error);
        if (status == SKD_OK && binds.count < skin->joint_count)
            status = skd_fail(error, SKD_BAD_RIG,
                              "skin %zu has %zu joints and %zu inverse bind matrices", index,
                              skin->joint_count, binds.count);
        if (status != SKD_OK) {
            skd_elements_close(&binds);
            return status;
        }
    } else {
        rig->notes[SKD_NOTE_BINDS_MISSING]++;
    }
    const enum skd_status status = read_joints(container, index, &binds, source, rig, error);
    skd_elements_close(&binds);
    if (status == SKD_OK)
        find_bone_parents(rig, first_bone, nearest);
    return status;
}

/* Room for a bone a joint: a joint that stands twice leaves one unused. */
static enum skd_status reserve_bones(const struct skd_gltf_document *document,
                                     struct skd_gltf_source *source, struct skd_skeleton *skeleton,
                                     struct skd_error *error)
{
    source->skin_joints = calloc(document->skin_count + 1, sizeof *source->skin_joints);
    if (source->skin_joints == NULL)
        return skd_fail_memory(error, "the skins");
    size_t joints = 0;
    for (size_t s = 0; s < document->skin_count; s++) {
        if (document->skins[s].joint_count > SKD_BONES_MAX - joints)
            return skd_fail(error, SKD_TOO_LARGE, "the skins have more than %d joints in all",
                            (int)SKD_BONES_MAX);
        joints += document->skins[s].joint_count;
        source->skin_joints[s + 1] = (uint32_t)joints;
    }
    source->skin_count = (int)document->skin_count;
    source->bone_of_joint = malloc((joints + 1) * sizeof *source->bone_of_joint);
    source->joint_of_bone = malloc((joints + 1) * sizeof *source->joint_of_bone);
    skeleton->names = calloc(joints + 1, sizeof *skeleton->names);
    skeleton->parents = malloc((joints + 1) * sizeof *skeleton->parents);
    skeleton->skins = malloc((joints + 1) * sizeof *skeleton->skins);
    skeleton->nodes = malloc((joints + 1) * sizeof *skeleton->nodes);
    skeleton->inverse_binds = malloc((joints + 1) * SKD_MATRIX_SIZE * sizeof(double));
    if (source->bone_of_joint == NULL || source->joint_of_bone == NULL || skeleton->names == NULL ||
        skeleton->parents == NULL || skeleton->skins == NULL || skeleton->nodes == NULL ||
        skeleton->inverse_binds == NULL)
        return skd_fail_memory(error, "the bones");
    return SKD_OK;
}

enum skd_status skd_gltf_read_skins(const struct skd_gltf_container *container,
                                    struct skd_gltf_source *source, struct skd_rig *rig,
                                    struct skd_error *error)
{
    const struct skd_gltf_document *document = container->document;
    if (document->skin_count == 0)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "the file has no skin; bind a mesh to an armature and export it again");
    enum skd_status status = reserve_bones(document, source, &rig->skeleton, error);
    if (status != SKD_OK)
        return status;
    int32_t *nearest = malloc(rig->nodes.count * sizeof *nearest + 1);
    if (nearest == NULL)
        return skd_fail_memory(error, "the nodes");
    rig->skin_count = (int)document->skin_count;
    for (size_t s = 0; status == SKD_OK && s < document->skin_count; s++)
        status = read_skin(container, s, source, rig, nearest, error);
    free(nearest);
    return status;
}
