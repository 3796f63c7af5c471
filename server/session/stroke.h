/* A stroke: what a client asked for, and everything that is known of it on its way to a step.
 *
 * Stage: job -> [pure solve] -> result. Thread: see stroke_run.h, which goes through the stages.
 */
#ifndef SKD_SESSION_STROKE_H
#define SKD_SESSION_STROKE_H

#include "session/session.h"

/* The order of each is that of the wire's words. */
enum skd_pin_mode { SKD_PIN_SET, SKD_PIN_MOVE, SKD_PIN_NONE }; /* see stroke_targets.c */
enum skd_slots_mode { SKD_SLOTS_KEEP, SKD_SLOTS_EVIDENCE };
/* What is done about what weights cannot reach: it is told, the rest position moves too, or a
 * corrective shape for the stroke's pose takes it. */
enum skd_residual_mode { SKD_RESIDUAL_REPORT, SKD_RESIDUAL_REST, SKD_RESIDUAL_SHAPE };

/* What a client asked for. Arrays and names are borrowed for the stroke's life. */
struct skd_stroke_input {
    const uint32_t *vertices; /* [count] */
    const float *positions;   /* [count][3] posed positions wanted; NULL where pins are solved */
    size_t count;
    bool solves_pins;    /* the targets are the pins that are there */
    bool names_vertices; /* of the pins solve those of `vertices` only */
    const float *mask;   /* [count] 0..1, or NULL */
    double mix;          /* 0..1: how far from what is shown towards the positions */
    const char *const *locked_bones;
    size_t locked_bone_count;
    const uint32_t *locked_vertices;
    size_t locked_vertex_count;
    enum skd_pin_mode pin;
    enum skd_slots_mode slots;
    enum skd_residual_mode residual;
    bool choose_stiffness; /* from the data, instead of options.stiffness */
    /* Refit: poses (held by the job) and all vertices' positions in each. */
    struct skd_pose *const *frames;
    size_t frame_count;
    const float *frame_positions; /* [frame_count][V][3] */
    int rounds;
    struct skd_solve_options options; /* length is filled from the rig */
};

struct skd_residual {
    double mean; /* scene units */
    double max;
};

/* What the user should know about a result; X(name, wire name, sentence with %zu). */
#define SKD_STROKE_WARNINGS(X)                                                                     \
    X(REST_ONE_POSE, "rest_one_pose",                                                              \
      "%zu vertices have a target in one pose only, which says too little to move their rest "     \
      "positions; sculpt them in another pose too")                                                \
    X(REST_DOUBTFUL, "rest_doubtful",                                                              \
      "%zu vertices moved their rest positions on little evidence (two poses, or bones that are "  \
      "missing); look at them in other poses, or pin a third")                                     \
    X(POSES_ALIKE, "poses_alike",                                                                  \
      "the poses hardly move the bones of %zu vertices against each other, so their slots are "    \
      "a guess; bend the joints more")

enum skd_stroke_warning {
#define SKD_STROKE_WARNING_ENUM(name, wire, text) SKD_WARNING_##name,
    SKD_STROKE_WARNINGS(SKD_STROKE_WARNING_ENUM)
#undef SKD_STROKE_WARNING_ENUM
        SKD_WARNING_COUNT
};

/* Before slots are chosen for vertices whose rest positions may move too: both move with the slots
 * as they are, so that evidence is looked for where vertices will rest. Bones that are chosen for a
 * wrong rest position stay wrong. */
enum { SKD_PASS_REST_FIRST = -1 };

/* Targets of a step's vertices in one pose. */
struct skd_stroke_pose {
    const double *matrices; /* borrowed */
    float *targets;         /* [step->count][3] owned */
    float *strengths;       /* [step->count] owned; NULL: all 1 */
};

struct skd_smoothing;

struct skd_stroke {
    struct skd_session *session; /* borrowed */
    struct skd_pose *pose;       /* borrowed; the job holds it; NULL for a refit */
    struct skd_stroke_input input;
    struct skd_sheet *pins;  /* this pose's, or NULL where none are kept */
    struct skd_sheet *shape; /* this pose's, or NULL where it has none and needs none */
    struct skd_step *step;   /* vertices, before, after: the result */
    int pose_count;
    struct skd_stroke_pose *poses; /* [pose_count] owned; the stroke's own pose first */
    float *asked;        /* [step->count][3] owned: where the client wants to see vertices; NULL: at
                            the first pose's targets */
    float *shown_before; /* [step->count][3] owned, or NULL */
    float *residual_before; /* [step->count] owned */
    float *residual_after;
    uint16_t *candidates;   /* [step->count][SKD_CANDIDATES_MAX] owned, or NULL */
    uint8_t *doubtful;      /* [step->count] owned, or NULL: rest positions on little evidence */
    uint8_t *bone_locked;   /* [bones] owned, or NULL */
    uint8_t *vertex_locked; /* [V] owned, or NULL */
    struct skd_smoothing *smoothing; /* owned, or NULL */
    float *rest;    /* [V][3] owned: the session's with what SKD_PASS_REST_FIRST moved; or NULL */
    int pass;       /* first_pass first */
    int first_pass; /* 0 or SKD_PASS_REST_FIRST */
    int pass_count; /* passes from 0 on */
    /* filled by skd_stroke_finish */
    struct skd_residual before;
    struct skd_residual after;
    size_t unreached_count; /* farther than `reach` from their target */
    double reach;           /* scene units */
    int most_poses;         /* that one vertex has targets in */
    size_t slots_changed;   /* vertices */
    size_t rest_moved;
    size_t shaped;
    size_t warnings[SKD_WARNING_COUNT];
    float
        *told; /* [told_count] residuals in the order of the request's vertices, or rising; owned */
    size_t told_count;
};

const char *skd_stroke_warning_name(enum skd_stroke_warning warning);
void skd_stroke_warning_text(enum skd_stroke_warning warning, size_t count, char *text,
                             size_t text_bytes);

#endif
