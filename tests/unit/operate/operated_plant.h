/* SPDX-License-Identifier: BSD-3-Clause */
/* A plant that people operate, in a store, and its controllers, which do and say what the test has them say. */
#ifndef OPERATED_PLANT_H
#define OPERATED_PLANT_H

#include "check.h"
#include "experiment/experiment.h"
#include "operate/operate.h"

/* Of w, u and base: "second_person = 300.0; " */
#ifndef OPERATED_SECOND
#define OPERATED_SECOND ""
#endif

/* r is moved by the loop above, or by people; w is the scheduler's, or people's. */
static const char operated_text[] =
    "name = \"operated\"; duration = 10.0;\n"
    "measurements = ( { name = \"y\"; low = -100.0; high = 100.0; } );\n"
    "setpoints = ( { name = \"r\"; low = -50.0; high = 50.0; initial = 1.0; },\n"
    "              { name = \"w\"; low = -50.0; high = 50.0; initial = 5.0; confirm = 10.0; " OPERATED_SECOND
    "} );\n"
    "outputs = ( { name = \"u\"; low = -20.0; high = 20.0; " OPERATED_SECOND "} );\n"
    "plant = { model = \"first-order\"; period = 0.1; };\n"
    "client = { period = 0.1; };\n"
    "scheduler = { period = 10.0; setpoints = [\"w\"]; sequence = ( [5.0], [6.0] ); };\n"
    "controllers = (\n"
    "  { name = \"base\"; " OPERATED_SECOND
    "law = \"pi\"; period = 0.5; mode = \"Cas\"; measurements = [\"y\"];\n"
    "    setpoints = [\"r\"]; outputs = [\"u\"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },\n"
    "  { name = \"upper\"; law = \"pi\"; period = 1.0; measurements = [\"y\"]; setpoints = [\"w\"];\n"
    "    outputs = [\"r\"]; tuning = ( { Kp = 0.3; tau_i = 2.0; } ); } );\n";

enum { BASE = 1, UPPER = 2, LOOP_U = 1, LOOP_R = 2, SET_R = 1, SET_W = 2, KP = 1 };

static struct apc_store *store;

static struct apc_sample newest(enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    assert_true(apc_store_read(store, &s, 1) >= 0);
    return s;
}

static inline void append(struct apc_sample s)
{
    s.seq = newest(s.table, s.id).seq + 1;
    assert_int_equal(apc_store_append(store, &s, 1), 1);
}

static inline void ticked(int controller, apc_ns ago)
{
    static int64_t seq;
    double value = 0;
    struct apc_vector tick = {.table = APC_TICK,
                              .id = controller,
                              .seq = ++seq,
                              .time = apc_clock_utc(NULL) - ago,
                              .n = 1,
                              .room = 1,
                              .value = &value};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &tick, .n_vectors = 1};
    assert_true(apc_store_append_rows(store, &rows) >= 0);
}

/* What became of row @p origin, as its controller says. */
static inline void became(enum apc_table table, int id, int64_t origin, double value, apc_status status)
{
    append((struct apc_sample){.table = APC_ACTUAL,
                               .id = apc_variable_number(table, id),
                               .time = apc_clock_utc(NULL),
                               .value = value,
                               .origin = origin,
                               .status = status});
}

static void open_operated_plant(void)
{
    const struct experiment_source source = {.file = "test", .text = operated_text};
    struct experiment e;
    struct apc_error why;

    if (experiment_parse(&e, &source, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        apc_store_open(&store, "mem:", NULL, &why) < 0 || apc_store_init(store) < 0 ||
        provision(store, &e, PROVISION_KEEP) < 0)
        fail_msg("%s", why.text);
    experiment_free(&e);
}

#endif
