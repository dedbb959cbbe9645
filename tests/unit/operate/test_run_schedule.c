/* SPDX-License-Identifier: BSD-3-Clause */
/* Operator and scheduler over one store: whatever the order, the setpoint in force is its owner's. */
#include <pthread.h>
#include <stdlib.h>

#include <apcmodules.h>

#include "operate/operate.h"
#include "stores.h"

#define PERIOD (20 * APC_NS_PER_S)
#define STEPS  3

static const double sequence[STEPS] = {1, 2, 3};

/* A setpoint of its own for each order. */
struct world {
    struct apc_store *store;
    struct apc_scheduler *scheduler;
    int id;
    uint64_t step;
    apc_ns now;
    double set; /* the last value that an operator set */
};

static struct loops loops_of_one(int *id)
{
    return (struct loops){.scheduled = id, .n_scheduled = 1};
}

static void start(struct world *w)
{
    const struct apc_scheduler_setpoint r = {"r", w->id, LOOPS_OWNER(w->id)};
    const struct apc_scheduler_options o = {
        .size = sizeof o, .nz = 1, .z = &r, .steps = STEPS, .sequence = sequence, .period = PERIOD};
    apc_scheduler_destroy(w->scheduler);
    assert_int_equal(apc_scheduler_create(&w->scheduler, &o, NULL), 0);
}

static struct apc_now now_of(struct world *w)
{
    w->now += APC_NS_PER_MS;
    return (struct apc_now){.mono = w->now, .utc = w->now};
}

/* ---- What each of them does ----------------------------------------------------------------- */

static void look(struct world *w)
{
    ok(w->store, apc_store_read_rows(w->store, apc_scheduler_in(w->scheduler)));
}

static void write_due(struct world *w)
{
    if (apc_scheduler_compute(w->scheduler, now_of(w), w->step, 0, NULL) > 0)
        ok(w->store, apc_store_append_rows(w->store, apc_scheduler_out(w->scheduler)));
    (void)apc_scheduler_update(w->scheduler, true);
}

static void next_step(struct world *w)
{
    w->step++;
    look(w);
}

static void restart(struct world *w)
{
    start(w);
    look(w);
    apc_scheduler_resume(w->scheduler, w->step, (apc_ns)w->step * PERIOD + 1);
}

static void write_row(struct world *w, enum apc_table table, int id, double value)
{
    struct apc_sample row = {
        .table = table, .id = id, .seq = APC_SEQ_ANY, .time = now_of(w).utc, .value = value};
    const struct loops loops = loops_of_one(&w->id);
    struct owner_rows with;
    ok(w->store, owner_put(w->store, &loops, &row, 1, &with));
    free(with.at);
}

static void set_seven(struct world *w)
{
    write_row(w, APC_SETPOINT, w->id, w->set = 7);
}

static void set_eight(struct world *w)
{
    write_row(w, APC_SETPOINT, w->id, w->set = 8);
}

static void take(struct world *w)
{
    write_row(w, APC_OPMODE, LOOPS_OWNER(w->id), 0);
    w->set = newest(w->store, APC_SETPOINT, w->id).value;
}

static void give(struct world *w)
{
    write_row(w, APC_OPMODE, LOOPS_OWNER(w->id), 1);
}

/* ---- Every order ---------------------------------------------------------------------------- */

typedef void (*deed)(struct world *);

static void check_owner(struct world *w)
{
    const struct apc_sample owner = newest(w->store, APC_OPMODE, LOOPS_OWNER(w->id));
    look(w);
    write_due(w);
    const struct apc_sample z = newest(w->store, APC_SETPOINT, w->id);
    assert_near(z.value, loops_is_local(&owner) ? w->set : sequence[w->step], 0);
}

/* Bits of @p order: whose turn it is. */
static void run(struct world *w, const deed *operator, size_t n_operator, const deed *scheduler, size_t n,
                unsigned order)
{
    size_t done[2] = {0, 0};
    w->id++;
    w->step = 0;
    w->set = 0;
    w->now = APC_NS_PER_S;
    struct apc_sample first = {.table = APC_SETPOINT, .id = w->id, .time = w->now}; /* as of the file */
    ok(w->store, apc_store_put(w->store, &first, 1));
    start(w);
    look(w);
    for (size_t i = 0; i < n_operator + n; i++) {
        if (order >> i & 1)
            operator[done[1]++](w);
        else
            scheduler[done[0]++](w);
    }
    check_owner(w);
}

static unsigned count_bits(unsigned x)
{
    return x ? 1 + count_bits(x & (x - 1)) : 0;
}

/*
 * Promise(modes/scheduled-setpoint): A setpoint that the scheduler moves ends as its owner's, too, over
 *   each kind of store, also when the scheduler is started anew; given back it gets the step that is due;
 *   by SQL as well.
 */
static void test_in_every_order_the_setpoint_ends_as_its_owners(void **state)
{
    static const deed operators[][3] = {
        {set_seven, give, set_eight}, {give, set_seven, give}, {take, give, take}, {set_seven, take, give}};
    static const deed schedulers[][4] = {{write_due, next_step, write_due, look},
                                         {write_due, next_step, restart, write_due},
                                         {write_due, restart, next_step, write_due}};
    struct world w = {.store = *state};
    for (size_t i = 0; i < sizeof operators / sizeof *operators; i++)
        for (size_t k = 0; k < sizeof schedulers / sizeof *schedulers; k++)
            for (unsigned order = 0; order < 128; order++)
                if (count_bits(order) == 3)
                    run(&w, operators[i], 3, schedulers[k], 4, order);
    apc_scheduler_destroy(w.scheduler);
}

/* ---- At once -------------------------------------------------------------------------------- */

#define ROUNDS 100

static void *operate(void *ctx)
{
    struct world *w = ctx;
    for (int i = 0; i < ROUNDS; i++) {
        const struct loops loops = loops_of_one(&w->id);
        const bool back = i % 3 == 2;
        struct apc_sample row = {.table = back ? APC_OPMODE : APC_SETPOINT,
                                 .id = back ? LOOPS_OWNER(w->id) : w->id,
                                 .seq = APC_SEQ_ANY,
                                 .time = i + 1,
                                 .value = back ? 1 : 100 + i};
        struct owner_rows with;
        int rc;
        do /* ten tries may not be enough against one who does nothing else */
            free((rc = owner_put(w->store, &loops, &row, 1, &with), with.at));
        while (rc == APC_ECONFLICT && (row.seq = APC_SEQ_ANY, row.value = back ? 1 : 100 + i, true));
        if (rc < 0)
            return w;
        w->set = back ? w->set : 100 + i;
    }
    return NULL;
}

/* Promise(modes/scheduled-setpoint) */
static void test_at_once_the_setpoint_ends_as_its_owners(void **state)
{
    struct apc_store *other = stores_open();
    struct world w = {.store = *state, .id = 1, .now = APC_NS_PER_S}, o = {.store = other, .id = 1};
    pthread_t thread;
    void *failed;
    start(&w);
    assert_int_equal(pthread_create(&thread, NULL, operate, &o), 0);
    for (int i = 0; i < ROUNDS; i++) {
        w.step = (uint64_t)(i * STEPS / ROUNDS);
        look(&w);
        write_due(&w);
    }
    pthread_join(thread, &failed);
    assert_null(failed);
    w.set = o.set;
    check_owner(&w);
    apc_scheduler_destroy(w.scheduler);
    apc_store_close(other);
}

/* ---- What is written along ------------------------------------------------------------------ */

static void test_a_scheduled_setpoint_takes_its_switch_along_once(void **state)
{
    struct world w = {.store = *state, .id = 1};
    set_seven(&w);
    assert_int_equal(newest(w.store, APC_OPMODE, LOOPS_OWNER(1)).seq, 1);
    assert_near(newest(w.store, APC_OPMODE, LOOPS_OWNER(1)).value, 0, 0);
    set_eight(&w);
    assert_int_equal(newest(w.store, APC_OPMODE, LOOPS_OWNER(1)).seq, 1);
    assert_int_equal(newest(w.store, APC_SETPOINT, 1).seq, 2);
    give(&w);
    assert_int_equal(newest(w.store, APC_OPMODE, LOOPS_OWNER(1)).seq, 2);
    assert_int_equal(newest(w.store, APC_SETPOINT, 1).seq, 3); /* so that what is on its way is left out */
    assert_near(newest(w.store, APC_SETPOINT, 1).value, 8, 0);
    give(&w);
    assert_int_equal(newest(w.store, APC_SETPOINT, 1).seq, 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_scheduled_setpoint_takes_its_switch_along_once),
        T(test_in_every_order_the_setpoint_ends_as_its_owners),
        T(test_at_once_the_setpoint_ends_as_its_owners),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}
