/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc replay: what a controller would have done in a recorded run.
 *
 * The controller's core ticks where the recorded one did, at the times of its outputs, and is given what that
 * one had: the newest setpoints; the measurements that the client had brought by then, which it does at its
 * own instants; the mode. Its outputs go nowhere: the measurements stay those that the recorded outputs have
 * led to.
 */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "common/cores.h"
#include "print.h"
#include "samples.h"

#define ZERO APC_NS_PER_S /* t = 0 on both clocks of the replayed controller; not 0, which is "never" */

struct replay_options {
    const char *csv;
    double tolerance; /* < 0: none */
    struct experiment_overrides overrides;
};

enum { OPT_LAW = 0x600, OPT_CSV, OPT_TOLERANCE };

static const struct argp_option option_list[] = {
    {"law", OPT_LAW, "NAME", 0,
     "Control law instead of the run's: built in, or ./file.so; its own tuning applies", 0},
    {"tolerance", OPT_TOLERANCE, "U", 0, "End with code 1 when an output differs by more", 0},
    {"csv", OPT_CSV, "FILE", 0, "Write time,id,recorded,replayed there; - is stdout", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct replay_options *o = state->input;
    switch (key) {
    case OPT_LAW:
        o->overrides.law = arg;
        break;
    case OPT_TOLERANCE:
        if (apc_number_parse(arg, &o->tolerance) < 0 || o->tolerance < 0)
            argp_error(state, "--tolerance \"%s\": must be a number, 0 or above", arg);
        break;
    case OPT_CSV:
        o->csv = arg;
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct cli_spec spec = {
    .args_doc = "RUN",
    .doc = "Give the measurements, setpoints and modes of run folder RUN to a controller, and report how its "
           "outputs differ from the recorded ones. Tuning is the experiment file's; what an operator tuned "
           "meanwhile is not in the folder.",
    .min_args = 1,
    .max_args = 1,
    .extra = &extra,
};

/* How the outputs of one variable differ. */
struct difference {
    uint64_t same;
    double sum, worst, at, low, high; /* of the recorded ones: low, high */
};

struct replay {
    struct cli cli;
    struct replay_options options;
    struct experiment e;
    struct samples samples;
    struct {
        apc_ns at;
        enum apc_mode mode;
    } * modes; /* of the run's events, rising */
    size_t n_modes;

    struct apc_controller *core;
    struct apc_controller_size size;
    struct apc_sample *in, *out;
    size_t *next; /* [ny + nz] of each measurement and setpoint: the first sample not yet given */
    struct difference *difference; /* [nu] */
    uint64_t ticks;
    FILE *csv, *talk;
};

static int fail(const struct replay *r, int err, const struct apc_error *why)
{
    cli_error(&r->cli, err, "%s", why->text);
    return err;
}

/* ---- What was recorded -------------------------------------------------------------------- */

/* The actual mode as the controller's events tell it. */
static int read_modes(struct replay *r, const char *dir, struct apc_error *why)
{
    char path[600], *line = NULL;
    size_t size = 0, room = 0;
    double t;
    int rc = 0;

    snprintf(path, sizeof path, "%.580s/events.csv", dir);
    FILE *stream = fopen(path, "re");
    if (!stream)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", path, strerror(errno));
    while (rc == 0 && getline(&line, &size, stream) >= 0) {
        char *text = strstr(line, ",mode,\"mode "), *comma = strchr(line, ',');
        if (!text || !comma)
            continue;
        *comma = '\0';
        if (r->n_modes == room) {
            void *grown = reallocarray(r->modes, room = 2 * room + 8, sizeof *r->modes);
            if (!grown) {
                rc = apc_fail(why, APC_ENOMEM, "out of memory");
                break;
            }
            r->modes = grown;
        }
        if (apc_number_parse(line, &t) < 0 || apc_ns_from_s(t, &r->modes[r->n_modes].at) < 0)
            continue; /* the header, or no event of ours */
        text += strlen(",mode,\"mode ");
        r->modes[r->n_modes++].mode = !strncmp(text, "Man", 3)    ? APC_MODE_MAN
                                      : !strncmp(text, "Auto", 4) ? APC_MODE_AUTO
                                                                  : APC_MODE_OOS;
    }
    free(line);
    fclose(stream);
    return rc;
}

/*
 * What the operator wanted at the tick of @p t whose output has @p status: the mode of the newest event,
 * which is recorded shortly after the tick. An output that is not Good in mode Man was the fault value, in
 * mode Auto.
 */
static enum apc_mode mode_at(const struct replay *r, apc_ns t, apc_status status)
{
    enum apc_mode mode = r->e.controller.mode;
    for (size_t i = 0; i < r->n_modes && r->modes[i].at <= t + r->e.controller.rhythm.period / 2; i++)
        mode = r->modes[i].mode;
    return mode == APC_MODE_MAN && apc_status_severity(status) != APC_SEVERITY_GOOD ? APC_MODE_AUTO : mode;
}

/* When the client brought a measurement of that source time. */
static apc_ns arrival(const struct replay *r, apc_ns source)
{
    const struct rhythm *client = &r->e.client.rhythm;
    return apc_grid_time(client->phase, client->period, apc_grid_next(client->phase, client->period, source));
}

/* ---- The controller's inputs -------------------------------------------------------------- */

/* The newest sample of in[k] that was there at @p t. */
static void give(struct replay *r, size_t k, apc_ns t)
{
    struct apc_sample *in = &r->in[k];
    for (size_t *i = &r->next[k]; *i < r->samples.n; ++*i) {
        const struct apc_sample *s = &r->samples.at[*i];
        if (s->table != in->table || s->id != in->id)
            continue;
        if ((s->table == APC_SENSOR ? arrival(r, s->time) : s->time) > t)
            return;
        *in = *s;
        in->time += ZERO;
    }
}

/* What does not come from the samples: written before the run, or by an operator. */
static void give_value(struct apc_sample *in, int64_t seq, double value)
{
    in->seq = seq;
    in->time = ZERO;
    in->status = APC_GOOD;
    in->value = value;
}

/* @p tick points at the recorded outputs of one tick, [nu]. */
static void give_all(struct replay *r, const struct apc_sample *tick)
{
    const size_t ny = r->e.dim.ny, nz = r->e.dim.nz, nu = r->e.dim.nu;
    const size_t n_tuning = nu * r->e.controller.law->n_tuning;
    struct apc_sample *in = r->in + ny + nz;
    enum apc_mode mode = mode_at(r, tick->time, tick->status);

    for (size_t k = 0; k < ny + nz; k++)
        give(r, k, tick->time);
    give_value(in++, 1, mode);
    for (size_t i = 0; i < n_tuning; i++)
        give_value(in++, 1, r->e.controller.tuning[i]);
    for (size_t i = 0; i < nu; i++)
        give_value(in++, mode == APC_MODE_MAN ? tick[i].seq + 1 : 1, tick[i].value);
}

/* ---- The ticks ---------------------------------------------------------------------------- */

static void compare(struct replay *r, const struct apc_sample *recorded, double replayed)
{
    struct difference *d = &r->difference[recorded->id - 1];
    double apart = fabs(replayed - recorded->value), t = apc_ns_to_s(recorded->time);
    d->same += apart == 0;
    d->sum += apart;
    d->low = r->ticks ? fmin(d->low, recorded->value) : recorded->value;
    d->high = r->ticks ? fmax(d->high, recorded->value) : recorded->value;
    if (apart > d->worst) {
        d->worst = apart;
        d->at = t;
    }
    if (r->csv) {
        char a[40], b[40];
        apc_number_format(recorded->value, a, sizeof a);
        apc_number_format(replayed, b, sizeof b);
        fprintf(r->csv, "%.6f,%d,%s,%s\n", t, recorded->id, a, b);
    }
}

static void replay_tick(struct replay *r, const struct apc_sample *tick)
{
    const struct apc_now now = {.mono = ZERO + tick->time, .utc = ZERO + tick->time};
    struct apc_notice notice;
    give_all(r, tick);
    int n = apc_controller_compute(r->core, now, r->in, r->out, &notice);
    if (notice.kind != APC_NOTICE_NONE && notice.kind != APC_NOTICE_MODE)
        fprintf(r->talk, "%10.3f s  %s\n", apc_ns_to_s(tick->time), notice.text);
    for (int i = 0; i < n; i++)
        if (r->out[i].table == APC_ACTUATOR)
            compare(r, &tick[r->out[i].id - 1], r->out[i].value);
    apc_controller_update(r->core);
    r->ticks++;
}

/* The outputs of one tick have one time and stand together, in the order of their ids. */
static void replay_all(struct replay *r)
{
    const size_t nu = r->e.dim.nu;
    for (size_t i = 0; i + nu <= r->samples.n; i++) {
        const struct apc_sample *s = &r->samples.at[i];
        size_t n = 0;
        while (n < nu && s[n].table == APC_ACTUATOR && s[n].id == (int)n + 1 && s[n].time == s->time)
            n++;
        if (n == nu)
            replay_tick(r, s);
    }
}

/* ---- The command -------------------------------------------------------------------------- */

static int make_room(struct replay *r)
{
    r->size = apc_controller_size(r->core);
    r->in = calloc(r->size.in, sizeof *r->in);
    r->out = calloc(r->size.out, sizeof *r->out);
    r->next = calloc(r->e.dim.ny + r->e.dim.nz, sizeof *r->next);
    r->difference = calloc(r->e.dim.nu, sizeof *r->difference);
    if (!r->in || !r->out || !r->next || !r->difference)
        return APC_ENOMEM;
    apc_controller_inputs(r->core, r->in);
    return 0;
}

static int load(struct replay *r, struct apc_error *why)
{
    const char *dir = r->cli.args[0];
    char path[600];
    snprintf(path, sizeof path, "%.580s/run.conf", dir);
    int rc = experiment_load(&r->e, path, EXPERIMENT_LAW, &r->options.overrides, why);
    if (rc == 0)
        rc = samples_read(&r->samples, dir, why);
    if (rc == 0)
        rc = read_modes(r, dir, why);
    if (rc == 0)
        rc = cores_controller(&r->e, &r->core, why);
    if (rc == 0 && make_room(r) < 0)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    return rc;
}

static int print_differences(const struct replay *r)
{
    static const struct print_column columns[] = {{"", PRINT_LEFT},          {"ticks", PRINT_RIGHT},
                                                  {"the same", PRINT_RIGHT}, {"mean apart", PRINT_POINT},
                                                  {"at most", PRINT_POINT},  {"% of span", PRINT_POINT},
                                                  {"at s", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < r->e.dim.nu; i++) {
        const struct difference *d = &r->difference[i];
        print_cell(&table, PRINT_PLAIN, "%s", r->e.u[i].tag.name);
        print_cell(&table, PRINT_PLAIN, "%llu", (unsigned long long)r->ticks);
        print_cell(&table, PRINT_PLAIN, "%llu", (unsigned long long)d->same);
        print_cell(&table, PRINT_PLAIN, "%.3g", d->sum / (double)r->ticks);
        print_cell(&table, PRINT_PLAIN, "%.3g", d->worst);
        print_cell(&table, PRINT_PLAIN, d->high > d->low ? "%.4f" : "-", 100 * d->worst / (d->high - d->low));
        print_cell(&table, PRINT_PLAIN, "%.3f", d->at);
    }
    int rc = print_table_show(&table, r->talk, false, 0, "\n");
    print_table_close(&table);
    return rc;
}

static int replay(struct replay *r)
{
    struct apc_error why;
    const char *csv = r->options.csv;
    int rc = load(r, &why);
    if (rc < 0)
        return fail(r, rc, &why);
    if (csv && !(r->csv = !strcmp(csv, "-") ? stdout : fopen(csv, "w"))) {
        cli_error(&r->cli, APC_ESYS, "%s: cannot be written: %s", csv, strerror(errno));
        return APC_ESYS;
    }
    if (r->csv)
        fputs("time,id,recorded,replayed\n", r->csv);
    replay_all(r);
    if (r->csv && r->csv != stdout && fclose(r->csv) != 0) {
        cli_error(&r->cli, APC_ESYS, "%s: cannot be written: %s", csv, strerror(errno));
        return APC_ESYS;
    }
    if (r->ticks == 0) {
        cli_error(&r->cli, APC_ENOTFOUND, "%s/samples.csv holds no outputs", r->cli.args[0]);
        return APC_ENOTFOUND;
    }
    if ((rc = print_differences(r)) < 0) {
        cli_error(&r->cli, rc, "out of memory");
        return rc;
    }
    for (size_t i = 0; i < r->e.dim.nu && r->options.tolerance >= 0; i++)
        if (!(r->difference[i].worst <= r->options.tolerance)) {
            cli_error(&r->cli, APC_ESTATE, "%s differs by %g, more than %g", r->e.u[i].tag.name,
                      r->difference[i].worst, r->options.tolerance);
            return APC_ESTATE;
        }
    return 0;
}

int command_replay(int argc, char **argv)
{
    struct replay r = {.options = {.tolerance = -1}};
    cli_parse(&r.cli, &spec, &r.options, argc, argv);
    r.talk = r.options.csv && !strcmp(r.options.csv, "-") ? stderr : stdout;
    int rc = replay(&r);
    apc_controller_destroy(r.core);
    samples_free(&r.samples);
    experiment_free(&r.e);
    free(r.modes);
    free(r.in);
    free(r.out);
    free(r.next);
    free(r.difference);
    return cli_done(&r.cli, exit_code_of(rc));
}
