/* SPDX-License-Identifier: BSD-3-Clause */
/* Decimal numbers as programs write them, to the last digit, several times as fast as by strtod(). */
#ifndef APC_DECIMAL_H
#define APC_DECIMAL_H

#include <stdbool.h>

/* The number that begins at @p from, and in @p end where it ends: at the first character that belongs to
 * none. Behind it 8 bytes must be there to be read. Returns whether there is one. */
bool decimal_take(const char *from, const char **end, double *value);

#endif
