/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What runs a law for a controller. An instance for each output keeps a call of its own. Of what there is one
 * of for each output (u, limits) that has the controller's array from its own element on; so it has of y, z,
 * d and tuning where its own stand one behind another, and else copies in the order of its ports. After
 * creation nothing is allocated.
 */
#include "base/base_internal.h"
#include "control/control_internal.h"
#include "control/parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LAW_SIZE_MAX 1000000 /* a law that wants more than this has counted wrong */

struct instance {
    void *self;
    struct apc_dim dim;
    struct apc_law_needs needs;
    struct apc_instance_part part;
    size_t *tuning; /* [n_tuning] which of the controller's parameters are its own */
    size_t n_tuning;
    bool y_apart, z_apart, d_apart, tuning_apart, apart; /* they do not stand one behind another; any */
    struct apc_law_call call;
};

/* Copies of what stands apart; there is one, as one instance is asked at a time. */
struct window {
    double y[APC_LAW_PORTS], y_age[APC_LAW_PORTS], y_low[APC_LAW_PORTS], y_high[APC_LAW_PORTS];
    apc_status y_status[APC_LAW_PORTS];
    bool y_new[APC_LAW_PORTS];
    unsigned y_limited[APC_LAW_PORTS];
    double *z, *d;  /* [n_ahead * ports] */
    double *tuning; /* of the instance that has most */
    char why[APC_LAW_WHY];
};

struct apc_instances {
    const struct apc_law *law;
    struct apc_dim dim;
    double Ts;
    struct apc_instances_size size;
    struct instance *instance;           /* [size.instances] */
    struct apc_law_ports *ports;         /* [nu] */
    struct apc_law_parameter *parameter; /* [size.tuning] */
    struct window window;
    const struct apc_law_call *kept; /* whose arrays all instances' calls have */
    uint32_t mark;
};

/* ---- Creation -------------------------------------------------------------------------------- */

/* Which parameters instance k, for an output, has: the law's, its output's, those of its measurements. */
static int choose_tuning(struct apc_instances *s, size_t k)
{
    const struct apc_law *law = s->law;
    const size_t own = apc_law_count(law, APC_OF_LAW), each = apc_law_count(law, APC_OF_OUTPUT),
                 measured = apc_law_count(law, APC_OF_MEASUREMENT);
    struct instance *of = &s->instance[k];
    size_t n = 0;

    of->n_tuning = apc_law_parameters(law, &of->dim);
    of->tuning = calloc(of->n_tuning + 1, sizeof(*of->tuning));
    if (!of->tuning)
        return APC_ENOMEM;
    for (size_t j = 0; j < own; j++)
        of->tuning[n++] = j;
    for (size_t j = 0; j < each; j++)
        of->tuning[n++] = own + k * each + j;
    for (size_t i = 0; i < of->dim.ny; i++) {
        for (size_t j = 0; j < measured; j++)
            of->tuning[n++] = own + s->dim.nu * each + (size_t)s->ports[k].y[i] * measured + j;
    }
    return 0;
}

/* Do they not stand one behind another? */
static bool apart(const int *number, size_t n)
{
    size_t i = 1;

    while (i < n && number[i] == number[i - 1] + 1)
        i++;
    return i < n;
}

/* Which of the controller's arrays instance k, for an output, cannot be shown as they are. */
static void find_apart(struct apc_instances *s, size_t k)
{
    const struct apc_law_ports *p = &s->ports[k];
    struct instance *of = &s->instance[k];
    const bool ahead = of->needs.n_ahead > 1;

    of->y_apart = apart(p->y, p->ny);
    of->z_apart = apart(p->z, p->nz) || (ahead && p->nz != s->dim.nz);
    of->d_apart = apart(p->d, p->nd) || (ahead && p->nd != s->dim.nd);
    for (size_t i = 1; i < of->n_tuning; i++)
        of->tuning_apart |= of->tuning[i] != of->tuning[i - 1] + 1;
    of->apart = of->y_apart || of->z_apart || of->d_apart || of->tuning_apart;
}

/* Make instance k from its own setup, and lay out what it has. */
static int make_instance(struct apc_instances *s, size_t k, const struct apc_law_setup *own,
                         struct apc_error *why)
{
    const struct apc_law *law = s->law;
    struct instance *of = &s->instance[k];
    struct apc_law_needs *needs = &of->needs;
    int rc;

    of->dim = own->dim;
    *needs =
        (struct apc_law_needs){.size = sizeof(*needs), .states = law->n_state ? law->n_state(&own->dim) : 0};
    rc = law->create ? law->create(own, needs, &of->self, why) : 0;
    if (rc < 0)
        return rc;
    of->part = (struct apc_instance_part){.u = k,
                                          .nu = of->dim.nu,
                                          .x = s->size.states,
                                          .states = needs->states,
                                          .published = s->size.published,
                                          .n_published = needs->n_published,
                                          .what = needs->published};
    for (size_t i = 0; i < needs->n_published && of->part.n <= LAW_SIZE_MAX; i++)
        of->part.n += needs->published[i].length > LAW_SIZE_MAX ? LAW_SIZE_MAX + 1
                      : needs->published[i].length              ? needs->published[i].length
                                                                : 1;
    if (!needs->n_ahead)
        needs->n_ahead = 1;
    s->size.states += needs->states;
    s->size.published += of->part.n;
    if (needs->n_ahead > s->size.n_ahead)
        s->size.n_ahead = needs->n_ahead;
    if (needs->states > LAW_SIZE_MAX || s->size.states > LAW_SIZE_MAX || s->size.published > LAW_SIZE_MAX ||
        needs->n_ahead > LAW_SIZE_MAX)
        return apc_fail(
            why, APC_EINVAL,
            "law %s wants %zu states, %zu ticks ahead, and to publish %zu numbers; %d of each at most",
            law->name, s->size.states, needs->n_ahead, s->size.published, LAW_SIZE_MAX);
    return 0;
}

static int make_instances(struct apc_instances *s, const struct apc_law_setup *setup, struct apc_error *why)
{
    int rc = 0;

    for (size_t i = 0; i < s->dim.nu && rc == 0; i++)
        rc = apc_law_find_ports(s->law, setup, i, &s->ports[i], why);
    if (rc == 0 && s->law->whole)
        rc = make_instance(s, 0, setup, why);
    for (size_t k = 0; !s->law->whole && k < s->dim.nu && rc == 0; k++) {
        struct apc_law_view v;

        if (apc_law_view_setup(&v, setup, k, &s->ports[k]) < 0)
            return apc_fail(why, APC_ENOMEM, "law %s: no memory", s->law->name);
        rc = make_instance(s, k, &v.setup, why);
        free(v.memory);
        if (rc == 0 && choose_tuning(s, k) < 0)
            rc = apc_fail(why, APC_ENOMEM, "law %s: no memory", s->law->name);
        if (rc == 0)
            find_apart(s, k);
    }
    return rc;
}

static int make_window(struct apc_instances *s)
{
    struct window *w = &s->window;
    size_t most = 1;

    if (s->law->whole)
        return 0;
    for (size_t k = 0; k < s->size.instances; k++)
        most = s->instance[k].n_tuning > most ? s->instance[k].n_tuning : most;
    w->z = calloc(s->size.n_ahead * APC_LAW_PORTS, sizeof(*w->z));
    w->d = calloc(s->size.n_ahead * APC_LAW_PORTS, sizeof(*w->d));
    w->tuning = calloc(most, sizeof(*w->tuning));
    return w->z && w->d && w->tuning ? 0 : APC_ENOMEM;
}

static int fill_instances(struct apc_instances *s, const struct apc_law_setup *setup, struct apc_error *why)
{
    int rc;

    if (s->law->n_tuning > LAW_SIZE_MAX || apc_law_parameters(s->law, &s->dim) > LAW_SIZE_MAX)
        return apc_fail(why, APC_EINVAL, "law %s wants more than %d tuning parameters", s->law->name,
                        LAW_SIZE_MAX);
    s->size = (struct apc_instances_size){.instances = s->law->whole ? 1 : s->dim.nu,
                                          .tuning = apc_law_parameters(s->law, &s->dim),
                                          .n_ahead = 1};
    s->instance = calloc(s->size.instances, sizeof(*s->instance));
    s->ports = calloc(s->dim.nu, sizeof(*s->ports));
    s->parameter = calloc(s->size.tuning + 1, sizeof(*s->parameter));
    if (!s->instance || !s->ports || !s->parameter)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", s->law->name);
    for (size_t i = 0; i < s->size.tuning; i++)
        s->parameter[i] = apc_law_parameter_at(s->law, &s->dim, i);
    rc = make_instances(s, setup, why);
    if (rc == 0 && make_window(s) < 0)
        rc = apc_fail(why, APC_ENOMEM, "law %s: no memory", s->law->name);
    s->mark = apc_law_mark(s->law, setup, s->size.states);
    return rc;
}

int apc_instances_create(struct apc_instances **instances, const struct apc_law *law,
                         const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct apc_dim *d = &setup->dim;
    struct apc_law_setup own = *setup;
    struct apc_instances *s;
    int rc = apc_law_check(law, "controller", why);

    *instances = NULL;
    if (rc < 0)
        return rc;
    if (!d->nu || (law->accepts && !law->accepts(d)))
        return apc_fail(why, APC_EINVAL,
                        "law %s does not work with measurements: %zu, setpoints: %zu, outputs: %zu",
                        law->name, d->ny, d->nz, d->nu);
    rc = apc_law_check_settings(law, setup, why);
    if (rc < 0)
        return rc;
    s = calloc(1, sizeof(*s));
    if (!s)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", law->name);
    own.size = sizeof(own);
    own.output = 0;
    own.law = law;
    s->law = law;
    s->dim = *d;
    s->Ts = setup->Ts;
    rc = fill_instances(s, &own, why);
    if (rc < 0) {
        apc_instances_destroy(s);
        return rc;
    }
    *instances = s;
    return 0;
}

void apc_instances_destroy(struct apc_instances *s)
{
    if (!s)
        return;
    for (size_t k = 0; s->instance && k < s->size.instances; k++) {
        if (s->instance[k].self && s->law->destroy)
            s->law->destroy(s->instance[k].self);
        free(s->instance[k].tuning);
    }
    free(s->window.z);
    free(s->window.d);
    free(s->window.tuning);
    free(s->instance);
    free(s->parameter);
    free(s->ports);
    free(s);
}

int apc_law_try(const struct apc_law *law, const struct apc_law_setup *setup, const double *tuning,
                struct apc_error *why)
{
    struct apc_instances *s;
    int rc = apc_instances_create(&s, law, setup, why);

    if (rc == 0 && tuning)
        rc = apc_instances_check(s, tuning, why);
    apc_instances_destroy(s);
    return rc;
}

int apc_law_published(const struct apc_law *law, const struct apc_law_setup *setup, apc_published_fn fn,
                      void *ctx, struct apc_error *why)
{
    struct apc_instances *s;
    int n = apc_instances_create(&s, law, setup, why);

    for (size_t k = 0; n >= 0 && k < s->size.instances; k++) {
        const struct apc_law_needs *needs = &s->instance[k].needs;

        for (size_t i = 0; i < needs->n_published; i++, n++)
            fn(ctx, k, &needs->published[i]);
    }
    apc_instances_destroy(s);
    return n;
}

/* ---- What there is --------------------------------------------------------------------------- */

struct apc_instances_size apc_instances_size(const struct apc_instances *s)
{
    return s->size;
}

const struct apc_instance_part *apc_instances_part(const struct apc_instances *s, size_t k)
{
    return &s->instance[k].part;
}

const struct apc_law_ports *apc_instances_ports(const struct apc_instances *s, size_t output)
{
    return &s->ports[output];
}

struct apc_law_parameter apc_instances_parameter(const struct apc_instances *s, size_t i)
{
    return s->parameter[i];
}

uint32_t apc_instances_mark(const struct apc_instances *s)
{
    return s->mark;
}

/* ---- Calls ----------------------------------------------------------------------------------- */

static void gather_numbered(double *to, const double *from, const int *number, size_t n)
{
    for (size_t i = 0; from && i < n; i++)
        to[i] = from[number[i]];
}

static void gather_rows(double *to, const double *from, size_t rows, size_t width, const int *number,
                        size_t n)
{
    for (size_t k = 0; from && k < rows; k++)
        gather_numbered(to + k * n, from + k * width, number, n);
}

/* The controller's tuning as instance k has it. */
static const double *own_tuning(struct apc_instances *s, size_t k, const double *tuning)
{
    const struct instance *of = &s->instance[k];

    if (s->law->whole)
        return tuning;
    for (size_t i = 0; i < of->n_tuning; i++)
        s->window.tuning[i] = tuning[of->tuning[i]];
    return s->window.tuning;
}

/* Where an instance has what the controller has at @p from: there, from number @p first on, or copied. */
#define SEEN(from, apart, first, copy) (!(from) ? NULL : (apart) ? (copy) : (from) + (first))

/* What instance k sees of the controller's arrays. */
static void find_own_signals(struct apc_instances *s, size_t k, const struct apc_law_call *whole)
{
    const struct apc_law_ports *p = &s->ports[k];
    struct instance *of = &s->instance[k];
    struct apc_law_call *c = &of->call;
    struct window *w = &s->window;
    const int y = p->ny ? p->y[0] : 0, z = p->nz ? p->z[0] : 0, d = p->nd ? p->d[0] : 0;

    c->y_status = SEEN(whole->y_status, of->y_apart, y, w->y_status);
    c->y_new = SEEN(whole->y_new, of->y_apart, y, w->y_new);
    c->y = SEEN(whole->y, of->y_apart, y, w->y);
    c->y_age = SEEN(whole->y_age, of->y_apart, y, w->y_age);
    c->y_low = SEEN(whole->y_low, of->y_apart, y, w->y_low);
    c->y_high = SEEN(whole->y_high, of->y_apart, y, w->y_high);
    c->z = SEEN(whole->z, of->z_apart, z, w->z);
    c->d = SEEN(whole->d, of->d_apart, d, w->d);
    c->tuning = SEEN(whole->tuning, of->tuning_apart, of->n_tuning ? of->tuning[0] : 0, w->tuning);
    c->low = SEEN(whole->low, false, k, NULL);
    c->high = SEEN(whole->high, false, k, NULL);
    c->rate = SEEN(whole->rate, false, k, NULL);
    c->u_last = SEEN(whole->u_last, false, k, NULL);
}

static void lay_out_instance(struct apc_instances *s, size_t k, const struct apc_law_call *whole)
{
    struct instance *of = &s->instance[k];
    struct apc_law_call *c = &of->call;

    *c = *whole;
    c->size = sizeof(*c);
    c->dim = of->dim;
    c->Ts = s->Ts;
    c->self = of->self;
    c->n_ahead = of->needs.n_ahead;
    c->x += of->part.x;
    if (c->published)
        c->published = of->part.n ? c->published + of->part.published : NULL;
    if (!s->law->whole)
        find_own_signals(s, k, whole);
}

void apc_instances_keep(struct apc_instances *s, const struct apc_law_call *call)
{
    for (size_t k = 0; k < s->size.instances; k++)
        lay_out_instance(s, k, call);
    s->kept = call;
}

/* What stands apart, and is therefore copied. */
static void copy_apart(struct apc_instances *s, size_t k, const struct apc_law_call *whole)
{
    const struct instance *of = &s->instance[k];
    const struct apc_law_ports *p = &s->ports[k];
    struct window *w = &s->window;

    for (size_t i = 0; of->y_apart && i < p->ny; i++) {
        if (whole->y_status)
            w->y_status[i] = whole->y_status[p->y[i]];
        if (whole->y_new)
            w->y_new[i] = whole->y_new[p->y[i]];
    }
    if (of->y_apart) {
        gather_numbered(w->y, whole->y, p->y, p->ny);
        gather_numbered(w->y_age, whole->y_age, p->y, p->ny);
        gather_numbered(w->y_low, whole->y_low, p->y, p->ny);
        gather_numbered(w->y_high, whole->y_high, p->y, p->ny);
    }
    if (of->z_apart)
        gather_rows(w->z, whole->z, whole->n_ahead, s->dim.nz, p->z, p->nz);
    if (of->d_apart)
        gather_rows(w->d, whole->d, whole->n_ahead, s->dim.nd, p->d, p->nd);
    if (of->tuning_apart)
        (void)own_tuning(s, k, whole->tuning);
}

/* The controller's call as instance k sees it. */
static struct apc_law_call *instance_call(struct apc_instances *s, size_t k, const struct apc_law_call *whole)
{
    struct instance *of = &s->instance[k];
    struct apc_law_call *c = &of->call;
    const size_t from = s->law->whole ? 0 : k;

    if (whole != s->kept) {
        lay_out_instance(s, k, whole);
        s->kept = NULL; /* another's arrays stand here now */
    }
    if (of->apart)
        copy_apart(s, k, whole);
    c->u = whole->u + from;
    c->limited = whole->limited + from;
    c->out = whole->out ? whole->out + from : NULL;
    c->gap = whole->gap;
    c->tick = whole->tick;
    c->t = whole->t;
    c->budget = whole->budget;
    c->deadline = whole->deadline;
    c->why = whole->why;
    c->say = whole->say;
    c->y_limited = whole->y_limited;
    if (c->y_limited && !s->law->whole)
        c->y_limited = memset(s->window.y_limited, 0, sizeof(s->window.y_limited));
    return c;
}

static bool is_in_order(const struct apc_instances *s, size_t k, const struct apc_law_call *c)
{
    return apc_values_ok(c->u, s->instance[k].dim.nu) && apc_values_ok(c->x, s->instance[k].needs.states);
}

void apc_instances_reset(struct apc_instances *s, size_t k, const struct apc_law_call *call)
{
    struct apc_law_call *c = instance_call(s, k, call);

    memset(c->x, 0, s->instance[k].needs.states * sizeof(*c->x));
    if (s->law->reset)
        s->law->reset(c);
}

int apc_instances_compute(struct apc_instances *s, size_t k, const struct apc_law_call *call)
{
    char *const said = call->why ? call->why : s->window.why;
    struct apc_law_call *c = instance_call(s, k, call);
    int result;

    c->why = said;
    said[0] = '\0';
    result = s->law->compute(c);
    for (size_t i = 0; s->law->selects && call->y_limited && i < c->dim.ny; i++)
        call->y_limited[s->ports[k].y[i]] = c->y_limited[i];
    said[APC_LAW_WHY - 1] = '\0';
    if (result < APC_LAW_GOOD || result > APC_LAW_FAILED)
        (void)snprintf(said, APC_LAW_WHY, "gave %d, which is no result", result);
    else if (result == APC_LAW_FAILED || is_in_order(s, k, c))
        return result;
    else
        (void)snprintf(said, APC_LAW_WHY, "gave no finite number");
    return APC_LAW_FAILED;
}

size_t apc_instances_terms(struct apc_instances *s, size_t i, const struct apc_law_call *call,
                           struct apc_law_term *term, size_t most)
{
    const struct apc_law_call *c = instance_call(s, s->law->whole ? 0 : i, call);

    if (s->law == &apc_law_pi)
        return apc_pi_terms(c, term, most);
    if (s->law == &apc_law_pid)
        return apc_pid_terms(c, term, most);
    return s->law == &apc_law_mpc || s->law == &apc_law_nmpc ? apc_mpc_terms(c, i, term, most) : 0;
}

void apc_instances_update(struct apc_instances *s, size_t k, const struct apc_law_call *call)
{
    struct apc_law_call *c = instance_call(s, k, call);

    if (s->law->update)
        s->law->update(c);
}

void apc_instances_track(struct apc_instances *s, size_t k, const struct apc_law_call *call)
{
    struct apc_law_call *c = instance_call(s, k, call);

    if (s->law->track)
        s->law->track(c);
}

static int check_parameter(const struct apc_instances *s, size_t i, double value, struct apc_error *why)
{
    const struct apc_law_parameter p = s->parameter[i];
    const struct apc_param *param = &s->law->tuning[p.number];

    if (apc_param_accepts(param, value))
        return 0;
    if (p.scope == APC_OF_LAW)
        return apc_fail(why, APC_ERANGE, "%s: %.15g is not within %.15g to %.15g", param->name, value,
                        param->low, param->high);
    return apc_fail(why, APC_ERANGE, "%s of %s %zu: %.15g is not within %.15g to %.15g", param->name,
                    p.scope == APC_OF_OUTPUT ? "output" : "measurement", p.of + 1, value, param->low,
                    param->high);
}

int apc_instances_check(struct apc_instances *s, const double *tuning, struct apc_error *why)
{
    int rc = 0;

    for (size_t i = 0; i < s->size.tuning && rc == 0; i++)
        rc = check_parameter(s, i, tuning[i], why);
    for (size_t k = 0; s->law->check && k < s->size.instances && rc == 0; k++) {
        const struct apc_law_setup setup = {
            .size = sizeof(setup), .dim = s->instance[k].dim, .Ts = s->Ts, .output = s->law->whole ? 0 : k};

        rc = s->law->check(&setup, own_tuning(s, k, tuning), why);
    }
    return rc;
}
