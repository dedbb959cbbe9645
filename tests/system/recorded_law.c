/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * recorded_law EXPERIMENT RECORD: simulate it, and record each call of its controller's law: what the law was
 * given, and what it made of that.
 *
 * recorded_law RECORD, compiled with REPLAY: give the same to the law here, and compare what it makes of it,
 * bit for bit. That takes laws and models, and no library of others: so it is to be had for a processor that
 * has none of them here. Both processors have words of 64 bits and the lowest byte first.
 */
#include <apccontrol.h>
#include <apcplant.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef REPLAY
enum { REPLAYS = 1 };
#else
#include "experiment/experiment.h"
#include "simulation/simulation.h"
enum { REPLAYS = 0 };
#endif
#define INSTANCES 64 /* alive at a time */

struct instance_calls {
    const struct apc_law *law;
    void *self;
    size_t states, published;
};

static FILE *file;
static struct instance_calls instance[INSTANCES];
static _Alignas(max_align_t) char arena[1 << 22]; /* of one call: what it is given */
static size_t used;
static unsigned long ticks;

static void stop(const char *why)
{
    fprintf(stderr, "recorded_law: after %lu ticks: %s\n", ticks, why);
    exit(EXIT_FAILURE);
}

/* Into the record, or out of it. */
static void pass(void *at, size_t bytes)
{
    if (bytes > 0 && (REPLAYS ? fread(at, bytes, 1, file) : fwrite(at, bytes, 1, file)) != 1)
        stop(REPLAYS ? "the record ends in the middle" : "the record cannot be written");
}

/* A copy of what may be NULL. In a replay @p of is what the record's own program had there: no address here. */
static void *pass_array(const void *of, size_t n, size_t size)
{
    bool there = of != NULL;
    pass(&there, sizeof there);
    if (!there)
        return NULL;
    void *const copy = &arena[used];
    if (size > 0 && n > (sizeof arena - used) / size)
        stop("a call takes too much");
    used += (n * size + _Alignof(max_align_t) - 1) / _Alignof(max_align_t) * _Alignof(max_align_t);
    if (!REPLAYS)
        memcpy(copy, of, n * size);
    pass(copy, n * size);
    return copy;
}

static char *pass_text(const char *of)
{
    size_t n = !REPLAYS && of ? strlen(of) + 1 : 0;
    pass(&n, sizeof n);
    return pass_array(of, n, 1);
}

/* What a law made: recorded, or compared with what is on record. */
static void tell(const void *at, size_t bytes, const char *what)
{
    const char *const was = pass_array(at, bytes, 1);
    if (bytes > 0 && memcmp(was, at, bytes) != 0)
        stop(what);
}

static struct apc_signal_view *pass_views(const struct apc_signal_view *of, size_t n)
{
    struct apc_signal_view *const v = pass_array(of, n, sizeof *v);
    for (size_t i = 0; v && i < n; i++) {
        v[i].name = pass_text(v[i].name);
        v[i].unit = pass_text(v[i].unit);
    }
    return v;
}

static struct apc_law_plant *pass_plant(const struct apc_law_plant *of, const struct apc_dim *dim)
{
    struct apc_law_plant *const p = pass_array(of, 1, sizeof *p);
    const size_t n_in = dim->nu + dim->nd;
    if (!p)
        return NULL;
    if (p->sampled)
        stop("this plant's model is sampled already, which is not recorded");
    p->A = pass_array(p->A, p->nx * p->nx, sizeof *p->A);
    p->B = pass_array(p->B, p->nx * n_in, sizeof *p->B);
    p->C = pass_array(p->C, dim->ny * p->nx, sizeof *p->C);
    p->D = pass_array(p->D, dim->ny * n_in, sizeof *p->D);
    p->x0 = pass_array(p->x0, p->nx, sizeof *p->x0);
    p->u0 = pass_array(p->u0, n_in, sizeof *p->u0);
    p->y0 = pass_array(p->y0, dim->ny, sizeof *p->y0);
    p->disturbance = pass_array(p->disturbance, dim->nd, sizeof *p->disturbance);
    const char *const name = pass_text(!REPLAYS && p->model ? p->model->name : NULL);
    if (REPLAYS) {
        struct apc_error why;
        void *handle;
        p->model = NULL;
        if (name && apc_model_find(name, &p->model, &handle, &why) < 0)
            stop(why.text);
    }
    const size_t n = p->model ? p->model->np : 0;
    p->p = pass_array(p->p, n, sizeof *p->p);
    return p;
}

static struct apc_law_setup pass_setup(const struct apc_law_setup *of)
{
    struct apc_law_setup s = *of;
    pass(&s.dim, sizeof s.dim);
    pass(&s.Ts, sizeof s.Ts);
    pass(&s.output, sizeof s.output);
    pass(&s.n_setting, sizeof s.n_setting);
    s.y = pass_views(s.y, s.dim.ny);
    s.z = pass_views(s.z, s.dim.nz);
    s.u = pass_views(s.u, s.dim.nu);
    s.d = pass_views(s.d, s.dim.nd);
    struct apc_setting *const setting = pass_array(s.setting, s.n_setting, sizeof *setting);
    for (size_t i = 0; setting && i < s.n_setting; i++) {
        setting[i].name = pass_text(setting[i].name);
        setting[i].text = pass_text(setting[i].text);
        setting[i].value =
            pass_array(setting[i].value, setting[i].rows * setting[i].columns, sizeof *setting[i].value);
    }
    s.setting = setting;
    s.plant = pass_plant(s.plant, &s.dim);
    return s;
}

static int make(size_t at, const struct apc_law *law, const struct apc_law_setup *of,
                struct apc_law_needs *needs, void **self, struct apc_error *why)
{
    struct apc_law_setup setup = pass_setup(of);
    setup.law = law;
    const int rc = law->create(&setup, needs, self, why);
    struct instance_calls *const i = &instance[at];
    *i = (struct instance_calls){.law = law, .self = *self, .states = needs->states};
    for (size_t k = 0; k < needs->n_published; k++)
        i->published += needs->published[k].length ? needs->published[k].length : 1;
    tell(&rc, sizeof rc, "an instance comes out otherwise");
    tell(&i->states, sizeof i->states, "an instance has another number of states");
    tell(&i->published, sizeof i->published, "an instance publishes another number of values");
    return rc;
}

/* Only numbers are compared. @p c is what the law is asked with, in a replay as it is on record. */
static int call(size_t at, char which, struct apc_law_call *c)
{
    const struct instance_calls *const i = &instance[at];
    struct apc_law_call own = *c;
    char why[APC_LAW_WHY] = "", say[APC_LAW_SAY] = "";
    int rc = 0;

    pass(&own, sizeof own);
    const size_t ny = own.dim.ny, nu = own.dim.nu, n_tuning = apc_law_parameters(i->law, &own.dim);
    own.size = sizeof own;
    own.self = i->self;
    own.y = pass_array(own.y, ny, sizeof *own.y);
    own.z = pass_array(own.z, own.n_ahead * own.dim.nz, sizeof *own.z);
    own.tuning = pass_array(own.tuning, n_tuning, sizeof *own.tuning);
    own.x = pass_array(own.x, i->states, sizeof *own.x);
    own.u = pass_array(own.u, nu, sizeof *own.u);
    own.limited = pass_array(own.limited, nu, sizeof *own.limited);
    own.y_status = pass_array(own.y_status, ny, sizeof *own.y_status);
    own.y_age = pass_array(own.y_age, ny, sizeof *own.y_age);
    own.y_new = pass_array(own.y_new, ny, sizeof *own.y_new);
    own.d = pass_array(own.d, own.n_ahead * own.dim.nd, sizeof *own.d);
    own.low = pass_array(own.low, nu, sizeof *own.low);
    own.high = pass_array(own.high, nu, sizeof *own.high);
    own.rate = pass_array(own.rate, nu, sizeof *own.rate);
    own.y_low = pass_array(own.y_low, ny, sizeof *own.y_low);
    own.y_high = pass_array(own.y_high, ny, sizeof *own.y_high);
    own.u_last = pass_array(own.u_last, nu, sizeof *own.u_last);
    own.out = pass_array(own.out, nu, sizeof *own.out);
    own.published = pass_array(own.published, i->published, sizeof *own.published);
    own.y_limited = pass_array(own.y_limited, ny, sizeof *own.y_limited);
    own.why = own.why ? why : NULL;
    own.say = own.say ? say : NULL;
    if (REPLAYS)
        *c = own;
    switch (which) {
    case 'r':
        i->law->reset(c);
        break;
    case 'c':
        rc = i->law->compute(c);
        break;
    case 'u':
        i->law->update(c);
        break;
    default:
        i->law->track(c);
        break;
    }
    tell(&rc, sizeof rc, "compute has another result");
    tell(c->x, i->states * sizeof *c->x, "x has other bits");
    tell(c->u, nu * sizeof *c->u, "u has other bits");
    tell(c->limited, nu * sizeof *c->limited, "others are held back by a limit");
    if (which == 'c' && c->published)
        tell(c->published, i->published * sizeof *c->published, "what is published has other bits");
    ticks += which == 'c';
    return rc;
}

/* Which call of which instance comes. False: none any more. */
static bool begin(char *which, size_t *at)
{
    used = 0;
    if (REPLAYS && fread(which, 1, 1, file) != 1)
        return false;
    if (!REPLAYS)
        pass(which, 1);
    pass(at, sizeof *at);
    return true;
}

#ifdef REPLAY

int main(int argc, char **argv)
{
    char which;
    size_t at;
    file = argc == 2 ? fopen(argv[1], "rb") : NULL;
    if (!file)
        stop("expected RECORD");
    while (begin(&which, &at)) {
        if (which == 'm') {
            struct apc_error why;
            const struct apc_law *law;
            void *handle, *self = NULL;
            const char *const name = pass_text(NULL);
            if (!name || apc_law_find(name, &law, &handle, &why) < 0)
                stop("there is no such law");
            struct apc_law_needs needs = {.size = sizeof needs};
            (void)make(at, law, &(struct apc_law_setup){.size = sizeof(struct apc_law_setup)}, &needs, &self,
                       &why);
        } else if (which == 'd') {
            instance[at].law->destroy(instance[at].self);
        } else {
            (void)call(at, which, &(struct apc_law_call){.size = sizeof(struct apc_law_call)});
        }
    }
    printf("%lu of %lu ticks the same bit for bit\n", ticks, ticks);
    return ticks == 0;
}

#else

static const struct apc_law *real;

static size_t number_of(const void *self)
{
    size_t at = 0;
    while (at < INSTANCES && instance[at].self != self)
        at++;
    if (at == INSTANCES)
        stop("too many instances");
    return at;
}

static int recorded_create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                           struct apc_error *why)
{
    size_t at = number_of(NULL);
    (void)begin(&(char){'m'}, &at);
    (void)pass_text(real->name);
    return make(at, real, setup, needs, self, why);
}

static void recorded_destroy(void *self)
{
    size_t at = number_of(self);
    (void)begin(&(char){'d'}, &at);
    real->destroy(self);
    instance[at].self = NULL;
}

static int recorded_call(char which, struct apc_law_call *c)
{
    size_t at = number_of(c->self);
    (void)begin(&which, &at);
    return call(at, which, c);
}

static void recorded_reset(struct apc_law_call *c)
{
    (void)recorded_call('r', c);
}

static int recorded_compute(struct apc_law_call *c)
{
    return recorded_call('c', c);
}

static void recorded_update(struct apc_law_call *c)
{
    (void)recorded_call('u', c);
}

static void recorded_track(struct apc_law_call *c)
{
    (void)recorded_call('t', c);
}

int main(int argc, char **argv)
{
    struct experiment e = {.name = ""};
    struct simulation s = {.rc = 0};
    struct apc_error why = {"expected EXPERIMENT RECORD"};
    file = argc == 3 ? fopen(argv[2], "wb") : NULL;
    if (!file || experiment_load(&e, argv[1], EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        stop(why.text);
    real = e.controllers[0].law;
    struct apc_law law = *real;
    if (e.n_controllers != 1 || !real->create || !real->destroy)
        stop("expected one controller, of a law that has instances");
    law.create = recorded_create;
    law.destroy = recorded_destroy;
    law.reset = real->reset ? recorded_reset : NULL;
    law.compute = recorded_compute;
    law.update = real->update ? recorded_update : NULL;
    law.track = real->track ? recorded_track : NULL;
    e.controllers[0].law = &law;
    if (simulation_create(&s, &e, e.seed, &why) < 0)
        stop(why.text);
    if (simulation_run(&s, e.duration) < 0)
        stop("the simulation failed");
    simulation_destroy(&s);
    experiment_free(&e);
    if (fclose(file) != 0)
        stop("the record cannot be written");
    printf("%lu ticks\n", ticks);
    return ticks == 0;
}

#endif
