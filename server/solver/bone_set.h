/* One vertex against a set of bones that are not its slots: what evidence.c weighs up.
 *
 * Stage: [pure solve], inside solver/. Thread: any. Owns nothing: it lives on the caller's stack.
 */
#ifndef SKD_SOLVER_BONE_SET_H
#define SKD_SOLVER_BONE_SET_H

#include "solver/evidence.h"
#include "solver/problem.h"

/* A target of the vertex. */
struct skd_aim {
    const double *matrices;
    double target[3];
    double strength; /* > 0 */
    double shown[3]; /* where weights put the vertex: skd_bone_set_show() */
};

/* The vertex, and its targets in the order of the batch's poses. */
struct skd_subject {
    const struct skd_solve_batch *batch;
    const struct skd_solve_options *options;
    size_t item;
    size_t vertex;
    double rest[3];
    const uint16_t *start_joints; /* [N] the vertex's row at the session's start */
    const float *start_weights;
    int aim_count;
    double strength; /* sum of the aims' */
    struct skd_aim aims[SKD_EVIDENCE_POSES_MAX];
};

/* Bones and what they weigh. A held one (locked) keeps its weight. */
struct skd_bone_set {
    int count;
    uint16_t bones[SKD_SLOT_COUNT_MAX];
    double weights[SKD_SLOT_COUNT_MAX];
    double anchor[SKD_SLOT_COUNT_MAX]; /* at the start */
    double prior[SKD_SLOT_COUNT_MAX];  /* energy of a whole unit of weight */
    bool held[SKD_SLOT_COUNT_MAX];
};

/* Reads an item of the batch. */
void skd_subject_read(const struct skd_solve_batch *batch, const struct skd_solve_options *options,
                      size_t item, struct skd_subject *subject);

/* The bone's weight in the start's row, or 0. */
double skd_subject_anchor(const struct skd_subject *subject, uint16_t bone);

bool skd_bone_set_has(const struct skd_bone_set *set, uint16_t bone);

/* Adds a bone that the set does not have (it must not be full). */
void skd_bone_set_add(struct skd_bone_set *set, const struct skd_subject *subject, uint16_t bone,
                      double weight, double prior);

/* The energy of solve.h (targets, guard, anchor of stiffness kappa; no prior) over the bones that
 * are not held, as a problem; open[r] is the bone of its weight r. False: all are held. */
bool skd_bone_set_problem(const struct skd_bone_set *set, const struct skd_subject *subject,
                          double kappa, struct skd_problem *problem, int *open);

/* Fills the aims' `shown` by the set's weights; root of the weighted mean of the distances
 * squared to the targets. */
double skd_bone_set_show(const struct skd_bone_set *set, struct skd_subject *subject);

#endif
