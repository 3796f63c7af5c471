/* Requests as typed values: every parameter read, its type and range checked, defaults filled.
 *
 * Stage: request. Thread: any. What needs a session to be checked (an index against the vertex
 * count, a pose's name) is left to the session.
 * Strings and arrays borrow from the message that the request owns.
 */
#ifndef SKD_PROTOCOL_REQUEST_H
#define SKD_PROTOCOL_REQUEST_H

#include "protocol/message.h"
#include "protocol/words.h"

struct skd_hello_params {
    const char *client_name; /* "" when not said */
    const char *client_version;
    const char *client_id;   /* what it goes by over reconnects; NULL: nothing */
    const char *client_user; /* "" when not said */
    const char *token;       /* SKD_TOKEN_DIGITS of them; NULL: none */
    int protocol_min;
    int protocol_max;
};

struct skd_cancel_params {
    struct skd_request_id target;
};

struct skd_session_create_params {
    const char *name; /* NULL: made from the file's name, or "rig" */
    const char *file; /* absolute path; NULL: the arrays below */
    int influences;   /* 4 or 8 */
    int fill;         /* index into skd_fill_words */
    enum skd_reduce reduce;
    int durability;             /* index into skd_durability_words */
    uint64_t history_bytes;     /* for undo; 0: the usual */
    struct skd_array positions; /* f32 [V,3] */
    struct skd_array triangles; /* u32 [T,3] */
    const char **bone_names;    /* [bone_name_count], owned by the request; may be NULL */
    size_t bone_name_count;
    struct skd_array bone_parents;      /* i32 [B] */
    struct skd_array bone_binds;        /* f64 [B,16] */
    struct skd_array influence_offsets; /* u32 [V+1] */
    struct skd_array influence_joints;  /* u16 [K] */
    struct skd_array influence_weights; /* f32 [K] */
};

/* All methods that take a session and nothing else, or little else. */
struct skd_session_params {
    const char *session;
    const char *path;  /* session.export: absolute */
    bool has_revision; /* session.attach */
    uint64_t revision;
    const char *instance; /* session.attach: that the revision is of; NULL: not said */
    bool own;             /* history.undo, history.redo */
};

/* session.set, save, open, fork, delete, verify: what a method does not take, or was not given, is
 * NULL, -1 and 0. */
struct skd_session_keep_params {
    const char *session;
    const char *path;   /* absolute */
    const char *closed; /* session.open: the name of a closed session */
    const char *name;   /* that a new session is to have */
    int durability;     /* index into skd_durability_words */
    uint64_t history_bytes;
};

struct skd_session_claim_params {
    const char *session;
    const char **bones; /* names, owned by the request */
    size_t bone_count;
    struct skd_array vertices; /* u32 */
};

struct skd_pose_set_params {
    const char *session;
    const char *pose;
    const char *clip; /* with time; NULL: bend or matrices */
    double time;      /* seconds */
    double bend;      /* degrees, every joint, axes chosen by seed; NAN: not given */
    int seed;
    struct skd_array matrices; /* f64 [B,16] */
};

/* pose.evaluate, weights.get. */
struct skd_shown_params {
    const char *session;
    const char *pose;          /* pose.evaluate */
    struct skd_array vertices; /* u32; empty and vertices_given false: all */
    bool vertices_given;
};

struct skd_weights_set_params {
    const char *session;
    struct skd_array vertices; /* u32 [n] */
    struct skd_array weights;  /* f32 [n,N]: N is 4 or 8, and the session knows which */
    struct skd_array joints;   /* u16, the shape of weights; data NULL: the slots stay */
    struct skd_array rest;     /* f32 [n,3]; data NULL: the rest positions stay */
    const char *shape;         /* a pose, with its offsets; NULL: shapes stay */
    struct skd_array offsets;  /* f32 [n,3] */
};

/* stroke.apply, pins.solve and session.refit: poses, targets, and how to solve for them. A member
 * that a method does not take is 0, false or NULL, but for `mix`, which is 1, and `pin`, which is
 * "none". */
struct skd_stroke_params {
    const char *session;
    const char *pose;          /* stroke.apply, pins.solve */
    const char **poses;        /* session.refit: names, owned by the request */
    size_t pose_count;         /* session.refit: 1 to SKD_TARGET_POSES_MAX */
    int rounds;                /* session.refit: 1 to SKD_REFIT_ROUNDS_MAX */
    struct skd_array vertices; /* u32 [n]; pins.solve: not given, all that are pinned */
    bool vertices_given;
    struct skd_array positions; /* f32 [n,3]; session.refit: [P*V,3], a whole number of P */
    struct skd_array mask;      /* f32 [n], 0..1 (for the job to look at); data NULL: all 1 */
    double mix;                 /* 0..1 */
    bool stream;                /* default true */
    int method;                 /* index into skd_method_words */
    int constraint;
    double stiffness; /* kappa, 0..10; NAN: to be chosen from the data */
    double guard;     /* lambda, 0..1000 */
    double smooth;    /* mu, 0..10 */
    int pin;          /* index into skd_pin_words */
    int slots;        /* index into skd_slots_words */
    int residual;     /* index into skd_residual_words */
    bool guard_given;
    double thesis_k;
    double thesis_h;
    const char **locked_bones; /* names, owned by the request */
    size_t locked_bone_count;
    struct skd_array locked_vertices; /* u32 */
};

/* pins.get, pins.weigh, pins.clear, shapes.get. */
struct skd_pins_params {
    const char *session;
    const char *pose; /* NULL (pins.clear): all poses */
    double weight;    /* pins.weigh: 0..1000 */
    struct skd_array vertices;
    bool vertices_given; /* false: all that are pinned */
};

/* guard.set: none of the three lists clears the guard. */
struct skd_guard_set_params {
    const char *session;
    const char **poses; /* names of the session's, owned by the request; NULL: not given */
    size_t pose_count;
    const char **clips;
    size_t clip_count;
    struct skd_array matrices; /* f64 [Q*B,16] */
    int count;                 /* most poses to pick, 1 to SKD_GUARD_COUNT_MAX */
};

/* weights.mirror, weights.prune, weights.reduce. */
struct skd_weights_edit_params {
    const char *session;
    struct skd_array vertices;
    bool vertices_given; /* false: all (mirror: all of the side written) */
    int axis;            /* mirror: index into skd_axis_words, so 0, 1, 2 */
    int from;            /* mirror: index into skd_side_words; 0: from the positive side */
    double origin;       /* mirror: where the plane cuts the axis, scene units */
    double tolerance;    /* mirror: shares of the rig's length, above 0 to 1 */
    double below;        /* prune: 0..1 */
    int influences;      /* reduce: 1 to 8 */
    int by;              /* reduce: enum skd_reduce_by */
    const char **poses;  /* reduce: names, owned by the request; NULL: not given */
    size_t pose_count;
};

struct skd_request {
    enum skd_request_method method;
    struct skd_message message; /* owned */
    uint64_t sequence; /* of what changes a session, by client; 0: it is not to be remembered */
    union {
        struct skd_hello_params hello;
        struct skd_cancel_params cancel;
        struct skd_session_create_params session_create;
        struct skd_session_params session;
        struct skd_session_keep_params session_keep;
        struct skd_session_claim_params session_claim;
        struct skd_pose_set_params pose_set;
        struct skd_shown_params shown;
        struct skd_weights_set_params weights_set;
        struct skd_stroke_params stroke;
        struct skd_pins_params pins;
        struct skd_guard_set_params guard_set;
        struct skd_weights_edit_params weights_edit;
    } params;
    void *owned[16]; /* memory of inline arrays and name lists */
    int owned_count;
};

/* Parses and decodes a frame, taking its block. On failure request->message.id tells whom to
 * answer; call skd_request_finish in any case. Errors: those of skd_message_parse,
 * SKD_UNKNOWN_METHOD, SKD_BAD_PARAMS, SKD_NOT_FINITE, SKD_COUNT_MISMATCH, SKD_TOO_LARGE.
 * Finite numbers inside binary buffers are not looked at: that is a job's. */
SKD_MUST_CHECK enum skd_status
skd_request_decode(struct skd_frame *frame, struct skd_request *request, struct skd_error *error);
void skd_request_finish(struct skd_request *request);

#endif
