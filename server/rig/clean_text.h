/* Sentences that quote a file: whatever bytes it holds, what is sent on is UTF-8 on one line.
 *
 * Stage: rig session and export. Thread: any. Pure.
 */
#ifndef SKD_RIG_CLEAN_TEXT_H
#define SKD_RIG_CLEAN_TEXT_H

#include "base/error.h"

/* Puts '?' for every byte of error->text that is not UTF-8 or is a control character. error may be
 * NULL. Returns status, for a call's end. */
enum skd_status skd_clean_error(enum skd_status status, struct skd_error *error);

#endif
