/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller's tick on PostgreSQL for 1 to 1000 loops: tick_run.c. */
#include "bench.h"
#include "tick.h"

int main(int argc, char **argv)
{
    static const size_t sizes[] = {1, 10, 100, 1000};
    struct bench b = {.name = "tick",
                      .reference = {"floor", "by hand", "listing"},
                      .calls = 50,
                      .budget = 400 * APC_NS_PER_MS};
    char server[256];

    bench_begin(&b, argc, argv, "Time a controller's tick on the PostgreSQL database of the environment.");
    PGconn *conn = tick_connect(NULL);
    tick_describe(conn, server, sizeof server);
    bench_describe(&b, server);
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        tick_run(&b, conn, sizes[i]);
    PQfinish(conn);
    bench_end(&b);
    return 0;
}
