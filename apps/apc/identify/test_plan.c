/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What a test is to be, from what is known: the limits of the signals, the noise that there is, and, where
 * the file has a model of the plant, its time constants and gains.
 */
#include "test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/complex.h"
#include "linear.h"

#define PERIODS   60   /* of the controller, a settling time of which nothing is known */
#define SETTLINGS 10   /* that a test takes */
#define BITS      24   /* in a settling time */
#define OF_RANGE  0.1  /* is the amplitude at first, */
#define OF_ROOM   0.5  /* what is expected of a measurement takes no more of what its guards leave, */
#define OF_NOISE  10.0 /* nor less of its noise, if that can be had by */
#define GREATER   2.5  /* so much more */
#define SAMPLES   400000
#define LINES     64 /* of a multisine, at most */

/* ---- What is moved --------------------------------------------------------------------------- */

/* Of what it writes, and of its mode, which a test may change. */
static bool move_takes_two(const struct experiment *e, const struct test_move *m)
{
    const struct controller_loop loop = controllers_loop(e, (size_t)m->loop->id - 1);
    const struct apc_tag *to = m->tag.table == APC_MANUAL ? controllers_output(e, loop) : &m->tag;
    const struct signal *of = to->table == APC_SETPOINT ? &e->z[to->id - 1] : &e->u[to->id - 1];
    return loop.of->second > 0.0 || of->second > 0.0;
}

static int find_move(struct test *z, const char *name, struct test_move *m, struct apc_error *why)
{
    struct test_bench *b = &z->bench;
    int rc = action_find(&z->e, b->tags, b->n_tags, name, true, &m->tag, why);

    if (rc < 0)
        return rc;
    if (m->tag.table == APC_MANUAL || m->tag.table == APC_SETPOINT)
        m->loop = loops_of(&b->loops, m->tag.table, m->tag.id);
    if (!m->loop)
        return apc_fail(why, APC_EINVAL,
                        "\"%s\" is neither an output nor the setpoint of a loop: those can be moved", name);
    m->name = m->tag.table == APC_MANUAL ? m->loop->name : m->tag.name;
    if (z->own.live && move_takes_two(&z->e, m))
        return apc_fail(
            why, APC_EPERM,
            "%s needs two persons, and a test has one: take second_person out of the file for the test",
            m->name);
    for (const struct test_move *other = z->move; other < m; other++)
        if (other->loop == m->loop)
            return apc_fail(why, APC_EINVAL, "%s and %s are of one loop: move one of them", other->name,
                            m->name);
    return 0;
}

static int find_moves(struct test *z, struct apc_error *why)
{
    int rc = 0;

    if (z->own.moves == 0) /* all that goes to the plant */
        for (size_t i = 0; i < z->e.dim.nu && i < TEST_SIGNALS; i++)
            z->own.move[z->own.moves++] = z->e.u[i].tag.name;
    for (size_t i = 0; i < z->own.moves && rc == 0; i++)
        rc = find_move(z, z->own.move[i], &z->move[z->moves++], why);
    if (rc == 0 && z->own.kind == TEST_RELAY && z->moves > 1)
        return apc_fail(why, APC_EINVAL, "a relay moves one output at a time: name it by --move");
    if (rc == 0 && z->own.kind == TEST_RELAY && z->move[0].tag.table != APC_MANUAL)
        return apc_fail(why, APC_EINVAL,
                        "%s is a setpoint: a relay moves an output, in the place of its loop",
                        z->move[0].name);
    if (rc == 0 && z->own.kind == TEST_RELAY && !z->move[0].loop->measurement)
        return apc_fail(why, APC_EINVAL, "the loop of %s has no measurement for a relay to look at",
                        z->move[0].name);
    return rc;
}

static int name_amplitudes(struct test *z, struct apc_error *why)
{
    for (size_t i = 0; i < z->own.amplitudes; i++) {
        const char *name = z->own.amplitude[i].name;
        bool found = false;
        for (size_t k = 0; k < z->moves; k++)
            if (!*name || !strcmp(name, z->move[k].name)) {
                z->move[k].amplitude = z->own.amplitude[i].value;
                found = true;
            }
        if (!found)
            return apc_fail(why, APC_ENOTFOUND, "--amplitude %s: that is not moved", name);
    }
    return 0;
}

static int name_guards(struct test *z, struct apc_error *why)
{
    for (size_t i = 0; i < z->e.dim.ny; i++) {
        const struct signal *y = &z->e.y[i];
        const bool soft = y->soft_low > -HUGE_VAL || y->soft_high < HUGE_VAL;
        z->guard[i] = (struct test_guard){.low = soft ? y->soft_low : y->tag.low,
                                          .high = soft ? y->soft_high : y->tag.high};
    }
    for (size_t i = 0; i < z->own.guards; i++) {
        size_t k = 0;
        while (k < z->e.dim.ny && strcmp(z->e.y[k].tag.name, z->own.guard[i].name) != 0)
            k++;
        if (k == z->e.dim.ny)
            return apc_fail(why, APC_ENOTFOUND, "--guard %s: there is no such measurement",
                            z->own.guard[i].name);
        z->guard[k].low = z->own.guard[i].value;
        z->guard[k].high = z->own.guard[i].high;
    }
    for (size_t i = 0; i < z->e.dim.ny && z->own.live; i++)
        if (!(z->guard[i].low > -APC_VALUE_MAX && z->guard[i].high < APC_VALUE_MAX))
            return apc_fail(why, APC_EINVAL,
                            "%s has no limits in the file, and nothing would end the test of a live plant: "
                            "give --guard %s=LOW..HIGH",
                            z->e.y[i].tag.name, z->e.y[i].tag.name);
    return 0;
}

/* ---- What the file's model says -------------------------------------------------------------- */

struct linearised {
    double *memory, *x, *u, *a, *b, *c, *d, *manipulated, *direct, *gain;
    double complex *pole;
};

static int linearise(const struct test *z, struct linearised *l)
{
    const struct apc_model *m = z->e.plant.model;
    const size_t nx = m->nx, nu = m->nu, all = nu + m->nd, ny = m->ny;
    struct apc_error why;
    int rc = linear_load(&why);

    l->memory = calloc(nx + all + nx * nx + nx * all + ny * nx + ny * all + nx * nu + 2 * ny * nu + 1,
                       sizeof *l->memory);
    l->pole = calloc(nx + 1, sizeof *l->pole);
    if (rc < 0 || !l->memory || !l->pole)
        return rc < 0 ? rc : APC_ENOMEM;
    l->x = l->memory;
    l->u = l->x + nx;
    l->a = l->u + all;
    l->b = l->a + nx * nx;
    l->c = l->b + nx * all;
    l->d = l->c + ny * nx;
    l->manipulated = l->d + ny * all;
    l->direct = l->manipulated + nx * nu;
    l->gain = l->direct + ny * nu;
    for (size_t i = 0; i < nx; i++)
        l->x[i] = z->e.plant.x0 ? z->e.plant.x0[i] : m->state ? m->state[i].initial : 0.0;
    for (size_t i = 0; i < all; i++)
        l->u[i] = i < nu && isfinite(z->e.u[i].initial) ? z->e.u[i].initial
                  : i < nu                              ? (m->input ? m->input[i].initial : 0.0)
                  : m->disturbance                      ? m->disturbance[i - nu].initial
                                                        : 0.0;
    (void)apc_model_equilibrium(m, z->e.plant.p, l->u, l->x, &why); /* else where it begins */
    rc = apc_model_linearize(m, z->e.plant.p, l->x, l->u, l->a, l->b, l->c, l->d, &why);
    for (size_t i = 0; i < nx * nu; i++)
        l->manipulated[i] = l->b[i / nu * all + i % nu];
    for (size_t i = 0; i < ny * nu; i++)
        l->direct[i] = l->d[i / nu * all + i % nu];
    return rc;
}

/* The time in which all that decays has, and the gains to each measurement. */
static int ask_model(struct test *z, struct apc_error *why)
{
    const struct apc_model *m = z->e.plant.model;
    struct linearised l = {.memory = NULL};
    double slowest = HUGE_VAL, fastest = 0.0;
    bool unstable = false;

    if (!m || linearise(z, &l) < 0)
        goto out;
    const struct linear sys = {m->nx, m->nu, m->ny, l.a, l.manipulated, l.c, l.direct};
    if (linear_poles(&sys, l.pole) < 0)
        goto out;
    for (size_t i = 0; i < m->nx; i++)
        fastest = fmax(fastest, apc_cabs(l.pole[i]));
    for (size_t i = 0; i < m->nx; i++) {
        unstable |= creal(l.pole[i]) > 1e-9 * fastest;
        if (creal(l.pole[i]) < -1e-9 * fastest)
            slowest = fmin(slowest, -creal(l.pole[i]));
    }
    if (isfinite(slowest) && z->settling <= 0.0) {
        z->settling = 4.0 / slowest + z->e.plant.options.dead_time;
        z->settled_by = "of the file's model";
    }
    for (size_t k = 0; k < z->moves && linear_gain(&sys, l.gain) == 0 && !unstable; k++)
        for (size_t i = 0; z->move[k].loop->table == APC_ACTUATOR && i < m->ny; i++)
            z->move[k].gain[i] = z->move[k].tag.table == APC_MANUAL
                                     ? l.gain[i * m->nu + (size_t)z->move[k].loop->output - 1]
                                     : (double)NAN;
out:
    free(l.memory);
    free(l.pole);
    for (size_t k = 0; k < z->moves && unstable; k++)
        if (z->move[k].tag.table == APC_MANUAL && z->own.kind != TEST_RELAY)
            return apc_fail(
                why, APC_EINVAL,
                "the plant does not stay where it is by itself, so %s cannot be left in Man: move "
                "the setpoint of its loop, by --move",
                z->move[k].name);
    return 0;
}

/* ---- How long -------------------------------------------------------------------------------- */

static int find_times(struct test *z, struct apc_error *why)
{
    const double duration = z->own.duration > 0.0 ? z->own.duration : SETTLINGS * z->settling;
    const double bit = z->own.to > 0.0 ? 0.44 / z->own.to : z->settling / BITS;
    const double samples = duration / z->Ts;

    if (!(samples >= 40.0 && samples <= SAMPLES))
        return apc_fail(
            why, APC_EINVAL,
            "a test of %g s has %.0f samples of %g s: must be 40 to %d; see --settling and --duration",
            duration, samples, z->Ts, SAMPLES);
    z->n = (size_t)samples;
    z->rest = (size_t)ceil(2.0 * z->settling / z->Ts);
    z->lead = (size_t)ceil(0.25 * z->settling / z->Ts) + 2;
    if (z->own.live)
        z->rest = (size_t)fmax(ceil(0.25 * z->settling / z->Ts), 20.0);
    z->hold = (size_t)fmax(round(bit / z->Ts), 1.0);
    for (z->order = 2; z->order < 10;) { /* the longest that fits, or that reaches down to the band */
        const double period = (double)(((size_t)2 << z->order) - 1) * (double)z->hold;
        if (period > samples || (z->own.from > 0.0 && period * z->Ts > 2.0 / z->own.from))
            break;
        z->order++;
    }
    if (z->own.kind == TEST_PRBS) {
        const size_t period = (((size_t)1 << z->order) - 1) * z->hold;
        z->n = (size_t)fmax(round(samples / (double)period), 1.0) * period;
    }
    return 0;
}

int test_plan(struct test *z, struct apc_error *why)
{
    int rc = find_moves(z, why);

    z->gains = calloc(z->moves * z->e.dim.ny + 1, sizeof *z->gains);
    z->guard = calloc(z->e.dim.ny + 1, sizeof *z->guard);
    if (rc == 0 && (!z->gains || !z->guard))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k < z->moves && rc == 0; k++) {
        z->move[k].gain = z->gains + k * z->e.dim.ny;
        for (size_t i = 0; i < z->e.dim.ny; i++)
            z->move[k].gain[i] = (double)NAN;
    }
    if (rc == 0 && (rc = name_amplitudes(z, why)) == 0 && (rc = name_guards(z, why)) == 0) {
        z->settling = z->own.settling;
        z->settled_by = "as given";
        rc = ask_model(z, why);
    }
    if (rc == 0 && z->settling <= 0.0) {
        z->settling = PERIODS * z->Ts;
        z->settled_by = "a guess, sixty periods of the controller: --settling says it better";
    }
    return rc < 0 ? rc : find_times(z, why);
}

/* ---- How far --------------------------------------------------------------------------------- */

/* By which factor what is expected of measurement @p i would have to change. */
static double fitting_factor(const struct test *z, size_t i, double *noise_factor)
{
    const struct test_guard *g = &z->guard[i];
    double expected = 0.0;

    for (size_t k = 0; k < z->moves; k++)
        expected += isnan(z->move[k].gain[i]) ? 0.0 : fabs(z->move[k].gain[i] * z->move[k].amplitude);
    if (!(expected > 0.0))
        return HUGE_VAL;
    *noise_factor = fmax(*noise_factor, OF_NOISE * g->noise / expected);
    return OF_ROOM * fmin(g->high - g->base, g->base - g->low) / expected;
}

static int propose(struct test_move *m, struct apc_error *why)
{
    if (!(m->tag.low > -APC_VALUE_MAX && m->tag.high < APC_VALUE_MAX))
        return apc_fail(why, APC_EINVAL,
                        "%s has no limits in the file, so that no amplitude can be proposed: "
                        "give --amplitude %s=X",
                        m->name, m->name);
    m->amplitude = OF_RANGE * (m->tag.high - m->tag.low);
    return 0;
}

int test_plan_amplitudes(struct test *z, struct apc_error *why)
{
    double factor = HUGE_VAL, noise = 0.0;
    bool proposed[TEST_SIGNALS] = {false};

    for (size_t k = 0; k < z->moves; k++) {
        proposed[k] = !(z->move[k].amplitude > 0.0);
        if (proposed[k] && propose(&z->move[k], why) < 0)
            return APC_EINVAL;
    }
    for (size_t i = 0; i < z->e.dim.ny; i++)
        factor = fmin(factor, fitting_factor(z, i, &noise));
    factor = fmin(factor, fmin(fmax(noise, 1.0), GREATER));
    for (size_t k = 0; k < z->moves; k++) {
        struct test_move *m = &z->move[k];
        const double room = fmin(m->tag.high - m->base, m->base - m->tag.low);
        if (proposed[k])
            m->amplitude = fmin(m->amplitude * factor, 0.9 * room);
        if (!(m->amplitude > 1e-6 * fabs(m->base)) || m->amplitude > room)
            return apc_fail(why, APC_ERANGE,
                            "%s is %g, and may be %g to %g: it cannot be moved by %g to both sides. Move the "
                            "plant to where it has room first%s",
                            m->name, m->base, m->tag.low, m->tag.high, m->amplitude,
                            proposed[k] ? "" : ", or give a smaller --amplitude");
    }
    return 0;
}

/* ---- The signals ----------------------------------------------------------------------------- */

/* Lines evenly spaced over the band; of several signals each its own ones. */
static int make_multisine(struct test *z, struct test_move *m, size_t number, struct apc_error *why)
{
    size_t period = (size_t)(5.0 * z->settling / z->Ts), first, last, every;

    if (z->own.from > 0.0)
        period = (size_t)ceil((double)z->moves / (z->own.from * z->Ts));
    period = period > z->n ? z->n : period;
    last = (size_t)((z->own.to > 0.0 ? z->own.to : 6.4 / z->settling) * (double)period * z->Ts);
    last = 2 * last + 2 > period ? (period - 2) / 2 : last;
    every = z->moves * (last / z->moves / LINES + 1);
    first = number + 1;
    if (last < first || apc_excite_multisine(first, last, every, m->level, period, NULL) < 0)
        return apc_fail(why, APC_EINVAL,
                        "no frequency lies in that band: a period of %g s has those from %g to %g Hz",
                        (double)period * z->Ts, 1.0 / ((double)period * z->Ts), 0.5 / z->Ts);
    for (size_t k = period; k < z->n; k++)
        m->level[k] = m->level[k - period];
    return 0;
}

int test_plan_levels(struct test *z, struct apc_error *why)
{
    const size_t bits = ((size_t)1 << z->order) - 1, share = z->n / z->moves;
    int rc = 0;

    z->levels = calloc(z->moves * z->n, sizeof *z->levels);
    if (!z->levels)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k < z->moves && rc == 0; k++) {
        struct test_move *m = &z->move[k];
        m->level = z->levels + k * z->n;
        if (z->own.kind == TEST_PRBS)
            (void)apc_excite_prbs(z->order, z->hold, k * bits / z->moves, m->level, z->n);
        else if (z->own.kind == TEST_STEPS) /* one after another */
            (void)apc_excite_steps((size_t)fmax(z->settling / z->Ts, 4.0), m->level + k * share, share);
        else if (z->own.kind == TEST_MULTISINE)
            rc = make_multisine(z, m, k, why);
    }
    return rc;
}

/* ---- Telling --------------------------------------------------------------------------------- */

void test_plan_print(const struct test *z)
{
    static const char *const kind[TEST_KINDS] = {"prbs", "steps", "multisine", "relay"};
    printf("%s: %.6g s", kind[z->own.kind], (double)z->n * z->Ts);
    if (z->own.kind == TEST_PRBS)
        printf(", %zu bits of %.6g s", ((size_t)1 << z->order) - 1, (double)z->hold * z->Ts);
    printf(", after %.6g s of rest; settling time %.4g s, %s\n", (double)(z->rest + z->lead) * z->Ts,
           z->settling, z->settled_by);
    printf("%-12s %-5s %-12s %s\n", "moves", "in", "around", "by");
    for (size_t k = 0; k < z->moves; k++)
        printf("%-12s %-5s %-12.6g %.4g\n", z->move[k].name,
               z->move[k].tag.table == APC_MANUAL ? "Man" : "Auto", z->move[k].base, z->move[k].amplitude);
    printf("%-12s %-12s %-12s %-12s %s\n", "guards", "from", "to", "now", "noise");
    for (size_t i = 0; i < z->e.dim.ny; i++) {
        const struct test_guard *g = &z->guard[i];
        char low[32] = "-", high[32] = "-";
        if (g->low > -APC_VALUE_MAX)
            snprintf(low, sizeof low, "%.6g", g->low);
        if (g->high < APC_VALUE_MAX)
            snprintf(high, sizeof high, "%.6g", g->high);
        printf("%-12s %-12s %-12s %-12.6g %.3g\n", z->e.y[i].tag.name, low, high, g->base, g->noise);
    }
}
