/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_NEAREST_H
#define APC_NEAREST_H

#include <stddef.h>

/* Of several names, the one that is most like another; to be begun with the other in `wanted`. */
struct nearest {
    const char *wanted, *name; /* name: NULL when none is alike */
    size_t edits;
};
void nearest_look(struct nearest *nearest, const char *name);

#endif
