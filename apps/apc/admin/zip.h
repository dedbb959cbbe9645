/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A zip archive whose entries are stored as they are. libzip packs them as well, but loads six libraries, which would make
 * each command of apc begin a twelfth later (bench/counts).
 */
#ifndef APC_ZIP_H
#define APC_ZIP_H

#include <apcbase.h>

struct zip_entry {
    const char *name;
    const void *data;
    uint32_t size;
};

/* Entries [n, 100 at most] of all together less than 4 GiB, in the place of what @p file was. Returns 0 or a negative
 * error; then that is as it was. */
int zip_write(const char *file, const struct zip_entry *entry, size_t n, struct apc_error *why);

#endif
