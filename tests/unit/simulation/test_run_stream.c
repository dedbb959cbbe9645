/* SPDX-License-Identifier: BSD-3-Clause */
/* The samples of a run on their way out: the same as of a run that keeps them all, in the same order, whatever
 * the world does to their times; and what its store keeps meanwhile does not grow with the run.
 */
#include "check.h"

#include <stdlib.h>

#include "simulation/simulation.h"

/* Slow sensors, ticks that are late and long, frames that are lost, late and doubled, a wall clock that goes
 * back. */
static const char text[] =
    "name = \"rough\"; duration = 900.0; seed = 3;\n"
    "measurements = ( { name = \"h1\"; noise = 0.001; }, { name = \"h2\"; noise = 0.001; period = 0.7; } );\n"
    "setpoints = ( { name = \"r\"; low = 0.0; high = 0.5; initial = 0.18; } );\n"
    "outputs = ( { name = \"u\"; low = 0.0; high = 10.0; } );\n"
    "signals = ( { name = \"f\"; low = 0.0; high = 0.5; } );\n"
    "plant = { model = \"double-tank\"; period = 0.01; jitter = \"uniform(0.0,0.004)\";\n"
    "          execution = \"uniform(0.0,0.004)\"; };\n"
    "client = { period = 0.05; execution = \"uniform(0.0,0.01)\"; };\n"
    "controllers = (\n"
    "  { name = \"smooth\"; law = \"filter\"; period = 0.4; measurements = [\"h2\"]; outputs = [\"f\"];\n"
    "    execution = \"uniform(0.0,0.5)\"; },\n"
    "  { name = \"base\"; law = \"pi\"; period = 0.1; measurements = [\"f\"]; setpoints = [\"r\"];\n"
    "    outputs = [\"u\"]; execution = \"uniform(0.0,0.09)\"; } );\n"
    "network = { delay = \"normal(0.01,0.01)\"; loss = 0.05; duplication = 0.05; reordering = 0.1;\n"
    "            outages = ( [200.0, 350.0] ); };\n"
    "clock = ( { at = 300.0; step = -60.0; drift = 1e-4; }, { at = 500.0; step = 20.0; } );\n"
    "actions = ( { at = 400.0; kill = \"base\"; }, { at = 420.0; start = \"base\"; },\n"
    "            { at = 450.0; set = \"r\"; value = 0.2; } );\n";

struct taken {
    const struct simulation *s;
    struct samples all;
    size_t pieces, kept; /* the most rows that the store had when it was asked to let go of some */
};

static int count_row(void *ctx, const struct apc_sample *row)
{
    (void)row;
    ++*(size_t *)ctx;
    return 0;
}

static int count_vector(void *ctx, const struct apc_vector *row)
{
    (void)row;
    ++*(size_t *)ctx;
    return 0;
}

static size_t rows_of(struct apc_store *store)
{
    struct apc_sample *at;
    size_t rows = 0;
    int n = apc_store_variables(store, NULL, 0);
    assert_true(n > 0);
    at = calloc((size_t)n, sizeof *at);
    assert_non_null(at);
    assert_int_equal(apc_store_variables(store, at, (size_t)n), n);
    for (int i = 0; i < n; i++)
        if (apc_table_vectors(at[i].table))
            assert_true(apc_store_vectors(store, at[i].table, at[i].id, NULL, count_vector, &rows) > 0);
        else
            assert_true(apc_store_history(store, at[i].table, at[i].id, NULL, count_row, &rows) > 0);
    free(at);
    return rows;
}

static int take_piece_of_stream(void *ctx, const struct samples *rows)
{
    struct taken *t = ctx;
    const size_t kept = rows_of(t->s->store);
    t->pieces++;
    t->kept = kept > t->kept ? kept : t->kept;
    return samples_append(&t->all, rows);
}

static void make_stream(struct taken *t, const struct experiment *e, double until)
{
    struct simulation s;
    struct apc_error why;
    if (simulation_create(&s, e, e->seed, &why) < 0)
        fail_msg("%s", why.text);
    *t = (struct taken){.s = &s};
    if (simulation_stream(&s, until, take_piece_of_stream, t) < 0)
        fail_msg("%s", s.why.text);
    simulation_destroy(&s);
}

static void make_whole(struct samples *all, const struct experiment *e, double until)
{
    struct simulation s;
    struct apc_error why;
    *all = (struct samples){0};
    if (simulation_create(&s, e, e->seed, &why) < 0)
        fail_msg("%s", why.text);
    if (simulation_run(&s, until) < 0)
        fail_msg("%s", s.why.text);
    assert_int_equal(samples_collect(all, s.store, e, NULL), 0);
    simulation_destroy(&s);
}

static void parse(struct experiment *e)
{
    struct apc_error why;
    if (experiment_parse(e, &(struct experiment_source){.file = "here.conf", .text = text},
                         EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
}

static void the_same_samples_go_out_in_pieces(void **state)
{
    struct experiment e;
    struct taken t;
    struct samples all;
    (void)state;
    parse(&e);
    make_whole(&all, &e, e.duration);
    make_stream(&t, &e, e.duration);
    assert_true(t.pieces > 4);
    assert_int_equal(t.all.n, all.n);
    for (size_t i = 0; i < all.n; i++) {
        const struct apc_sample *a = &t.all.at[i], *b = &all.at[i];
        if (a->time != b->time || a->table != b->table || a->id != b->id || a->seq != b->seq ||
            a->status != b->status || a->value < b->value || a->value > b->value)
            fail_msg("sample %zu is another", i);
    }
    samples_free(&all);
    samples_free(&t.all);
    experiment_free(&e);
}

/* Promise(simulation/long-run): A long simulation needs no more memory for its samples than a short one. */
static void what_the_store_keeps_does_not_grow_with_the_run(void **state)
{
    struct experiment e;
    struct taken brief, lengthy;
    struct apc_error why;
    (void)state;
    if (experiment_load(&e, APC_SOURCE_DIR "/experiments/servo.conf", EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL,
                        &why) < 0)
        fail_msg("%s", why.text);
    make_stream(&brief, &e, 25.0);
    make_stream(&lengthy, &e, 100.0);
    assert_true(brief.pieces > 1);
    assert_true(lengthy.pieces > 3 * brief.pieces);
    assert_true(lengthy.all.n > 3 * brief.all.n);
    assert_in_range(lengthy.kept, 1, brief.kept + brief.kept / 100);
    samples_free(&brief.all);
    samples_free(&lengthy.all);
    experiment_free(&e);
}

/* Whoever wants none of them pays for none. */
static void what_nobody_takes_goes_too(void **state)
{
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    (void)state;
    parse(&e);
    if (simulation_create(&s, &e, e.seed, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(simulation_stream(&s, e.duration, NULL, NULL), 0);
    assert_in_range(rows_of(s.store), 1, 60000);
    simulation_destroy(&s);
    experiment_free(&e);
}

static int take_none(void *ctx, const struct samples *rows)
{
    (void)ctx;
    (void)rows;
    return APC_ENOMEM;
}

static void who_cannot_take_them_ends_the_run(void **state)
{
    struct experiment e;
    struct simulation s;
    struct apc_error why;
    (void)state;
    parse(&e);
    if (simulation_create(&s, &e, e.seed, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(simulation_stream(&s, e.duration, take_none, NULL), APC_ENOMEM);
    assert_true(s.ended < e.duration);
    simulation_destroy(&s);
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_samples_go_out_in_pieces),
        cmocka_unit_test(what_the_store_keeps_does_not_grow_with_the_run),
        cmocka_unit_test(what_nobody_takes_goes_too),
        cmocka_unit_test(who_cannot_take_them_ends_the_run),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
