/* The daemon's talk: one line an event on stderr, with a time and a level.
 *
 * Thread: any (one write a line). Levels are syslog's words; the threshold is set once in main.
 * Warnings are what a peer can cause as often as it likes: beyond a thousand there is one a second,
 * and the next says how many were left out, so that nobody fills a disk with them.
 */
#ifndef SKD_BASE_LOG_H
#define SKD_BASE_LOG_H

enum skd_log_level { SKD_LOG_ERROR, SKD_LOG_WARNING, SKD_LOG_INFO, SKD_LOG_DEBUG };

/* Lines above this level are dropped. Call before the first thread starts. */
void skd_log_set_level(enum skd_log_level level);

void skd_log(enum skd_log_level level, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

#endif
