/* Limits on what a peer may choose. hello tells them; each is checked once, where the bytes
 * become a value. */
#ifndef SKD_PROTOCOL_LIMITS_H
#define SKD_PROTOCOL_LIMITS_H

#include <stddef.h>
#include <stdint.h>

#define SKD_FRAME_BYTES_MAX (UINT64_C(512) << 20) /* header, JSON, padding and tail */
#define SKD_JSON_BYTES_MAX (UINT32_C(4) << 20)    /* the JSON part of a frame */
#define SKD_LINE_BYTES_MAX (UINT32_C(1) << 20)    /* one line, newline included, in line mode */
#define SKD_HELLO_BYTES_MAX (UINT32_C(64) << 10)  /* a message before hello was answered */

#define SKD_HISTORY_BYTES_LEAST (UINT64_C(1) << 20) /* that a session may be told to keep */
#define SKD_HISTORY_BYTES_LIMIT (UINT64_C(16) << 30)
#define SKD_HISTORY_BYTES_USUAL (UINT64_C(512) << 20)

#define SKD_REMEMBERED_BYTES_MAX ((size_t)16 << 20) /* answers to give again, of a session */

#define SKD_STIFFNESS_MAX 10.0    /* kappa */
#define SKD_GUARD_MAX 1000.0      /* lambda */
#define SKD_SMOOTH_MAX 10.0       /* mu */
#define SKD_PIN_WEIGHT_MAX 1000.0 /* omega */

enum {
    SKD_PROTOCOL_MIN = 1, /* protocol versions that this build speaks */
    SKD_PROTOCOL_MAX = 1,
    SKD_JSON_NESTING_MAX = 32, /* arrays and objects within each other */
    SKD_BUFFERS_MAX = 16,      /* of one message */
    SKD_ID_BYTES_MAX = 64,     /* a request id that is a string */
    SKD_SESSION_NAME_BYTES_MAX = 64,
    SKD_POSE_NAME_BYTES_MAX = 64,
    SKD_CLIENT_NAME_BYTES_MAX = 64,
    SKD_CLIENT_ID_BYTES_MAX = 64,
    SKD_USER_BYTES_MAX = 64,
    SKD_TOKEN_DIGITS = 64,           /* hexadecimal: 256 bits */
    SKD_REMEMBERED_ANSWERS_MAX = 64, /* of one client in one session */
    SKD_REMEMBERED_CLIENTS_MAX = 64, /* in one session */
    SKD_PATH_BYTES_MAX = 4096,
    SKD_SESSIONS_MAX = 64,      /* open at once in a daemon */
    SKD_POSES_MAX = 1024,       /* of one session */
    SKD_TARGET_POSES_MAX = 256, /* in which a session has pins, or shapes; of one refit */
    SKD_GUARD_COUNT_MAX = 64,   /* guard poses that a session keeps */
    SKD_GUARD_NAMES_MAX = 256,  /* poses, or clips, that guard.set names to pick from */
    SKD_REFIT_ROUNDS_MAX = 16,
    SKD_CONNECTIONS_MAX = 1200,
    SKD_REQUESTS_MAX = 64, /* unanswered, of one connection; then its bytes wait */
};

#endif
