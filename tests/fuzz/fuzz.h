/* What a fuzz target and its drivers agree on.
 *
 * A target is one function, which libFuzzer calls in the `fuzz` build and replay.c in all others,
 * so that every input which was ever worth keeping (corpus/) is a unit test.
 */
#ifndef SKD_TESTS_FUZZ_H
#define SKD_TESTS_FUZZ_H

#include "base/error.h"

#include <stddef.h>
#include <stdint.h>

/* Takes one input; a crash, a failed SKD_ASSERT, a leak or a hang is a finding. Returns 0. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#endif
