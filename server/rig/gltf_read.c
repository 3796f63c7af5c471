/* See gltf.h: a file becomes a rig. The steps are those of gltf_read.h. */
#include "rig/gltf.h"

#include "rig/gltf_read.h"
#include "rig/matrix.h"
#include "rig/nodes.h"
#include "rig/rig_derive.h"
#include "rig/topology.h"

#include <stdlib.h>

/* Skin matrices of the file's own node transforms, which must come out finite. */
static enum skd_status find_rest_pose(struct skd_rig *rig, struct skd_error *error)
{
    const size_t bones = (size_t)rig->skeleton.bone_count;
    double *globals = malloc((rig->nodes.count + 1) * SKD_MATRIX_SIZE * sizeof *globals);
    rig->rest_pose = malloc(bones * SKD_MATRIX_SIZE * sizeof *rig->rest_pose);
    if (globals == NULL || rig->rest_pose == NULL) {
        free(globals);
        return skd_fail_memory(error, "the nodes");
    }
    skd_nodes_globals(rig->nodes.items, rig->nodes.order, rig->nodes.count, globals);
    skd_nodes_skin_matrices(&rig->skeleton, globals, rig->rest_pose);
    free(globals);
    for (size_t b = 0; b < bones; b++)
        if (!skd_matrix_is_finite(rig->rest_pose + b * SKD_MATRIX_SIZE))
            return skd_fail(error, SKD_BAD_RIG,
                            "the transforms above bone %zu (\"%s\") grow beyond all numbers", b,
                            rig->skeleton.names[b]);
    return SKD_OK;
}

/* Everything that needs the file's bytes. Their memory becomes scratch, and the rest is given back
 * before the topology is made. */
static enum skd_status read_file(struct skd_gltf_source *source, struct skd_rig *rig,
                                 struct skd_influences *influences, struct skd_scratch *scratch,
                                 struct skd_error *error)
{
    struct skd_gltf_container container;
    enum skd_status status = skd_gltf_container_read(source, &container, error);
    if (status != SKD_OK)
        return status;
    status = skd_gltf_read_nodes(&container, rig, error);
    if (status == SKD_OK)
        status = skd_gltf_read_skins(&container, source, rig, error);
    if (status == SKD_OK)
        status = skd_gltf_read_clips(&container, rig, error);
    if (status == SKD_OK)
        status = find_rest_pose(rig, error);
    if (status == SKD_OK)
        status = skd_gltf_read_meshes(&container, source, rig, influences, error);
    *scratch = (struct skd_scratch){container.file, container.file_bytes};
    container.file = NULL;
    skd_gltf_container_finish(&container);
    return status;
}

static enum skd_status parse(const char *path, struct skd_rig **rig,
                             struct skd_influences *influences, struct skd_scratch *scratch,
                             struct skd_error *error)
{
    *rig = NULL;
    *influences = (struct skd_influences){0};
    struct skd_gltf_source *source = NULL;
    enum skd_status status = skd_gltf_source_open(path, &source, error);
    if (status != SKD_OK)
        return status;
    struct skd_rig *made = calloc(1, sizeof *made);
    if (made == NULL) {
        skd_gltf_source_destroy(source);
        return skd_fail_memory(error, "a rig");
    }
    made->source = source;
    status = read_file(source, made, influences, scratch, error);
    /* Only a file splits vertices; a client's own array means each of its vertices. */
    if (status == SKD_OK)
        status = skd_topology_find_twins(&made->mesh, influences, scratch, error);
    if (status != SKD_OK) {
        skd_rig_destroy(made);
        skd_influences_finish(influences);
        return status;
    }
    source->is_known = true;
    skd_rig_measure(made, influences);
    *rig = made;
    return SKD_OK;
}

enum skd_status skd_gltf_parse(const char *path, struct skd_rig **rig,
                               struct skd_influences *influences, struct skd_error *error)
{
    struct skd_scratch scratch = {0};
    const enum skd_status status = parse(path, rig, influences, &scratch, error);
    skd_scratch_finish(&scratch);
    return status;
}

enum skd_status skd_gltf_import(const char *path, struct skd_rig **rig,
                                struct skd_influences *influences, struct skd_error *error)
{
    struct skd_scratch scratch = {0};
    enum skd_status status = parse(path, rig, influences, &scratch, error);
    if (status == SKD_OK)
        status = skd_rig_derive(*rig, &scratch, error);
    skd_scratch_finish(&scratch);
    if (status != SKD_OK) {
        skd_rig_destroy(*rig);
        *rig = NULL;
        skd_influences_finish(influences);
    }
    return status;
}
