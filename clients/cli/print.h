/* Data for people and programs on stdout, progress on a terminal's stderr.
 *
 * Thread: one.
 */
#ifndef SKD_CLI_PRINT_H
#define SKD_CLI_PRINT_H

#include "protocol/author.h"
#include "protocol/message.h"

/* Prints a value of a message as one line of JSON, with {"buffer": i} written out as the array that
 * it stands for. message may be NULL where there are no buffers. */
void skd_print_json(const struct skd_message *message, const cJSON *value);

/* Prints a tree of our own as one line of JSON and deletes it. */
void skd_print_own_json(cJSON *value);

/* With --json, prints what was written into a file that --raw names. */
void skd_print_raw_written(const char *path, size_t vertices);

/* Members of an answer, and what stands for them when the daemon left them out. */
double skd_json_number(const cJSON *object, const char *name);
const char *skd_json_text(const cJSON *object, const char *name);

/* Writes 1234567 as "1,234,567". */
enum { SKD_COUNT_TEXT_BYTES = 32 };
const char *skd_count_text(double count, char text[SKD_COUNT_TEXT_BYTES]);
/* Writes 123456789 as "118 MiB". */
const char *skd_bytes_text(double bytes, char text[SKD_COUNT_TEXT_BYTES]);

/* Writes a unix time as the machine's own: "2026-03-14 15:09". */
enum { SKD_TIME_TEXT_BYTES = 32 };
const char *skd_time_text(double seconds, char text[SKD_TIME_TEXT_BYTES]);
/* Writes who a member of `present`, or a claim's notification, is: "anna (Blender)". */
const char *skd_person_text(const cJSON *presence, char text[SKD_AUTHOR_TEXT_BYTES]);

/* Prints open sessions, as session.list tells them. */
void skd_print_sessions(const cJSON *sessions);
/* Prints who is attached to a session: a line each, or that nobody is. */
void skd_print_present(const cJSON *present);

/* Prints what a step of the history, forwards or backwards, was answered with. */
void skd_print_step(const cJSON *result);

/* Prints what session.export answered. */
void skd_print_exported(const cJSON *result);

/* A table whose columns are as wide as what is in them. */
enum { SKD_COLUMNS_MAX = 8 };
struct skd_table {
    int columns;
    const char *titles[SKD_COLUMNS_MAX];
    bool is_number[SKD_COLUMNS_MAX]; /* set to the right */
    size_t rows;
    char **cells; /* [rows * columns], owned */
};
/* Adds a copy of the cells; a row that finds no memory is left out. */
void skd_table_add(struct skd_table *table, const char *const *cells);
/* Prints the table, indented, and frees its cells. */
void skd_table_print(struct skd_table *table, int indent);

/* Progress of what may take long: a line on stderr when that is a terminal, from 0.3 s on. */
struct skd_progress {
    const char *what;
    double begun_s;
    double shown_s; /* 0: not yet */
    bool is_silent;
};
void skd_progress_begin(struct skd_progress *progress, const char *what);
void skd_progress_set(struct skd_progress *progress, double fraction);
/* Wipes the line away. */
void skd_progress_end(struct skd_progress *progress);

/* Seconds of a clock that only goes on. */
double skd_clock_s(void);

#endif
