/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcshareddata.h
 * The second principle of the paper: shared data (section "Shared Data"). The paper's own functions on
 * PostgreSQL, beside the stores of apcstore.h.
 */
#ifndef APCSHAREDDATA_H
#define APCSHAREDDATA_H

#include <libpq-fe.h>

#include "apcstore.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- The paper's functions (Listings 3, 4 and 5) ------------------------------------------ */

/**
 * They work on a plain PGconn and the tables of schema `apc`, which `apc init` makes. @p table is one
 * of the names of apc_table_name(). A stamp is RFC 3339 or the paper's form; a status is a name of
 * apc_status_parse() ("'ok'" and "ok" are Good). Values go to the server as parameters, never as SQL.
 * One thread at a time per PGconn. They wait for the server as long as libpq does: a task that must
 * not hang uses a store (apcstore.h).
 *
 * All return 0 or an error. APC_EINVAL: argument, table, stamp or status not understood, or a value not
 * finite; APC_ENOTFOUND: no row yet, outputs untouched; APC_ECONFLICT: a concurrent writer won three times.
 * APC_ERANGE: an Int function found a value that is no int; APC_ESTORE: refused by the server, PQerrorMessage
 * says why. Also APC_ECONN, APC_ENOMEM.
 */
/** Append a row with the seq that follows the newest one's. [setup] */
APC_API int insertIntoTableFloat(PGconn *conn, const char *table, int id, const char *ts, const char *status,
                                 double value);
/** The same for a whole number. [setup] */
APC_API int insertIntoTableInt(PGconn *conn, const char *table, int id, const char *ts, const char *status,
                               int value);
/** The newest row. @p ts needs 27 bytes, @p status APC_STATUS_NAME_LEN; each may be NULL. [setup] */
APC_API int readRecentValFloat(PGconn *conn, const char *table, int id, char *ts, char *status,
                               double *value);
/** The same for a whole number: APC_ERANGE if it is none. [setup] */
APC_API int readRecentValInt(PGconn *conn, const char *table, int id, char *ts, char *status, int *value);
/** The newest rows of ids 1..n in one round trip. @p ts and @p status may be NULL. [setup] */
APC_API int readMultiRecentValsFloat(PGconn *conn, const char *table, int n, char (*ts)[1024],
                                     char (*status)[1024], double *values);
/** The same for whole numbers. [setup] */
APC_API int readMultiRecentValsInt(PGconn *conn, const char *table, int n, char (*ts)[1024],
                                   char (*status)[1024], int *values);
/** Now, UTC, as `2026-01-31 12:00:00.123456`: 26 characters and the terminator. [tick] */
APC_API void genTimeStampUTC(char ts[27]);

#ifdef __cplusplus
}
#endif
#endif
