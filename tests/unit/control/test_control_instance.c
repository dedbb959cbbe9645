/* SPDX-License-Identifier: BSD-3-Clause */
/* What runs a law for a controller: who sees what, and who is asked. */
#include "laws.h"

#include "apclinear.h"
#include "apcplant.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NY = 4, NZ = 3, NU = 2, ND = 2, AHEAD = 3 };

/* ---- A law that tells what it was shown ------------------------------------------------------ */

/* What instance k was made from, and its last call. */
static struct seen {
    struct apc_dim dim;
    size_t output;
    char text[32], names[64];
    double model[24], matrix[8];
    struct apc_law_call call;
    double y[NY], z[NZ * AHEAD], d[ND * AHEAD], tuning[8];
    int destroyed, fail; /* how often; create: 1 with self set, 2 without */
} seen[NU];

/* Output i: measurements 3 - i and i, setpoint i + 1, disturbance 1 - i. */
static int crossed(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                   struct apc_error *why)
{
    (void)setup, (void)why;
    *p = (struct apc_law_ports){.ny = 2,
                                .nz = 1,
                                .nd = 1,
                                .y = {3 - (int)output, (int)output},
                                .z = {(int)output + 1},
                                .d = {1 - (int)output}};
    return 0;
}

static const struct apc_published publishes[] = {{.name = "objective", .length = 0},
                                                 {.name = "path", .length = 3}};

/* Of one with two states: A, B, C, D, x0, u0, y0. */
static void keep_model(struct seen *s, const struct apc_law_plant *p)
{
    const double *const part[] = {p->A, p->B, p->C, p->D, p->x0, p->u0, p->y0};
    const size_t length[] = {4, 4, 4, 4, 2, 2, 2};
    double *to = s->model;

    assert_int_equal(p->nx, 2);
    for (size_t i = 0; i < 7; i++) {
        memcpy(to, part[i], length[i] * sizeof(*to));
        to += length[i];
    }
}

static int create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    const struct apc_setting *text = apc_setting_find(setup, "file"),
                             *matrix = apc_setting_find(setup, "matrix");
    struct seen *s = &seen[setup->output];

    assert_true(setup->size >= sizeof(*setup) && needs->size >= sizeof(*needs));
    s->dim = setup->dim;
    s->output = setup->output;
    if (setup->y)
        (void)snprintf(s->names, sizeof(s->names), "%s %s %s %s %s", setup->y[0].name, setup->y[1].name,
                       setup->z[0].name, setup->u[0].name, setup->d[0].name);
    if (setup->plant)
        keep_model(s, setup->plant);
    if (matrix)
        memcpy(s->matrix, matrix->value, matrix->rows * matrix->columns * sizeof(double));
    (void)snprintf(s->text, sizeof(s->text), "%s", text && text->text ? text->text : "");
    *self = s->fail == 2 ? NULL : s;
    needs->states = 2 + setup->output;
    needs->n_ahead = AHEAD - setup->output;
    needs->n_published = 1 + setup->output;
    needs->published = publishes;
    return s->fail ? apc_fail(why, APC_ENOTFOUND, "instance %zu wants more", setup->output + 1) : 0;
}

static void destroy(void *self)
{
    struct seen *s = self;

    assert_non_null(self);
    s->destroyed++;
}

static void look(struct apc_law_call *c)
{
    struct seen *s = c->self;

    s->call = *c;
    memcpy(s->y, c->y, c->dim.ny * sizeof(*c->y));
    memcpy(s->z, c->z, c->n_ahead * c->dim.nz * sizeof(*c->z));
    memcpy(s->d, c->d, c->n_ahead * c->dim.nd * sizeof(*c->d));
    memcpy(s->tuning, c->tuning, 7 * sizeof(*c->tuning));
}

/* u = 10 x0 + y0; x0 = -1 gives NaN, -2 breaks x, below that result - x0 - 3. */
static int compute(struct apc_law_call *c)
{
    look(c);
    c->u[0] = 10.0 * c->x[0] + c->y[0];
    c->limited[0] |= APC_LIMITED_LOW;
    if (c->published)
        c->published[0] = 100.0 + c->y[0];
    if (c->x[0] == -1.0)
        c->u[0] = (double)NAN;
    if (c->x[0] == -2.0)
        c->x[1] = (double)INFINITY;
    if (c->x[0] <= -3.0)
        (void)snprintf(c->why, APC_LAW_WHY, "said so");
    return c->x[0] <= -3.0 ? (int)(-c->x[0] - 3.0) : APC_LAW_GOOD;
}

static void fill(struct apc_law_call *c)
{
    look(c);
    assert_near(c->x[0], 0.0, 0.0);
    c->x[0] = c->y[0];
}

static void update(struct apc_law_call *c)
{
    look(c);
    c->x[1] += c->u[0];
}

static void track(struct apc_law_call *c)
{
    look(c);
    c->x[0] = c->u[0];
}

/* Refuses where the law's own parameter is above that of its output. */
static int check(const struct apc_law_setup *setup, const double *tuning, struct apc_error *why)
{
    assert_null(setup->setting);
    return tuning[0] > tuning[1]
               ? apc_fail(why, APC_ERANGE, "instance %zu does not like it", setup->output + 1)
               : 0;
}

static const struct apc_param params[] = {{"gain", "", "", 1.0, -1e6, 1e6},
                                          {"weight", "", "", 2.0, -1e6, 1e6},
                                          {"horizon", "", "", 0.5, -1e6, 1e6},
                                          {"zone", "", "", 3.0, -1e6, 1e6},
                                          {"slack", "", "", 4.0, -1e6, 1e6}};
static const enum apc_law_scope scopes[] = {APC_OF_OUTPUT, APC_OF_MEASUREMENT, APC_OF_LAW, APC_OF_MEASUREMENT,
                                            APC_OF_OUTPUT};
static const char *const known[] = {"file", "matrix", NULL};
static const struct apc_law telling = {.abi = APC_LAW_ABI,
                                       .name = "telling",
                                       .n_tuning = 5,
                                       .tuning = params,
                                       .scope = scopes,
                                       .reset = fill,
                                       .compute = compute,
                                       .update = update,
                                       .track = track,
                                       .settings = known,
                                       .ports = crossed,
                                       .create = create,
                                       .destroy = destroy,
                                       .check = check};

/* ---- A controller's call --------------------------------------------------------------------- */

struct rig {
    struct apc_instances *s;
    double y[NY], z[AHEAD * NZ], d[AHEAD * ND], tuning[1 + 2 * NU + 2 * NY], x[5], u[NU], published[5];
    double y_age[NY], y_low[NY], y_high[NY], low[NU], high[NU], rate[NU], u_last[NU];
    apc_status y_status[NY];
    bool y_new[NY];
    enum apc_law_output out[NU];
    unsigned limited[NU];
    char why[APC_LAW_WHY];
    struct apc_law_call c;
};

static const struct apc_law_setup plain = {.dim = {NY, NZ, NU, ND}, .Ts = 2.0};

static void make(struct rig *r, const struct apc_law_setup *setup)
{
    struct apc_error why = {""};

    memset(r, 0, sizeof(*r));
    memset(seen, 0, sizeof(seen));
    for (int i = 0; i < NY; i++) {
        r->y[i] = 1.0 + i;
        r->y_age[i] = 0.1 * i;
        r->y_low[i] = -i;
        r->y_high[i] = 50.0 + i;
        r->y_status[i] = i == 3 ? APC_BAD : APC_GOOD;
        r->y_new[i] = i == 0;
    }
    for (int i = 0; i < AHEAD * NZ; i++)
        r->z[i] = 100.0 * (i / NZ) + i % NZ;
    for (int i = 0; i < AHEAD * ND; i++)
        r->d[i] = 1000.0 * (i / ND) + i % ND;
    for (int i = 0; i < 1 + 2 * NU + 2 * NY; i++)
        r->tuning[i] = i;
    for (int i = 0; i < NU; i++) {
        r->low[i] = -10.0 - i;
        r->high[i] = 10.0 + i;
        r->rate[i] = 3.0 + i;
        r->u_last[i] = 7.0 + i;
        r->out[i] = i ? APC_OUT_GIVEN : APC_OUT_LAW;
        r->limited[i] = i ? APC_LIMITED_HIGH : 0;
    }
    r->c = (struct apc_law_call){.dim = setup->dim,
                                 .y = r->y,
                                 .z = r->z,
                                 .tuning = r->tuning,
                                 .x = r->x,
                                 .u = r->u,
                                 .limited = r->limited,
                                 .gap = true,
                                 .tick = 17,
                                 .t = 34.0,
                                 .y_status = r->y_status,
                                 .y_age = r->y_age,
                                 .y_new = r->y_new,
                                 .d = r->d,
                                 .n_ahead = AHEAD,
                                 .low = r->low,
                                 .high = r->high,
                                 .rate = r->rate,
                                 .y_low = r->y_low,
                                 .y_high = r->y_high,
                                 .u_last = r->u_last,
                                 .out = r->out,
                                 .published = r->published,
                                 .why = r->why,
                                 .budget = 1.25};
    if (laws_make(&r->s, &telling, setup, &why) < 0)
        fail_msg("%s", why.text);
}

/* ---- Who sees what --------------------------------------------------------------------------- */

/*
 * Promise(laws/instance-output-sees): An instance for each output sees what belongs to it and nothing else,
 *   and is asked by itself.
 */
static void an_instance_sees_what_belongs_to_its_output_and_no_more(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &plain);
    assert_int_equal(apc_instances_size(r.s).instances, NU);
    for (size_t k = 0; k < NU; k++) {
        const struct apc_law_call *c = &seen[k].call;
        const size_t y[] = {3 - k, k};

        assert_int_equal(apc_instances_compute(r.s, k, &r.c), APC_LAW_GOOD);
        assert_true(c->size >= sizeof(*c));
        assert_int_equal(c->dim.ny, 2);
        assert_int_equal(c->dim.nz, 1);
        assert_int_equal(c->dim.nu, 1);
        assert_int_equal(c->dim.nd, 1);
        assert_near(c->Ts, 2.0, 0.0);
        for (size_t i = 0; i < 2; i++) {
            assert_near(seen[k].y[i], r.y[y[i]], 0.0);
            assert_int_equal(c->y_status[i], r.y_status[y[i]]);
            assert_int_equal(c->y_new[i], r.y_new[y[i]]);
            assert_near(c->y_age[i], r.y_age[y[i]], 0.0);
            assert_near(c->y_low[i], r.y_low[y[i]], 0.0);
            assert_near(c->y_high[i], r.y_high[y[i]], 0.0);
            for (size_t j = 0; j < 2; j++) /* after the law's and its output's two */
                assert_near(seen[k].tuning[3 + 2 * i + j], (double)(5 + 2 * y[i] + j), 0.0);
        }
        assert_int_equal(c->n_ahead, AHEAD - k);
        for (size_t row = 0; row < c->n_ahead; row++) {
            assert_near(seen[k].z[row], 100.0 * (double)row + (double)k + 1.0, 0.0);
            assert_near(seen[k].d[row], 1000.0 * (double)row + 1.0 - (double)k, 0.0);
        }
        assert_near(seen[k].tuning[0], 0.0, 0.0);
        assert_near(seen[k].tuning[1], 1.0 + 2.0 * (double)k, 0.0);
        assert_near(seen[k].tuning[2], 2.0 + 2.0 * (double)k, 0.0);
        assert_near(c->low[0], r.low[k], 0.0);
        assert_near(c->high[0], r.high[k], 0.0);
        assert_near(c->rate[0], r.rate[k], 0.0);
        assert_near(c->u_last[0], r.u_last[k], 0.0);
        assert_int_equal(c->out[0], r.out[k]);
        assert_int_equal(r.limited[k], k ? APC_LIMITED_LOW | APC_LIMITED_HIGH : APC_LIMITED_LOW);
        assert_true(c->gap);
        assert_int_equal(c->tick, 17);
        assert_near(c->t, 34.0, 0.0);
        assert_near(apc_law_left(c), 1.25, 0.0);
    }
}

static void a_law_that_is_whole_sees_the_controllers_own(void **state)
{
    static struct apc_law whole; /* the instance ends after this function */
    struct apc_instance_part part;
    struct rig r;

    (void)state;
    make(&r, &plain);
    whole = telling;
    whole.whole = true;
    assert_int_equal(laws_make(&r.s, &whole, &plain, NULL), 0);
    assert_int_equal(apc_instances_size(r.s).instances, 1);
    part = *apc_instances_part(r.s, 0);
    assert_int_equal(part.nu, NU);
    assert_int_equal(apc_instances_compute(r.s, 0, &r.c), APC_LAW_GOOD);
    assert_int_equal(seen[0].call.dim.ny, NY);
    assert_ptr_equal(seen[0].call.y, r.y);
    assert_ptr_equal(seen[0].call.u, r.u);
    assert_ptr_equal(seen[0].call.x, r.x);
    assert_ptr_equal(seen[0].call.tuning, r.tuning);
    assert_ptr_equal(seen[0].call.out, r.out);
    assert_int_equal(apc_instances_ports(r.s, 1)->y[0], 2); /* what a page believes */
    assert_int_equal(apc_instances_ports(r.s, 1)->z[0], 2);
}

static void what_a_caller_does_not_know_is_not_there(void **state)
{
    const struct apc_law_call *c = &seen[1].call;
    struct rig r;

    (void)state;
    make(&r, &plain);
    r.c.y_status = NULL, r.c.y_age = NULL, r.c.y_new = NULL, r.c.low = NULL, r.c.high = NULL, r.c.rate = NULL;
    r.c.y_low = NULL, r.c.y_high = NULL, r.c.u_last = NULL, r.c.out = NULL, r.c.published = NULL,
    r.c.why = NULL;
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_GOOD);
    assert_true(!c->y_status && !c->y_age && !c->y_new && !c->low && !c->high && !c->rate && !c->y_low &&
                !c->y_high && !c->u_last && !c->out && !c->published);
    r.x[2] = -3.0 - (double)APC_LAW_INFEASIBLE; /* its words have a place all the same */
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_INFEASIBLE);
}

static void what_a_law_says_goes_where_the_call_of_that_time_wants_it(void **state)
{
    char line[APC_LAW_SAY];
    struct rig r;

    (void)state;
    make(&r, &plain);
    apc_instances_keep(r.s, &r.c);
    r.c.say = line;
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_GOOD);
    assert_ptr_equal(seen[1].call.say, line);
    r.c.say = NULL;
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_GOOD);
    assert_null(seen[1].call.say);
}

static void x_and_what_is_published_are_laid_out_one_after_another(void **state)
{
    const struct apc_instances_size expected = {
        .instances = 2, .states = 5, .tuning = 1 + 2 * NU + 2 * NY, .n_ahead = AHEAD, .published = 1 + 1 + 3};
    struct apc_instances_size size;
    struct apc_instance_part part;
    struct rig r;

    (void)state;
    make(&r, &plain);
    size = apc_instances_size(r.s);
    assert_memory_equal(&size, &expected, sizeof(size));
    part = *apc_instances_part(r.s, 1);
    assert_int_equal(part.u, 1);
    assert_int_equal(part.nu, 1);
    assert_int_equal(part.x, 2);
    assert_int_equal(part.states, 3);
    assert_int_equal(part.published, 1);
    assert_int_equal(part.n, 4);
    assert_int_equal(part.n_published, 2);
    assert_string_equal(part.what[1].name, "path");
    assert_int_equal(apc_instances_compute(r.s, 0, &r.c), APC_LAW_GOOD);
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_GOOD);
    assert_near(r.published[0], 104.0, 0.0);
    assert_near(r.published[1], 103.0, 0.0);
}

/* One that is asked alone moves nothing of the other's. */
/* Promise(laws/instance-output-sees) */
static void an_instance_is_asked_by_itself(void **state)
{
    struct rig r, before;

    (void)state;
    make(&r, &plain);
    for (int i = 0; i < 5; i++)
        r.x[i] = 0.5 + i;
    before = r;
    apc_instances_reset(r.s, 1, &r.c);
    assert_near(r.x[2], r.y[2], 0.0);
    assert_near(r.x[3], 0.0, 0.0);
    assert_near(r.x[4], 0.0, 0.0);
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_GOOD);
    assert_near(r.u[1], 10.0 * r.y[2] + r.y[2], 0.0);
    apc_instances_update(r.s, 1, &r.c);
    assert_near(r.x[3], r.u[1], 0.0);
    r.u[1] = 0.25;
    apc_instances_track(r.s, 1, &r.c);
    assert_near(r.x[2], 0.25, 0.0);
    assert_memory_equal(r.x, before.x, 2 * sizeof(r.x[0]));
    assert_near(r.u[0], before.u[0], 0.0);
    assert_near(r.published[0], 0.0, 0.0);
    assert_int_equal(r.limited[0], 0);
    assert_null(seen[0].call.y);
}

/* Everything but the call itself is the same twice: what is looked at, and where it is written. */
static void assert_same_answer(struct rig *kept, struct rig *plainly, size_t k)
{
    struct seen first;

    assert_int_equal(apc_instances_compute(kept->s, k, &kept->c), APC_LAW_GOOD);
    first = seen[k];
    assert_int_equal(apc_instances_compute(plainly->s, k, &plainly->c), APC_LAW_GOOD);
    assert_memory_equal(first.y, seen[k].y, sizeof(first.y));
    assert_memory_equal(first.z, seen[k].z, sizeof(first.z));
    assert_memory_equal(first.d, seen[k].d, sizeof(first.d));
    assert_memory_equal(first.tuning, seen[k].tuning, sizeof(first.tuning));
    assert_int_equal(first.call.tick, seen[k].call.tick);
    assert_near(first.call.t, seen[k].call.t, 0.0);
    assert_int_equal(first.call.gap, seen[k].call.gap);
    assert_memory_equal(kept->u, plainly->u, sizeof(kept->u));
    assert_memory_equal(kept->published, plainly->published, sizeof(kept->published));
}

static void move_on(struct rig *r, double by)
{
    for (int i = 0; i < NY; i++)
        r->y[i] += by;
    for (int i = 0; i < AHEAD * NZ; i++)
        r->z[i] -= by;
    for (int i = 0; i < AHEAD * ND; i++)
        r->d[i] *= by;
    for (int i = 0; i < 1 + 2 * NU + 2 * NY; i++)
        r->tuning[i] += 2.0 * by;
    for (int i = 0; i < 5; i++)
        r->x[i] = by;
    r->c.tick++;
    r->c.t += by;
    r->c.gap = !r->c.gap;
}

/* Numbers change where they stand; whether the call was kept shows in nothing. */
/* Promise(laws/instance-output-sees) */
static void a_call_that_is_kept_is_seen_as_one_that_is_not(void **state)
{
    struct rig kept, plainly;

    (void)state;
    make(&kept, &plain);
    make(&plainly, &plain);
    apc_instances_keep(kept.s, &kept.c);
    for (int i = 0; i < 4; i++) {
        for (size_t k = 0; k < NU; k++)
            assert_same_answer(&kept, &plainly, k);
        move_on(&kept, 1.5 + i);
        move_on(&plainly, 1.5 + i);
    }
}

/* Promise(laws/instance-output-sees) */
static void another_call_in_between_takes_nothing_from_the_one_that_is_kept(void **state)
{
    struct rig kept, plainly;

    (void)state;
    make(&kept, &plain);
    make(&plainly, &plain);
    apc_instances_keep(kept.s, &kept.c);
    move_on(&plainly, 4.0);
    assert_int_equal(apc_instances_compute(kept.s, 1, &plainly.c), APC_LAW_GOOD);
    assert_near(seen[1].y[0], plainly.y[2], 0.0);
    assert_near(seen[1].z[0], plainly.z[2], 0.0);
    assert_int_equal(apc_instances_compute(kept.s, 1, &kept.c), APC_LAW_GOOD);
    assert_near(seen[1].y[0], kept.y[2], 0.0);
    assert_near(seen[1].z[0], kept.z[2], 0.0);
    assert_near(kept.u[1], kept.y[2], 0.0);
    assert_near(kept.published[1], 100.0 + kept.y[2], 0.0);
}

/* ---- What it is made from -------------------------------------------------------------------- */

/* Promise(laws/instance-output-sees) */
static void an_instance_is_made_from_its_part_of_the_model_and_the_signals(void **state)
{
    static const double A[4] = {1, 2, 3, 4}, x0[2] = {5, 6}, u0[4] = {10, 11, 12, 13},
                        y0[4] = {20, 21, 22, 23};
    double B[2 * 4], C[4 * 2], D[4 * 4];
    const struct apc_law_plant plant = {
        .nx = 2, .A = A, .B = B, .C = C, .D = D, .x0 = x0, .u0 = u0, .y0 = y0};
    const struct apc_signal_view y[NY] = {{.name = "y1"}, {.name = "y2"}, {.name = "y3"}, {.name = "y4"}},
                                 z[NZ] = {{.name = "z1"}, {.name = "z2"}, {.name = "z3"}};
    const struct apc_signal_view u[NU] = {{.name = "u1"}, {.name = "u2"}},
                                 d[ND] = {{.name = "d1"}, {.name = "d2"}};
    struct apc_law_setup setup = plain;
    struct apc_instances *s;

    (void)state;
    setup.plant = &plant;
    setup.y = y, setup.z = z, setup.u = u, setup.d = d;
    for (int i = 0; i < 8; i++) {
        B[i] = 30.0 + i;
        C[i] = 40.0 + i;
    }
    for (int i = 0; i < 16; i++)
        D[i] = 50.0 + i;
    memset(seen, 0, sizeof(seen));
    assert_int_equal(laws_make(&s, &telling, &setup, NULL), 0);
    for (size_t k = 0; k < NU; k++) {
        /* B: columns of u and d, C: rows of y, D both, about the operating point */
        static const double model[NU][22] = {
            {1, 2, 3, 4, 30, 33, 34, 37, 46, 47, 40, 41, 62, 65, 50, 53, 5, 6, 10, 13, 23, 20},
            {1, 2, 3, 4, 31, 32, 35, 36, 44, 45, 42, 43, 59, 60, 55, 56, 5, 6, 11, 12, 22, 21}};

        assert_int_equal(seen[k].output, k);
        assert_int_equal(seen[k].dim.ny, 2);
        assert_int_equal(seen[k].dim.nu, 1);
        assert_string_equal(seen[k].names, k ? "y3 y2 z3 u2 d1" : "y4 y1 z2 u1 d2");
        for (size_t i = 0; i < 22; i++)
            assert_near(seen[k].model[i], model[k][i], 0.0);
    }
}

/* Promise(laws/settings-numbers): Settings are numbers, matrices or text. */
static void settings_are_numbers_matrices_and_texts(void **state)
{
    static const double value[6] = {1, 2, 3, 4, 5, 6};
    const struct apc_setting setting[] = {{"file", "tank.fmu", 0, 0, NULL}, {"matrix", NULL, 2, 3, value}};
    struct apc_law_setup setup = plain;
    struct apc_instances *s;

    (void)state;
    memset(seen, 0, sizeof(seen));
    setup.n_setting = 2;
    setup.setting = setting;
    assert_int_equal(laws_make(&s, &telling, &setup, NULL), 0);
    for (size_t k = 0; k < NU; k++) { /* each sees all of them */
        assert_string_equal(seen[k].text, "tank.fmu");
        assert_near(seen[k].matrix[5], 6.0, 0.0);
    }
}

static void a_text_where_numbers_belong_is_refused(void **state)
{
    const struct apc_setting setting = {"measurement", "y1", 0, 0, NULL};
    const struct apc_law_setup setup = {.dim = {1, 1, 1, 0}, .Ts = 1.0, .n_setting = 1, .setting = &setting};
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_try(&apc_law_pid, &setup, NULL, &why), APC_EINVAL);
    assert_string_equal(why.text, "setting \"measurement\" must be 1 numbers, not a text");
}

/* What was made before it is ended, and so is what the failing one had begun. */
static void an_instance_that_cannot_be_made_ends_the_others(void **state)
{
    (void)state;
    for (int how = 1; how <= 2; how++) {
        struct apc_instances *s;
        struct apc_error why = {""};

        memset(seen, 0, sizeof(seen));
        seen[1].fail = how;
        assert_int_equal(laws_make(&s, &telling, &plain, &why), APC_ENOTFOUND);
        assert_null(s);
        assert_string_equal(why.text, "instance 2 wants more");
        assert_int_equal(seen[0].destroyed, 1);
        assert_int_equal(seen[1].destroyed, how == 1);
    }
    memset(seen, 0, sizeof(seen));
    assert_int_equal(apc_law_try(&telling, &plain, NULL, NULL), 0);
    assert_int_equal(seen[0].destroyed + seen[1].destroyed, 2);
    apc_instances_destroy(NULL);
}

static size_t greedy_states;
static struct apc_law_needs greed;

static int greedy_create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                         struct apc_error *why)
{
    (void)setup, (void)self, (void)why;
    assert_int_equal(needs->states, greedy_states);
    *needs = greed;
    return 0;
}

static size_t greedy_count(const struct apc_dim *dim)
{
    (void)dim;
    return greedy_states;
}

static void a_law_that_counted_wrong_is_refused(void **state)
{
    static const struct apc_published endless = {.name = "p", .length = SIZE_MAX},
                                      two[] = {{.length = 999999}, {0}};
    static const struct apc_law law = {.abi = APC_LAW_ABI,
                                       .name = "greedy",
                                       .compute = compute,
                                       .n_state = greedy_count,
                                       .create = greedy_create};
    static const struct apc_law_needs of[] = {{.states = 1000001},
                                              {.states = SIZE_MAX},
                                              {.n_ahead = 1000001},
                                              {.n_published = 1, .published = &endless}};
    const struct apc_law_setup setup = {.dim = {1, 1, 1, 0}, .Ts = 1.0};
    struct apc_error why = {""};

    (void)state;
    greedy_states = 3;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        greed = of[i];
        assert_int_equal(apc_law_try(&law, &setup, NULL, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "law greedy wants"));
    }
    greed = (struct apc_law_needs){.states = 1000000, .n_ahead = 4, .n_published = 2, .published = two};
    assert_int_equal(apc_law_try(&law, &setup, NULL, &why), 0);
}

/* ---- Tuning ---------------------------------------------------------------------------------- */

/*
 * Promise(laws/parameters-law-outputs): Parameters of the law, of outputs, of measurements; a set is
 *   checked whole.
 */
static void parameters_are_of_the_law_of_outputs_and_of_measurements(void **state)
{
    static const struct apc_law_parameter expected[] = {
        {2, APC_OF_LAW, 0},         {0, APC_OF_OUTPUT, 0},      {4, APC_OF_OUTPUT, 0},
        {0, APC_OF_OUTPUT, 1},      {4, APC_OF_OUTPUT, 1},      {1, APC_OF_MEASUREMENT, 0},
        {3, APC_OF_MEASUREMENT, 0}, {1, APC_OF_MEASUREMENT, 1}, {3, APC_OF_MEASUREMENT, 1},
        {1, APC_OF_MEASUREMENT, 2}};
    const struct apc_dim dim = {3, 3, 2, 1};
    struct rig r;

    (void)state;
    make(&r, &plain);
    assert_int_equal(apc_law_parameters(&telling, &dim), 11);
    for (size_t i = 0; i < sizeof(expected) / sizeof(expected[0]); i++) {
        const struct apc_law_parameter p = apc_law_parameter_at(&telling, &dim, i);

        assert_int_equal(p.number, expected[i].number);
        assert_int_equal(p.scope, expected[i].scope);
        assert_int_equal(p.of, expected[i].of);
    }
    assert_int_equal(apc_instances_parameter(r.s, 12).number, 3);
    assert_int_equal(apc_instances_parameter(r.s, 12).of, 3);
    assert_int_equal(apc_law_parameters(&apc_law_pi, &dim), 10);
    assert_int_equal(apc_law_parameter_at(&apc_law_pi, &dim, 7).number, 2);
}

/* Promise(laws/parameters-law-outputs) */
static void a_set_is_checked_whole_instance_by_instance(void **state)
{
    struct apc_error why = {""};
    struct rig r;

    (void)state;
    make(&r, &plain);
    assert_int_equal(apc_instances_check(r.s, r.tuning, &why), 0);
    r.tuning[3] = -1.0; /* output 2's first is below the law's */
    assert_int_equal(apc_instances_check(r.s, r.tuning, &why), APC_ERANGE);
    assert_string_equal(why.text, "instance 2 does not like it");
    r.tuning[3] = 2e6;
    assert_int_equal(apc_instances_check(r.s, r.tuning, &why), APC_ERANGE);
    assert_string_equal(why.text, "gain of output 2: 2000000 is not within -1000000 to 1000000");
    r.tuning[12] = -2e6;
    r.tuning[3] = 3.0;
    assert_int_equal(apc_instances_check(r.s, r.tuning, &why), APC_ERANGE);
    assert_string_equal(why.text, "zone of measurement 4: -2000000 is not within -1000000 to 1000000");
    r.tuning[0] = (double)NAN;
    assert_int_equal(apc_instances_check(r.s, r.tuning, &why), APC_ERANGE);
    assert_string_equal(why.text, "horizon: nan is not within -1000000 to 1000000");
}

/* ---- Answers --------------------------------------------------------------------------------- */

/*
 * Promise(laws/answer-infeasible-failed): An answer that is infeasible, failed or no number does not go
 *   out.
 */
static void an_answer_is_looked_at_before_it_is_believed(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &plain);
    for (int result = APC_LAW_GOOD; result <= APC_LAW_FAILED; result++) {
        r.x[2] = -3.0 - result;
        assert_int_equal(apc_instances_compute(r.s, 1, &r.c), result);
        assert_string_equal(r.why, "said so");
    }
    r.x[2] = -3.0 - (double)APC_LAW_FAILED - 1;
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_FAILED);
    assert_string_equal(r.why, "gave 5, which is no result");
    r.x[2] = -1.0;
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_FAILED);
    assert_string_equal(r.why, "gave no finite number");
    r.x[2] = -2.0;
    assert_int_equal(apc_instances_compute(r.s, 1, &r.c), APC_LAW_FAILED);
    assert_int_equal(apc_instances_compute(r.s, 0, &r.c), APC_LAW_GOOD); /* the other does not mind */
    assert_string_equal(r.why, "");
}

static void the_time_left_is_counted_from_the_clock_where_there_is_one(void **state)
{
    struct apc_law_call c = {.budget = 0.5};

    (void)state;
    assert_near(apc_law_left(&c), 0.5, 0.0);
    c.deadline = apc_clock_mono(NULL) + 3600 * APC_NS_PER_S;
    assert_true(apc_law_left(&c) > 3000.0 && apc_law_left(&c) <= 3600.0);
    c.deadline = apc_clock_mono(NULL) - 1;
    assert_true(apc_law_left(&c) < 0.0);
}

/* ---- What it publishes ------------------------------------------------------------------------ */

struct told {
    char text[100];
    int n;
};

static void tell(void *ctx, size_t output, const struct apc_published *published)
{
    struct told *t = ctx;
    const size_t used = strlen(t->text);

    (void)snprintf(t->text + used, sizeof(t->text) - used, "%zu:%s ", output, published->name);
    t->n++;
}

/* The first output nothing, the second both. */
static int create_second(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                         struct apc_error *why)
{
    const int rc = create(setup, needs, self, why);

    needs->n_published = 2 * setup->output;
    return rc;
}

static void what_it_publishes_is_told_by_output_in_order(void **state)
{
    struct apc_law second = telling;
    struct told all = {.n = 0}, last = {.n = 0};

    (void)state;
    second.create = create_second;
    assert_int_equal(apc_law_published(&telling, &plain, tell, &all, NULL), 3);
    assert_string_equal(all.text, "0:objective 1:objective 1:path ");
    assert_int_equal(apc_law_published(&second, &plain, tell, &last, NULL), 2);
    assert_string_equal(last.text, "1:objective 1:path ");
    assert_int_equal(all.n + last.n, 5);
}

/* ---- Its mark -------------------------------------------------------------------------------- */

static uint32_t mark(const struct apc_law *law, const struct apc_law_setup *setup)
{
    struct apc_instances *s;
    uint32_t mark;

    assert_int_equal(apc_instances_create(&s, law, setup, NULL), 0);
    mark = apc_instances_mark(s);
    apc_instances_destroy(s);
    return mark;
}

static void whatever_x_depends_on_is_in_the_mark(void **state)
{
    static const double value[6] = {1, 2, 3, 4, 5, 6}, other[6] = {1, 2, 3, 4, 5, 7}, zero[16];
    static const struct apc_setting setting[] = {{"matrix", NULL, 2, 3, value},
                                                 {"matrix", NULL, 3, 2, value},
                                                 {"matrix", NULL, 2, 3, other},
                                                 {"file", "a", 0, 0, NULL},
                                                 {"file", "b", 0, 0, NULL}};
    static const struct apc_law_plant plant = {
        .nx = 2, .A = zero, .B = zero, .C = zero, .D = zero, .x0 = zero, .u0 = zero, .y0 = zero};
    struct apc_law_plant changed = plant;
    struct apc_law newer;
    static double zero_of[4][16];
    uint32_t marks[16];
    size_t n = 0;

    (void)state;
    marks[n++] = mark(&telling, &plain);
    newer = telling;
    newer.version = 1;
    marks[n++] = mark(&newer, &plain);
    newer = telling;
    newer.name = "Telling";
    marks[n++] = mark(&newer, &plain);
    for (size_t i = 0; i < sizeof(setting) / sizeof(setting[0]); i++) {
        struct apc_law_setup setup = plain;

        setup.n_setting = 1;
        setup.setting = &setting[i];
        marks[n++] = mark(&telling, &setup);
    }
    for (int i = 0; i < 3; i++) {
        struct apc_law_setup setup = plain;

        setup.Ts = i == 0 ? 3.0 : plain.Ts;
        setup.plant = i == 0 ? NULL : i == 1 ? &plant : &changed;
        changed.y0 = other;
        marks[n++] = mark(&telling, &setup);
    }
    for (int i = 0; i < 4; i++) { /* a model that is sampled already */
        struct apc_law_setup setup = plain;
        struct apc_linear sampled = {
            .nx = 2, .A = zero_of[0], .B = zero_of[1], .C = zero_of[2], .x0 = zero_of[3]};
        const struct apc_law_plant of = {.D = zero, .u0 = zero, .y0 = zero, .sampled = &sampled};

        memset(zero_of, 0, sizeof(zero_of));
        zero_of[i][1] = 1.0;
        setup.plant = &of;
        marks[n++] = mark(&telling, &setup);
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < i; k++) {
            if (marks[i] == marks[k])
                fail_msg("%zu and %zu have the same mark", k, i);
        }
    }
    assert_int_equal(mark(&telling, &plain), marks[0]);
}

/* Each of its numbers makes another mark; what stands behind them in memory makes none. */
static void a_model_is_in_the_mark_from_the_first_number_to_the_last(void **state)
{
    enum { NX = 2, NP = 3, WIDTH = NU + ND, ROOM = NY * WIDTH + 1 };
    static const size_t length[] = {NX * NX, NX * WIDTH, NY * NX, NY * WIDTH, NX,      WIDTH,
                                    NY,      NP,         NX * NX, NX * WIDTH, NY * NX, NX};
    static double part[sizeof(length) / sizeof(length[0])][ROOM];
    static const struct apc_law law = {
        .abi = APC_LAW_ABI, .name = "of all", .whole = true, .compute = compute};
    static const struct apc_model model = {.name = "a tank", .np = NP},
                                  renamed = {.name = "b tank", .np = NP};
    struct apc_linear sampled = {.nx = NX, .A = part[8], .B = part[9], .C = part[10], .x0 = part[11]};
    struct apc_law_plant plant = {.nx = NX,
                                  .A = part[0],
                                  .B = part[1],
                                  .C = part[2],
                                  .D = part[3],
                                  .x0 = part[4],
                                  .u0 = part[5],
                                  .y0 = part[6],
                                  .model = &model,
                                  .p = part[7]};
    struct apc_law_setup setup = plain;
    uint32_t marks[64];

    (void)state;
    setup.plant = &plant;
    for (size_t i = 0; i < sizeof(length) / sizeof(length[0]); i++) {
        size_t n = 0;

        plant.sampled = i < 8 ? NULL : &sampled;
        plant.nx = i < 8 ? NX : 0;
        marks[n++] = mark(&law, &setup);
        for (size_t k = 0; k < length[i]; k++) {
            part[i][k] = 1.0;
            marks[n++] = mark(&law, &setup);
            part[i][k] = 0.0;
            for (size_t other = 0; other + 1 < n; other++)
                if (marks[other] == marks[n - 1])
                    fail_msg("array %zu: %zu and %zu have the same mark", i, other, n - 1);
        }
        part[i][length[i]] = 1.0;
        assert_int_equal(mark(&law, &setup), marks[0]);
        part[i][length[i]] = 0.0;
    }
    marks[0] = mark(&law, &setup);
    plant.model = &renamed;
    assert_int_not_equal(mark(&law, &setup), marks[0]);
    plant.model = NULL; /* its parameters say nothing then */
    marks[0] = mark(&law, &setup);
    part[7][0] = 1.0;
    assert_int_equal(mark(&law, &setup), marks[0]);
    part[7][0] = 0.0;
}

/* ---- Whoever takes the output says how far --------------------------------------------------- */

/* A law, its error kept at 1: how far does its output rise, while that way is closed or open? */
static double rise(const struct apc_law *law, double gain, double tau_t, unsigned held)
{
    const bool cascade = law == &apc_law_cascade;
    const struct apc_law_setup setup = {.dim = {cascade ? 2 : 1, 1, 1, 0}, .Ts = 1.0};
    double y[2] = {0.0, 0.0}, z = 1.0, x[12] = {0.0}, u = 0.0, before = 0.0, tuning[32] = {0.0};
    unsigned limited = held;
    struct apc_law_call c = {
        .dim = setup.dim, .y = y, .z = &z, .tuning = tuning, .x = x, .u = &u, .limited = &limited};
    struct apc_instances *s;

    for (size_t i = 0; i < law->n_tuning; i++) {
        const char *name = law->tuning[i].name;

        tuning[i] = strstr(name, "tau_t") ? tau_t : law->tuning[i].initial;
        if (strcmp(name, "Kp") == 0 || strcmp(name, "inner_Kp") == 0)
            tuning[i] = gain;
    }
    assert_int_equal(laws_make(&s, law, &setup, NULL), 0);
    laws_reset(s, &c);
    for (int k = 0; k < 20; k++) {
        limited = held;
        c = laws_call(&c, APC_OUT_LAW);
        assert_int_equal(apc_instances_compute(s, 0, &c), APC_LAW_GOOD);
        if (k == 0)
            before = u;
        limited = held;
        apc_instances_update(s, 0, &c);
    }
    return u - before;
}

/* Promise(laws): No integral moves the way that its consumer cannot follow. */
static void no_integral_moves_the_way_that_its_consumer_cannot_follow(void **state)
{
    static const struct apc_law *const laws[] = {&apc_law_pi, &apc_law_pid, &apc_law_cascade};

    (void)state;
    for (size_t i = 0; i < 3; i++) {
        for (double tau_t = 0.0; tau_t <= 5.0; tau_t += 5.0) {
            for (double gain = -0.5; gain <= 0.5; gain += 1.0) {
                const unsigned ahead = gain > 0.0 ? APC_LIMITED_HIGH : APC_LIMITED_LOW;
                const double free = rise(laws[i], gain, tau_t, 0);

                assert_true(free * gain > 0.1);
                assert_near(rise(laws[i], gain, tau_t, ahead), 0.0, 1e-12);
                assert_near(rise(laws[i], gain, tau_t, APC_LIMITED_LOW | APC_LIMITED_HIGH), 0.0, 1e-12);
                assert_near(rise(laws[i], gain, tau_t, apc_law_mirrored(ahead)), free, 1e-12);
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(an_instance_sees_what_belongs_to_its_output_and_no_more, laws_end),
        cmocka_unit_test_teardown(a_law_that_is_whole_sees_the_controllers_own, laws_end),
        cmocka_unit_test_teardown(what_a_caller_does_not_know_is_not_there, laws_end),
        cmocka_unit_test_teardown(what_a_law_says_goes_where_the_call_of_that_time_wants_it, laws_end),
        cmocka_unit_test_teardown(x_and_what_is_published_are_laid_out_one_after_another, laws_end),
        cmocka_unit_test_teardown(an_instance_is_asked_by_itself, laws_end),
        cmocka_unit_test_teardown(a_call_that_is_kept_is_seen_as_one_that_is_not, laws_end),
        cmocka_unit_test_teardown(another_call_in_between_takes_nothing_from_the_one_that_is_kept, laws_end),
        cmocka_unit_test_teardown(an_instance_is_made_from_its_part_of_the_model_and_the_signals, laws_end),
        cmocka_unit_test_teardown(settings_are_numbers_matrices_and_texts, laws_end),
        cmocka_unit_test_teardown(a_text_where_numbers_belong_is_refused, laws_end),
        cmocka_unit_test_teardown(an_instance_that_cannot_be_made_ends_the_others, laws_end),
        cmocka_unit_test_teardown(a_law_that_counted_wrong_is_refused, laws_end),
        cmocka_unit_test_teardown(parameters_are_of_the_law_of_outputs_and_of_measurements, laws_end),
        cmocka_unit_test_teardown(a_set_is_checked_whole_instance_by_instance, laws_end),
        cmocka_unit_test_teardown(an_answer_is_looked_at_before_it_is_believed, laws_end),
        cmocka_unit_test_teardown(the_time_left_is_counted_from_the_clock_where_there_is_one, laws_end),
        cmocka_unit_test_teardown(what_it_publishes_is_told_by_output_in_order, laws_end),
        cmocka_unit_test_teardown(whatever_x_depends_on_is_in_the_mark, laws_end),
        cmocka_unit_test_teardown(a_model_is_in_the_mark_from_the_first_number_to_the_last, laws_end),
        cmocka_unit_test_teardown(no_integral_moves_the_way_that_its_consumer_cannot_follow, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
