/* The one way in which a call says that input, a file or a limit stopped it.
 *
 * Stage: all of them. Thread: any; an error belongs to the caller's stack.
 *
 * Three kinds of trouble are kept apart:
 *   bad input, I/O, a limit   a must-check enum skd_status, and the sentence in struct skd_error
 *   a bug                     SKD_ASSERT, which stays on in shipped builds
 *   a vertex without answer   data (a flag and a count), never an error
 *
 * The sentence is written where the trouble is found: what is wrong, with names and numbers, and
 * what to do. It is logged or sent once, at the top.
 */
#ifndef SKD_BASE_ERROR_H
#define SKD_BASE_ERROR_H

#include <stdbool.h>

enum skd_status {
    SKD_OK = 0,
    /* the wire */
    SKD_BAD_FRAME,
    SKD_BAD_JSON,
    SKD_BAD_REQUEST,
    SKD_UNKNOWN_METHOD,
    SKD_BAD_PARAMS,
    SKD_INTERNAL,
    SKD_VERSION,
    SKD_HELLO_FIRST,
    SKD_TOO_LARGE,
    SKD_BUSY,
    SKD_CANCELLED,
    SKD_SHUTTING_DOWN,
    SKD_NO_MEMORY,
    /* names that lead nowhere */
    SKD_NO_SESSION,
    SKD_NO_POSE,
    SKD_NO_CLIP,
    SKD_NO_BONE,
    SKD_NAME_TAKEN,
    /* arrays and numbers */
    SKD_BAD_INDEX,
    SKD_NOT_FINITE,
    SKD_COUNT_MISMATCH,
    /* files and rigs */
    SKD_NO_FILE,
    SKD_FILE_IO,
    SKD_NOT_GLTF,
    SKD_UNSUPPORTED,
    SKD_BAD_RIG,
    SKD_TOO_MANY_INFLUENCES,
    SKD_SOURCE_CHANGED,
    SKD_DAMAGED,
    SKD_NEWER,
    /* history */
    SKD_NOTHING_TO_UNDO,
    SKD_NOTHING_TO_REDO,
    SKD_CONFLICT,
    SKD_STALE_SEQUENCE,
    /* who may enter */
    SKD_BAD_TOKEN,
    SKD_STATUS_COUNT
};

enum { SKD_ERROR_TEXT_BYTES = 400 };

/* status is SKD_OK until a call fails; text is one UTF-8 sentence, cut to fit. */
struct skd_error {
    enum skd_status status;
    char text[SKD_ERROR_TEXT_BYTES];
};

#define SKD_MUST_CHECK __attribute__((warn_unused_result))

/* Fills error (which may be NULL) and returns status, so that a failing call ends in
 * `return skd_fail(error, SKD_BAD_INDEX, "...")`. Never allocates. Whatever bytes of a peer or a
 * file the sentence quotes, it comes out as UTF-8 on one line. */
enum skd_status skd_fail(struct skd_error *error, enum skd_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* skd_fail for memory that could not be had: `what` names it ("1,000,000 targets"). */
enum skd_status skd_fail_memory(struct skd_error *error, const char *what);

/* A bug: prints the place and aborts, in shipped builds too. */
#define SKD_ASSERT(condition)                                                                      \
    ((condition) ? (void)0 : skd_assert_failed(#condition, __FILE__, __LINE__))
_Noreturn void skd_assert_failed(const char *condition, const char *file, int line);

#endif
