/* See stroke_check.h. */
#include "session/stroke_check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static enum skd_status check_positions(const struct skd_stroke_input *input,
                                       struct skd_error *error)
{
    for (size_t i = 0; i < input->count * 3; i++) {
        if (!isfinite(input->positions[i]))
            return skd_fail(error, SKD_NOT_FINITE,
                            "positions[%zu] (vertex %u) is not finite; send the posed position in "
                            "scene units",
                            i / 3, (unsigned)input->vertices[i / 3]);
    }
    return SKD_OK;
}

static enum skd_status check_mask(const struct skd_stroke_input *input, struct skd_error *error)
{
    for (size_t i = 0; i < input->count && input->mask != NULL; i++) {
        if (!(input->mask[i] >= 0.0f && input->mask[i] <= 1.0f))
            return skd_fail(error, SKD_BAD_PARAMS,
                            "mask[%zu] (vertex %u) is %g; send 0 (leave it) to 1 (all of the "
                            "stroke)",
                            i, (unsigned)input->vertices[i], (double)input->mask[i]);
    }
    return SKD_OK;
}

static enum skd_status check_frames(const struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    size_t vertex_count = stroke->session->rig->mesh.vertex_count;
    SKD_ASSERT(input->frame_count <= SKD_TARGET_POSES_MAX);
    if (input->count != input->frame_count * vertex_count)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "positions has %zu rows; send %zu (the vertices of session \"%s\") for "
                        "each of the %zu poses",
                        input->count, vertex_count, stroke->session->name, input->frame_count);
    for (size_t i = 0; i < input->count * 3; i++) {
        if (!isfinite(input->frame_positions[i]))
            return skd_fail(error, SKD_NOT_FINITE,
                            "positions[%zu] (pose %zu, vertex %zu) is not finite; send the posed "
                            "position in scene units",
                            i / 3, i / 3 / vertex_count, i / 3 % vertex_count);
    }
    return SKD_OK;
}

static enum skd_status lock_bones(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_skeleton *skeleton = &stroke->session->rig->skeleton;
    if (input->locked_bone_count == 0)
        return SKD_OK;
    stroke->bone_locked = calloc((size_t)skeleton->bone_count, 1);
    if (stroke->bone_locked == NULL)
        return skd_fail_memory(error, "the locked bones");
    for (size_t i = 0; i < input->locked_bone_count; i++) {
        bool found = false;
        for (int bone = 0; bone < skeleton->bone_count; bone++) {
            if (strcmp(skeleton->names[bone], input->locked_bones[i]) == 0)
                stroke->bone_locked[bone] = 1, found = true;
        }
        if (!found)
            return skd_fail(error, SKD_NO_BONE,
                            "locked_bones names \"%s\", which is no bone of session \"%s\"",
                            input->locked_bones[i], stroke->session->name);
    }
    return SKD_OK;
}

static enum skd_status lock_vertices(struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    const struct skd_mesh *mesh = &stroke->session->rig->mesh;
    if (input->locked_vertex_count == 0)
        return SKD_OK;
    enum skd_status status = skd_session_check_vertices(stroke->session, input->locked_vertices,
                                                        input->locked_vertex_count, error);
    if (status != SKD_OK)
        return status;
    stroke->vertex_locked = calloc(mesh->vertex_count, 1);
    if (stroke->vertex_locked == NULL)
        return skd_fail_memory(error, "the locked vertices");
    for (size_t i = 0; i < input->locked_vertex_count; i++) {
        uint32_t first = input->locked_vertices[i], vertex = first;
        if (stroke->vertex_locked[first])
            continue; /* and so is its ring, which may be long */
        do {
            stroke->vertex_locked[vertex] = 1;
            vertex = mesh->twins != NULL ? mesh->twins[vertex] : first;
        } while (vertex != first);
    }
    return SKD_OK;
}

static enum skd_status check_method(const struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    if (input->options.constraint == SKD_CONSTRAINT_AFFINE && input->slots != SKD_SLOTS_KEEP)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "slots \"evidence\" are chosen under constraint \"simplex\" only");
    if (input->options.method != SKD_METHOD_THESIS)
        return SKD_OK;
    if (stroke->session->slot_count != 4)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "method \"thesis\" is defined for 4 influences and this session has %d; "
                        "use method \"exact\"",
                        stroke->session->slot_count);
    if (input->locked_bone_count > 0 || input->options.constraint != SKD_CONSTRAINT_SIMPLEX)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "method \"thesis\" knows neither locked bones nor constraint \"affine\"; "
                        "use method \"exact\"");
    return SKD_OK;
}

/* Positions, mask and vertices of the request. */
static enum skd_status check_input(const struct skd_stroke *stroke, struct skd_error *error)
{
    const struct skd_stroke_input *input = &stroke->input;
    enum skd_status status = check_method(stroke, error);
    if (status != SKD_OK)
        return status;
    if (input->frame_count > 0)
        return check_frames(stroke, error);
    status = skd_session_check_distinct(stroke->session, input->vertices, input->count, error);
    if (status != SKD_OK)
        return status;
    if (input->solves_pins && (stroke->pins == NULL || stroke->pins->used == 0))
        return skd_fail(error, SKD_NO_POSE,
                        "session \"%s\" has no pins in pose \"%s\"; sculpt in it first",
                        stroke->session->name, stroke->pose->name);
    if (!input->solves_pins && (status = check_positions(input, error)) != SKD_OK)
        return status;
    return check_mask(input, error);
}

enum skd_status skd_stroke_check(struct skd_stroke *stroke, struct skd_error *error)
{
    enum skd_status status;
    if ((status = check_input(stroke, error)) != SKD_OK ||
        (status = lock_bones(stroke, error)) != SKD_OK)
        return status;
    return lock_vertices(stroke, error);
}
