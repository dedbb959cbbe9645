/* SPDX-License-Identifier: BSD-3-Clause */
/* Past instants of a PostgreSQL store beside SQL on its rows: packed, half packed, and in a dense week. */
#include "packed_rig.h"
#include "xorshift.h"

/* All rows as they were before they were packed. */
static void keep_rows(void)
{
    ask("CREATE TABLE kept AS SELECT 1 AS t, id, seq, time, status, value, origin, author FROM sensor UNION "
        "ALL "
        "SELECT 2, id, seq, time, status, value, origin, author FROM actuator UNION ALL "
        "SELECT 3, id, seq, time, status, value, origin, author FROM setpoint");
    ask("CREATE INDEX ON kept (t, id, seq)");
}

/* What the rows say of an instant: "": nothing was there yet. */
static const char *said_by_rows(enum apc_table table, int id, apc_ns at)
{
    char sql[800];
    snprintf(sql, sizeof sql,
             "SELECT coalesce((SELECT concat_ws(' ', seq, (extract(epoch FROM time) * 1000000)::bigint, CASE "
             "WHEN status < 1073741824 AND EXISTS (SELECT FROM kept AS n WHERE n.t = k.t AND n.id = k.id AND "
             "n.seq > k.seq) AND NOT EXISTS (SELECT FROM kept AS n WHERE n.t = k.t AND n.id = k.id AND "
             "n.seq = k.seq + 1) THEN %u ELSE status END, encode(float8send(value), 'hex'), "
             "coalesce(origin, 0), coalesce(author, 0)) FROM kept AS k WHERE t = %d AND id = %d AND "
             "time <= timestamptz 'epoch' + %lld * interval '1 microsecond' ORDER BY seq DESC LIMIT 1), '')",
             (unsigned)APC_UNCERTAIN_LAST_USABLE, (int)table, id, (long long)(at / 1000));
    return ask(sql);
}

static const char *said_by_sample(const struct apc_sample *s, char text[200])
{
    uint64_t bits;
    memcpy(&bits, &s->value, sizeof bits);
    text[0] = '\0';
    if (s->seq > 0)
        snprintf(text, 200, "%lld %lld %u %016llx %lld %u", (long long)s->seq, (long long)(s->time / 1000),
                 s->status, (unsigned long long)bits, (long long)s->origin, s->author);
    return text;
}

/* At random instants, and at those of rows. Not of 5, whose clock was a week behind for a while: of both that stood
 * then, the row of the minute before is meant, whatever its seq. */
static void assert_instants_are_the_rows(struct apc_store *store, const char *what)
{
    const struct list of = history(store, 0, NULL, 0);
    uint64_t seed = 3;
    for (int i = 0; i < 60; i++) {
        const struct apc_sample *near = &of.at[xorshift(&seed) % of.n];
        const apc_ns at = near->time + (i % 3 == 0 ? 0 : (apc_ns)(xorshift(&seed) % 250) * APC_NS_PER_S);
        struct apc_sample s[VARIABLES];
        struct apc_store *then = NULL;
        char text[200];
        for (size_t v = 0; v < VARIABLES; v++)
            s[v] = (struct apc_sample){.table = all[v].table, .id = all[v].id};
        ok(store, apc_store_past(&then, store, at, NULL));
        ok(then, apc_store_read(then, s, VARIABLES));
        apc_store_close(then);
        for (size_t v = 0; v < VARIABLES; v++)
            if (v != 4 && strcmp(said_by_sample(&s[v], text), said_by_rows(s[v].table, s[v].id, at)) != 0)
                fail_msg("%s: variable %zu at %lld: \"%s\", and the rows say \"%s\"", what, v, (long long)at,
                         text, said_by_rows(s[v].table, s[v].id, at));
    }
    free(of.at);
}

/* Promise(run/at-time-shows) */
static void test_what_stood_at_an_instant_is_what_the_rows_say_packed_or_half_packed(void **state)
{
    (void)state;
    struct apc_store *store = open_direct(LONG);
    make_history();
    keep_rows();
    assert_instants_are_the_rows(store, "rows");
    ok(store, pack(store));
    assert_instants_are_the_rows(store, "packed");
    ask("CREATE TABLE came_late AS SELECT 2 AS id, seq + 1 AS seq, time + interval '1 second' AS time, "
        "0::bigint "
        "AS "
        "status, 5::double precision AS value FROM kept AS k WHERE t = 1 AND id = 2 AND seq % 4 < 2 AND NOT "
        "EXISTS (SELECT FROM kept AS n WHERE n.t = 1 AND n.id = 2 AND n.seq = k.seq + 1) AND seq < 3000");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT * FROM came_late");
    ask("INSERT INTO kept (t, id, seq, time, status, value) SELECT 1, * FROM came_late");
    assert_string_equal(ask("SELECT count(*) > 20 FROM sensor JOIN came_late USING (id, seq)"), "t");
    assert_instants_are_the_rows(store, "half packed");
    apc_store_close(store);
}

/* By the server's own count, once a session that ended has told it. */
static int64_t counted(const char *what, const char *of)
{
    char sql[200];
    snprintf(sql, sizeof sql,
             "SELECT coalesce(sum(%s), 0)::bigint FROM pg_stat_user_indexes WHERE schemaname = 'plant%d' AND "
             "relname LIKE 'sensor_2%%' AND indexrelname LIKE '%%%s'",
             what, plant, of);
    return strtoll(ask(sql), NULL, 10);
}

static void test_an_instant_of_a_dense_week_goes_through_no_key(void **state)
{
    (void)state;
    make_history();
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT i, s, at(2.5) + s * interval '1 second', "
        "0, s "
        "FROM generate_series(1, 20000) AS s, generate_series(11, 14) AS i");
    ask("INSERT INTO sensor (id, seq, time, status, value) SELECT i, 20001, now(), 0, 0 FROM "
        "generate_series(11, 14) AS i");
    ask("ANALYZE sensor");
    struct apc_store *store = open_direct(LONG), *then = NULL;
    ok(store, apc_store_maintain(store, &(struct apc_retention){.size = sizeof(struct apc_retention)}));
    assert_string_equal(ask("SELECT sum(brin_summarize_new_values(indexrelid)) FROM pg_stat_user_indexes "
                            "WHERE schemaname = current_schema AND indexrelname LIKE 'sensor%time_idx'"),
                        "0"); /* maintain has entered all */
    struct apc_sample s[4];
    const apc_ns at =
        strtoll(ask("SELECT (extract(epoch FROM at(2.5)) * 1000000)::bigint + 3000000000"), NULL, 10) * 1000;
    for (int i = 0; i < 4; i++)
        s[i] = (struct apc_sample){.table = APC_SENSOR, .id = 11 + i};
    const int64_t scans = counted("idx_scan", ""), before = counted("idx_tup_read", "pkey");
    ok(store, apc_store_past(&then, store, at, NULL));
    ok(then, apc_store_read(then, s, 4));
    apc_store_close(then);
    apc_store_close(store);
    for (int i = 0; i < 4; i++)
        assert_true(s[i].seq == 3000 && s[i].time == at && s[i].status == APC_GOOD);
    while (counted("idx_scan", "") == scans)
        ;
    assert_true(counted("idx_tup_read", "pkey") - before <= 100);
}

#define T(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_what_stood_at_an_instant_is_what_the_rows_say_packed_or_half_packed),
        T(test_an_instant_of_a_dense_week_goes_through_no_key),
    };
    cluster = cluster_start();
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    cluster_destroy(cluster);
    return failed;
}
