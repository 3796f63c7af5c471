/* uthash, set up so that a table that cannot grow is an error and not an exit.
 *
 * After HASH_ADD_*(hh, ...), skd_hash_added(element) tells whether it went in.
 */
#ifndef SKD_BASE_HASH_H
#define SKD_BASE_HASH_H

#include <stddef.h>

#define HASH_NONFATAL_OOM 1
#include <uthash.h>

#define skd_hash_added(element) ((element)->hh.tbl != NULL)

#endif
