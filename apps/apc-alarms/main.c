/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-alarms: evaluates the alarms of the experiment, all of them in one order, and takes what people want of
 * them. What a tick has made is stored before anything else is looked at, so no transition is lost; while the
 * store is away nothing can be judged, and its tick row grows old.
 */
#include "daemon/daemon.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include "notifier.h"
#include "record/record.h"

struct options {
    bool test;
};

static const struct option_spec own_options[] = {
    {"test-notify", 0, NULL, "Send a test message to each command of `notify`, print the results, and end",
     OPTION_FLAG, .to = offsetof(struct options, test)},
    {0},
};

static const struct program program = {
    .ordinary = true,
    .name = "apc-alarms",
    .doc = "Evaluate the alarms of an experiment, and take acknowledgements and shelving.",
    .task = "alarms",
    .extra = own_options,
};

struct shell {
    struct daemon *d;
    struct apc_store *store;
    struct apc_alarms *core;
    struct notifier *notifier[ALARM_NOTICES];
    bool failing;
};

static void report_alarms_store(struct shell *s, int rc)
{
    if (rc < 0 && !s->failing)
        daemon_event(s->d, APC_EVENT_WARNING, "store", "alarms are not evaluated, trying again: %s",
                     apc_store_error(s->store));
    if (rc >= 0 && s->failing)
        daemon_event(s->d, APC_EVENT_INFO, "store", "alarms are evaluated again");
    s->failing = rc < 0;
}

/* Numbers of authors are each database user's own: the same name under ours. Where it cannot be had, the row
 * of the request says it. */
static int name_alarm_authors(struct shell *s)
{
    struct apc_rows *out = apc_alarms_out(s->core);
    char name[APC_AUTHOR_LEN];
    for (size_t i = 0; i < out->n_samples; i++) {
        struct apc_sample *row = &out->sample[i];
        if (row->author == 0)
            continue;
        int rc = apc_store_author_name(s->store, row->author, name);
        if (rc == 0)
            rc = apc_store_author(s->store, name);
        if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
            return rc;
        row->author = rc > 0 ? (uint32_t)rc : 0;
    }
    return 0;
}

static int evaluate(struct shell *s)
{
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    struct apc_notice notice;
    int rc = apc_store_read_rows(s->store, apc_alarms_in(s->core));
    if (rc < 0)
        return rc;
    apc_alarms_compute(s->core, now, &notice);
    daemon_notice(s->d, &notice);
    return 0;
}

static void notify(struct shell *s, const struct apc_sample *row, bool again)
{
    for (size_t i = 0; i < s->d->experiment.alarms.n_notices; i++)
        notifier_tell(s->notifier[i], row, again);
}

static void tell_transitions(struct shell *s)
{
    const struct apc_rows *out = apc_alarms_out(s->core);
    struct apc_event event;
    for (size_t i = 0; i < out->n_samples; i++) {
        const struct apc_sample *row = &out->sample[i];
        if (alarm_event(&s->d->experiment, row, &event)) {
            daemon_event(s->d, event.severity, event.kind, "%s", event.text);
            notify(s, row, false);
        } else if (row->table == APC_ALARM) {
            for (size_t k = 0; k < s->d->experiment.alarms.n_notices; k++)
                notifier_follow(s->notifier[k], row);
        }
    }
}

/* Whether a predecessor that died came to telling of what nobody has acknowledged, nobody knows. */
static int start_notifiers(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    const struct apc_rows *former = apc_alarms_former(s->core);
    for (size_t i = 0; i < e->alarms.n_notices; i++) {
        int rc = notifier_start(&s->notifier[i], s->d, &e->alarms.notice[i]);
        if (rc < 0)
            return rc;
    }
    for (size_t i = 0; i < former->n_samples; i++)
        if (former->sample[i].table == APC_ALARM && former->sample[i].seq > 0 &&
            apc_alarm_is_unacked((enum apc_alarm_state)(int)former->sample[i].value))
            notify(s, &former->sample[i], true);
    return 0;
}

static int on_alarms_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    int rc = apc_alarms_pending(s->core) ? 0 : evaluate(s);
    (void)tick;
    if (rc >= 0)
        rc = name_alarm_authors(s);
    if (rc >= 0)
        rc = apc_store_append_rows(s->store, apc_alarms_out(s->core));
    if (rc >= 0) {
        tell_transitions(s);
        apc_alarms_stored(s->core);
    }
    report_alarms_store(s, rc);
    return daemon_fatal(s->d, s->store, rc);
}

/* One writer of all alarms, and of what tells that it lives. */
static int claim(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    struct apc_sample *all = calloc(e->n_alarms + 1, sizeof *all);
    if (!all)
        return daemon_error(s->d, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < e->n_alarms; i++)
        all[i] = (struct apc_sample){.table = APC_ALARM, .id = (int)i + 1};
    all[e->n_alarms] = (struct apc_sample){.table = APC_TICK, .id = module_alarms_number(e)};
    const int rc = daemon_store(s->d, &s->store, all, e->n_alarms + 1);
    free(all);
    return rc;
}

static int open_alarms(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    struct apc_error why;
    if (e->n_alarms == 0)
        return daemon_error(s->d, APC_EINVAL,
                            "%s has no alarms: give a signal of it \"alarms\", or do not start apc-alarms",
                            e->file);
    int rc = module_alarms(e, &s->core, &why);
    if (rc < 0)
        return daemon_error(s->d, rc, "%s", why.text);
    s->d->store_timeout = daemon_timeout(e->alarms.rhythm.period);
    rc = claim(s);
    if (rc == 0 && (rc = apc_store_read_rows(s->store, apc_alarms_former(s->core))) < 0)
        return daemon_error(s->d, rc, "%s", apc_store_error(s->store));
    if (rc == 0) {
        apc_alarms_resume(s->core);
        rc = start_notifiers(s);
    }
    return rc;
}

/* Returns 0, or APC_ESYS: one of them did not take it. */
static int test_notify(struct daemon *d)
{
    const struct experiment *e = &d->experiment;
    int rc = 0;
    if (e->alarms.n_notices == 0)
        return daemon_error(d, APC_EINVAL, "%s has no command of `notify`: alarms are reported to nobody",
                            e->file);
    for (size_t i = 0; i < e->alarms.n_notices; i++) {
        char why[128] = "needs more memory than there is";
        const struct alarm_notice *is = &e->alarms.notice[i];
        if (notifier_try(e, is, why, sizeof why))
            printf("\"%s\" was told\n", is->command);
        else
            rc = daemon_error(d, APC_ESYS, "\"%s\" was not notified: it %s", is->command, why);
        (void)fflush(stdout);
    }
    return rc;
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct options options = {.test = false};
    struct shell s = {.d = &d};
    int rc = daemon_open(&d, &program, &options, argc, argv);
    if (rc == 0 && options.test)
        return daemon_close(&d, test_notify(&d));
    if (rc == 0)
        rc = open_alarms(&s);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.alarms.rhythm, on_alarms_tick, &s);
    for (size_t i = 0; i < ALARM_NOTICES; i++)
        notifier_stop(s.notifier[i]);
    apc_store_close(s.store);
    apc_alarms_destroy(s.core);
    return daemon_close(&d, rc);
}
