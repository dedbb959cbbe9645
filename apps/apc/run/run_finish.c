/* SPDX-License-Identifier: BSD-3-Clause */
/* After the daemons of `apc run` have stopped: the record is made whole, judged and reported. */
#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apc/folder/folder.h"
#include "apc/folder/run_recovery.h"
#include "apc/folder/spools.h"
#include "apc/report/report.h"
#include "base/text.h"
#include "control_history.h"
#include "run.h"

#define EXPORT_TRIES 60 /* a second each */
#define ASIDE        5  /* its nice value: the run that goes on comes first */

typedef int stage(const struct run *r, apc_ns since, apc_ns until, struct apc_error *why);

/* What the daemons could not store before they were stopped belongs to the record. */
static int drain(const struct run *r, apc_ns since, apc_ns until, struct apc_error *why)
{
    (void)since;
    (void)until;
    int rc = spools_drain(r->dir, r->cli.store, r->cli.timeout, why);
    if (r->history && (rc == 0 || rc == APC_EPROTO)) {
        const int kept = recovery_finish(r->cli.store, r->history, r->cli.timeout, why);
        rc = kept < 0 ? kept : rc;
    }
    return rc;
}

static apc_ns ran(const struct run *r)
{
    return (r->finish && r->finish < r->stopped ? r->finish : r->stopped) - r->begin;
}

static int export(const struct run *r, apc_ns since, apc_ns until, struct apc_error *why)
{
    return folder_export(r->dir, r->store, &r->e, r->start, apc_ns_to_s(ran(r)), since, until, why);
}

/* The store may just be away: nobody wants to lose a run for that. */
static int patiently(const struct run *r, stage *what, apc_ns since, apc_ns until, struct apc_error *why)
{
    const struct timespec pause = {1, 0};
    int rc = what(r, since, until, why);
    for (int tries = 0; (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_EBUSY) && tries < EXPORT_TRIES;
         tries++) {
        if (tries == 0)
            cli_error(&r->cli, rc, "%s; trying again", why->text);
        nanosleep(&pause, NULL);
        rc = what(r, since, until, why);
    }
    return rc;
}

/* The longest of those who command the plant. */
static apc_ns longest_hold(const struct experiment *e)
{
    apc_ns hold = 0;
    for (size_t i = 0; i < e->n_controllers; i++)
        for (size_t k = 0; k < e->controllers[i].dim.nu; k++)
            if (e->controllers[i].u[k].table == APC_ACTUATOR && e->controllers[i].hold > hold)
                hold = e->controllers[i].hold;
    return hold;
}

/* A run of which the record has not all is no success: nobody can say what it was. */
static void name_missing(struct run *r, const struct missing *missing)
{
    if (missing->empty)
        apc_fail(&r->failure, APC_ESTATE, "the record has no value of %s: see %s/*.log", missing->empty,
                 r->dir);
    else if (missing->name)
        apc_fail(&r->failure, APC_ESTATE,
                 "the record is not whole: of %s %" PRIu64 " of %" PRIu64 " rows were lost, see %s/*.log",
                 missing->name, missing->rows, missing->of, r->dir);
}

/* Why the run is not what it was to be, if it is not: in r->failure. */
static int judge_run(struct run *r, apc_ns since, apc_ns until, struct control *control)
{
    const struct apc_range range = {.since = since - 2 * SUPERVISOR_LEAD, .until = until};
    struct missing missing = {0};
    char why[400];
    apc_ns begin;
    int rc = control_history_begin(r->store, &r->e, r->start, &begin);
    control_begin(control, r->e.plant.external, apc_watchdog_make(r->e.client.rhythm.period, 0).link, begin);
    if (rc == 0)
        rc = control_history_read(r->store, &r->e, &range, control, &missing);
    if (rc < 0 || r->failure.text[0])
        return rc;
    control_end(control, until);
    const enum control_verdict verdict =
        control_judge(control, r->start, longest_hold(&r->e), why, sizeof why);
    if (verdict == CONTROL_OPEN)
        apc_fail(&r->failure, APC_ESTATE, "%s; see %s/*.log", why, r->dir);
    for (size_t i = 0; i < r->daemons.n && !r->failure.text[0]; i++) {
        const struct child *child = &r->daemons.child[i];
        if (child->faults > 0 && !child->aside)
            apc_fail(&r->failure, APC_ESTATE, "%s failed %u time%s and was started again: see %.300s",
                     child->title[0] ? child->title : child->name, child->faults, PLURAL(child->faults),
                     child->log);
    }
    if (verdict == CONTROL_AGAIN && !r->failure.text[0])
        apc_fail(&r->failure, APC_ESTATE, "%s", why);
    if (!r->failure.text[0])
        name_missing(r, &missing);
    return rc;
}

/* The last word on the run, into its records too. */
static void record_failure(const struct run *r, apc_ns until)
{
    struct apc_event event = {
        .time = until - APC_NS_PER_US, .severity = APC_EVENT_ALARM, .source = "apc-run", .kind = "stop"};
    if (!r->failure.text[0])
        return;
    snprintf(event.text, sizeof event.text, "the run failed: %.170s", r->failure.text);
    apc_store_append_events(r->store, &event, 1);
}

static int write_report(const struct run *r, struct apc_error *why)
{
    char title[sizeof r->e.title + sizeof r->failure.text + 32];
    snprintf(title, sizeof title, "%s%s%s", r->e.title, r->failure.text[0] ? " - failed: " : "",
             r->failure.text);
    return report_leave(&r->cli, r->dir, &r->e, title, NULL, why);
}

static int leave_run_report(struct run *r)
{
    struct apc_error why = {""};
    struct control control = {0};
    /* By how much the wall clock stepped meanwhile: samples before it and after it both belong to the run. */
    apc_ns step = apc_clock_offset(NULL, NULL) - (r->start - r->begin);
    if (r->options.pace || (step > -APC_NS_PER_S && step < APC_NS_PER_S))
        step = 0;
    apc_ns since = r->start + (step < 0 ? step : 0), until = r->start + ran(r) + (step > 0 ? step : 0);
    struct cli cli = r->cli;
    cli.store = r->record;
    int rc = cli_open(&cli, &r->store);
    if (rc < 0)
        return rc;
    int drained = patiently(r, drain, since, until, &why);
    rc = drained == APC_EPROTO ? 0 : drained; /* what is damaged is no reason not to give the rest */
    control.ever = r->options.pace;
    if (rc >= 0 && !r->options.pace && (rc = judge_run(r, since, until, &control)) < 0)
        apc_fail(&why, rc, "%s", apc_store_error(r->store));
    if (rc >= 0)
        record_failure(r, until);
    if (rc >= 0)
        rc = patiently(r, export, since, until, &why);
    /* somebody waits for a run that is rewound to go on */
    const int drawn = rc >= 0 && r->rewind == 0 ? write_report(r, &why) : 0;
    if (drawn < 0 && !r->failure.text[0])
        apc_fail(&r->failure, APC_ESTATE, "the record cannot be read: %.400s", why.text);
    if (rc >= 0 && drained < 0) {
        rc = drained;
        apc_fail(&why, rc, "a spool with waiting rows is damaged: see %s", r->dir);
    }
    if (drained == 0 || drained == APC_EPROTO) {
        segment_remove(&r->segment);
        if (r->rewind > 0 && rc >= 0)
            rc = folder_moved(r->dir, NULL, &why);
    }
    if (rc < 0) {
        cli_error(&r->cli, rc, "%s%s%s", r->failure.text, r->failure.text[0] ? "; no report: " : "",
                  why.text);
        const bool kept = drained < 0 && drained != APC_EPROTO && r->segment.path[0];
        if (kept && access(r->segment.path, F_OK) != 0)
            fprintf(stderr, "%s was removed while the run went on: what its history does not have is lost\n",
                    r->segment.path);
        else if (kept)
            fprintf(stderr, "the record is still in memory, %s: `apc drain '%s'` moves it to its history\n",
                    r->live_name, r->dir);
        return rc;
    }
    if (drawn > 0 && (!r->failure.text[0] || control.ever))
        printf("report:  %s/report.png, report.svg\n", r->dir);
    if ((!r->failure.text[0] || control.ever) && r->rewind == 0)
        printf("samples: %s/samples.csv\n", r->dir);
    fflush(stdout);
    return r->failure.text[0] ? cli_error(&r->cli, APC_ESTATE, "%s", r->failure.text), APC_ESTATE : 0;
}

/* In a process of its own: what it reads may be shared memory that somebody cuts short. */
int run_finish(struct run *r)
{
    int status;
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0) {
        if (r->rewind > 0)
            (void)setpriority(PRIO_PROCESS, 0, ASIDE);
        int rc = leave_run_report(r);
        apc_store_close(r->store);
        fflush(stdout);
        _exit(-rc);
    }
    if (pid < 0)
        return leave_run_report(r);
    if (r->rewind > 0) /* who waits for the run to go on does not wait for that: run_await_aside() */
        return 0;
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    if (WIFEXITED(status))
        return -WEXITSTATUS(status);
    cli_error(&r->cli, APC_ESTATE, "%s%sthe record could not be written (%s): the shared data are damaged",
              r->failure.text, r->failure.text[0] ? "; " : "", sigdescr_np(WTERMSIG(status)));
    return APC_ESTATE;
}
