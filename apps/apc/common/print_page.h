/* SPDX-License-Identifier: BSD-3-Clause */
/* A page of HTML that prints well: what is put into it is text and never markup. */
#ifndef APC_PRINT_PAGE_H
#define APC_PRINT_PAGE_H

#include "print.h"

/* Until its heading, @p what and the name of what it is about. */
void page_begin(FILE *out, const char *what, const char *name);
void page_text(FILE *out, const char *text);
/* Of a table that has rows, which is closed. Returns 0 or APC_ENOMEM. */
int page_table(FILE *out, struct print_table *table);

#endif
