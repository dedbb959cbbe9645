/* SPDX-License-Identifier: BSD-3-Clause */
/* Where the records of a command are: in files, or in a store. */
#include "identify.h"

#include "common/storeuri.h"

#define TIMEOUT (60 * APC_NS_PER_S)

int identify_read(struct identify_data *data, const char *file, const struct identify_selection *selection,
                  struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = TIMEOUT};
    struct grid_source from = {.file = file, .read = identify_read_files};
    char name[600];
    int rc = 0;

    if (store_is_uri(file)) {
        store_name(file, name, sizeof name);
        from.file = name;
        from.read = stored_read;
        rc = store_open(&from.store, file, &options, why);
    }
    if (rc == 0)
        rc = grid_read(data, &from, selection, why);
    apc_store_close(from.store);
    return rc;
}
