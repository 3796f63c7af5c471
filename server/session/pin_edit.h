/* Pins that are weighed or cleared: steps that leave weights as they are; and pins that go with the
 * weights they were for.
 *
 * Stage: job -> result. Thread: a worker, while the session is lent to the job.
 */
#ifndef SKD_SESSION_PIN_EDIT_H
#define SKD_SESSION_PIN_EDIT_H

#include "session/rows.h"

struct skd_pin_edit {
    struct skd_edit_scope scope; /* of these, the vertices that are pinned */
    const char *pose;            /* every layer of that name; NULL: of any name */
    bool clear;                  /* the pins go; else they get this strength */
    float strength;              /* omega, >= 0 */
};

/* Makes the step (one reference, the caller's), empty where nothing changes. Twins of named
 * vertices go along. *vertices counts those whose pins change.
 * Errors: those of skd_rows_list, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_pin_edit_prepare(struct skd_session *session,
                                                    const struct skd_pin_edit *edit,
                                                    struct skd_step **step, size_t *vertices,
                                                    struct skd_error *error);

/* Adds to a step that its vertices' pins go, in every pose: of weights that were not solved for,
 * pins do not tell any more, and would take them back with the next stroke. Errors: SKD_NO_MEMORY.
 */
SKD_MUST_CHECK enum skd_status skd_pins_forget(struct skd_session *session, struct skd_step *step,
                                               struct skd_error *error);

#endif
