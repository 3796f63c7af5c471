/* What is in a session's file: an SQLite database with these tables and nothing else.
 *
 * - session: one row: what stays (name, instance, source, sizes, reports); never changes
 * - state: one row: revision, where the history's boundary is; written with each step
 * - chunks: the large arrays in pieces: rig image, base weights, source files, ...
 * - poses: name and matrices, each pair once; base_sheets, named and step_sheets refer to it
 * - named: the poses by name, in the order in which they were put
 * - base_sheets: pins and shapes of the base (their rows are chunks)
 * - steps: what a step changed: vertices and the values after it
 * - step_sheets: its pins and shapes
 * - history: the order of steps, and the revision that each made
 * - guard: the guard's poses
 * - remembered: answers to give again
 * - sources: the files that the rig came from (their bytes are chunks)
 *
 *     state of the session = base, then steps[0 .. position), in the order of `history`
 *     steps[position .. count) can be redone; steps[0 .. first) cannot be undone any more
 *
 * Each row ends in a checksum of itself. The checksums of `history` are a chain: each is over its
 * step's and the one before it, so that a prefix of it is known to be whole without `state`, and
 * taking a step out of the middle (undo of one's own) rewrites small rows only.
 *
 * Stage: journal. Thread: any; no state.
 */
#ifndef SKD_JOURNAL_SCHEMA_H
#define SKD_JOURNAL_SCHEMA_H

#include "base/error.h"

#include <stdbool.h>

#include <sqlite3.h>

enum {
    SKD_JOURNAL_APPLICATION = 0x736b696e, /* "skin" */
    SKD_JOURNAL_VERSION = 2,              /* of the tables; SQLite's user_version */
};

/* Brings the tables of `version` (0: an empty database) to SKD_JOURNAL_VERSION. SQLite's result. */
SKD_MUST_CHECK int skd_schema_upgrade(sqlite3 *db, int version);

/* Whether the database has our tables to the letter, and nothing else: no view, no trigger. */
SKD_MUST_CHECK int skd_schema_check(sqlite3 *db, bool *is_ours);

#endif
