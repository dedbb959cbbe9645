/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Each law gives the same numbers and says the same, on each compiler, as long as nobody means it to be
 * otherwise: with settings and tunings that are not the usual ones, two or three of everything, and all that
 * may come from outside, at times of its own: what is measured, announced, Bad, not new, given by hand, away,
 * held back below, limited. All that an instance puts out, keeps and publishes is one number here. Who
 * changes a law on purpose takes the new one from what this test says, and tells why it is better.
 */
#include "apclinear.h"
#include "base/base_internal.h"
#include "laws.h"
#include "plant/plant_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDE = 4, STATES_MOST = 4096, AHEAD_MOST = 64, PUBLISHED_MOST = 2048, TUNING_MOST = 64, TICKS = 130 };

/* What a law is tried in. */
struct world {
    const char *name;
    const struct apc_law *law;
    struct apc_dim dim;
    double Ts;
    struct apc_setting setting[18];            /* until one without a name */
    double y[WIDE], z[WIDE], d[WIDE], u[WIDE]; /* about which all of it moves */
    double by;                                 /* how far y does, of what it is */
    struct {
        size_t number;
        double value;
    } tuning[24]; /* others than the initial ones, until one that is 0 of number 0 */
    enum { NO_MODEL, TANKS, SAMPLED, REACTOR, TWO_LEVELS } model;
    double expected;
};

struct sum {
    double value;
    size_t n;
};

/* Each number counts by its leading digits, whatever its size. */
static void count(struct sum *sum, double value)
{
    const double weight = 1.0 + 0.618 * (double)(++sum->n % 7);

    sum->value += weight * (isfinite(value) ? asinh(1e3 * value) : 7.0);
}

static void count_all(struct sum *sum, const double *value, size_t n)
{
    for (size_t i = 0; i < n; i++)
        count(sum, value[i]);
}

static void count_text(struct sum *sum, const char *text)
{
    count(sum, (double)apc_hash(APC_HASH_BEGIN, text, strlen(text)) / 4294967296.0);
}

/* ---- Models ----------------------------------------------------------------------------------------- */

/* Two tanks over two others, with a leak that is measured, and a third level. */
static const double A[] = {-0.016, 0, 0.042, 0, 0, -0.011, 0, 0.033, 0, 0, -0.042, 0, 0, 0, 0, -0.033},
                    B[] = {0.083, 0, -0.02, 0, 0.063, 0.01, 0, 0.048, 0, 0.031, 0, -0.03},
                    B_u[] = {0.083, 0, 0, 0.063, 0, 0.048, 0.031, 0},
                    C[] = {0.5, 0, 0, 0, 0, 0.5, 0, 0, 0.1, 0, 0.5, 0}, D[9] = {0.0},
                    x_rest[] = {12.0, 13.0, 1.6, 1.4}, u_rest[] = {3.0, 3.2, 0.1}, y_rest[] = {6.0, 6.5, 2.0};

struct model {
    struct apc_law_plant plant;
    struct apc_linear *sampled;
    double A[16], B[24], C[12], D[12], B_u[8], D_u[8], x[4], u[4], y[4];
    size_t disturbance[2];
};

/* The equations' own linear model at rest; columns of u, and of the disturbances that are measured. */
static void linearise(struct model *m, const struct world *w, const struct apc_model *of, const double *u,
                      const double *x)
{
    const size_t nx = of->nx, all = of->nu + of->nd, own = of->nu + w->dim.nd;
    struct apc_error why;

    memcpy(m->u, u, all * sizeof *u);
    memcpy(m->x, x, nx * sizeof *x);
    assert_int_equal(apc_model_equilibrium(of, NULL, m->u, m->x, &why), 0);
    assert_int_equal(apc_model_linearize(of, NULL, m->x, m->u, m->A, m->B, m->C, m->D, &why), 0);
    assert_int_equal(apc_model_evaluate(of, NULL, m->x, m->u, NULL, m->y, &why), 0);
    m->disturbance[0] = of->nd - 1;
    for (size_t j = 0; j < own; j++) {
        const size_t from = j < of->nu ? j : of->nu + m->disturbance[j - of->nu];

        for (size_t i = 0; i < nx; i++)
            m->B_u[i * own + j] = m->B[i * all + from];
        for (size_t i = 0; i < of->ny; i++)
            m->D_u[i * own + j] = m->D[i * all + from];
        m->u[j] = m->u[from];
    }
    m->plant = (struct apc_law_plant){.nx = nx,
                                      .A = m->A,
                                      .B = m->B_u,
                                      .C = m->C,
                                      .D = m->D_u,
                                      .x0 = m->x,
                                      .u0 = m->u,
                                      .y0 = m->y,
                                      .model = of,
                                      .disturbance = m->disturbance};
}

static const struct apc_law_plant *make_model(struct model *m, const struct world *w)
{
    static const double late[] = {1.6, 0.0, 0.5};
    const double *b = w->dim.nd ? B : B_u;
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = 4,
                                               .nu = 2,
                                               .nd = w->dim.nd,
                                               .ny = w->dim.ny,
                                               .A = A,
                                               .B = b,
                                               .C = C,
                                               .x0 = x_rest,
                                               .u0 = u_rest,
                                               .y0 = y_rest,
                                               .dead_time = late};
    struct apc_error why;

    memset(m, 0, sizeof *m);
    switch (w->model) {
    case NO_MODEL:
        return NULL;
    case REACTOR:
        linearise(m, w, &apc_model_adiabatic_cstr, (const double[]){500.0, 0.8, 1.2, 0.5},
                  (const double[]){0.515, 0.63, 38.6});
        return &m->plant;
    case TWO_LEVELS:
        linearise(m, w, &apc_model_double_tank, (const double[]){10.0, 0.0}, (const double[]){0.5, 0.5});
        return &m->plant;
    default:
        break;
    }
    m->plant = (struct apc_law_plant){
        .nx = 4, .A = A, .B = b, .C = C, .D = D, .x0 = x_rest, .u0 = u_rest, .y0 = y_rest};
    if (w->model == SAMPLED) {
        assert_int_equal(apc_linear_from_continuous(&m->sampled, &from, w->Ts, &why), 0);
        m->plant = (struct apc_law_plant){.D = D, .u0 = u_rest, .y0 = y_rest, .sampled = m->sampled};
    }
    return &m->plant;
}

/* ---- What comes from outside ------------------------------------------------------------------------ */

struct rig {
    const struct world *w;
    struct apc_signal_view signal[4][WIDE];
    char name[4][WIDE][8];
    struct model model;
    struct apc_law_setup setup;
    struct apc_instances *law;
    struct apc_law_call c;
    struct apc_random random;
    double y[WIDE], age[WIDE], z[AHEAD_MOST * WIDE], d[AHEAD_MOST * WIDE], u[WIDE], u_last[WIDE], low[WIDE],
        high[WIDE], rate[WIDE], y_low[WIDE], y_high[WIDE], x[STATES_MOST], tuning[TUNING_MOST],
        published[PUBLISHED_MOST];
    apc_status status[WIDE];
    bool is_new[WIDE];
    enum apc_law_output out[WIDE];
    unsigned limited[WIDE], y_limited[WIDE];
    char why[APC_LAW_WHY];
};

static void name_signals(struct rig *r)
{
    static const char letter[] = "yzud";
    const struct world *w = r->w;
    const double *about[] = {w->y, w->z, w->u, w->d};

    for (size_t kind = 0; kind < 4; kind++) {
        for (size_t i = 0; i < WIDE; i++) {
            snprintf(r->name[kind][i], sizeof r->name[kind][i], "%c%zu", letter[kind], i + 1);
            r->signal[kind][i] = (struct apc_signal_view){.name = r->name[kind][i],
                                                          .unit = i ? "V" : "m",
                                                          .low = -0.1 * about[kind][i],
                                                          .high = 2.0 * about[kind][i],
                                                          .rate = HUGE_VAL,
                                                          .soft_low = -HUGE_VAL,
                                                          .soft_high = HUGE_VAL};
        }
    }
}

static double wave(double t, size_t i)
{
    return sin(0.11 * t + 1.3 * (double)i) + 0.4 * sin(0.37 * t + (double)i);
}

/* Tick k: what is measured, announced, and who has the outputs. */
static void come_in(struct rig *r, int k)
{
    const struct world *w = r->w;
    const size_t nz = w->dim.nz, nd = w->dim.nd;

    for (size_t i = 0; i < w->dim.ny; i++) {
        r->y[i] = w->y[i] * (1.0 + w->by * (wave(k * w->Ts, i) + 0.2 * apc_random_normal(&r->random)));
        r->is_new[i] = apc_random_uniform(&r->random) < 0.8;
        r->status[i] = (k >= 40 && k < 52 && i == 0) || (k >= 72 && k < 74 && i + 1 == w->dim.ny)
                           ? APC_BAD_SENSOR_FAILURE
                           : APC_GOOD;
        r->age[i] = r->is_new[i] ? 0.1 : w->Ts;
        r->y_limited[i] = 0;
        r->y_low[i] = k >= 104 ? w->y[i] * (1.0 - 0.4 * w->by) : -HUGE_VAL;
        r->y_high[i] = k >= 100 && k < 116 ? w->y[i] * (1.0 + 0.3 * w->by) : HUGE_VAL;
    }
    for (size_t row = 0; row < r->c.n_ahead; row++) {
        const int then = k + (int)row;

        for (size_t i = 0; i < nz; i++)
            r->z[row * nz + i] = w->z[i] * (1.0 + w->by * (then >= 15 + 6 * (int)i ? 0.8 : 0.0) -
                                            (then >= 90 ? 2 * w->by : 0.0));
        for (size_t i = 0; i < nd; i++)
            r->d[row * nd + i] = w->d[i] * (1.0 + 0.3 * wave(1.7 * k * w->Ts, i));
    }
    for (size_t j = 0; j < w->dim.nu; j++) {
        r->out[j] = (j == 0 && k >= 25 && k < 33) || (k >= 60 && k < 64) ? APC_OUT_GIVEN : APC_OUT_LAW;
        r->limited[j] = k >= 80 && k < 84 ? APC_LIMITED_LOW : k >= 84 && k < 88 ? APC_LIMITED_HIGH : 0u;
        r->low[j] = k < 96 ? 0.0 : 0.9 * w->u[j];
        r->high[j] = 1.6 * w->u[j];
        r->rate[j] = k < 110 ? HUGE_VAL : 0.02 * w->u[j] / w->Ts;
    }
}

static void count_state(struct rig *r, struct sum *sum)
{
    count_all(sum, r->x, apc_instances_size(r->law).states);
}

/* As a controller asks instance k of a loop: what is given is followed, else it acts. */
static void ask(struct rig *r, size_t k, int tick, struct sum *sum)
{
    const struct apc_instance_part *part = apc_instances_part(r->law, k);
    int result;

    if (r->out[part->u] == APC_OUT_GIVEN && !r->w->law->estimates) {
        r->c.gap = tick == 60;
        for (size_t j = part->u; j < part->u + part->nu; j++)
            r->u[j] = r->out[j] == APC_OUT_GIVEN ? r->w->u[j] * (1.02 + 0.01 * wave(tick, j)) : r->u_last[j];
        apc_instances_track(r->law, k, &r->c);
        count_state(r, sum);
        if (!r->w->law->whole)
            return;
        apc_instances_update(r->law, k, &r->c);
        return;
    }
    if ((r->c.gap = tick == 0 || tick == 62))
        apc_instances_track(r->law, k, &r->c);
    r->c.gap = false;
    result = apc_instances_compute(r->law, k, &r->c);
    count(sum, result);
    count_text(sum, r->why);
    count_all(sum, r->published + part->published, part->n);
    for (size_t j = part->u; j < part->u + part->nu; j++) {
        count(sum, r->limited[j]);
        if (result > APC_LAW_LATE)
            r->u[j] = r->u_last[j];
        count(sum, r->u[j]);
        if (r->out[j] == APC_OUT_GIVEN)
            r->u[j] = r->w->u[j] * (1.02 + 0.01 * wave(tick, j));
        r->u[j] = fmin(fmax(r->u[j], -1e6), 1e6);
        r->limited[j] = tick >= 80 && tick < 84   ? APC_LIMITED_LOW
                        : tick >= 84 && tick < 88 ? APC_LIMITED_HIGH
                                                  : 0u;
    }
    apc_instances_update(r->law, k, &r->c);
}

static void begin(struct rig *r, const struct world *w, struct sum *sum)
{
    struct apc_error why = {""};
    struct apc_instances_size size;

    memset(r, 0, sizeof *r);
    r->w = w;
    name_signals(r);
    r->setup = (struct apc_law_setup){.size = sizeof r->setup,
                                      .dim = w->dim,
                                      .Ts = w->Ts,
                                      .y = r->signal[0],
                                      .z = r->signal[1],
                                      .u = r->signal[2],
                                      .d = r->signal[3],
                                      .setting = w->setting,
                                      .plant = make_model(&r->model, w)};
    while (w->setting[r->setup.n_setting].name)
        r->setup.n_setting++;
    if (laws_make(&r->law, w->law, &r->setup, &why) < 0)
        fail_msg("%s: %s", w->name, why.text);
    size = apc_instances_size(r->law);
    assert_in_range(size.states, 0, STATES_MOST);
    assert_in_range(size.n_ahead, 1, AHEAD_MOST);
    assert_in_range(size.published, 0, PUBLISHED_MOST);
    assert_in_range(size.tuning, 0, TUNING_MOST);
    count(sum, (double)size.states);
    count(sum, (double)size.n_ahead);
    count(sum, (double)size.published);
    for (size_t i = 0; i < size.tuning; i++)
        r->tuning[i] = w->law->tuning[apc_instances_parameter(r->law, i).number].initial;
    for (size_t i = 0; w->tuning[i].number || w->tuning[i].value != 0.0; i++) {
        assert_true(w->tuning[i].number < size.tuning);
        r->tuning[w->tuning[i].number] = w->tuning[i].value;
    }
    for (size_t k = 0; k < size.instances; k++) {
        const struct apc_instance_part *part = apc_instances_part(r->law, k);

        for (size_t i = 0; i < part->n_published; i++) {
            count_text(sum, part->what[i].name);
            count_text(sum, part->what[i].unit ? part->what[i].unit : "");
            count_text(sum, part->what[i].description ? part->what[i].description : "");
            count(sum, (double)part->what[i].length);
            count(sum, part->what[i].step);
        }
    }
    r->c = (struct apc_law_call){.size = sizeof r->c,
                                 .dim = w->dim,
                                 .Ts = w->Ts,
                                 .y = r->y,
                                 .z = r->z,
                                 .tuning = r->tuning,
                                 .x = r->x,
                                 .u = r->u,
                                 .limited = r->limited,
                                 .y_status = r->status,
                                 .y_age = r->age,
                                 .y_new = r->is_new,
                                 .d = r->d,
                                 .n_ahead = size.n_ahead,
                                 .low = r->low,
                                 .high = r->high,
                                 .rate = r->rate,
                                 .y_low = r->y_low,
                                 .y_high = r->y_high,
                                 .u_last = r->u_last,
                                 .out = r->out,
                                 .published = r->published,
                                 .why = r->why,
                                 .y_limited = r->y_limited,
                                 .budget = 0.5};
    memcpy(r->u, w->u, sizeof r->u);
    for (size_t j = 0; j < WIDE; j++)
        r->u_last[j] = (double)NAN;
    apc_random_init(&r->random, 20261127u, w->name);
}

/* What it is about the point that all of it moves about; some are not linear there, and say so. */
static void count_linear(struct rig *r, struct sum *sum)
{
    const struct world *w = r->w;
    struct apc_law_linear *l = NULL;
    struct apc_error why = {""};

    count(sum, apc_law_linearize(&l, w->law, &r->setup, r->tuning, w->y, w->z, w->d, w->u, &why));
    count_text(sum, why.text);
    if (!l)
        return;
    count(sum, (double)l->nx);
    count_all(sum, l->A, l->nx * l->nx);
    count_all(sum, l->B, l->nx * l->n_in);
    count_all(sum, l->C, l->nu * l->nx);
    count_all(sum, l->D, l->nu * l->n_in);
    free(l);
}

static void count_parts(struct rig *r, struct sum *sum)
{
    struct apc_pair pair[WIDE];

    assert_int_equal(apc_law_pairing(r->w->law, &r->setup, pair, NULL), 0);
    for (size_t j = 0; j < r->w->dim.nu; j++) {
        count(sum, (double)pair[j].measurement);
        count(sum, (double)pair[j].setpoint);
    }
    for (size_t i = 0; i < apc_instances_size(r->law).tuning; i++) {
        const struct apc_law_parameter p = apc_instances_parameter(r->law, i);

        count(sum, (double)p.scope);
        count(sum, (double)p.of);
        count(sum, (double)p.number);
    }
}

static struct sum sum_of(const struct world *w)
{
    static struct rig r;
    struct sum sum = {0.0, 0};
    struct apc_error why;

    begin(&r, w, &sum);
    if (apc_instances_check(r.law, r.tuning, &why) < 0)
        fail_msg("%s: %s", w->name, why.text);
    count_parts(&r, &sum);
    if (w->law != &apc_law_nmpc) /* which takes seconds for it */
        count_linear(&r, &sum);
    for (int k = 0; k < TICKS; k++) {
        const size_t instances = apc_instances_size(r.law).instances;

        r.c.tick = (uint64_t)k;
        r.c.t = k * w->Ts;
        come_in(&r, k);
        for (size_t i = 0; i < instances && k == 0; i++)
            apc_instances_reset(r.law, i, &r.c);
        if (k == 0)
            memcpy(r.u_last, r.u, sizeof r.u);
        for (size_t i = 0; i < instances; i++)
            ask(&r, i, k, &sum);
        count_state(&r, &sum);
        for (size_t i = 0; i < w->dim.ny; i++)
            count(&sum, r.y_limited[i]);
        memcpy(r.u_last, r.u, sizeof r.u);
        for (size_t i = 0; i < apc_instances_size(r.law).tuning && k == 55; i++)
            r.tuning[i] = fabs(r.tuning[i]) < 1e6 ? 0.9 * r.tuning[i] : r.tuning[i];
    }
    laws_end(NULL);
    apc_linear_destroy(r.model.sampled);
    return sum;
}

/* ---- The worlds ------------------------------------------------------------------------------------- */

static const struct world worlds[] = {
    {.name = "pi",
     .law = &apc_law_pi,
     .dim = {2, 2, 2, 0},
     .Ts = 0.5,
     .y = {5.0, 7.0},
     .z = {5.2, 6.9},
     .u = {4.0, 3.0},
     .by = 0.1,
     .tuning = {{0, 1.5}, {1, 4.0}, {2, 3.9}, {3, 3.0}, {4, 4.8}, {5, -0.7}, {6, 9.0}, {7, 3.1}},
     .expected = 11817.451102237},
    {.name = "pid, paired the other way round, fed forward from a measurement and a disturbance",
     .law = &apc_law_pid,
     .dim = {3, 2, 2, 1},
     .Ts = 0.5,
     .setting = {ROW("measurement", 2, 1), ROW("setpoint", 1, 2), ROW("feed_forward", 3, 4)},
     .y = {5.0, 7.0, 2.0},
     .z = {7.2, 4.9},
     .d = {1.5},
     .u = {4.0, 3.0},
     .by = 0.1,
     .tuning = {{0, 1.5},  {1, 4.0},  {2, 2.0},  {3, 6.0},  {4, 0.7},  {5, 0.2},   {6, 3.0},
                {7, 3.9},  {8, 3.0},  {9, 5.1},  {10, 1.0}, {11, 0.3}, {12, -0.8}, {13, 7.0},
                {14, 1.0}, {16, 0.5}, {19, 3.0}, {20, 2.0}, {21, 4.4}, {22, 0.8},  {23, -0.2}},
     .expected = 38614.043913548},
    {.name = "pid, without an integral",
     .law = &apc_law_pid,
     .dim = {2, 2, 2, 0},
     .Ts = 0.5,
     .y = {5.0, 7.0},
     .z = {5.2, 6.9},
     .u = {4.0, 3.0},
     .by = 0.1,
     .tuning = {{0, 1.5}, {1, 0.0}, {2, 1.0}, {6, 2.5}, {7, 4.0}, {12, -0.8}, {13, 0.0}, {19, 3.0}},
     .expected = 34248.691369542},
    {.name = "cascade",
     .law = &apc_law_cascade,
     .dim = {4, 2, 2, 0},
     .Ts = 0.5,
     .setting = {ROW("outer", 2, 1), ROW("inner", 3, 4), ROW("setpoint", 2, 1)},
     .y = {5.0, 7.0, 2.0, 3.0},
     .z = {5.1, 7.2},
     .u = {4.0, 3.0},
     .by = 0.1,
     .tuning = {{0, 0.6},  {1, 9.0},  {4, 0.8},  {6, 4.0},   {7, 2.0},  {8, 1.5},  {9, 2.6},
                {10, 0.2}, {11, 1.5}, {12, 3.0}, {13, 0.4},  {17, 2.0}, {18, 4.0}, {19, 3.0},
                {20, 5.0}, {22, 0.5}, {29, 3.0}, {33, -0.9}, {34, 5.0}, {40, 3.0}, {43, 0.7}},
     .expected = 63868.294251645},
    {.name = "filter",
     .law = &apc_law_filter,
     .dim = {3, 0, 2, 0},
     .Ts = 0.5,
     .y = {5.0, 7.0, 1.0},
     .u = {5.0, 7.0},
     .by = 0.1,
     .tuning = {{0, 2.0}, {1, 4.6}, {2, 5.4}, {3, 5.0}},
     .expected = 23136.619333961},
    {.name = "leadlag",
     .law = &apc_law_leadlag,
     .dim = {2, 0, 2, 1},
     .Ts = 0.5,
     .y = {5.0, 7.0},
     .d = {2.0},
     .u = {5.0, 7.0},
     .by = 0.1,
     .tuning = {{0, 1.3}, {1, 3.0}, {2, 4.0}, {3, 1.0}, {4, -0.7}, {5, 0.5}, {6, 2.0}, {7, 9.0}},
     .expected = 26001.107831262},
    {.name = "ramp",
     .law = &apc_law_ramp,
     .dim = {2, 2, 2, 0},
     .Ts = 0.5,
     .y = {5.0, 7.0},
     .z = {5.0, 7.0},
     .u = {5.0, 7.0},
     .by = 0.1,
     .tuning = {{0, 0.05}, {1, 4.8}, {2, 5.2}, {3, 0.2}},
     .expected = 21912.415715689},
    {.name = "select, the least",
     .law = &apc_law_select,
     .dim = {4, 0, 2, 0},
     .Ts = 0.5,
     .setting = {{.name = "select", .text = "low"}, ROWS("inputs", 2, 1, 3, 4, 2)},
     .y = {5.0, 5.1, 5.2, 4.9},
     .u = {5.0, 5.0},
     .by = 0.1,
     .expected = 22719.964458513},
    {.name = "select, the greatest of all",
     .law = &apc_law_select,
     .dim = {3, 0, 1, 0},
     .Ts = 0.5,
     .setting = {{.name = "select", .text = "high"}},
     .y = {5.0, 5.1, 5.2},
     .u = {5.0},
     .by = 0.1,
     .expected = 13840.812238868},
    {.name = "split",
     .law = &apc_law_split,
     .dim = {2, 0, 3, 0},
     .Ts = 0.5,
     .setting = {ROW("input", 2, 1, 2)},
     .y = {50.0, 40.0},
     .u = {50.0, 50.0, 50.0},
     .by = 0.3,
     .tuning = {{1, 45.0}, {2, 5.0}, {4, 30.0}, {5, 60.0}, {6, 90.0}, {7, 10.0}, {8, 38.0}},
     .expected = 20504.822383277},
    {.name = "lqg",
     .law = &apc_law_lqg,
     .dim = {2, 2, 2, 0},
     .Ts = 1.0,
     .y = {6.0, 6.5},
     .z = {6.0, 6.5},
     .u = {3.0, 3.2},
     .by = 0.05,
     .model = TANKS,
     .expected = 13846.890267916},
    {.name = "lqg, late, with a preview, three measurements and everything weighed",
     .law = &apc_law_lqg,
     .dim = {3, 2, 2, 0},
     .Ts = 1.0,
     .setting = {ROW("measurement", 2, 1), ROW("y_scale", 0.5, 0.2, 2.0), ROW("x_scale", 4.0, 5.0, 6.0, 0.0),
                 ROW("u_scale", 0.7, 1.6), ROW("y_noise", 0.1, 0.2, 0.3),
                 ROW("x_noise", 0.01, 0.02, 0.0, 0.03), ROW("u_noise", 0.2, 0.1), ROW("delay", 0.3),
                 ROW("setpoint_preview", 7.4)},
     .y = {6.0, 6.5, 2.0},
     .z = {6.5, 6.0},
     .u = {3.0, 3.2},
     .by = 0.05,
     .tuning = {{0, 2.5}, {1, 3.6}, {2, 4.0}, {3, 0.2}, {4, 2.0}, {5, 4.0}, {6, 0.5}, {7, 0.1}},
     .model = TANKS,
     .expected = 18532.675652291},
    {.name = "lqg, of a model that is sampled",
     .law = &apc_law_lqg,
     .dim = {3, 2, 2, 0},
     .Ts = 1.0,
     .setting = {ROW("y_scale", 0.5, 0.2, 2.0), ROW("x_scale", 4.0, 5.0, 6.0, 0.0),
                 ROW("setpoint_preview", 3.0)},
     .y = {6.0, 6.5, 2.0},
     .z = {6.0, 6.5},
     .u = {3.0, 3.2},
     .by = 0.05,
     .tuning = {{2, 5.0}},
     .model = SAMPLED,
     .expected = 13539.975282748},
    {.name = "mpc",
     .law = &apc_law_mpc,
     .dim = {2, 2, 2, 0},
     .Ts = 1.0,
     .y = {6.0, 6.5},
     .z = {6.0, 6.5},
     .u = {3.0, 3.2},
     .by = 0.05,
     .model = TANKS,
     .expected = 368801.983068162},
    {.name = "mpc, with everything set",
     .law = &apc_law_mpc,
     .dim = {3, 2, 2, 1},
     .Ts = 1.0,
     .setting = {ROW("horizon", 25), ROW("blocks", 1, 2, 3, 5), ROW("measurement", 2, 1),
                 ROW("rank", 2, 1, 3), ROW("terminal", 0), ROW("steady", 0), ROW("delay", 1.5, 0.3),
                 ROW("y_scale", 0.5, 0.2, 2.0), ROW("u_scale", 0.7, 1.6),
                 ROW("x_noise", 0.01, 0.02, 0.0, 0.03), ROW("d_noise", 0.2, 0.3),
                 ROW("y_noise", 0.1, 0.2, 0.3), ROW("hold", 5.0, 1.0, 2.0), ROW("critical", 0, 0, 1),
                 ROW("at_input", 2), ROW("at_output", 2), ROW("iterations", 200)},
     .y = {6.0, 6.5, 2.0},
     .z = {6.5, 6.0},
     .d = {0.1},
     .u = {3.0, 3.2},
     .by = 0.05,
     .tuning = {{0, 0.4},
                {1, 0.2},
                {2, 2.9},
                {3, 0.1},
                {4, 2.0},
                {5, 4.0},
                {6, 0.5},
                {7, 0.3},
                {12, 4.4},
                {13, 0.3},
                {14, 2.0},
                {15, 0.1},
                {19, 0.5},
                {20, 0.05},
                {21, 5.5},
                {22, 7.4}},
     .model = TANKS,
     .expected = 556376.043774262},
    {.name = "mpc, of a model that is sampled, without a preview",
     .law = &apc_law_mpc,
     .dim = {3, 2, 2, 1},
     .Ts = 1.0,
     .setting = {ROW("horizon", 15), ROW("setpoint_preview", 0), ROW("y_noise", 0.1, 0.2, 0.3),
                 ROW("at_output", 1, 3), ROW("x_noise", 0.01, 0.02, 0.03, 0.04), ROW("hold", 3.0, 3.0, 3.0)},
     .y = {6.0, 6.5, 2.0},
     .z = {6.0, 6.5},
     .d = {0.1},
     .u = {3.0, 3.2},
     .by = 0.05,
     .tuning = {{14, 0.8}, {18, 0.0}, {23, 0.6}},
     .model = SAMPLED,
     .expected = 343609.796113218},
    {.name = "nmpc, by itself",
     .law = &apc_law_nmpc,
     .dim = {1, 1, 1, 0},
     .Ts = 1.0,
     .y = {38.6},
     .z = {38.6},
     .u = {500.0},
     .by = 0.01,
     .model = REACTOR,
     .expected = 459990.145624308},
    {.name = "nmpc, with everything set",
     .law = &apc_law_nmpc,
     .dim = {1, 1, 1, 1},
     .Ts = 1.0,
     .setting = {ROW("horizon", 30), ROW("y_scale", 1.0), ROW("u_scale", 50.0), ROW("y_noise", 0.02),
                 ROW("x_noise", 0.0002, 0.0002, 0.005), ROW("d_noise", 0.05), ROW("at_input", 4),
                 ROW("delay", 2.4), ROW("steps", 4), ROW("newton", 3), ROW("blocks", 1, 1, 2, 4),
                 ROW("terminal", 1), ROW("iterations", 300), ROW("hold", 4.0)},
     .y = {38.6},
     .z = {38.6},
     .d = {0.5},
     .u = {500.0},
     .by = 0.01,
     .tuning = {{0, 0.5}, {6, 60.0}, {9, 36.0}},
     .model = REACTOR,
     .expected = 669997.770773974},
    {.name = "nmpc, above a loop",
     .law = &apc_law_nmpc,
     .dim = {2, 1, 1, 0},
     .Ts = 10.0,
     .setting = {ROW("horizon", 12), ROW("blocks", 1, 1, 3), ROWS("lower", 1, 2, 60.0, 80.0),
                 ROW("y_scale", 0.05, 0.1), ROW("y_noise", 0.001, 0.001), ROW("delay", 3.0), ROW("steps", 20),
                 ROW("at_output", 1)},
     .y = {0.4, 0.5},
     .z = {0.4},
     .u = {0.5},
     .by = 0.02,
     .model = TWO_LEVELS,
     .expected = 263855.044525730},
};

static void each_law_gives_the_same_numbers(void **state)
{
    size_t wrong = 0;
    (void)state;

    for (size_t i = 0; i < sizeof worlds / sizeof *worlds; i++) {
        const struct sum sum = sum_of(&worlds[i]);

        if (!(fabs(sum.value - worlds[i].expected) <= 1e-9 * (double)sum.n)) {
            print_message("%s: .expected = %.9f, of %zu numbers\n", worlds[i].name, sum.value, sum.n);
            wrong++;
        }
    }
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(each_law_gives_the_same_numbers, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
