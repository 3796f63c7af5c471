/* How surely a session's steps are kept when the daemon dies.
 *
 * Stage: rig session. The numbers are those of skd_durability_words (protocol/words.h) and of the
 * journal's files: none is ever given another meaning.
 */
#ifndef SKD_SESSION_DURABILITY_H
#define SKD_SESSION_DURABILITY_H

enum skd_durability {
    SKD_DURABILITY_FULL,   /* an answered step is on the disk */
    SKD_DURABILITY_SECOND, /* on the disk within a second after its answer */
    SKD_DURABILITY_OFF,    /* the session is kept in memory alone */
};

#endif
