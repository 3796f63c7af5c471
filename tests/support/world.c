/* See world.h. */
#include "support/world.h"

#include "journal/whole.h"
#include "session/guard_choice.h"

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { CLIENTS = 70 }; /* more than are remembered */

static void on_suspended(void *user, void *owner, const char *reason)
{
    struct world *world = user;
    (void)reason;
    SKD_ASSERT(owner == world);
    world->suspended++;
}

void world_start(struct world *world, uint64_t seed, size_t vertices, int bones, int slots)
{
    const char *base = getenv("TMPDIR");
    const struct skd_journal_events events = {.user = world, .suspended = on_suspended};
    memset(world, 0, sizeof *world);
    (void)snprintf(world->folder, sizeof world->folder, "%s/skind-journal-XXXXXX",
                   base != NULL ? base : "/tmp");
    SKD_ASSERT(mkdtemp(world->folder) != NULL);
    (void)snprintf(world->path, sizeof world->path, "%.200s/session.skind", world->folder);
    world->random.state = seed;
    world->step_vertices = vertices / 8;
    world->session = random_session(&world->random, vertices, bones, slots);
    world->digests[0] = random_digest(world->session);
    SKD_ASSERT(uv_loop_init(&world->loop) == 0);
    SKD_ASSERT(skd_journal_start(&world->journal, &world->loop, &events, NULL) == SKD_OK);
}

void world_write(struct world *world)
{
    struct skd_pose *poses[SKD_POSES_MAX], *pose, *next;
    size_t count = 0;
    HASH_ITER(hh, world->session->poses.by_name, pose, next)
    {
        poses[count++] = pose;
    }
    SKD_ASSERT(skd_journal_write(world->path, world->session, NULL, poses, count, NULL) == SKD_OK);
}

void world_open(struct world *world)
{
    SKD_ASSERT(skd_journal_open(world->journal, world->path, world->session->durability,
                                world->session->instance, world, &world->file, NULL) == SKD_OK);
}

static void on_done(void *user)
{
    struct world *world = user;
    world->waiting--;
    world->told++;
}

static void append(struct world *world, struct skd_record *record)
{
    if (world->file == NULL) {
        skd_record_destroy(record);
        return;
    }
    SKD_ASSERT(record != NULL);
    if (skd_journal_append(world->file, record, on_done, world))
        world->waiting++;
}

static void advance(struct world *world)
{
    skd_session_advance(world->session);
    SKD_ASSERT(world->session->revision < WORLD_REVISIONS_MAX);
    world->digests[world->session->revision] = random_digest(world->session);
}

void world_step(struct world *world, size_t count, unsigned changes)
{
    struct skd_session *session = world->session;
    struct skd_step *step = random_step(session, &world->random, count, changes);
    char client[8], answer[64];
    skd_session_write(session, step, false);
    SKD_ASSERT(skd_history_reserve(&session->history, NULL) == SKD_OK);
    step->revision = session->revision + 1;
    size_t dropped = skd_history_push(&session->history, step);
    advance(world);
    struct skd_record *record = skd_record_create_step(step, session->revision, dropped);
    (void)snprintf(client, sizeof client, "c%u", (unsigned)random_below(&world->random, CLIENTS));
    (void)snprintf(answer, sizeof answer, "{\"revision\":%u}", (unsigned)session->revision);
    SKD_ASSERT(skd_record_remember(record, client, session->revision, answer));
    SKD_ASSERT(skd_remembered_add(&session->remembered, client, session->revision,
                                  session->revision, answer, NULL) == SKD_OK);
    append(world, record);
    skd_step_release(step);
}

static bool touches(const struct skd_step *step, const uint8_t *touched)
{
    for (size_t i = 0; i < step->count; i++) {
        if (touched[step->vertices[i]] != 0)
            return true;
    }
    for (const struct skd_sheet_change *pins = step->pins; pins != NULL; pins = pins->next) {
        for (size_t i = 0; i < pins->count; i++) {
            if (touched[pins->vertices[i]] != 0)
                return true;
        }
    }
    return false;
}

static void mark(const struct skd_step *step, uint8_t *touched)
{
    for (size_t i = 0; i < step->count; i++)
        touched[step->vertices[i]] = 1;
    for (const struct skd_sheet_change *pins = step->pins; pins != NULL; pins = pins->next) {
        for (size_t i = 0; i < pins->count; i++)
            touched[pins->vertices[i]] = 1;
    }
}

/* The step farthest from the boundary that may be moved there, at most `most` away. */
static size_t choose_index(const struct world *world, int direction, size_t most)
{
    const struct skd_history *history = &world->session->history;
    uint8_t *touched = calloc(world->session->rig->mesh.vertex_count, 1);
    size_t boundary = direction < 0 ? history->position - 1 : history->position;
    size_t chosen = boundary, at = boundary;
    SKD_ASSERT(touched != NULL);
    for (size_t i = 0; i <= most && at < history->count; i++) {
        if (!touches(history->steps[at], touched))
            chosen = at;
        mark(history->steps[at], touched);
        at = direction < 0 ? at - 1 : at + 1; /* SIZE_MAX ends it */
    }
    free(touched);
    return chosen;
}

/* A step at most `most` places from the boundary is undone or redone. */
static void move(struct world *world, int direction, size_t most)
{
    struct skd_session *session = world->session;
    struct skd_history *history = &session->history;
    if (direction < 0 ? history->position == 0 : history->position == history->count)
        return;
    size_t index = choose_index(world, direction, most);
    struct skd_step *step = history->steps[index];
    skd_session_write(session, step, direction < 0);
    skd_history_move(history, direction, index, session->revision + 1);
    advance(world);
    append(world, skd_record_create_move(direction, index, session->revision));
}

void world_undo(struct world *world)
{
    move(world, -1, 0);
}

static void put_pose(struct world *world)
{
    char name[8];
    (void)snprintf(name, sizeof name, "p%u", (unsigned)random_below(&world->random, 6));
    struct skd_pose *pose = random_below(&world->random, 2) == 0
                                ? random_sheet_pose(world->session, &world->random)
                                : random_pose(world->session, &world->random, name);
    append(world, skd_record_create_pose(pose));
    SKD_ASSERT(skd_poses_put(&world->session->poses, pose, NULL) == SKD_OK);
}

static void set_guard(struct world *world)
{
    struct skd_session *session = world->session;
    struct skd_pose *poses[3];
    struct skd_guards_input input = {.poses = poses, .most = 2};
    skd_guards_finish(&session->guards);
    if (random_below(&world->random, 3) > 0) {
        for (; input.pose_count < 3; input.pose_count++)
            poses[input.pose_count] = random_pose(session, &world->random, "guard");
        SKD_ASSERT(skd_guards_build(session, &input, &session->guards, NULL) == SKD_OK);
        for (size_t i = 0; i < 3; i++)
            skd_pose_release(poses[i]);
    }
    append(world, skd_record_create_guard(&session->guards));
}

static void set_limits(struct world *world)
{
    struct skd_history *history = &world->session->history;
    size_t bytes = history->bytes / 2 + 4096;
    size_t dropped = skd_history_limit(history, bytes);
    append(world, skd_record_create_settings(world->session->durability, bytes, dropped));
}

void world_act(struct world *world)
{
    static const unsigned changes[] = {0,
                                       0,
                                       RANDOM_PINS,
                                       RANDOM_JOINTS,
                                       RANDOM_REST,
                                       RANDOM_SHAPE,
                                       RANDOM_JOINTS | RANDOM_PINS | RANDOM_REST,
                                       RANDOM_CLEAR};
    size_t choice = random_below(&world->random, 32);
    if (choice < 18)
        world_step(world, 1 + random_below(&world->random, world->step_vertices),
                   changes[random_below(&world->random, sizeof changes / sizeof *changes)]);
    else if (choice < 24)
        move(world, -1, random_below(&world->random, 4));
    else if (choice < 27)
        move(world, 1, random_below(&world->random, 4));
    else if (choice < 29)
        put_pose(world);
    else if (choice < 30)
        set_guard(world);
    else if (choice < 31)
        set_limits(world);
    else {
        world->session->exported = world->session->revision;
        append(world, skd_record_create_exported(world->session->revision));
    }
}

void world_wait(struct world *world)
{
    while (world->waiting > 0)
        (void)uv_run(&world->loop, UV_RUN_ONCE);
}

static void on_end(void *user)
{
    ((struct world *)user)->ended = true;
}

void world_close(struct world *world)
{
    world->ended = false;
    skd_journal_close(world->file, NULL, on_end, world);
    world->file = NULL;
    while (!world->ended)
        (void)uv_run(&world->loop, UV_RUN_ONCE);
}

static int remove_one(const char *path, const struct stat *status, int kind, struct FTW *place)
{
    (void)status;
    (void)kind;
    (void)place;
    return remove(path);
}

void world_end(struct world *world)
{
    if (world->journal != NULL)
        skd_journal_stop(world->journal);
    (void)uv_run(&world->loop, UV_RUN_DEFAULT);
    SKD_ASSERT(uv_loop_close(&world->loop) == 0);
    skd_session_destroy(world->session);
    (void)nftw(world->folder, remove_one, 8, FTW_DEPTH | FTW_PHYS);
}
