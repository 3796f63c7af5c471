/* Sessions and steps at random, for tests of what becomes of them: nothing is solved, the numbers
 * mean nothing, and every part of a session is touched. */
#ifndef SKD_TESTS_SUPPORT_RANDOM_SESSION_H
#define SKD_TESTS_SUPPORT_RANDOM_SESSION_H

#include "session/session.h"

/* Numbers that depend on the seed alone (splitmix64). */
struct random {
    uint64_t state;
};
uint64_t random_next(struct random *random);
size_t random_below(struct random *random, size_t limit);
float random_share(struct random *random); /* 0 .. 1 */

/* A strip of vertices over a chain of bones, with the pose "rest". Aborts where it cannot. */
struct skd_session *random_session(struct random *random, size_t vertices, int bones, int slots);

/* A pose at random under a name. */
struct skd_pose *random_pose(const struct skd_session *session, struct random *random,
                             const char *name);

/* One of the poses p0 .. p3 of random steps: always the same matrices under a name. */
struct skd_pose *random_sheet_pose(const struct skd_session *session, struct random *random);

/* What a random step changes beside weights. */
enum {
    RANDOM_JOINTS = 1,
    RANDOM_REST = 2,
    RANDOM_PINS = 4,   /* of its own vertices, in a pose or two */
    RANDOM_SHAPE = 8,  /* in a pose */
    RANDOM_CLEAR = 16, /* pins of other vertices, and no weights at all */
};

/* A step of `count` vertices with both its sides, not yet written; its sheets are among those of
 * the poses p0 .. p3. One reference, the caller's. */
struct skd_step *random_step(struct skd_session *session, struct random *random, size_t count,
                             unsigned changes);

/* What strokes can see of a session: weights, bones, rest positions, pins and shapes. */
uint64_t random_digest(const struct skd_session *session);

#endif
