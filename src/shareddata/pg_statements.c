/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Every statement on the tables of samples, spelt out by the preprocessor: no SQL is ever built at run
 * time, and a table's name is never anything but one of these.
 *
 * Measured here on a local socket, p50 of the newest of n = 1 / 10 / 100 / 1000 variables, in us, next to
 * 48 for SELECT 1 (generic plans):
 *     LATERAL ... ORDER BY seq DESC LIMIT 1      62 /  97 /  363 / 3230     chosen
 *     the same gathered into arrays              66 / 104 /  372 / 3403
 *     scalar subquery giving a whole row         73 / 102 /  402 / 3560
 *     max(seq), then a join for the row          73 / 120 /  548 / 5249
 * Two tables, n each: one statement a table      71 / 121 /  580 / 5485     chosen
 *                     one UNION ALL              78 / 125 /  580 / 5504
 * A plan made anew at each execution costs 45 to 50 us more, and plan_cache_mode = auto settles for that
 * at n = 1 and 10: the session says force_generic_plan.
 */
#include "shareddata/postgresql.h"

/* $1 ids. One row a variable that has samples: position in $1 (from 1), then its newest sample. */
#define READ(table, more)                                                                                    \
    "SELECT v.i, n.* FROM unnest($1::int4[]) WITH ORDINALITY AS v (id, i) CROSS JOIN LATERAL "               \
    "(SELECT seq, time, status, value" more " FROM " table                                                   \
    " WHERE id = v.id ORDER BY seq DESC LIMIT 1) AS n"

/*
 * Rows are nearly always new, and ON CONFLICT costs them half as much again (each is then inserted
 * speculatively, with a WAL record more): so it is left to a repeat. Naming no columns to conflict in needs
 * no right to SELECT.
 */
#define APPEND(table, more, arrays, repeat)                                                                  \
    "INSERT INTO " table " (id, seq, time, status, value" more ") SELECT * FROM "                            \
    "unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[]" arrays ")" repeat

/* In the order of ids, so that two writers never wait for each other in a circle within a table. */
#define PUT(table)                                                                                           \
    "INSERT INTO " table " (id, seq, time, status, value) SELECT v.id, "                                     \
    "coalesce((SELECT max(seq) FROM " table " WHERE id = v.id), 0) + 1, v.time, v.status, v.value FROM "     \
    "unnest($1::int4[], $2::timestamptz[], $3::int8[], $4::float8[]) AS v (id, time, status, value) "        \
    "ORDER BY v.id"

#define SWAP(table)                                                                                          \
    "INSERT INTO " table                                                                                     \
    " (id, seq, time, status, value) SELECT v.id, v.seq + 1, v.time, v.status, v.value "                     \
    "FROM unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[]) "                      \
    "AS v (id, seq, time, status, value) "                                                                   \
    "WHERE v.seq = coalesce((SELECT max(seq) FROM " table " WHERE id = v.id), 0) ORDER BY v.id "             \
    "RETURNING id, seq"

#define DECLARE "DECLARE rows NO SCROLL CURSOR FOR "
/* $1 id, $2 since, $3 until. */
#define HISTORY(table, more)                                                                                 \
    DECLARE "SELECT seq, time, status, value" more " FROM " table                                            \
            " WHERE id = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz ORDER BY seq"
/* $4 how many. */
#define HISTORY_LAST(table, more)                                                                            \
    DECLARE "SELECT * FROM (SELECT seq, time, status, value" more " FROM " table                             \
            " WHERE id = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz "                   \
            "ORDER BY seq DESC LIMIT $4::int8) AS newest ORDER BY seq"

/*
 * $4 where each bin begins, but in order. Bad is a status from 2^31 on. The last value comes by its key: an
 * aggregate for it would hold or sort all rows.
 */
#define GOOD " FILTER (WHERE status < 2147483648)"
#define BINS(table)                                                                                          \
    DECLARE "SELECT bin::int8, good, samples - good, lowest, highest, mean, "                                \
            "(SELECT value FROM " table " WHERE id = $1::int4 AND seq = b.last "                             \
            "AND time >= $2::timestamptz AND time < $3::timestamptz), worst, newest FROM "                   \
            "(SELECT width_bucket(time, $4::timestamptz[]) AS bin, count(*)" GOOD " AS good, "               \
            "count(*) AS samples, min(value)" GOOD " AS lowest, max(value)" GOOD " AS highest, "             \
            "avg(value)" GOOD " AS mean, max(seq)" GOOD                                                      \
            " AS last, max(status) AS worst, max(seq) AS newest "                                            \
            "FROM " table " WHERE id = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz "     \
            "GROUP BY 1) AS b ORDER BY bin"

#define TEXTS(table, more, arrays)                                                                           \
    {                                                                                                        \
        .read_name = "read_" table, .read = READ(table, more), .append_name = "append_" table,               \
        .append = APPEND(table, more, arrays, ""),                                                           \
        .repeat = APPEND(table, more, arrays, " ON CONFLICT DO NOTHING"),                                    \
        .put = PUT(table) " RETURNING id, seq", .swap = SWAP(table), .bins = BINS(table),                    \
        .drop = "DELETE FROM " table " AS s WHERE time < $1::timestamptz AND seq < "                         \
                "(SELECT max(seq) FROM " table " WHERE id = s.id)",                                          \
        .history = HISTORY(table, more), .history_last = HISTORY_LAST(table, more),                          \
        .paper_read = READ("apc." table, ""), .paper_put = PUT("apc." table) " ON CONFLICT DO NOTHING",      \
    }

const struct apc_pg_text apc_pg_texts[APC_TABLE_END] = {
    [APC_SENSOR] = TEXTS("sensor", "", ""),
    [APC_ACTUATOR] = TEXTS("actuator", ", sensor_seq, setpoint_seq", ", $6::int8[], $7::int8[]"),
    [APC_SETPOINT] = TEXTS("setpoint", "", ""),
    [APC_DIM] = TEXTS("dim", "", ""),
    [APC_OPMODE] = TEXTS("opmode", "", ""),
    [APC_TUNING] = TEXTS("tuning", "", ""),
    [APC_MANUAL] = TEXTS("manual", "", ""),
    [APC_STATE] = TEXTS("state", "", ""),
};
