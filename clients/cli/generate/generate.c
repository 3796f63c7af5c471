/* See generate.h. Puts the stages in a row; owns what they make until the file is written. */
#include "generate.h"

#include <stdlib.h>
#include <string.h>

#include "anatomy.h"
#include "body.h"
#include "clips.h"
#include "mesh.h"
#include "skeleton.h"
#include "surface.h"
#include "tessellation.h"
#include "weights.h"
#include "write_glb.h"

_Static_assert((int)SKELETON_MAX_BONES == (int)SKD_GENERATE_MAX_BONES, "one limit, two names");

/* What all stages leave behind, but for the arrays that grow with the vertex count. */
struct figure {
    struct anatomy anatomy;
    struct skeleton skeleton;
    struct weight_model weights;
    struct cage cage;
    struct surface surface;
    struct tessellation tessellation;
    struct clip clips[CLIP_COUNT];
};

static enum skd_status check(const struct skd_generate_options *options, struct skd_error *error)
{
    if (options->vertex_count < SKD_GENERATE_MIN_VERTICES ||
        options->vertex_count > SKD_GENERATE_MAX_VERTICES)
        return skd_fail(error, SKD_BAD_PARAMS, "%u vertices cannot be generated: ask for %d to %d",
                        options->vertex_count, SKD_GENERATE_MIN_VERTICES,
                        SKD_GENERATE_MAX_VERTICES);
    if (options->bone_count < SKD_GENERATE_MIN_BONES ||
        options->bone_count > SKD_GENERATE_MAX_BONES)
        return skd_fail(error, SKD_BAD_PARAMS, "%u bones cannot be generated: ask for %d to %d",
                        (unsigned)options->bone_count, SKD_GENERATE_MIN_BONES,
                        SKD_GENERATE_MAX_BONES);
    return SKD_OK;
}

static void tell(const struct skd_generate_options *options, double fraction)
{
    if (options->progress != NULL)
        options->progress(fraction, options->user);
}

enum skd_status skd_generate_humanoid(const struct skd_generate_options *options, const char *path,
                                      struct skd_error *error)
{
    enum skd_status status = check(options, error);
    if (status != SKD_OK)
        return status;
    struct figure *figure = calloc(1, sizeof *figure);
    if (figure == NULL)
        return skd_fail_memory(error, "the figure");
    struct mesh mesh = {0};
    tell(options, 0.0);
    skd_anatomy_init(&figure->anatomy);
    skd_skeleton_init(&figure->skeleton, &figure->anatomy, options->bone_count);
    skd_weights_init(&figure->weights, &figure->skeleton);
    skd_body_build(&figure->cage, &figure->anatomy);
    skd_surface_init(&figure->surface, &figure->cage);
    skd_tessellation_init(&figure->tessellation, &figure->surface, options->vertex_count);
    tell(options, 0.05);
    status = skd_clips_init(figure->clips, &figure->skeleton, error);
    if (status != SKD_OK)
        goto finish;
    status = skd_mesh_init(&mesh, &figure->tessellation, &figure->weights, error);
    if (status != SKD_OK)
        goto finish;
    tell(options, 0.7);
    const struct glb_content content = {&mesh, &figure->skeleton, figure->clips};
    status = skd_write_glb(&content, path, error);
    if (status == SKD_OK)
        tell(options, 1.0);
finish:
    skd_mesh_finish(&mesh);
    skd_clips_finish(figure->clips);
    free(figure);
    return status;
}
