/* A random session with its journal, as the daemon has them: what happens to the session is
 * appended to its file, and what it was at each revision is noted. */
#ifndef SKD_TESTS_SUPPORT_WORLD_H
#define SKD_TESTS_SUPPORT_WORLD_H

#include "journal/journal.h"
#include "support/random_session.h"

enum { WORLD_PATH_BYTES = 256, WORLD_REVISIONS_MAX = 4096 };

struct world {
    char folder[WORLD_PATH_BYTES]; /* a temporary one of its own */
    char path[WORLD_PATH_BYTES];
    struct random random;
    size_t step_vertices; /* at most, of one step */
    uv_loop_t loop;
    struct skd_journal *journal;
    struct skd_journal_file *file; /* NULL: nothing is appended */
    struct skd_session *session;
    uint64_t digests[WORLD_REVISIONS_MAX]; /* by revision */
    size_t waiting;                        /* records that done was not called for */
    size_t told;                           /* and those that it was */
    size_t suspended;
    bool ended;
};

void world_start(struct world *world, uint64_t seed, size_t vertices, int bones, int slots);
/* Writes the session's file (world->path) whole. */
void world_write(struct world *world);
/* Appends to it from now on. */
void world_open(struct world *world);
/* Something happens to the session: mostly a step. */
void world_act(struct world *world);
void world_step(struct world *world, size_t count, unsigned changes);
/* The step at the boundary, where there is one. */
void world_undo(struct world *world);
/* Runs the loop until all that was appended is told. */
void world_wait(struct world *world);
/* Closes the file; all of it is written then. */
void world_close(struct world *world);
/* Frees all, and removes the folder. */
void world_end(struct world *world);

#endif
