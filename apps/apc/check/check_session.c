/* SPDX-License-Identifier: BSD-3-Clause */
#include "check_session.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/simulate/trial.h"
#include "apc/simulate/worker_pool.h"
#include "figures/figures.h"

enum { RUN_SESSION, RUN_UNTOUCHED, RUN_REFERENCE, RUNS };

static const char *const run_keys[RUNS] = {"session", "untouched", "reference"};

struct check_session {
    struct scenario untouched, reference; /* untouched: of the session's, but for what people did */
    struct worker_pool *pool;             /* NULL: the runs have not been made */
    size_t stride, n;                     /* n: 2, or 3 where the file says what was to be done */
    char *runs;
    char dir[EXPERIMENT_PATH], who[200];
};

/* ---- What there is -------------------------------------------------------------------------- */

static void add_person(struct check_session *s, const char *name)
{
    char list[sizeof s->who + 4], wanted[APC_AUTHOR_LEN + 5];
    const size_t used = strlen(s->who);
    snprintf(list, sizeof list, ", %s, ", s->who);
    snprintf(wanted, sizeof wanted, ", %.*s, ", (int)sizeof wanted - 5, name);
    if (!strstr(list, wanted) && used + strlen(name) + 3 < sizeof s->who)
        snprintf(s->who + used, sizeof s->who - used, "%s%s", used > 0 ? ", " : "", name);
}

/* Who operated it, as its events say. */
static int read_people(struct check_session *s, struct apc_error *why)
{
    char path[sizeof s->dir + 16];
    struct csv *csv;
    snprintf(path, sizeof path, "%s/events.csv", s->dir);
    int rc = csv_open(&csv, path, why);
    if (rc == 0)
        rc = csv_expect(csv, PRINT_EVENT_HEADER, why);
    while (rc == 0 && (rc = csv_next(csv, why)) > 0) {
        rc = 0;
        if (!strcmp(csv_text(csv, 3), "operator") && strcmp(csv_text(csv, 2), "apc-simulate") != 0)
            add_person(s, csv_text(csv, 2));
    }
    csv_close(csv);
    return rc;
}

int checked_session_load(struct checked *c, struct apc_error *why)
{
    struct check_session *s = c->session = calloc(1, sizeof *s);
    if (!s)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    (void)experiment_run_dir(&c->scenario.e, s->dir);
    int rc = scenario_load_reference(&s->reference, &c->scenario, why);
    s->untouched = c->scenario;
    s->untouched.written = s->reference.written;
    s->n = s->reference.n_triggers + s->reference.e.n_actions > 0 ? 3 : 2;
    return rc < 0 ? rc : read_people(s, why);
}

void checked_session_free(struct checked *c)
{
    struct check_session *s = c->session;
    if (!s)
        return;
    scenario_free(&s->reference);
    worker_pool_destroy(s->pool, s->n * s->stride);
    free(s);
}

/* ---- The runs ------------------------------------------------------------------------------- */

static const struct scenario *run_of(const struct checked *c, size_t i)
{
    return i == RUN_SESSION     ? &c->scenario
           : i == RUN_UNTOUCHED ? &c->session->untouched
                                : &c->session->reference;
}

static struct session_run *session_run_at(const struct checked *c, size_t i)
{
    return (struct session_run *)(void *)(c->session->runs + i * c->session->stride);
}

struct session_work {
    const struct scenario *of;
    struct session_run *run;
};

static void make_session_run(void *ctx)
{
    const struct session_work *w = ctx;
    session_run_make(w->run, w->of);
}

static void work_on_session(void *ctx, unsigned job)
{
    const struct checked *c = ctx;
    struct session_work work = {run_of(c, job), session_run_at(c, job)};
    if (!trial_has_plugin(&work.of->e))
        make_session_run(&work);
    else if (trial_apart(make_session_run, &work, &work.run->made, work.run->why, sizeof work.run->why) < 0)
        work.run->rc = APC_ESYS;
    atomic_fetch_add(&c->session->pool->done, 1);
}

int checked_session_make(struct checked *c, unsigned processes, struct apc_error *why)
{
    struct check_session *s = c->session;
    void *results;
    s->stride = (session_run_size(&c->scenario) + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE;
    s->pool = worker_pool_create(s->n * s->stride, &results);
    if (!s->pool)
        return apc_fail(why, APC_ENOMEM, "no memory for %zu runs", s->n);
    s->runs = results;
    s->pool->jobs = s->pool->all = (unsigned)s->n;
    s->pool->what = "runs";
    int rc = worker_pool_run(s->pool, processes, work_on_session, c, why);
    for (size_t i = 0; i < s->n && i < RUNS && rc == 0; i++) {
        const struct session_run *run = session_run_at(c, i);
        if (!run->made || run->rc < 0)
            rc = apc_fail(why, run->rc < 0 ? run->rc : APC_ESTATE, "%s, %s: %s", s->dir, run_keys[i],
                          run->made ? run->why : "the run was not made");
    }
    return rc;
}

/* ---- Figures -------------------------------------------------------------------------------- */

/* When the first alarm was raised; 0: none was. */
static double first_alarm(const struct checked *c)
{
    double first = HUGE_VAL;
    for (size_t i = 0; i < c->scenario.e.n_alarms; i++)
        first = fmin(first, session_alarm(session_run_at(c, RUN_SESSION), &c->scenario, i)[SESSION_FIRST]);
    return isinf(first) ? 0 : first;
}

/* "set r2": what it writes to. */
static void name_action(const struct apc_tag *tags, size_t n, const struct action *action, char *text,
                        size_t size)
{
    size_t i = 0;
    while (i < n && (tags[i].table != action->to.table || tags[i].id != action->to.id))
        i++;
    snprintf(text, size, "%s %s",
             action->to.table == APC_OPMODE   ? "mode"
             : action->to.table == APC_TUNING ? "tune"
                                              : "set",
             i < n ? tags[i].name : apc_table_name(action->to.table));
}

/* Each thing that was to be done once: calls @p take with its name, and when it was done, s, NAN: never. */
static int each_action(const struct checked *c, void (*take)(void *ctx, const char *name, double at),
                       void *ctx)
{
    const struct scenario *reference = &c->session->reference;
    const double from = first_alarm(c);
    size_t n;
    struct apc_tag *tags = provision_tags(&reference->e, &n);
    const struct action *action, *other;
    for (size_t i = 0; tags && (action = session_next_action(reference, &i));) {
        char name[APC_TAG_LEN + 8];
        size_t k = 0;
        do
            other = session_next_action(reference, &k);
        while (other->to.table != action->to.table || other->to.id != action->to.id);
        name_action(tags, n, action, name, sizeof name);
        if (other == action)
            take(ctx, name, session_done(&c->scenario, action, from));
    }
    free(tags);
    return tags ? 0 : APC_ENOMEM;
}

/* ---- For people ----------------------------------------------------------------------------- */

static void put_seconds(struct print_table *t, double seconds, const char *none)
{
    if (isfinite(seconds))
        print_cell(t, PRINT_PLAIN, "%.6g", seconds);
    else
        print_cell(t, PRINT_PLAIN, "%s", isnan(seconds) ? "-" : none);
}

static void put_runs_row(const struct checked *c, struct print_table *t, const char *name,
                         double (*figure)(const struct checked *c, size_t run, size_t i), size_t i)
{
    print_cell(t, PRINT_PLAIN, "%s", name);
    for (size_t run = 0; run < c->session->n; run++)
        print_number(t, 4, figure(c, run, i));
}

static double session_iae(const struct checked *c, size_t run, size_t i)
{
    return session_run_at(c, run)->of[i];
}

static double session_beyond(const struct checked *c, size_t run, size_t i)
{
    (void)i;
    return session_run_at(c, run)->beyond;
}

static double session_active(const struct checked *c, size_t run, size_t i)
{
    return session_alarm(session_run_at(c, run), &c->scenario, i)[SESSION_ACTIVE];
}

static int show_session_runs(const struct checked *c, FILE *out, check_table_fn *put)
{
    static const struct print_column columns[] = {{"figure", PRINT_LEFT},
                                                  {"session", PRINT_POINT},
                                                  {"untouched", PRINT_POINT},
                                                  {"reference", PRINT_POINT}};
    struct loop *loop = calloc(controllers_loops(&c->scenario.e) + 1, sizeof *loop);
    const int n = loop ? metrics_loops(&c->scenario.e, loop) : APC_ENOMEM;
    const struct experiment *e = &c->scenario.e;
    struct print_table t;
    char name[APC_TAG_LEN + 24];
    print_table_open(&t, columns, 1 + c->session->n);
    for (int i = 0; i < n; i++) {
        snprintf(name, sizeof name, "IAE %s", loop[i].name);
        put_runs_row(c, &t, name, session_iae, (size_t)i);
    }
    put_runs_row(c, &t, "beyond limits s", session_beyond, 0);
    for (size_t i = 0; i < e->n_alarms; i++) {
        snprintf(name, sizeof name, "%s active s", e->alarm[i].name);
        put_runs_row(c, &t, name, session_active, i);
    }
    free(loop);
    const int rc = put(out, &t);
    return n < 0 ? n : rc;
}

static int show_session_alarms(const struct checked *c, FILE *out, check_table_fn *put)
{
    static const struct print_column columns[] = {{"alarm", PRINT_LEFT},
                                                  {"raised", PRINT_POINT},
                                                  {"first at s", PRINT_POINT},
                                                  {"acknowledged after s", PRINT_POINT}};
    struct print_table t;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < c->scenario.e.n_alarms; i++) {
        const double *alarm = session_alarm(session_run_at(c, RUN_SESSION), &c->scenario, i);
        print_cell(&t, PRINT_PLAIN, "%s", c->scenario.e.alarm[i].name);
        print_number(&t, 6, alarm[SESSION_RAISED]);
        put_seconds(&t, alarm[SESSION_FIRST], "");
        put_seconds(&t, alarm[SESSION_SLOWEST], "never");
    }
    return put(out, &t);
}

struct action_rows {
    struct print_table t;
    double from;
};

static void put_action_row(void *ctx, const char *name, double at)
{
    struct action_rows *rows = ctx;
    print_cell(&rows->t, PRINT_PLAIN, "%s", name);
    put_seconds(&rows->t, isnan(at) ? HUGE_VAL : at, "never");
    put_seconds(&rows->t, rows->from > 0 ? at - rows->from : (double)NAN, "");
}

static int show_session_actions(const struct checked *c, FILE *out, check_table_fn *put)
{
    static const struct print_column columns[] = {
        {"right action", PRINT_LEFT}, {"at s", PRINT_POINT}, {"after the first alarm s", PRINT_POINT}};
    struct action_rows rows = {.from = first_alarm(c)};
    print_table_open(&rows.t, columns, sizeof columns / sizeof *columns);
    const int failed = each_action(c, put_action_row, &rows), rc = put(out, &rows.t);
    return failed < 0 ? failed : rc;
}

int checked_session_show(const struct checked *c, FILE *out, check_table_fn *put)
{
    int rc = show_session_alarms(c, out, put);
    if (rc == 0)
        rc = show_session_actions(c, out, put);
    return rc == 0 ? show_session_runs(c, out, put) : rc;
}

const char *checked_session_folder(const struct checked *c)
{
    return c->session->dir;
}

const char *checked_session_who(const struct checked *c)
{
    return c->session->who[0] ? c->session->who : "nobody";
}

/* ---- For programs --------------------------------------------------------------------------- */

static void add_action(void *ctx, const char *name, double at)
{
    json_add(ctx, "{name:%s, at_s:%g}", name, at);
}

void checked_session_json(const struct checked *c, struct text *t)
{
    const struct experiment *e = &c->scenario.e;
    struct loop *loop = calloc(controllers_loops(e) + 1, sizeof *loop);
    const int n = loop ? metrics_loops(e, loop) : 0;
    json_add(t, "session:{folder:%s, who:%s, alarms:[", c->session->dir, c->session->who);
    for (size_t i = 0; i < e->n_alarms; i++) {
        const double *alarm = session_alarm(session_run_at(c, RUN_SESSION), &c->scenario, i);
        json_add(t, "{name:%s, raised:%g, first_at_s:%g, acknowledged:%i, acknowledged_after_s:%g}",
                 e->alarm[i].name, alarm[SESSION_RAISED], alarm[SESSION_FIRST],
                 isnan(alarm[SESSION_SLOWEST]) ? -1 : isfinite(alarm[SESSION_SLOWEST]),
                 alarm[SESSION_SLOWEST]);
    }
    json_add(t, "], actions:[");
    (void)each_action(c, add_action, t);
    json_add(t, "], runs:{");
    for (size_t run = 0; run < c->session->n && run < RUNS; run++) {
        json_add(t, "%s:{beyond_limits_s:%g, iae:[", run_keys[run], session_beyond(c, run, 0));
        for (int i = 0; i < n; i++)
            json_add(t, "{name:%s, value:%g}", loop[i].name, session_iae(c, run, (size_t)i));
        json_add(t, "], alarm_active_s:[");
        for (size_t i = 0; i < e->n_alarms; i++)
            json_add(t, "{name:%s, value:%g}", e->alarm[i].name, session_active(c, run, i));
        json_add(t, "]}");
    }
    json_add(t, "}}");
    free(loop);
}
