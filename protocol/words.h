/* The words that both sides spell the same: the methods' names, and choices among a few words.
 *
 * Stage: request. Thread: any. A choice travels as its word and is held as its number.
 */
#ifndef SKD_PROTOCOL_WORDS_H
#define SKD_PROTOCOL_WORDS_H

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
    X(SESSION_SET, "session.set")                                                                  \
    X(SESSION_SAVE, "session.save")                                                                \
    X(SESSION_OPEN, "session.open")                                                                \
    X(SESSION_FORK, "session.fork")                                                                \
    X(SESSION_DELETE, "session.delete")                                                            \
    X(SESSION_VERIFY, "session.verify")                                                            \
    X(SESSION_CLAIM, "session.claim")                                                              \
    X(MESH_GET, "mesh.get")                                                                        \
    X(POSE_SET, "pose.set")                                                                        \
    X(POSE_EVALUATE, "pose.evaluate")                                                              \
    X(STROKE_APPLY, "stroke.apply")                                                                \
    X(PINS_LIST, "pins.list")                                                                      \
    X(PINS_GET, "pins.get")                                                                        \
    X(PINS_WEIGH, "pins.weigh")                                                                    \
    X(PINS_CLEAR, "pins.clear")                                                                    \
    X(PINS_SOLVE, "pins.solve")                                                                    \
    X(GUARD_SET, "guard.set")                                                                      \
    X(GUARD_GET, "guard.get")                                                                      \
    X(SHAPES_LIST, "shapes.list")                                                                  \
    X(SHAPES_GET, "shapes.get")                                                                    \
    X(SESSION_REFIT, "session.refit")                                                              \
    X(WEIGHTS_GET, "weights.get")                                                                  \
    X(WEIGHTS_SET, "weights.set")                                                                  \
    X(WEIGHTS_MIRROR, "weights.mirror")                                                            \
    X(WEIGHTS_PRUNE, "weights.prune")                                                              \
    X(WEIGHTS_REDUCE, "weights.reduce")                                                            \
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

/* Words that both sides spell the same; the order is that of the solver's and the session's enums.
 */
extern const char *const skd_method_words[];     /* "exact", "thesis", NULL */
extern const char *const skd_constraint_words[]; /* "simplex", "affine", NULL */
extern const char *const skd_fill_words[];       /* "hop", "infect", "neighbours", "none", NULL */
extern const char *const skd_pin_words[];        /* "set", "move", "none", NULL */
extern const char *const skd_slots_words[];      /* "keep", "evidence", NULL */
extern const char *const skd_residual_words[];   /* "report", "rest", "shape", NULL */
extern const char *const skd_axis_words[];       /* "x", "y", "z", NULL */
extern const char *const skd_durability_words[]; /* "full", "second", "off", NULL */
extern const char *const skd_side_words[];       /* "+", "-", NULL */

/* Words whose numbers are these. */
enum skd_reduce { SKD_REDUCE_REFUSE, SKD_REDUCE_LARGEST, SKD_REDUCE_POSED };
enum skd_reduce_by { SKD_REDUCE_BY_POSES, SKD_REDUCE_BY_SIZE };
extern const char *const skd_reduce_words[];    /* "refuse", "largest", "posed", NULL */
extern const char *const skd_reduce_by_words[]; /* "poses", "size", NULL */

#endif
