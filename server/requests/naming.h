/* Names for sessions that come from files.
 *
 * Stage: rig session. Thread: the loop.
 */
#ifndef SKD_REQUESTS_NAMING_H
#define SKD_REQUESTS_NAMING_H

#include "requests/state.h"

/* Reserves `name`, or where it is NULL one made from the file's: "Knight" from ".../Knight.glb",
 * "Knight-2" where that is taken. `file` NULL counts as "rig". Errors: those of skd_live_reserve.
 */
SKD_MUST_CHECK enum skd_status skd_reserve_name(struct skd_daemon *daemon, const char *name,
                                                const char *file, struct skd_live **live,
                                                struct skd_error *error);

#endif
