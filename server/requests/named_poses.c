/* See named_poses.h. */
#include "requests/named_poses.h"

#include <stdlib.h>

enum skd_status skd_named_poses_find(const struct skd_session *session, const char *const *names,
                                     size_t count, struct skd_named_poses *poses,
                                     struct skd_error *error)
{
    *poses = (struct skd_named_poses){.items = calloc(count + 1, sizeof(struct skd_pose *))};
    if (poses->items == NULL)
        return skd_fail_memory(error, "the named poses");
    while (poses->count < count) {
        struct skd_pose *pose = skd_session_find_pose(session, names[poses->count], error);
        if (pose == NULL)
            return SKD_NO_POSE;
        poses->items[poses->count++] = skd_pose_hold(pose);
    }
    return SKD_OK;
}

enum skd_status skd_named_poses_all(const struct skd_session *session,
                                    struct skd_named_poses *poses, struct skd_error *error)
{
    struct skd_pose *pose, *next;
    size_t count = HASH_COUNT(session->poses.by_name);
    *poses = (struct skd_named_poses){.items = calloc(count + 1, sizeof(struct skd_pose *))};
    if (poses->items == NULL)
        return skd_fail_memory(error, "the named poses");
    HASH_ITER(hh, session->poses.by_name, pose, next)
    poses->items[poses->count++] = skd_pose_hold(pose);
    return SKD_OK;
}

void skd_named_poses_finish(struct skd_named_poses *poses)
{
    for (size_t i = 0; i < poses->count; i++)
        skd_pose_release(poses->items[i]);
    free(poses->items);
    *poses = (struct skd_named_poses){0};
}
