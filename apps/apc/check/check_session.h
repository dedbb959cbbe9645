/* SPDX-License-Identifier: BSD-3-Clause */
/* The training record of a session that is judged: its figures beside those of its experiment without people, and
 * with what the scenario does. */
#ifndef APC_CHECK_SESSION_H
#define APC_CHECK_SESSION_H

#include "apc/common/print.h"
#include "check_print.h"

/* Returns 0 or a negative error with a text in @p why; checked_session_free() in either case. */
int checked_session_load(struct checked *c, struct apc_error *why);
/* The runs. Returns as worker_pool_run(). */
int checked_session_make(struct checked *c, unsigned processes, struct apc_error *why);
void checked_session_free(struct checked *c);

const char *checked_session_folder(const struct checked *c);
const char *checked_session_who(const struct checked *c); /* the names of those who operated it */
/* Each table goes to @p put, which closes it: alarms, what was to be done, the runs side by side. */
typedef int check_table_fn(FILE *out, struct print_table *table);
int checked_session_show(const struct checked *c, FILE *out, check_table_fn *put);
void checked_session_json(const struct checked *c, struct text *t);

#endif
