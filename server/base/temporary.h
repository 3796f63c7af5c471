/* Files that are written beside the one that they are to replace, under a hidden name.
 *
 * Thread: any. A process that is killed leaves what it was writing; who writes into the same folder
 * much later removes that.
 */
#ifndef SKD_BASE_TEMPORARY_H
#define SKD_BASE_TEMPORARY_H

enum { SKD_TEMPORARY_IDLE_S = 3600 }; /* nobody writes this slowly */

/* "dir/.skind-<16 digits>.tmp" for "dir/name", never the same twice; the caller's to free. NULL: no
 * memory. */
char *skd_temporary_name(const char *path);

/* Removes those files of a folder that were not written to for so long; 0: all of them. What cannot
 * be removed stays. */
void skd_temporary_sweep(int folder_fd, int idle_s);

#endif
