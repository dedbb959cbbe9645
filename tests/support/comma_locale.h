/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_TEST_COMMA_LOCALE_H
#define APC_TEST_COMMA_LOCALE_H

#include <stdbool.h>

/* Put a locale with a decimal comma in force: an installed one, or one that localedef makes for the moment.
 * False, after saying so, when there is none to be had; then skip(). Back with setlocale(LC_ALL, "C"). */
bool comma_locale(void);
/* The same with a decimal point of two bytes, as Pashto has it. */
bool wide_locale(void);

#endif
