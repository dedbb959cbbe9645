/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"
#include "operate/operate.h"

#define FILE_NAME "plant.csv"
#define HEADER    "time,what,id,value"

static size_t trajectory_curves(const struct apc_dim *dim)
{
    return dim->ny + 3 * dim->nz + dim->nu;
}

int trajectory_create(struct trajectory *c, const struct apc_dim *dim)
{
    *c = (struct trajectory){.dim = *dim, .gap = HUGE_VAL};
    c->output = calloc(trajectory_curves(dim), sizeof *c->output);
    c->setpoint = c->output + dim->ny;
    c->input = c->setpoint + dim->nz;
    c->target = c->input + dim->nu;
    c->rate = c->target + dim->nz;
    c->failed = !c->output;
    return c->output ? 0 : APC_ENOMEM;
}

void trajectory_free(struct trajectory *c)
{
    for (size_t i = 0; c->output && i < trajectory_curves(&c->dim); i++)
        free(c->output[i].at);
    free(c->output);
    free(c->without.at);
    memset(c, 0, sizeof *c);
}

void trajectory_add(struct trajectory *c, struct curve *curve, double t, double value)
{
    if (curve->n == curve->room) {
        size_t room = curve->room ? 2 * curve->room : 256;
        struct curve_point *at = reallocarray(curve->at, room, sizeof *at);
        if (!at) {
            c->failed = true;
            return;
        }
        curve->at = at;
        curve->room = room;
    }
    curve->at[curve->n++] = (struct curve_point){t, value};
}

void trajectory_change(struct trajectory *c, struct curve *curve, double t, double value)
{
    if (curve->n == 0 || curve->at[curve->n - 1].value != value)
        trajectory_add(c, curve, t, value);
}

/* ---- From samples ------------------------------------------------------------------------- */

/* How long each kind of sample may stay away: as the plant's watchdog has it. */
static double sample_patience(apc_ns period)
{
    return 3 * apc_ns_to_s(period) + 0.1;
}

/* A sign of life: of the measurements, of each output. */
struct life {
    double until; /* it may stay away */
    double limit; /* s without it, at most */
    bool bad;     /* it never came, or was not good */
};

/* Before what happens at @t is looked at: was there control all the time until then? */
static void watch_control(struct trajectory *c, const struct life *life, double t)
{
    double lost = life[0].until;
    for (size_t i = 1; i <= c->dim.nu; i++)
        lost = fmin(lost, life[i].until);
    if (lost < t)
        trajectory_change(c, &c->without, lost, 1);
}

static bool is_without(const struct trajectory *c, const struct life *life, double t)
{
    bool lost = false;
    for (size_t i = 0; i <= c->dim.nu; i++)
        lost = lost || life[i].bad || life[i].until < t;
    return lost;
}

/* [1 + nu]: of the measurements, of each output; NULL: out of memory. */
static struct life *lives(const struct experiment *e)
{
    const apc_ns plant = e->plant.rhythm.period, client = e->client.rhythm.period;
    struct life *life = calloc(1 + e->dim.nu, sizeof *life);
    if (!life)
        return NULL;
    life[0] = (struct life){0, sample_patience(client > plant ? client : plant), true};
    for (size_t i = 0; i < e->dim.nu; i++) {
        const struct controller *owner = controllers_above(e, (struct wire){APC_ACTUATOR, i}).of;
        life[1 + i] = (struct life){0, sample_patience(owner->rhythm.period), true};
    }
    return life;
}

int trajectory_of_samples(struct trajectory *c, const struct samples *samples, const struct experiment *e,
                          apc_ns start)
{
    struct life *life = lives(e);
    if (trajectory_create(c, &e->dim) < 0 || !life) {
        free(life);
        return APC_ENOMEM;
    }
    c->measured = true;
    c->gap = life[0].limit;
    trajectory_change(c, &c->without, 0, 1);
    for (size_t i = 0; i < samples->n; i++) {
        const struct apc_sample *s = &samples->at[i];
        const enum apc_severity severity = apc_status_severity(s->status);
        const size_t k = (size_t)s->id - 1;
        double t = apc_ns_to_s(s->time - start);
        if (c->end > t) /* the wall clock may have stepped back */
            t = c->end;
        c->end = t;
        if (s->table == APC_SETPOINT && k < c->dim.nz) {
            trajectory_change(c, &c->setpoint[k], t, s->value);
            continue;
        }
        watch_control(c, life, t);
        if (s->table == APC_SENSOR && k < c->dim.ny && severity != APC_SEVERITY_BAD) {
            trajectory_add(c, &c->output[k], t, s->value);
            life[0] = (struct life){t + life[0].limit, life[0].limit, false};
        } else if (s->table == APC_ACTUATOR && k < c->dim.nu) {
            struct life *of = &life[1 + k];
            trajectory_change(c, &c->input[k], t, s->value);
            *of = (struct life){t + of->limit, of->limit, severity != APC_SEVERITY_GOOD};
            trajectory_change(c, &c->without, t, is_without(c, life, t));
        }
    }
    watch_control(c, life, c->end);
    free(life);
    return c->failed ? APC_ENOMEM : 0;
}

/* ---- The file ----------------------------------------------------------------------------- */

static void write_curves(FILE *out, const char *what, const struct curve *curve, size_t n)
{
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < curve[i].n; k++) {
            char value[40];
            apc_number_format(curve[i].at[k].value, value, sizeof value);
            fprintf(out, "%.9f,%s,%zu,%s\n", curve[i].at[k].t, what, i + 1, value);
        }
}

int trajectory_write(const struct trajectory *c, const char *dir, struct apc_error *why)
{
    char path[600];
    snprintf(path, sizeof path, "%.580s/" FILE_NAME, dir);
    FILE *out = fopen(path, "we");
    if (!out)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    fputs(HEADER "\n", out);
    write_curves(out, "output", c->output, c->dim.ny);
    write_curves(out, "setpoint", c->setpoint, c->dim.nz);
    write_curves(out, "input", c->input, c->dim.nu);
    write_curves(out, "without", &c->without, 1);
    fprintf(out, "%.9f,%s,1,%d\n", c->end, "end", c->diverged);
    bool failed = ferror(out) != 0;
    failed |= fclose(out) != 0;
    return failed ? apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno)) : 0;
}

/* The curve that a line is about; NULL: there is none such. */
static struct curve *find_curve(struct trajectory *c, const char *what, double id)
{
    const struct {
        const char *name;
        struct curve *curve;
        size_t n;
    } of[] = {{"output", c->output, c->dim.ny},
              {"setpoint", c->setpoint, c->dim.nz},
              {"input", c->input, c->dim.nu},
              {"without", &c->without, 1}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        if (!strcmp(what, of[i].name) && id >= 1 && id <= (double)of[i].n && id == floor(id))
            return &of[i].curve[(size_t)id - 1];
    return NULL;
}

static int take_trajectory_row(struct trajectory *c, struct csv *csv, struct apc_error *why)
{
    double t = 0.0, id = 0.0, value = 0.0;
    int rc = csv_number(csv, 0, &t, why);

    if (rc == 0)
        rc = csv_number(csv, 2, &id, why);
    if (rc == 0)
        rc = csv_number(csv, 3, &value, why);
    if (rc < 0)
        return rc;
    if (!strcmp(csv_text(csv, 1), "end")) {
        c->end = t;
        c->diverged = value != 0;
        return 0;
    }
    struct curve *const curve = find_curve(c, csv_text(csv, 1), id);
    if (!curve)
        return csv_refuse(csv, why, "this experiment has no %.40s %g", csv_text(csv, 1), id);
    if (curve->n > 0 && t < curve->at[curve->n - 1].t)
        return csv_refuse(csv, why, "%.40s %g goes back in time", csv_text(csv, 1), id);
    trajectory_add(c, curve, t, value);
    return 0;
}

int trajectory_read(struct trajectory *c, const char *dir, const struct apc_dim *dim, struct apc_error *why)
{
    struct csv *csv = NULL;
    char path[600];
    int rc = trajectory_create(c, dim);

    if (rc < 0)
        return apc_fail(why, rc, "out of memory");
    c->end = -1;
    snprintf(path, sizeof path, "%.580s/" FILE_NAME, dir);
    rc = csv_open(&csv, path, why);
    if (rc == 0)
        rc = csv_expect(csv, HEADER, why);
    while (rc == 0 && (rc = csv_next(csv, why)) > 0)
        rc = take_trajectory_row(c, csv, why);
    csv_close(csv);
    if (rc == 0 && c->end < 0)
        rc = apc_fail(why, APC_EPROTO, "%s: is not whole: its last line must tell the end", path);
    if (rc == 0 && c->failed)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    return rc;
}

/* The row of a ramp of setpoint @first and those after it: which setpoint's; NULL: it is none. */
static struct curve *find_ramp(struct trajectory *c, struct curve *of, int first, const struct apc_sample *s)
{
    const size_t k = (size_t)s->id - (size_t)first;
    return s->table == APC_SETPOINT && s->id >= first && k < c->dim.nz ? &of[k] : NULL;
}

void trajectory_add_ramps(struct trajectory *c, const struct samples *operation, apc_ns start)
{
    for (size_t i = 0; i < operation->n; i++) {
        const struct apc_sample *s = &operation->at[i];
        struct curve *const rate = find_ramp(c, c->rate, LOOPS_RATE(1), s), *const of =
                                                                                rate
                                                                                    ? rate
                                                                                    : find_ramp(c, c->target,
                                                                                                LOOPS_RAMP(1),
                                                                                                s);
        if (of)
            trajectory_add(c, of, apc_ns_to_s(s->time - start), s->value);
    }
}

int trajectory_load(struct trajectory *c, const char *dir, const struct experiment *e, struct apc_error *why)
{
    struct samples samples = {0}, operation = {0};
    int rc = trajectory_read(c, dir, &e->dim, why);
    if (rc == APC_ENOTFOUND) {
        trajectory_free(c);
        rc = samples_read(&samples, dir, "samples.csv", why);
        if (rc == 0 && trajectory_of_samples(c, &samples, e, 0) < 0)
            rc = apc_fail(why, APC_ENOMEM, "out of memory");
    }
    if (rc == 0 && (rc = samples_read(&operation, dir, "operation.csv", why)) == APC_ENOTFOUND)
        rc = 0; /* a former version's */
    if (rc == 0)
        trajectory_add_ramps(c, &operation, 0);
    if (rc == 0 && c->failed)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    samples_free(&operation);
    samples_free(&samples);
    return rc;
}
