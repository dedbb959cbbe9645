/* SPDX-License-Identifier: BSD-3-Clause */
/* Where the records of a command are: in files, or in a store. */
#include "identify.h"

#include "common/storeuri.h"

#define TIMEOUT (60 * APC_NS_PER_S)

static int read_uri(struct reading *r)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = TIMEOUT};
    int rc = store_open(&r->store, r->file, &options, r->why);

    if (rc == 0)
        rc = stored_read(r);
    apc_store_close(r->store);
    return rc;
}

int identify_read(struct identify_data *data, const char *file, const struct identify_selection *selection,
                  struct apc_error *why)
{
    const struct grid_source from = {.file = file,
                                     .read = store_is_uri(file) ? read_uri : identify_read_files};

    return grid_read(data, &from, selection, why);
}
