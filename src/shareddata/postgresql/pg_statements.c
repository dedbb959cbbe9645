/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Every statement on the tables of samples, spelt out by the preprocessor: no SQL is ever built at run
 * time, and a table's name is never anything but one of these. Why they are as they are, with figures:
 * docs/rationale.md, "PostgreSQL's newest values have tables of their own".
 *
 * A plan made anew at each execution costs 45 to 50 us more, and plan_cache_mode = auto settles for that
 * at n = 1 and 10: the session says force_generic_plan.
 */
#include "shareddata/postgresql/postgresql.h"

/*
 * $1 ids. One row a variable that has samples: position in $1 (from 1), then its newest sample. LIMIT 1 keeps
 * the planner from reading the whole table of newest values for a few. (Seq 0: somebody is writing the
 * first.)
 */
#define READ(table, more)                                                                                    \
    "SELECT v.i, n.* FROM unnest($1::int4[]) WITH ORDINALITY AS v (id, i) CROSS JOIN LATERAL "               \
    "(SELECT seq, time, status, value" more " FROM " table                                                   \
    "_newest WHERE id = v.id AND seq > 0 LIMIT 1) AS n"

#define PLAIN_ARRAYS "$1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[]"
#define ARRAYS       PLAIN_ARRAYS ", $6::int8[], $7::int8[]"
/* Of rows that come from none and have no author, which are most. */
#define APPEND_PLAIN(table)                                                                                  \
    "INSERT INTO " table " (id, seq, time, status, value) SELECT * FROM unnest(" PLAIN_ARRAYS ")"
#define MORE ", origin, author"
#define APPEND(table)                                                                                        \
    "INSERT INTO " table " (id, seq, time, status, value" MORE ") SELECT * FROM unnest(" ARRAYS ")"

/* Rows are nearly always new: only a repeat looks which are not. No right to SELECT is needed. */
#define REPEAT(table)                                                                                        \
    "INSERT INTO " table " (id, seq, time, status, value" MORE ") SELECT id, seq, time, status, value" MORE  \
    " FROM unnest(" ARRAYS ") WITH ORDINALITY AS v (id, seq, time, status, value" MORE                       \
    ", i) WHERE i IN (SELECT absent('" table "', $1::int4[], $2::int8[]))"

/* The vectors' elements stand in $5 one after another: from $6 to $7 are those of one. */
#define VECTORS                                                                                              \
    " (id, seq, time, status, value) SELECT id, seq, time, status, ($5::float8[])[first : last] FROM "       \
    "unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $6::int4[], $7::int4[]) WITH ORDINALITY " \
    "AS v (id, seq, time, status, first, last, i)"

/* In the order of ids, so that two writers never wait for each other in a circle within a table. */
#define PUT(table, more, values)                                                                             \
    "INSERT INTO " table " (id, seq, time, status, value" more ") SELECT v.id, "                             \
    "coalesce((SELECT seq FROM " table "_newest WHERE id = v.id), 0) + 1, v.time, v.status, v.value" more    \
    " FROM unnest($1::int4[], $2::timestamptz[], $3::int8[], $4::float8[]" values                            \
    ") AS v (id, time, status, value" more ") ORDER BY v.id"

#define SWAP(table)                                                                                          \
    "INSERT INTO " table " (id, seq, time, status, value, origin, author) SELECT id, seq + 1, time, "        \
    "status, value, origin, author FROM unnest(" ARRAYS                                                      \
    ") AS v (id, seq, time, status, value, origin, author) "                                                 \
    "WHERE v.seq = coalesce((SELECT seq FROM " table "_newest WHERE id = v.id), 0) ORDER BY v.id "           \
    "RETURNING id, seq"

/* The next seq of those that are what the writer knows, and that nobody holds; in the order of ids. */
#define PLACE(table)                                                                                         \
    "INSERT INTO " table " (id, seq, time, status, value, origin, author) SELECT ($1::int4[])[i], next, "    \
    "($3::timestamptz[])[i], ($4::int8[])[i], ($5::float8[])[i], ($6::int8[])[i], ($7::int8[])[i] "          \
    "FROM " table "_vacant($1::int4[], $2::int8[]) ORDER BY 1 RETURNING id, seq"

#define DECLARE "DECLARE rows NO SCROLL CURSOR FOR "
/* $1 id, $2 since, $3 until, $4 after. */
#define HISTORY(table, more)                                                                                 \
    DECLARE "SELECT seq, time, status, value" more " FROM " table                                            \
            " WHERE id = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz "                   \
            "AND seq > $4::int8 ORDER BY seq"
/*
 * $5 how many. By their key, "id", all that came since is gone through, though LIMIT makes it look cheap: of
 * long ago they are found by their time, "id + 0" (150 and 3 ms of 600 000 rows a week).
 */
#define HISTORY_LAST(table, more, id)                                                                        \
    DECLARE "SELECT * FROM (SELECT seq, time, status, value" more " FROM " table " WHERE " id                \
            " = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz "                            \
            "AND seq > $4::int8 ORDER BY seq DESC LIMIT $5::int8) AS newest ORDER BY seq"

/*
 * $1 ids. Of each, its row of the highest seq with $2 <= time < $3, and whether the next seq is there, up to $4:
 * the times are gone through once for all of them, and no key is.
 */
#define WITHIN(table)                                                                                        \
    "WITH found AS MATERIALIZED (SELECT DISTINCT ON (id) id, seq, time, status, value" MORE " FROM " table   \
    " WHERE id + 0 = ANY ($1::int4[]) AND time >= $2::timestamptz "                                          \
    "AND time < $3::timestamptz ORDER BY id, seq DESC) "                                                     \
    "SELECT seq, time, status, value" MORE ", NULL::bytea AS data, id::int8, "                               \
    "(SELECT count(*) FROM " table " AS next WHERE next.id = found.id AND next.seq = found.seq + 1 "         \
    "AND next.time >= $2::timestamptz AND next.time < $4::timestamptz) FROM found"
/* Of each, the last chunk that reaches into these times. */
#define WITHIN_CHUNKS(table)                                                                                 \
    " UNION ALL SELECT last, NULL, NULL, NULL, NULL, NULL, data, id, 0 FROM (SELECT DISTINCT ON (id) "       \
    "id, last, data FROM " table "_packed WHERE id = ANY ($1::int4[]) AND until >= $2::timestamptz "         \
    "AND since < $3::timestamptz ORDER BY id, last DESC) AS chunk"

/*
 * $4 where each bin begins, in order. Bad is a status from 2^31 on. The last value comes by its key, for an
 * aggregate of it would hold or sort all rows; the bin's times tell in which partitions it can be.
 */
#define GOOD " FILTER (WHERE status < 2147483648)"
#define BINS(table)                                                                                          \
    DECLARE "SELECT bin::int8, good, samples - good, lowest, highest, mean, "                                \
            "(SELECT value FROM " table " WHERE id = $1::int4 AND seq = b.last AND time >= b.first "         \
            "AND time <= b.final), worst, newest, last, NULL AS data FROM "                                  \
            "(SELECT width_bucket(time, $4::timestamptz[]) AS bin, count(*)" GOOD " AS good, "               \
            "count(*) AS samples, min(value)" GOOD " AS lowest, max(value)" GOOD " AS highest, "             \
            "avg(value)" GOOD " AS mean, max(seq)" GOOD " AS last, max(status) AS worst, "                   \
            "max(seq) AS newest, min(time) AS first, max(time) AS final "                                    \
            "FROM " table " WHERE id = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz "     \
            "GROUP BY 1) AS b"

/*
 * The same of tables whose old weeks may be packed: a chunk comes as one row, by its first seq, or by its
 * last where the newest are asked for, and the last column holds what is in it.
 */
#define CHUNKS(table)                                                                                        \
    " FROM " table "_packed WHERE id = $1::int4 AND until >= $2::timestamptz AND since < $3::timestamptz "   \
    "AND last > $4::int8 "
#define ROWS(table, id)                                                                                      \
    " FROM " table " WHERE " id " = $1::int4 AND time >= $2::timestamptz AND time < $3::timestamptz "        \
    "AND seq > $4::int8 "
#define MERGED(table, key, id)                                                                               \
    DECLARE "SELECT seq, time, status, value" MORE ", NULL AS data" ROWS(table, id) ALSO_CHUNKS(table, key)
#define ALSO_CHUNKS(table, key)                                                                              \
    "UNION ALL SELECT " key ", NULL, NULL, NULL, NULL, NULL, data" CHUNKS(table) "ORDER BY 1"

/*
 * Chunks that lie in one bin have said all that it needs; of the others, each a part of its own, the data
 * come. The chunks are looked through once, which is most of what a year costs. OFFSET 0 keeps width_bucket()
 * from being asked twice. The last value comes by its key, as above: that of the first chunk which ends at
 * its seq or later.
 */
#define ADD_CHUNKS(table)                                                                                    \
    " UNION ALL SELECT greatest(part, 0), good, bad, lowest, highest, mean, CASE WHEN part >= 0 THEN "       \
    "(SELECT latest FROM " table "_packed WHERE id = $1::int4 AND last >= b.final AND b.final > 0 "          \
    "ORDER BY last LIMIT 1) END, worst, CASE WHEN part >= 0 THEN newest ELSE oldest END, final, "            \
    "CASE WHEN part < 0 THEN "                                                                               \
    "(SELECT data FROM " table "_packed WHERE id = $1::int4 AND last = b.newest) END FROM "                  \
    "(SELECT CASE WHEN since >= $2::timestamptz AND until < $3::timestamptz AND "                            \
    "(until < ($4::timestamptz[])[bin + 1]) IS NOT FALSE THEN bin ELSE -last END AS part, "                  \
    "sum(good)::int8 AS good, "                                                                              \
    "sum(last - first + 1 - good)::int8 AS bad, min(lowest)" SOME " AS lowest, max(highest)" SOME            \
    " AS highest, sum(mean * good) / nullif(sum(good), 0)::float8 AS mean, max(worst) AS worst, "            \
    "min(first) AS oldest, max(last) AS newest, max(final) AS final FROM "                                   \
    "(SELECT width_bucket(since, $4::timestamptz[]) AS bin, first, last, since, until, final, worst, "       \
    "lowest, highest, mean, good FROM " table "_packed "                                                     \
    "WHERE id = $1::int4 AND until >= $2::timestamptz AND since < $3::timestamptz OFFSET 0) AS c "           \
    "GROUP BY 1) AS b"
#define SOME " FILTER (WHERE good > 0)"

/* What is appended to opmode is that and no more: only a put of the mode of all loops is spread by the
 * trigger. */
#define AS_IS " RETURNING set_config('apc.as_is', 'on', true)"

#define ROWS_OF(table, as_is)                                                                                \
    .read_name = "read_" table, .read = READ(table, MORE), .append_name = "append_" table,                   \
    .append = APPEND(table) as_is, .plain_name = "plain_" table, .plain = APPEND_PLAIN(table) as_is,         \
    .repeat = REPEAT(table) as_is, .put = PUT(table, MORE, ", $5::int8[], $6::int8[]") " RETURNING id, seq", \
    .swap = SWAP(table), .bins = BINS(table), .history = HISTORY(table, MORE),                               \
    .history_last = HISTORY_LAST(table, MORE, "id"), .history_then = HISTORY_LAST(table, MORE, "id + 0"),    \
    .within = WITHIN(table), .paper_read = READ("apc." table, ""),                                           \
    .paper_put = PUT("apc." table, "", "") " ON CONFLICT DO NOTHING"

#define NUMBERS(table) ROWS_OF(table, "")
#define PACKED(table)                                                                                        \
    .merged = MERGED(table, "first", "id"), .merged_last = MERGED(table, "last", "id") " DESC",              \
    .merged_then = MERGED(table, "last", "id + 0") " DESC", .merged_bins = BINS(table) ADD_CHUNKS(table),    \
    .merged_within = WITHIN(table) WITHIN_CHUNKS(table)
#define SHARED_OF(table, as_is) ROWS_OF(table, as_is), .place_name = "place_" table, .place = PLACE(table)
#define SHARED(table)           SHARED_OF(table, "")

#define VECTOR_TEXTS(table)                                                                                  \
    .read_name = "read_" table, .read = READ(table, ""), .append_name = "append_" table,                     \
    .append = "INSERT INTO " table VECTORS,                                                                  \
    .repeat = "INSERT INTO " table VECTORS " WHERE i IN (SELECT absent('" table "', $1::int4[], "            \
              "$2::int8[]))",                                                                                \
    .history = HISTORY(table, ""), .history_last = HISTORY_LAST(table, "", "id"),                            \
    .history_then = HISTORY_LAST(table, "", "id + 0")

const struct apc_pg_text apc_pg_texts[APC_TABLE_END] = {
    [APC_SENSOR] = {NUMBERS("sensor"), PACKED("sensor")},
    [APC_ACTUATOR] = {NUMBERS("actuator"), PACKED("actuator")},
    [APC_SETPOINT] = {SHARED("setpoint"), PACKED("setpoint")},
    [APC_DIM] = {NUMBERS("dim")},
    [APC_OPMODE] = {SHARED_OF("opmode", AS_IS)},
    [APC_TUNING] = {SHARED("tuning")},
    [APC_MANUAL] = {SHARED("manual")},
    [APC_ACTUAL] = {NUMBERS("actual"), PACKED("actual")},
    [APC_ESTIMATE] = {NUMBERS("estimate"), PACKED("estimate")},
    [APC_ALARM] = {NUMBERS("alarm")},
    [APC_TICK] = {VECTOR_TEXTS("tick")},
    [APC_PLAN] = {VECTOR_TEXTS("plan")},
    [APC_PREDICTION] = {VECTOR_TEXTS("prediction")},
};

const struct apc_pg_text *apc_pg_text_of(struct apc_pg *pg, enum apc_table table)
{
    if (apc_pg_texts[table].read) {
        return &apc_pg_texts[table];
    }
    apc_fail(&pg->base.why, APC_ESCHEMA, "there is no table %s", apc_table_name(table));
    return NULL;
}
