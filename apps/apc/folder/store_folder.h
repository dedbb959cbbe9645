/* SPDX-License-Identifier: BSD-3-Clause */
/* What a store has on record is a run folder, for as long as something goes on from there. */
#ifndef APC_STORE_FOLDER_H
#define APC_STORE_FOLDER_H

#include <apcbase.h>

struct store_folder {
    char dir[400];
    bool made;
    double at; /* s since the start of that run */
};

/* Of the experiment in @p file, at the time @p at. Returns 0 or a negative error; store_folder_drop() in either case. */
int store_folder_make(struct store_folder *f, const char *uri, apc_ns at, const char *file,
                      struct apc_error *why);
void store_folder_drop(const struct store_folder *f);

#endif
