/* SPDX-License-Identifier: BSD-3-Clause */
/* In the folder of a run that goes on from another one, that one's, until then: PAST_FOLDER. */
#ifndef APC_PAST_FOLDER_H
#define APC_PAST_FOLDER_H

#include <apcbase.h>

/* What is needed of run folder @p from becomes that of @p dir, once past_folder_keep() is called. Returns 0 or an error. */
int past_folder_put(const char *dir, const char *from, struct apc_error *why);
void past_folder_discard(const char *dir);
/* What was put there, or none, instead of the one that was there before. */
int past_folder_keep(const char *dir, struct apc_error *why);
/* A folder goes, with all that is in it. */
void past_folder_remove(const char *dir);

#endif
