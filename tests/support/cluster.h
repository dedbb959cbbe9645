/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A PostgreSQL server for one test program. With APC_TEST_PGHOST (a socket directory) in the environment
 * that server is used, which the caller of many tests has started once, and the program gets a database of
 * its own in it; otherwise, and whenever a test has to stop or kill the server, a private cluster is made
 * in a temporary directory. Everything is gone when the program ends. Exits with 77 (skipped) where no
 * PostgreSQL is installed; fails the program on any other trouble.
 */
#ifndef APC_TEST_CLUSTER_H
#define APC_TEST_CLUSTER_H

#include <libpq-fe.h>
#include <stdbool.h>

struct cluster;

/** A fresh, empty database on the shared server or on a private one. */
struct cluster *cluster_start(void);
/** A server that belongs to this test alone: it may be killed. */
struct cluster *cluster_start_private(void);
/** A hot standby of a private server, streaming from it; to be queried for the same database. */
struct cluster *cluster_start_standby(const struct cluster *primary);
void cluster_destroy(struct cluster *c); /**< NULL is legal; done at exit for those that are left */

const char *cluster_uri(const struct cluster *c);    /**< postgresql://..., as superuser, without schema */
const char *cluster_host(const struct cluster *c);   /**< directory of the socket */
const char *cluster_socket(const struct cluster *c); /**< path of the socket, for a proxy */
const char *cluster_database(const struct cluster *c);

/** A plain connection as the superuser, whose name is apc; the caller finishes it. */
PGconn *cluster_connect(const struct cluster *c);
/** Run SQL as superuser. Returns the first value of the last result ("" if none), valid until the next call. */
const char *cluster_query(struct cluster *c, const char *sql);
/** Run a file of SQL as superuser. */
void cluster_query_file(struct cluster *c, const char *path);
/** Ask again and again until the answer is @p expected; false when it never was (bounded: about 20 s). */
bool cluster_await(struct cluster *c, const char *sql, const char *expected);
/** From now on commits wait for a standby of that name; "*": any. Returns false where that did not come
 * about. */
bool cluster_need_standby(struct cluster *c, const char *name);

/* Of a private server only. */
void cluster_stop(struct cluster *c); /**< in order, ending all sessions */
void cluster_kill(struct cluster *c); /**< kill -9 */
void cluster_run(struct cluster *c);  /**< start again, wait until it answers */

#endif
