/* SPDX-License-Identifier: BSD-3-Clause */
/* hour STORE: an hour of sensor 1, ten rows a second, as if it had passed. */
#include <apcstore.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define ROWS  36000
#define CHUNK 3600

int main(int argc, char **argv)
{
    static struct apc_sample row[CHUNK];
    const apc_ns begin = apc_clock_utc(NULL) - 3600 * APC_NS_PER_S;
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    int rc = argc == 2 ? apc_store_open(&store, argv[1], NULL, &why) : APC_EINVAL;
    if (rc == 0)
        rc = apc_store_claim(store, APC_SENSOR, 1, &row[0].seq);
    for (int k = 0; k < ROWS && rc >= 0; k += CHUNK) {
        for (int i = 0; i < CHUNK; i++)
            row[i] = (struct apc_sample){.table = APC_SENSOR,
                                         .id = 1,
                                         .seq = k + i + 1,
                                         .time = begin + (k + i) * 100 * APC_NS_PER_MS,
                                         .value = sin(1e-3 * (k + i))};
        rc = apc_store_append(store, row, CHUNK);
    }
    if (rc < 0)
        fprintf(stderr, "hour: %s\n", store ? apc_store_error(store) : why.text);
    apc_store_close(store);
    return rc < 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
