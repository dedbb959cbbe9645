/* SPDX-License-Identifier: BSD-3-Clause */
/* holds STORE TABLE ID: claims a variable, says so, and keeps it until its stdin ends. */
#include <stdio.h>
#include <stdlib.h>

#include "apcstore.h"

int main(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    int rc = argc == 4 ? apc_store_open(&store, argv[1], NULL, &why) : APC_EINVAL;
    if (rc == 0) {
        struct apc_sample one = {.table = apc_table_parse(argv[2]), .id = (int)strtol(argv[3], NULL, 10)};
        rc = apc_store_claim_set(store, &one, 1);
    }
    if (rc == 0 && puts("held") >= 0 && fflush(stdout) == 0)
        while (getchar() != EOF)
            ;
    else
        fprintf(stderr, "holds: %s\n", store ? apc_store_error(store) : why.text);
    apc_store_close(store);
    return rc < 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
