/* SPDX-License-Identifier: BSD-3-Clause */
/* The stores: each against what is written by hand for the same job. */
#include "store.h"
#include "tick.h"

int main(int argc, char **argv)
{
    struct bench b = {.name = "store"};
    char server[256];

    bench_begin(&b, argc, argv, "Time the stores; PostgreSQL is the database of the environment.");
    PGconn *conn = tick_connect(NULL);
    tick_describe(conn, server, sizeof server);
    PQfinish(conn);
    bench_describe(&b, server);
    bench_sqlite(&b);
    bench_postgresql(&b);
    bench_shm(&b);
    bench_end(&b);
    return 0;
}
