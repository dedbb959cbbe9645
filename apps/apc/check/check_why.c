/* SPDX-License-Identifier: BSD-3-Clause */
/* What `apc why` says of an expectation that failed, and its figure, out of a run of its own, of which all is
 * kept. */
#include "check_print.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/folder/folder.h"
#include "apc/folder/simulation_export.h"
#include "apc/report/print_why.h"
#include "apc/report/report.h"

#define AROUND 0.1 /* of the run, before and after what failed: in its figure */

/* The expectations of one run. */
struct failures {
    struct checked *of;
    const struct check_report *report;
    uint64_t seed;
    char dir[600]; /* its folder; "": it leaves none */
    bool drawn;
    struct apc_error *why;
};

/* Did it fail, as is told of that run? */
static bool is_failure_of(const struct failures *f, size_t i, struct check_outcome *o)
{
    *o = checked_outcome(f->of, i);
    return !o->held && o->verdict && o->seed == f->seed;
}

static int put_answer(const struct check_move *move, const struct simulation *s, FILE *out)
{
    struct replay replay = {.controller = NULL};
    const struct why_question question = {.replay = &replay,
                                          .store = s->store,
                                          .simulated = s->e,
                                          .loop = move->loop,
                                          .at = SIMULATION_BEGIN + move->at,
                                          .over = move->over};
    struct apc_error why;
    const int rc = print_why(&question, out, &why);
    if (rc < 0 && rc != APC_ENOTFOUND) /* it failed before the first tick */
        fprintf(out, "%s: %s\n", move->loop, why.text);
    replay_free(&replay);
    return rc == APC_ENOMEM ? rc : 0;
}

static void put_folder(const struct failures *f, size_t i, const struct check_verdict *verdict,
                       const struct simulation *s, FILE *out)
{
    const double around = AROUND * f->of->scenario.e.duration, t = apc_ns_to_s(verdict->at);
    const struct scenario *of = &f->of->scenario;
    char name[32], words[300], title[CHECK_TEXT + sizeof words + 2];
    struct apc_error why;
    check_words(&of->expect[i], verdict, &of->sources, words, sizeof words);
    snprintf(title, sizeof title, "%s: %s", of->expect[i].text, words);
    snprintf(name, sizeof name, "failed-%zu", i + 1);
    const struct report_part part = {name, fmax(0, t - around), t + around};
    const bool drawn = f->drawn && report_leave_part(f->dir, s->e, title, &part, &why) == 0;
    fputs("run folder: ", out);
    print_clean(out, f->dir);
    if (drawn)
        fprintf(out, ", %s.png, %s.svg", name, name);
    putc('\n', out);
}

static int explain_failure(const struct failures *f, size_t i, const struct check_verdict *verdict,
                           const struct simulation *s)
{
    struct check_move move;
    size_t size;
    FILE *out = open_memstream(&f->of->why[i], &size);
    int rc = out ? check_find_move(&move, &f->of->scenario, i, verdict) : APC_ENOMEM;
    if (rc > 0)
        rc = put_answer(&move, s, out);
    if (rc == 0 && f->dir[0])
        put_folder(f, i, verdict, s, out);
    if (out && fclose(out) != 0)
        rc = APC_ENOMEM;
    return rc < 0 ? apc_fail(f->why, rc, "out of memory") : 0;
}

/* DIR/NAME-SEED, NAME of the scenario's file. */
static int name_failure_folder(struct failures *f)
{
    const char *slash = strrchr(f->of->scenario.file, '/'), *name = slash ? slash + 1 : f->of->scenario.file;
    const char *dot = strrchr(name, '.');
    const int n = snprintf(f->dir, sizeof f->dir, "%s/%.*s-%llu", f->report->dir,
                           (int)(dot && dot > name ? (size_t)(dot - name) : strlen(name)), name,
                           (unsigned long long)f->seed);
    return n < (int)sizeof f->dir ? 0 : apc_fail(f->why, APC_EINVAL, "--report: the path is too long");
}

/* Of a run that has been made: its experiment says when each condition came true. */
static int leave_folder(struct failures *f, const struct simulation *s)
{
    int rc = name_failure_folder(f);
    if (rc == 0)
        rc = folder_create(f->dir, s->e, f->report->force, f->why);
    if (rc == 0)
        rc = simulation_export(s, f->dir, "apc check", 0, f->why);
    if (rc == 0 && f->of->scenario.session)
        rc = folder_put_written(f->dir, &s->written, SIMULATION_BEGIN, f->why);
    if (rc == 0) {
        rc = report_leave(f->report->cli, f->dir, s->e, f->of->scenario.title, NULL, f->why);
        f->drawn = rc > 0;
    }
    return rc < 0 ? rc : 0;
}

static int explain_run(void *ctx, const struct simulation *s)
{
    struct failures *f = ctx;
    struct check_outcome o;
    int rc = f->report->dir ? leave_folder(f, s) : 0;
    for (size_t i = 0; i < f->of->scenario.n_expect && rc == 0; i++)
        if (is_failure_of(f, i, &o))
            rc = explain_failure(f, i, o.verdict, s);
    return rc;
}

static bool is_first_of_run(struct checked *c, size_t i)
{
    const uint64_t seed = checked_outcome(c, i).seed;
    const struct failures f = {.of = c, .seed = seed};
    struct check_outcome o;
    size_t k = 0;
    while (k < i && !is_failure_of(&f, k, &o))
        k++;
    return k == i && is_failure_of(&f, i, &o);
}

int checked_why(struct checked *c, const struct check_report *report, struct apc_error *why)
{
    int rc = 0;
    c->why = calloc(c->scenario.n_expect + 1, sizeof *c->why);
    if (!c->why)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < c->scenario.n_expect && rc == 0; i++) {
        struct failures f = {.of = c, .report = report, .seed = checked_outcome(c, i).seed, .why = why};
        if (!is_first_of_run(c, i))
            continue;
        rc = scenario_rerun(&c->scenario, f.seed, explain_run, &f, why);
    }
    return rc;
}

void checked_why_free(struct checked *c)
{
    for (size_t i = 0; c->why && i < c->scenario.n_expect; i++)
        free(c->why[i]);
    free(c->why);
}
