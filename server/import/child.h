/* The short-lived process in which a file is parsed: skind itself, started again under another
 * name.
 *
 * Stage: before the line. Thread: main's.
 * It lowers its own limits, reads one glTF file, writes what it found into a memory file
 * (answer.h), and ends. It opens no socket and knows no session. That it is the same program makes
 * it the same version, with nothing more to install or to find.
 */
#ifndef SKD_IMPORT_CHILD_H
#define SKD_IMPORT_CHILD_H

#include <stdbool.h>

/* True when this process was started by skd_import_start. The first thing in main: only a program
 * that asks is started again. */
bool skd_import_is_child(int argc, const char *const *argv);

/* Whether it did. */
bool skd_import_was_asked(void);

/* Does the work and ends the process. */
_Noreturn void skd_import_child(int argc, const char *const *argv);

#endif
