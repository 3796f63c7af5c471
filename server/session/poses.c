/* See poses.h. */
#include "session/poses.h"

#include <stdlib.h>
#include <string.h>

struct skd_pose *skd_pose_create(const char *name, int bone_count)
{
    size_t matrix_bytes = (size_t)bone_count * SKD_MATRIX_SIZE * sizeof(double);
    struct skd_pose *pose = calloc(1, sizeof *pose + matrix_bytes);
    if (pose == NULL)
        return NULL;
    SKD_ASSERT(strlen(name) < sizeof pose->name);
    memcpy(pose->name, name, strlen(name) + 1);
    pose->references = 1;
    return pose;
}

struct skd_pose *skd_pose_hold(struct skd_pose *pose)
{
    pose->references++;
    return pose;
}

void skd_pose_release(struct skd_pose *pose)
{
    if (pose != NULL && --pose->references == 0)
        free(pose);
}

enum skd_status skd_poses_put(struct skd_poses *poses, struct skd_pose *pose,
                              struct skd_error *error)
{
    struct skd_pose *before = skd_poses_find(poses, pose->name);
    if (before == NULL && HASH_COUNT(poses->by_name) >= SKD_POSES_MAX) {
        skd_pose_release(pose);
        return skd_fail(error, SKD_TOO_LARGE,
                        "the session holds %d poses already; set one of their names again",
                        SKD_POSES_MAX);
    }
    if (before != NULL)
        HASH_DEL(poses->by_name, before);
    HASH_ADD_STR(poses->by_name, name, pose);
    skd_pose_release(before);
    if (!skd_hash_added(pose)) {
        skd_pose_release(pose);
        return skd_fail_memory(error, "another pose");
    }
    return SKD_OK;
}

struct skd_pose *skd_poses_find(const struct skd_poses *poses, const char *name)
{
    struct skd_pose *pose;
    HASH_FIND_STR(poses->by_name, name, pose);
    return pose;
}

void skd_poses_finish(struct skd_poses *poses)
{
    struct skd_pose *pose, *next;
    HASH_ITER(hh, poses->by_name, pose, next)
    {
        HASH_DEL(poses->by_name, pose);
        skd_pose_release(pose);
    }
}
