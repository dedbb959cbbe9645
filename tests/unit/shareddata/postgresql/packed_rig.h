/* SPDX-License-Identifier: BSD-3-Clause */
/* For tests of packed weeks: a plant with weeks behind it, and what its store streams. */
#ifndef APC_TEST_PACKED_RIG_H
#define APC_TEST_PACKED_RIG_H

#include "plants.h"

/* SQL in the plant's schema. */
static const char *ask(const char *sql)
{
    char path[100];
    snprintf(path, sizeof path, "SET search_path TO plant%d, pg_temp", plant);
    cluster_query(cluster, path);
    return cluster_query(cluster, sql);
}

/* ---- A plant with weeks behind it ------------------------------------------------------------------ */

/* 1: noise with a clock that jitters; 2: a converter, with gaps; 3: constant, with Bad times; 4: five samples
 * a week; 5: a clock that went back by a week for a while; 6: rows that stand in no order; 7: only one
 * sample, of long ago. */
static void make_history(void)
{
    ask("SELECT make_week(t, date_trunc('week', now() AT TIME ZONE 'UTC')::date - 7 * w, current_date)"
        " FROM generate_series(1, 4) AS w, unnest(ARRAY['sensor', 'actuator', 'setpoint', 'actual', "
        "'estimate']) AS t");
    ask("CREATE FUNCTION at(w double precision) RETURNS timestamptz LANGUAGE sql STABLE AS $$ SELECT"
        " date_trunc('week', now()) - w * interval '1 week' $$");
    ask("SELECT setseed(0.25)");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT 1, s, at(4) + s * interval '250 seconds'"
        " + random() * interval '1 millisecond', 0, (random() - 0.5) * 10 ^ (random() * 20 - 10) FROM"
        " generate_series(1, 9000) AS s");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT 2, s * 3 / 2 + s / 500 * 7, at(4) + s *"
        " interval '300 seconds', 0, -10 + trunc(random() * 65536) * (20 / 65535.0::double precision)"
        " FROM generate_series(1, 600) AS s UNION ALL SELECT 2, s + 2000 + s / 1700 * 40, at(3.5) + s * "
        "interval"
        " '300 seconds', 0, -10 + trunc(random() * 65536) * (20 / 65535.0::double precision)"
        " FROM generate_series(1, 5000) AS s");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT 3, s + 9000000000, at(4) + s * interval"
        " '200 seconds', CASE WHEN s % 1000 < 30 THEN 2157641728 WHEN s % 1000 < 40 THEN 1083179008 ELSE 0 "
        "END, 20.3"
        " FROM generate_series(1, 10000) AS s");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT 4, s, at(4) + s * interval '1.4 days', 0, "
        "-s"
        " FROM generate_series(1, 18) AS s");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT 5, s, at(4) + s * interval '1000 seconds' "
        "- CASE"
        " WHEN s BETWEEN 900 AND 1100 THEN interval '8 days' ELSE interval '0' END, 0, s * 0.1 FROM"
        " generate_series(1, 2200) AS s");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT 6, s, at(3) + s * interval '100 seconds', "
        "0, sqrt(s)"
        " FROM generate_series(1, 3000) AS s ORDER BY s * 7919 % 3001");
    ask("INSERT INTO sensor (id, seq, time, status, value) VALUES (7, 77, at(3.5), 0, 7)");
    ask("INSERT INTO actuator (id, seq, time, status, value, origin, sensor_seq, setpoint_seq) SELECT 1, s, "
        "at(4) + s *"
        " interval '700 seconds', 0, -0.0, CASE WHEN s > 500 THEN s * 2 END, CASE WHEN s < 300 THEN s END, "
        "nullif(s % 3, 0)"
        " FROM generate_series(1, 3000) AS s");
    ask("INSERT INTO setpoint (id, seq, time, status, value, origin, author) SELECT 1, s, at(4) + s * "
        "interval"
        " '1 hour', 0, s, NULL, nullif(s % 5, 4) FROM generate_series(1, 600) AS s"); /* author 0: no chunk
                                                                                         can say that */
    ask("INSERT INTO author (name, role) SELECT 'somebody ' || n, session_user FROM generate_series(1, 5) AS "
        "n");
}

struct list {
    struct apc_sample *at;
    size_t n, room, most; /* most: ends early after so many; 0: never */
};

static int add(void *ctx, const struct apc_sample *s)
{
    struct list *l = ctx;
    if (l->n == l->room) {
        l->room = l->room ? 2 * l->room : 1024;
        l->at = realloc(l->at, l->room * sizeof *l->at);
        assert_non_null(l->at);
    }
    l->at[l->n++] = *s;
    return l->n == l->most;
}

static const struct {
    enum apc_table table;
    int id;
} all[] = {{APC_SENSOR, 1}, {APC_SENSOR, 2}, {APC_SENSOR, 3},   {APC_SENSOR, 4},  {APC_SENSOR, 5},
           {APC_SENSOR, 6}, {APC_SENSOR, 7}, {APC_ACTUATOR, 1}, {APC_SETPOINT, 1}};
enum { VARIABLES = sizeof all / sizeof all[0] };

static struct list history(struct apc_store *store, size_t v, const struct apc_range *range, size_t most)
{
    struct list l = {.most = most};
    const int n = apc_store_history(store, all[v].table, all[v].id, range, add, &l);
    ok(store, n);
    assert_int_equal(n, l.n);
    return l;
}

static int pack(struct apc_store *store)
{
    const struct apc_retention keep = {.size = sizeof keep, .packed = 1};
    return apc_store_maintain(store, &keep);
}

#endif
