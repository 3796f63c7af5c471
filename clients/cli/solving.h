/* The options that say how targets are solved: skinctl stroke, replay, pins solve.
 *
 * Thread: one. File-level variables that popt's tables point at, as everywhere in skinctl.
 */
#ifndef SKD_CLI_SOLVING_H
#define SKD_CLI_SOLVING_H

#include "clients/cli/cli.h"
#include "clients/cli/script.h"

extern const struct poptOption skd_solving_options[]; /* of all three */
extern const struct poptOption skd_sculpt_options[];  /* of stroke and replay */

/* clang-format off */
#define SKD_OPTIONS_SOLVING                                                                        \
    {NULL, 0, POPT_ARG_INCLUDE_TABLE, (void *)(uintptr_t)skd_solving_options, 0,                   \
     "How it is solved:", NULL}
#define SKD_OPTIONS_SCULPT                                                                         \
    {NULL, 0, POPT_ARG_INCLUDE_TABLE, (void *)(uintptr_t)skd_sculpt_options, 0,                    \
     "What the targets are:", NULL}
/* clang-format on */

/* Puts what the command line says above what the stroke says; borrows from the options. False when
 * it says nothing. */
bool skd_solving_apply(struct skd_script_stroke *stroke);

#endif
