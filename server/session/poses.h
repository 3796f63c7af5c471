/* The named poses of a rig session.
 *
 * Stage: rig session. Thread: the loop makes, finds and releases poses; a worker reads the matrices
 * of a pose that its job holds. A pose never changes: setting a name again puts a new pose in its
 * place, and jobs that hold the old one go on with it.
 */
#ifndef SKD_SESSION_POSES_H
#define SKD_SESSION_POSES_H

#include "base/hash.h"
#include "protocol/limits.h"
#include "rig/rig.h"

struct skd_pose {
    char name[SKD_POSE_NAME_BYTES_MAX + 1];
    int references;
    UT_hash_handle hh;
    double matrices[]; /* [bones][12] skin matrices */
};

struct skd_poses {
    struct skd_pose *by_name;
};

/* A pose without a name in any table yet, one reference held by the caller, matrices unset.
 * NULL when there is no memory. */
struct skd_pose *skd_pose_create(const char *name, int bone_count);
struct skd_pose *skd_pose_hold(struct skd_pose *pose);
void skd_pose_release(struct skd_pose *pose); /* NULL is fine */

/* Puts the pose under its name, taking the caller's reference, also when it fails.
 * Errors: SKD_TOO_LARGE past SKD_POSES_MAX, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_poses_put(struct skd_poses *poses, struct skd_pose *pose,
                                             struct skd_error *error);
struct skd_pose *skd_poses_find(const struct skd_poses *poses, const char *name);
void skd_poses_finish(struct skd_poses *poses);

#endif
