/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A test, from tick to tick: at rest, where noise and base are seen; the hands change; the signal; and the
 * plant goes back to whom it was taken from, however the test ends. Nothing is written but as an operator.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "test.h"

#define PATIENCE 20 /* samples for a mode to come */
#define WITHOUT  5  /* samples without a measurement end the test */
#define BAR      24
#define LOOKS    20 /* at the gains, in a test */
#define ALIKE    1e-9

static struct apc_sample *row_of(const struct test *z, size_t move, enum test_row which)
{
    return &z->row[z->e.dim.ny + z->e.dim.nu + TEST_ROWS * move + which];
}

static bool is_same_number(double a, double b)
{
    return fabs(a - b) <= ALIKE * (1.0 + fabs(b));
}

static int end_early(struct test *z, enum test_end end, const struct apc_error *why)
{
    if (z->end == TEST_WHOLE) {
        z->end = end;
        if (why)
            z->why = *why;
    }
    return 1;
}

static void name_test_rows(struct test *z)
{
    for (size_t i = 0; i < z->e.dim.ny; i++)
        z->row[i] = (struct apc_sample){.table = APC_SENSOR, .id = (int)i + 1};
    for (size_t i = 0; i < z->e.dim.nu; i++)
        z->row[z->e.dim.ny + i] = (struct apc_sample){.table = APC_ACTUATOR, .id = (int)i + 1};
    for (size_t k = 0; k < z->moves; k++) {
        const struct test_move *m = &z->move[k];
        *row_of(z, k, TEST_WRITTEN) = (struct apc_sample){.table = m->tag.table, .id = m->tag.id};
        *row_of(z, k, TEST_OUTPUT) = (struct apc_sample){.table = m->loop->table, .id = m->loop->output};
        *row_of(z, k, TEST_TARGET) = (struct apc_sample){.table = APC_OPMODE, .id = m->loop->id};
        *row_of(z, k, TEST_ACTUAL) =
            (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, m->loop->id)};
    }
}

/* To the next sample. Returns 0, or 1: the test is over. */
static int wait_for_sample(struct test *z)
{
    struct apc_error why;

    if (test_bench_next(&z->bench, &why) < 0 || test_bench_read(&z->bench, z->row, z->rows, &why) < 0)
        return end_early(z, TEST_LOST, &why);
    return *z->bench.stop ? end_early(z, TEST_STOPPED, NULL) : 0;
}

static void keep_sample_row(struct test *z)
{
    const size_t nu = z->e.dim.nu, ny = z->e.dim.ny;

    if (z->kept == z->room)
        return;
    for (size_t i = 0; i < ny; i++) {
        const struct apc_sample *y = &z->row[i];
        const bool good = y->seq > 0 && apc_status_severity(y->status) != APC_SEVERITY_BAD;
        z->y[z->kept * ny + i] = good ? y->value : (double)NAN;
    }
    for (size_t j = 0; j < nu; j++) { /* what was in force until now */
        z->u[z->kept * nu + j] = z->row[ny + j].value;
        if (z->kept > 0)
            z->u[(z->kept - 1) * nu + j] = z->row[ny + j].value;
    }
    z->kept++;
}

/* ---- Writing --------------------------------------------------------------------------------- */

static struct action writing(enum apc_table table, int id, double value)
{
    return (struct action){.kind = ACTION_WRITE, .to = {.table = table, .id = id, .value = value}, .n = 1};
}

static int put_test_action(struct test *z, const struct action *action)
{
    struct apc_error why;
    return test_bench_do(&z->bench, action, &why) < 0 ? end_early(z, TEST_LOST, &why) : 0;
}

static int move_to(struct test *z, struct test_move *m, double value)
{
    const struct action action = writing(m->tag.table, m->tag.id, value);
    int rc = is_same_number(value, m->written) ? 0 : put_test_action(z, &action);

    m->written = rc == 0 ? value : m->written;
    return rc;
}

/* ---- At rest --------------------------------------------------------------------------------- */

/* The setpoints that the scheduler moves stay where they are. */
static int hold_setpoints(struct test *z)
{
    struct loops *loops = &z->bench.loops;

    for (size_t i = 0; i < loops->n_scheduled; i++) {
        struct apc_sample owner = {.table = APC_OPMODE, .id = LOOPS_OWNER(loops->scheduled[i])};
        const struct action local = writing(APC_OPMODE, owner.id, 0.0);
        struct apc_error why;
        if (test_bench_read(&z->bench, &owner, 1, &why) < 0)
            return end_early(z, TEST_LOST, &why);
        if (owner.seq > 0 && loops_is_local(&owner))
            continue;
        z->held[z->n_held++] = loops->scheduled[i];
        if (put_test_action(z, &local) != 0)
            return 1;
    }
    return 0;
}

static int check_loops(struct test *z, struct apc_error *why)
{
    for (size_t k = 0; k < z->moves; k++) {
        struct test_move *m = &z->move[k];
        const double mode = m->mode = row_of(z, k, TEST_TARGET)->value;
        if (mode == (double)APC_MODE_OOS)
            return apc_fail(why, APC_ESTATE, "%s is out of service: bring it to Man or Auto first",
                            m->loop->name);
        if (m->tag.table == APC_SETPOINT && mode < (double)APC_MODE_AUTO)
            return apc_fail(why, APC_ESTATE,
                            "%s is in Man: its setpoint moves nothing; bring it to Auto, or move its output",
                            m->loop->name);
        if (row_of(z, k, TEST_OUTPUT)->seq == 0)
            return apc_fail(why, APC_ESTATE,
                            "%s has no output on record yet: wait until its controller ticks", m->loop->name);
    }
    return 0;
}

/* From where they have come to rest. */
static void find_guards(struct test *z, size_t from)
{
    const size_t ny = z->e.dim.ny;

    for (size_t i = 0; i < ny; i++) {
        double sum = 0.0, apart = 0.0, last = (double)NAN;
        size_t n = 0, pairs = 0;
        for (size_t k = from; k < z->kept; k++) {
            const double y = z->y[k * ny + i];
            if (isnan(y))
                continue;
            sum += y;
            n++;
            if (!isnan(last)) {
                apart += (y - last) * (y - last);
                pairs++;
            }
            last = y;
        }
        z->guard[i].base = n > 0 ? sum / (double)n : (double)NAN;
        z->guard[i].noise = pairs > 0 ? sqrt(apart / (double)pairs / 2.0) : 0.0;
    }
}

static int check_guards(const struct test *z, struct apc_error *why)
{
    for (size_t i = 0; i < z->e.dim.ny; i++) {
        const struct test_guard *g = &z->guard[i];
        if (isnan(g->base))
            return apc_fail(why, APC_ESTATE,
                            "%s has no measurement on record: a test of it would show nothing",
                            z->e.y[i].tag.name);
        if (!(g->low < g->high) || !(g->base > g->low && g->base < g->high))
            return apc_fail(why, APC_ERANGE,
                            "%s is %.6g at rest, which is not within its guards %g to %g: "
                            "give others by --guard %s=LOW..HIGH",
                            z->e.y[i].tag.name, g->base, g->low, g->high, z->e.y[i].tag.name);
    }
    return 0;
}

static void find_bases(struct test *z, const double *sum, size_t n)
{
    for (size_t k = 0; k < z->moves; k++) {
        struct test_move *m = &z->move[k];
        const struct apc_sample *written = row_of(z, k, TEST_WRITTEN);
        const bool man = m->tag.table == APC_MANUAL;
        m->base = man && m->mode > (double)APC_MODE_MAN ? sum[k] / (double)n
                  : man                                 ? row_of(z, k, TEST_OUTPUT)->value
                                                        : written->value;
        m->was = man ? m->base : written->value;
        m->base = fmin(fmax(m->base, m->tag.low), m->tag.high);
        m->written = written->seq > 0 ? written->value : (double)NAN;
    }
}

static int wait_at_rest(struct test *z, struct apc_error *why)
{
    double sum[TEST_SIGNALS] = {0.0};
    const size_t from = z->own.live ? 0 : z->rest / 2;
    int rc = 0;

    if (wait_for_sample(z) != 0 || hold_setpoints(z) != 0)
        return 0;
    for (size_t k = 0; k < z->rest; k++) {
        if (wait_for_sample(z) != 0)
            return 0;
        keep_sample_row(z);
        for (size_t i = 0; i < z->moves && k >= from; i++)
            sum[i] += row_of(z, i, TEST_OUTPUT)->value;
    }
    find_guards(z, from);
    if ((rc = check_loops(z, why)) < 0 || (rc = check_guards(z, why)) < 0)
        return rc;
    find_bases(z, sum, z->rest - from);
    return test_plan_amplitudes(z, why);
}

/* ---- The hands change ------------------------------------------------------------------------ */

/* Is each loop in the mode that the test needs, and nobody else's? */
static bool all_in_mode(const struct test *z)
{
    for (size_t k = 0; k < z->moves; k++) {
        const double wanted = z->move[k].tag.table == APC_MANUAL ? APC_MODE_MAN : APC_MODE_AUTO;
        if (!is_same_number(row_of(z, k, TEST_ACTUAL)->value, wanted))
            return false;
    }
    return true;
}

static void take_over_loop(struct test *z)
{
    struct apc_error why;

    for (size_t k = 0; k < z->moves; k++) {
        struct test_move *m = &z->move[k];
        const double wanted = m->tag.table == APC_MANUAL ? APC_MODE_MAN : APC_MODE_AUTO;
        const struct action mode = writing(APC_OPMODE, m->loop->id, wanted);
        m->taken = true;
        if (!is_same_number(m->mode, wanted) && put_test_action(z, &mode) != 0)
            return;
    }
    for (int i = 0; i < PATIENCE && !(i > 0 && all_in_mode(z)); i++)
        if (wait_for_sample(z) != 0)
            return;
    if (!all_in_mode(z)) {
        apc_fail(&why, APC_EPERM, "a loop does not come to the mode of the test: see apc status");
        end_early(z, TEST_TAKEN, &why);
        return;
    }
    for (size_t k = 0; k < z->moves; k++)
        if (move_to(z, &z->move[k], z->move[k].base) != 0)
            return;
}

/* ---- The signal ------------------------------------------------------------------------------ */

static int watch_test_limits(struct test *z)
{
    const size_t ny = z->e.dim.ny;
    struct apc_error why;
    bool without = false;

    for (size_t i = 0; i < ny; i++) {
        const struct apc_sample *y = &z->row[i];
        const struct test_guard *g = &z->guard[i];
        if (apc_status_severity(y->status) == APC_SEVERITY_BAD) {
            without = true;
        } else if (!(y->value >= g->low && y->value <= g->high)) {
            apc_fail(&why, APC_ERANGE, "%s is %.6g, outside its guards %g to %g", z->e.y[i].tag.name,
                     y->value, g->low, g->high);
            return end_early(z, TEST_GUARDED, &why);
        }
    }
    z->bad = without ? z->bad + 1 : 0;
    if (z->bad == WITHOUT) {
        apc_fail(&why, APC_ESTATE, "a measurement is Bad");
        return end_early(z, TEST_GUARDED, &why);
    }
    for (size_t k = 0; k < z->moves; k++) {
        struct test_move *m = &z->move[k];
        const double wanted = m->tag.table == APC_MANUAL ? APC_MODE_MAN : APC_MODE_AUTO;
        if (is_same_number(row_of(z, k, TEST_WRITTEN)->value, m->written) &&
            is_same_number(row_of(z, k, TEST_TARGET)->value, wanted))
            continue;
        m->taken = false; /* it is somebody else's */
        apc_fail(&why, APC_EPERM, "another write has moved %s, or changed its mode", m->name);
        return end_early(z, TEST_TAKEN, &why);
    }
    return 0;
}

static double relay_level(struct test *z, double t)
{
    const size_t measurement = (size_t)z->move[0].loop->measurement - 1;
    const struct apc_sample *y = &z->row[measurement];
    const struct test_guard *g = &z->guard[measurement];
    const double error = g->base - y->value, gain = z->move[0].gain[measurement];

    z->relay.hysteresis = 3.0 * g->noise;
    if (z->sign == 0.0 && isfinite(gain) && gain != 0.0)
        z->sign = gain > 0.0 ? 1.0 : -1.0;
    if (z->sign == 0.0 && fabs(error) > 2.0 * z->relay.hysteresis + 1e-6 * fabs(g->base))
        z->sign = error < 0.0 ? 1.0 : -1.0; /* by what the first push does */
    if (apc_status_severity(y->status) == APC_SEVERITY_BAD)
        return z->sign * apc_relay_step(&z->relay, t, (double)NAN);
    return z->sign == 0.0 ? 1.0 : z->sign * apc_relay_step(&z->relay, t, error);
}

/* Is there somebody who follows it? */
static bool tells(const struct test *z)
{
    return z->own.live || isatty(STDERR_FILENO);
}

static void show_test_progress(struct test *z, double share, bool last)
{
    static const char full[] = "########################", empty[] = "........................";
    const bool terminal = isatty(STDERR_FILENO);
    const apc_ns now = apc_clock_mono(NULL), every = terminal ? APC_NS_PER_S / 10 : 60 * APC_NS_PER_S;
    const int filled = (int)(share * BAR);
    char gains[200];

    if (!tells(z) || (!last && now - z->shown < every))
        return;
    z->shown = now;
    test_gain_line(z, gains, sizeof gains);
    fprintf(stderr, "%s%s  [%.*s%.*s] %3.0f %%%s", terminal ? "\r" : "", gains, filled, full, BAR - filled,
            empty, 100.0 * share, terminal && !last ? "" : "\n");
    fflush(stderr);
}

/* Sample @p k of the signal; those before the first are of the base. */
static int put_levels(struct test *z, double k)
{
    for (size_t i = 0; i < z->moves; i++) {
        struct test_move *m = &z->move[i];
        double level = 0.0;
        if (k >= 0.0 && z->own.kind == TEST_RELAY)
            level = relay_level(z, (k + 1.0) * z->Ts);
        else if (k >= 0.0)
            level = m->level[(size_t)k];
        if (move_to(z, m, m->base + level * m->amplitude) != 0)
            return 1;
    }
    return 0;
}

static void carry_out_test(struct test *z)
{
    const double whole = (double)(z->lead + z->n);
    size_t looks = 1;

    z->begin = z->bench.now;
    z->kept = 0;
    for (double k = 0.0; k < whole;) {
        if (wait_for_sample(z) != 0)
            return;
        k = round(apc_ns_to_s(z->bench.now - z->begin) / z->Ts) - 1.0;
        keep_sample_row(z);
        if (watch_test_limits(z) != 0 || k >= whole || put_levels(z, k - (double)z->lead) != 0 ||
            (z->own.kind == TEST_RELAY && apc_relay_settled(&z->relay)))
            break;
        if (tells(z) && k * LOOKS > (double)looks * whole) {
            looks++;
            test_gain_find(z);
        }
        show_test_progress(z, k / whole, false);
    }
    test_gain_find(z);
    show_test_progress(z, (double)z->kept / (whole + 1.0), true);
}

/* ---- Giving back ----------------------------------------------------------------------------- */

/* A store that is away is waited for: nobody else knows that the plant is to go back. Returns 0, or 1: a
 * second signal has come. */
static int put_surely(struct test *z, const struct action *action)
{
    const struct timespec pause = {0, APC_NS_PER_S / 5};
    struct apc_error why;
    bool said = false;

    while (test_bench_do(&z->bench, action, &why) < 0) {
        if (!z->own.live || *z->bench.stop)
            return 1;
        if (!said)
            cli_error(&z->cli, 0, "%s. The plant goes back as soon as the store is there; Ctrl-C leaves it",
                      why.text);
        said = true;
        nanosleep(&pause, NULL);
    }
    return 0;
}

static int give_back_moves(struct test *z)
{
    struct apc_error why;
    int rc = 0;

    for (size_t k = 0; k < z->moves && rc == 0; k++) {
        const struct action to = writing(z->move[k].tag.table, z->move[k].tag.id, z->move[k].was);
        rc = z->move[k].taken ? put_surely(z, &to) : 0;
    }
    (void)test_bench_next(&z->bench, &why); /* it is put out */
    for (size_t k = 0; k < z->moves && rc == 0; k++) {
        const struct test_move *m = &z->move[k];
        const struct action to = writing(APC_OPMODE, m->loop->id, m->mode);
        if (m->taken && !is_same_number(m->mode, m->tag.table == APC_MANUAL ? APC_MODE_MAN : APC_MODE_AUTO))
            rc = put_surely(z, &to);
    }
    return rc;
}

static void give_back_loop(struct test *z)
{
    int rc;

    *z->bench.stop = 0;
    rc = z->bench.s && z->bench.s->rc < 0 ? 0 : give_back_moves(z);
    for (size_t i = 0; i < z->n_held && rc == 0; i++) {
        const struct action remote = writing(APC_OPMODE, LOOPS_OWNER(z->held[i]), 1.0);
        rc = z->bench.s && z->bench.s->rc < 0 ? 0 : put_surely(z, &remote);
    }
    if (rc != 0)
        cli_error(
            &z->cli, APC_ETIMEDOUT,
            "the plant was not given back: bring its loops to their modes by apc mode, and setpoints by "
            "apc remote");
}

int test_run(struct test *z, struct apc_error *why)
{
    const size_t nu = z->e.dim.nu, ny = z->e.dim.ny;
    int rc;

    z->rows = ny + nu + TEST_ROWS * z->moves;
    z->room = z->lead + z->n + z->rest + 2;
    z->row = calloc(z->rows, sizeof *z->row);
    z->u = calloc(z->room * nu, sizeof *z->u);
    z->y = calloc(z->room * ny, sizeof *z->y);
    z->held = calloc(z->bench.loops.n_scheduled + 1, sizeof *z->held);
    z->varies = calloc(nu, sizeof *z->varies);
    z->found = calloc(ny * nu, sizeof *z->found);
    if (!z->row || !z->u || !z->y || !z->held || !z->varies || !z->found)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < ny * nu; i++)
        z->found[i] = (double)NAN;
    name_test_rows(z);
    rc = wait_at_rest(z, why);
    if (rc == 0 && z->end == TEST_WHOLE)
        rc = test_plan_levels(z, why);
    if (rc == 0 && z->end == TEST_WHOLE) {
        test_plan_print(z);
        fflush(stdout);
        take_over_loop(z);
    }
    if (rc == 0 && z->end == TEST_WHOLE)
        carry_out_test(z);
    give_back_loop(z);
    return rc;
}
