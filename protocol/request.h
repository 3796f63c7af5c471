/* Requests as typed values: every parameter read, its type and range checked, defaults filled.
 *
 * Stage: request. Thread: any. What needs a session to be checked (an index against the vertex
 * count, a pose's name) is left to the session.
 * Strings and arrays borrow from the message that the request owns.
 */
#ifndef SKD_PROTOCOL_REQUEST_H
#define SKD_PROTOCOL_REQUEST_H

#include "protocol/message.h"

/* Every method a client may call; X(enum, wire name). */
#define SKD_REQUESTS(X)                                                                            \
    X(HELLO, "hello")                                                                              \
    X(PING, "ping")                                                                                \
    X(CANCEL, "cancel")                                                                            \
    X(SESSION_CREATE, "session.create")                                                            \
    X(SESSION_LIST, "session.list")                                                                \
    X(SESSION_INFO, "session.info")                                                                \
    X(SESSION_ATTACH, "session.attach")                                                            \
    X(SESSION_DETACH, "session.detach")                                                            \
    X(SESSION_CLOSE, "session.close")                                                              \
    X(SESSION_EXPORT, "session.export")                                                            \
    X(MESH_GET, "mesh.get")                                                                        \
    X(POSE_SET, "pose.set")                                                                        \
    X(POSE_EVALUATE, "pose.evaluate")                                                              \
    X(STROKE_APPLY, "stroke.apply")                                                                \
    X(WEIGHTS_GET, "weights.get")                                                                  \
    X(WEIGHTS_SET, "weights.set")                                                                  \
    X(HISTORY_UNDO, "history.undo")                                                                \
    X(HISTORY_REDO, "history.redo")                                                                \
    X(STATS, "stats")                                                                              \
    X(SHUTDOWN, "shutdown")

enum skd_request_method {
#define SKD_REQUEST_ENUM(name, wire) SKD_REQUEST_##name,
    SKD_REQUESTS(SKD_REQUEST_ENUM)
#undef SKD_REQUEST_ENUM
        SKD_REQUEST_METHOD_COUNT
};

const char *skd_request_method_name(enum skd_request_method method);

/* Words that both sides spell the same; the order is the solver's enums'. */
extern const char *const skd_method_words[];     /* "exact", "thesis", NULL */
extern const char *const skd_constraint_words[]; /* "simplex", "affine", NULL */
extern const char *const skd_fill_words[];       /* "hop", "infect", "neighbours", "none", NULL */

struct skd_hello_params {
    const char *client_name; /* "" when not said */
    const char *client_version;
    int protocol_min;
    int protocol_max;
};

struct skd_cancel_params {
    struct skd_request_id target;
};

enum skd_reduce { SKD_REDUCE_REFUSE, SKD_REDUCE_LARGEST };

struct skd_session_create_params {
    const char *name; /* NULL: made from the file's name, or "rig" */
    const char *file; /* absolute path; NULL: the arrays below */
    int influences;   /* 4 or 8 */
    int fill;         /* index into skd_fill_words */
    enum skd_reduce reduce;
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

struct skd_pose_evaluate_params {
    const char *session;
    const char *pose;
    struct skd_array vertices; /* u32; empty and vertices_given false: all */
    bool vertices_given;
};

struct skd_weights_get_params {
    const char *session;
    struct skd_array vertices;
    bool vertices_given;
};

struct skd_weights_set_params {
    const char *session;
    struct skd_array vertices; /* u32 [n] */
    struct skd_array weights;  /* f32 [n,N]: N is 4 or 8, and the session knows which */
};

struct skd_stroke_params {
    const char *session;
    const char *pose;
    struct skd_array vertices;  /* u32 [n] */
    struct skd_array positions; /* f32 [n,3] */
    bool stream;                /* default true */
    int method;                 /* index into skd_method_words */
    int constraint;
    double stiffness; /* kappa, 0..10, default 0.008 */
    double thesis_k;
    double thesis_h;
    const char **locked_bones; /* names, owned by the request */
    size_t locked_bone_count;
    struct skd_array locked_vertices; /* u32 */
};

struct skd_request {
    enum skd_request_method method;
    struct skd_message message; /* owned */
    union {
        struct skd_hello_params hello;
        struct skd_cancel_params cancel;
        struct skd_session_create_params session_create;
        struct skd_session_params session;
        struct skd_pose_set_params pose_set;
        struct skd_pose_evaluate_params pose_evaluate;
        struct skd_weights_get_params weights_get;
        struct skd_weights_set_params weights_set;
        struct skd_stroke_params stroke;
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
