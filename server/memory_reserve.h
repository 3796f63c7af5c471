/* Memory for libuv, with something put by for when there is none.
 *
 * Thread: any. libuv ends the process when it cannot grow its table of descriptors, however little
 * it is that lacks (uv__io_start in its src/unix/core.c). What it asks for is small, so a reserve
 * in the program's own memory gets it over that; all else that libuv fails to allocate comes back
 * as an error, but then costs nobody a connection either.
 */
#ifndef SKD_MEMORY_RESERVE_H
#define SKD_MEMORY_RESERVE_H

/* Makes libuv take its memory here. Before any other call of libuv. */
void skd_memory_reserve_start(void);

#endif
