/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-controller: the control module. Each tick costs two round trips to the store: one reads all that
 * the law needs, one writes all that it made.
 */
#include <stdio.h>
#include <stdlib.h>

#include "common/daemon.h"
#include "run/run_internal.h"

static const struct argp_option option_list[] = {
    {"law", 'l', "NAME", 0,
     "Control law instead of the file's: built in, or ./file.so; its own tuning applies", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct daemon_options *o = state->input;
    if (key != 'l')
        return ARGP_ERR_UNKNOWN;
    o->overrides.law = arg;
    return 0;
}

static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct program program = {
    .name = "apc-controller",
    .doc = "Run a control law on the shared data.",
    .task = "controller",
    .parts = EXPERIMENT_LAW,
    .extra = &extra,
};

struct shell {
    struct daemon *d;
    struct apc_store *store;
    struct apc_controller *core;
    bool store_up;
};

static void report_store(struct shell *s, int rc)
{
    if (rc < 0 && s->store_up)
        daemon_event(s->d, APC_EVENT_WARNING, "store", "store lost, trying again: %s",
                     apc_store_error(s->store));
    if (rc >= 0 && !s->store_up)
        daemon_event(s->d, APC_EVENT_INFO, "store", "store connected again");
    s->store_up = rc >= 0;
}

/* The controller never repeats a row: one that is there already is somebody else's. */
static int append(struct shell *s, int n)
{
    const struct apc_rows *out = apc_controller_out(s->core);
    int rc = apc_store_append_rows(s->store, out);
    for (size_t i = 0; rc >= 0 && i < out->n_samples; i++)
        n -= out->sample[i].seq == 0; /* left out: somebody was faster */
    return rc < 0 || rc == n ? rc : APC_ECONFLICT;
}

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    struct apc_notice notice = {0};
    int rc = apc_store_read_rows(s->store, apc_controller_in(s->core));
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    int n = apc_controller_compute(s->core, now, tick->index, rc >= 0, &notice);
    if (rc >= 0)
        rc = append(s, n);
    apc_controller_update(s->core, rc < 0 ? -1 : 1);
    daemon_notice(s->d, &notice);
    report_store(s, rc);
    return daemon_fatal(s->d, s->store, rc);
}

/* Go on where the last controller of this run stopped, if there was one. */
static int resume(struct shell *s)
{
    int rc = apc_store_read_rows(s->store, apc_controller_former(s->core));
    if (rc < 0)
        return daemon_error(s->d, rc, "%s", apc_store_error(s->store));
    if (apc_controller_resume(s->core, s->d->start) == 1)
        daemon_event(s->d, APC_EVENT_INFO, "start", "resuming from the stored state");
    return 0;
}

static int open_shell(struct shell *s)
{
    size_t nu = s->d->experiment.dim.nu;
    struct apc_error why;
    int rc = cores_controller(&s->d->experiment, &s->core, &why);
    if (rc < 0)
        return daemon_error(s->d, rc, "%s", why.text);
    int64_t *last = calloc(nu, sizeof *last);
    if (!last)
        return daemon_error(s->d, APC_ENOMEM, "out of memory");
    s->d->store_timeout = daemon_timeout(s->d->experiment.controllers->rhythm.period);
    s->d->store_pause = s->d->experiment.controllers->rhythm.period;
    rc = daemon_store(s->d, &s->store, APC_ACTUATOR, nu, last);
    if (rc == 0)
        rc = resume(s);
    free(last);
    return rc;
}

static void close_shell(struct shell *s)
{
    apc_controller_destroy(s->core);
    apc_store_close(s->store);
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct shell s = {.d = &d, .store_up = true};
    int rc = daemon_open(&d, &program, &d.options, argc, argv);
    if (rc == 0)
        rc = open_shell(&s);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.controllers->rhythm, on_tick, &s);
    if (s.core && apc_controller_failures(s.core) > 0)
        daemon_event(
            &d, APC_EVENT_WARNING, "rejected", "law %s gave no usable output at %llu ticks of this run",
            d.experiment.controllers->law->name, (unsigned long long)apc_controller_failures(s.core));
    close_shell(&s);
    return daemon_close(&d, rc);
}
