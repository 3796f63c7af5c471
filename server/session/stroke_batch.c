/* See stroke_batch.h. */
#include "session/stroke_batch.h"

#include "solver/evidence.h"

struct skd_solve_batch skd_stroke_batch(const struct skd_stroke *stroke)
{
    const struct skd_session *session = stroke->session;
    return (struct skd_solve_batch){
        .slot_count = session->slot_count,
        .pose_count = stroke->pose_count,
        .rest = stroke->rest != NULL ? stroke->rest : session->rest,
        .joints = session->joints,
        .weights = session->weights,
        .anchor = session->anchor,
        .start_joints = session->start_joints,
        .start_weights = session->start_weights,
        .guard = session->guards.factors,
        .vertex_locked = stroke->vertex_locked,
        .bone_locked = stroke->bone_locked,
    };
}

void skd_stroke_solve_evidence(const struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                               const uint16_t *candidates, uint16_t *joints)
{
    const struct skd_rig *rig = stroke->session->rig;
    const struct skd_evidence_bones bones = {
        .bone_count = rig->skeleton.bone_count,
        .bone_skin = rig->skeleton.skins,
        .vertex_skin = rig->mesh.skins,
        .lists = candidates,
    };
    skd_evidence_solve(batch, &stroke->input.options, &bones, joints);
}

void skd_stroke_point_poses(const struct skd_stroke *stroke, size_t first,
                            struct skd_solve_pose *poses)
{
    for (int p = 0; p < stroke->pose_count; p++) {
        const struct skd_stroke_pose *from = &stroke->poses[p];
        poses[p] = (struct skd_solve_pose){
            .matrices = from->matrices,
            .targets = from->targets + 3 * first,
            .strengths = from->strengths != NULL ? from->strengths + first : NULL,
        };
    }
}
