/* SPDX-License-Identifier: BSD-3-Clause */
/* What a plant did in a window, as a page for paper. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "apc/common/print.h"
#include "apc/common/print_prediction.h"
#include "apc/folder/kpi_window.h"
#include "experiment/experiment.h"
#include "report.h"

#define ACTORS 10 /* alarms that came most often */

struct page {
    FILE *out;
    struct apc_store *store;
    const struct page_window *window;
    struct apc_range range;
    struct known_plant plant;
    struct kpis kpis;
    struct outages outages;
    struct alarm_summary alarms; /* as they stood at the end */
    struct alarm_figures figures;
    size_t written, entered;
};

char *report_time(const void *window, apc_ns utc, char text[PRINT_LEN])
{
    const struct page_window *w = window;
    const time_t second = utc / APC_NS_PER_S;
    struct tm t;
    if (w->zero)
        snprintf(text, PRINT_LEN, "%.12g s", round(apc_ns_to_s(utc - w->zero) * 1e3) / 1e3);
    else if (!localtime_r(&second, &t) || !strftime(text, PRINT_LEN, "%Y-%m-%d %H:%M:%S", &t))
        print_second(utc, text);
    return text;
}

/* ---- What is read ------------------------------------------------------------------------- */

static bool is_of_people(const struct apc_event *event)
{
    return !strcmp(event->kind, "operator") || !strcmp(event->kind, "rejected");
}

static bool is_of_alarm(const struct apc_event *event)
{
    return !strcmp(event->kind, "alarm");
}

/* Neither what stands in another table, nor what goes well. */
static bool is_of_system(const struct apc_event *event)
{
    return !is_of_people(event) && !logbook_is_entry(event) && !is_of_alarm(event) &&
           strcmp(event->kind, "health") != 0 &&
           (event->severity >= APC_EVENT_WARNING || !strcmp(event->kind, "start") ||
            !strcmp(event->kind, "stop") || !strcmp(event->kind, "mode"));
}

static int count_report_event(void *ctx, const struct apc_event *event)
{
    struct page *p = ctx;
    p->written += !strcmp(event->kind, "operator");
    p->entered += logbook_is_entry(event);
    return 0;
}

/* Without alarms there are no figures of them. */
static int read_report_alarms(struct page *p, struct apc_error *why)
{
    struct apc_store *then = p->store;
    struct alarm_journal journal = {0};
    int rc =
        p->range.until < apc_store_now(p->store) ? apc_store_past(&then, p->store, p->range.until, why) : 0;
    if (rc == 0)
        rc = alarm_summary_open(&p->alarms, then, why);
    if (rc == 0 && (rc = alarm_summary_read(&p->alarms, then)) < 0)
        apc_fail(why, rc, "%s", apc_store_error(then));
    if (then != p->store)
        apc_store_close(then);
    if (rc == 0 && (rc = alarm_journal_load(&journal, p->store, p->alarms.e.n_alarms, &p->range)) < 0)
        apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(p->store));
    if (rc == 0 &&
        (rc = alarm_figures_make(&p->figures, &journal, &p->alarms.e, p->range.since, p->range.until)) < 0)
        apc_fail(why, rc, "%s", apc_err_text(rc));
    alarm_journal_free(&journal);
    return rc == APC_ENOTFOUND ? 0 : rc;
}

static int read_report(struct page *p, struct apc_error *why)
{
    const struct health_asked asked = {.horizon = 0, .give_up = INT64_MAX};
    int rc = apc_store_events(p->store, &p->range, count_report_event, p);
    if (rc >= 0)
        rc = outages_of_store(&p->outages, p->store, p->range.since, p->range.until);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(p->store));
    p->kpis = (struct kpis){.from = p->range.since, .until = p->range.until};
    rc = health_window_of_store(&p->kpis, p->store, &asked, why);
    if (rc == APC_EINVAL && !kpis_on_record(&p->kpis)) /* nothing is on record: the page says so */
        rc = 0;
    return rc < 0 ? rc : read_report_alarms(p, why);
}

/* ---- Sections ------------------------------------------------------------------------------ */

static double mean_service(const struct kpis *m)
{
    double sum = 0, n = 0;
    for (size_t i = 0; i < m->n_loops; i++)
        if (!isnan(m->loop[i].service)) {
            sum += m->loop[i].service;
            n++;
        }
    return n > 0 ? sum / n : (double)NAN;
}

static size_t count_ill(const struct kpis *m)
{
    size_t n = 0;
    for (size_t i = 0; i < m->n_loops; i++)
        n += m->loop[i].health.verdict > 0 && m->loop[i].health.verdict < HEALTH_UNKNOWN;
    return n;
}

static size_t count_standing(const struct page *p)
{
    size_t n = 0;
    for (size_t i = 0; i < p->alarms.e.n_alarms; i++)
        n += apc_alarm_is_standing(alarm_summary_state(&p->alarms.at[i]));
    return n;
}

static void put_key_figures(const struct page *p)
{
    const double service = 100 * mean_service(&p->kpis);
    char down[PRINT_LEN];
    FILE *out = p->out;
    fputs("<ul class=\"key\">\n", out);
    if (isnan(service))
        fputs("<li><b>-</b>in service</li>\n", out);
    else
        fprintf(out, "<li><b>%.3g %%</b>in service, mean of %zu loop%s</li>\n", service, p->kpis.n_loops,
                p->kpis.n_loops == 1 ? "" : "s");
    fprintf(out, "<li><b>%zu</b>loop%s to look at</li>\n", count_ill(&p->kpis),
            count_ill(&p->kpis) == 1 ? "" : "s");
    fprintf(out, "<li><b>%s</b>down, in %zu outage%s</li>\n",
            p->outages.n ? print_age(p->outages.down, down) : "0", p->outages.n,
            p->outages.n == 1 ? "" : "s");
    if (p->alarms.e.n_alarms > 0 && !p->window->folder)
        fprintf(out, "<li><b>%zu</b>alarm%s; %zu at the end</li>\n", p->figures.raised,
                p->figures.raised == 1 ? "" : "s", count_standing(p));
    fprintf(out, "<li><b>%zu</b>write%s by people</li>\n<li><b>%zu</b>in the log book</li>\n</ul>\n",
            p->written, p->written == 1 ? "" : "s", p->entered);
}

static int put_loops(const struct page *p)
{
    static const struct print_column columns[] = {{"Loop", PRINT_LEFT},
                                                  {"Health", PRINT_LEFT},
                                                  {"In service %", PRINT_POINT},
                                                  {"Auto %", PRINT_POINT},
                                                  {"Cas %", PRINT_POINT},
                                                  {"Man %", PRINT_POINT},
                                                  {"Other modes %", PRINT_POINT},
                                                  {"Not ticking %", PRINT_POINT},
                                                  {"At low limit %", PRINT_POINT},
                                                  {"At high limit %", PRINT_POINT},
                                                  {"SD in service", PRINT_POINT},
                                                  {"IAE", PRINT_POINT}};
    struct print_table table;
    fputs("<h2>Loops</h2>\n", p->out);
    if (!kpis_on_record(&p->kpis))
        return fputs("<p>Nothing is on record.</p>\n", p->out), 0;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (const struct kpis_loop *l = p->kpis.loop;
         l < p->kpis.loop + p->kpis.n_loops && table.n < (size_t)12 * PAGE_ROWS; l++) {
        const double share[] = {l->service,
                                l->mode[APC_MODE_AUTO],
                                l->mode[APC_MODE_CAS],
                                l->mode[APC_MODE_MAN],
                                l->mode[APC_MODE_OOS] + l->mode[APC_MODE_IMAN] + l->mode[APC_MODE_LO],
                                l->stopped,
                                l->low,
                                l->high};
        print_cell(&table, PRINT_PLAIN, "%s", l->name);
        print_cell(&table, PRINT_PLAIN, "%s", l->health.verdict ? health_name(l->health.verdict) : "");
        for (size_t i = 0; i < sizeof share / sizeof *share; i++)
            if (i > 0 && !(share[i] > 0))
                print_cell(&table, PRINT_PLAIN, "%s", "");
            else
                print_number(&table, 3, 100 * share[i]);
        print_number(&table, 4, l->with);
        if (isnan(l->iae))
            print_number(&table, 3, l->iae);
        else
            print_cell(&table, PRINT_PLAIN, "%.*f", l->iae < 10 ? 3 : l->iae < 1000 ? 1 : 0, l->iae);
    }
    const int rc = page_table(p->out, &table);
    fputs("<p>IAE: integral of the absolute deviation, in s times the unit of the measurement. Trends: the "
          "setpoint "
          "is dashed.</p>\n",
          p->out);
    for (size_t i = 0; i < p->kpis.n_loops; i++)
        if (p->kpis.loop[i].health.verdict > 0 && p->kpis.loop[i].health.verdict < HEALTH_UNKNOWN) {
            fputs("<p><b>", p->out);
            page_text(p->out, p->kpis.loop[i].name);
            fprintf(p->out, "</b>: %s</p>\n", health_words(p->kpis.loop[i].health.verdict));
        }
    page_left_out(p->out, p->kpis.n_loops, PAGE_ROWS);
    return rc;
}

/* The newest of which all has come; of a short window that of its middle. */
static int put_predictions(const struct page *p)
{
    struct prediction newest, o = {0};
    struct apc_error why;
    struct print_table table;
    char text[PRINT_LEN];
    double ahead = 0;
    int rc = window_prediction_of_store(&newest, p->store, p->range.until, &why);
    for (size_t i = 0; i < newest.n; i++)
        ahead = fmax(ahead, prediction_ahead(&newest.trajectory[i], newest.trajectory[i].n - 1));
    prediction_free(&newest);
    const double window = apc_ns_to_s(p->range.until - p->range.since);
    const apc_ns at = p->range.until - (apc_ns)(1e9 * fmin(ahead, window / 2));
    if (rc == 0)
        rc = window_prediction_of_store(&o, p->store, at, &why);
    if (rc == 0) {
        fprintf(p->out, "<h2>Prediction</h2>\n<p>What predictive laws expected at %s, and what came.</p>\n",
                report_time(p->window, at, text));
        prediction_table(&o, &table);
        rc = page_table(p->out, &table);
    }
    prediction_free(&o);
    return rc == APC_ENOTFOUND ? 0 : rc;
}

static int put_trends(const struct page *p)
{
    int rc = 0;
    for (size_t i = 0; i < p->plant.loops.n && i < PAGE_LOOPS && rc == 0; i++)
        rc = report_trend(p->out, p->store, &p->plant, &p->plant.loops.at[i], p->window);
    if (p->plant.loops.n > PAGE_LOOPS)
        fprintf(p->out, "<p>%zu loops are not drawn: the first %d are.</p>\n", p->plant.loops.n - PAGE_LOOPS,
                PAGE_LOOPS);
    return rc;
}

static int put_outages(const struct page *p)
{
    static const struct print_column columns[] = {
        {"From", PRINT_LEFT}, {"Until", PRINT_LEFT}, {"For", PRINT_RIGHT}, {"What", PRINT_LEFT}};
    struct print_table table;
    char text[PRINT_LEN];
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < p->outages.n && i < PAGE_ROWS; i++) {
        const struct outage *o = &p->outages.at[i];
        char others[32] = "", status[APC_STATUS_NAME_LEN];
        if (o->n > 1)
            snprintf(others, sizeof others, " and %zu more", o->n - 1);
        print_cell(&table, PRINT_PLAIN, "%s", report_time(p->window, o->from, text));
        print_cell(&table, PRINT_PLAIN, "%s",
                   o->until == p->range.until ? "" : report_time(p->window, o->until, text));
        print_cell(&table, PRINT_PLAIN, "%s", print_age(o->until - o->from, text));
        print_cell(&table, PRINT_PLAIN, "%.63s%s: %s", p->outages.tag[o->tag].name, others,
                   o->status != APC_GOOD    ? apc_status_format(o->status, status)
                   : o->table == APC_SENSOR ? "no measurement"
                                            : "no output: its controller did not tick");
    }
    fputs("<h2>Outages</h2>\n", p->out);
    fputs(p->outages.n == 0 ? "<p>None</p>\n" : "", p->out);
    const int rc = page_table(p->out, &table);
    page_left_out(p->out, p->outages.n, PAGE_ROWS);
    return rc;
}

static int by_times(const void *x, const void *y)
{
    const struct alarm_figure *a = *(const struct alarm_figure *const *)x,
                              *b = *(const struct alarm_figure *const *)y;
    return a->raised != b->raised ? (a->raised < b->raised) - (a->raised > b->raised) : (a > b) - (a < b);
}

static int put_actors(const struct page *p)
{
    static const struct print_column columns[] = {{"Alarm", PRINT_LEFT},  {"Priority", PRINT_RIGHT},
                                                  {"Times", PRINT_RIGHT}, {"Active for", PRINT_RIGHT},
                                                  {"", PRINT_LEFT},       {"Message", PRINT_LEFT}};
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    const struct alarm_figure **at = calloc(p->figures.n + 1, sizeof *at);
    struct print_table table;
    char text[PRINT_LEN];
    if (!at)
        return APC_ENOMEM;
    for (size_t i = 0; i < p->figures.n; i++)
        at[i] = &p->figures.alarm[i];
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): and again */
    qsort(at, p->figures.n, sizeof *at, by_times);
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < p->figures.n && i < ACTORS && at[i]->raised > 0; i++) {
        const struct alarm *alarm = &p->alarms.e.alarm[at[i] - p->figures.alarm];
        print_cell(&table, PRINT_PLAIN, "%s", alarm->name);
        print_cell(&table, PRINT_PLAIN, "%d", alarm->is.priority);
        print_cell(&table, PRINT_PLAIN, "%zu", at[i]->raised);
        print_cell(&table, PRINT_PLAIN, "%s", print_age(at[i]->active, text));
        print_cell(&table, PRINT_PLAIN, "%s", at[i]->chatters ? "chatters" : "");
        print_cell(&table, PRINT_PLAIN, "%s", alarm->message);
    }
    free(at);
    fputs(table.n > 0 ? "<h3>That came most often</h3>\n" : "", p->out);
    return page_table(p->out, &table);
}

/* What stood at the end, and what nobody was told of. */
static int put_standing(const struct page *p)
{
    static const struct print_column columns[] = {{"Alarm", PRINT_LEFT},
                                                  {"Priority", PRINT_RIGHT},
                                                  {"State", PRINT_LEFT},
                                                  {"Since", PRINT_LEFT},
                                                  {"Message", PRINT_LEFT}};
    struct print_table table;
    char text[PRINT_LEN];
    size_t n = 0;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < p->alarms.e.n_alarms; i++) {
        const struct alarm_now *now = &p->alarms.at[i];
        const enum apc_alarm_state state = alarm_summary_state(now);
        if (state == APC_ALARM_NORMAL || n++ >= PAGE_ROWS)
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", p->alarms.e.alarm[i].name);
        print_cell(&table, PRINT_PLAIN, "%d", p->alarms.e.alarm[i].is.priority);
        print_cell(&table, PRINT_PLAIN, "%s", apc_alarm_state_name(state));
        print_cell(&table, PRINT_PLAIN, "%s", report_time(p->window, now->row->time, text));
        print_cell(&table, PRINT_PLAIN, "%s", p->alarms.e.alarm[i].message);
    }
    fputs(n > 0 ? "<h3>Not normal at the end</h3>\n" : "", p->out);
    const int rc = page_table(p->out, &table);
    page_left_out(p->out, n, PAGE_ROWS);
    return rc;
}

static int put_alarms(const struct page *p)
{
    const struct alarm_figures *f = &p->figures;
    char text[PRINT_LEN];
    fputs("<h2>Alarms</h2>\n", p->out);
    if (p->alarms.e.n_alarms == 0)
        return fputs("<p>None are described.</p>\n", p->out), 0;
    if (p->window->folder) {
        fputs("<p>The run folder has no journal of alarms: what they said, without figures.</p>\n", p->out);
        const int n =
            page_events(p->out, p->store, &p->range, is_of_alarm, report_time, p->window, PAGE_ROWS);
        return n < 0 ? n : 0;
    }
    fprintf(p->out,
            "<p>%zu alarm%s, %.3g an hour; of priority 1: %zu, 2: %zu, 3: %zu, 4: %zu. Most in ten minutes: "
            "%zu; more than "
            "%d in %zu of %zu. Chattering: %zu.",
            f->raised, f->raised == 1 ? "" : "s", f->per_hour, f->by_priority[0], f->by_priority[1],
            f->by_priority[2], f->by_priority[3], f->peak, ALARMS_FLOOD, f->floods, f->windows,
            f->chattering);
    if (f->to_acknowledge >= 0)
        fprintf(p->out, " Acknowledged after %s on average.",
                print_age((apc_ns)(f->to_acknowledge * 1e9), text));
    fputs("</p>\n", p->out);
    const int rc = put_actors(p);
    return rc == 0 ? put_standing(p) : rc;
}

static int put_report_events(const struct page *p, const char *heading,
                             bool (*is)(const struct apc_event *event))
{
    fprintf(p->out, "<h2>%s</h2>\n", heading);
    const int rc = page_events(p->out, p->store, &p->range, is, report_time, p->window, PAGE_ROWS);
    return rc < 0 ? rc : 0;
}

static void put_report_head(const struct page *p)
{
    const struct page_window now = {.plant = ""};
    char text[PRINT_LEN], zone[16] = "";
    const time_t begin = p->range.since / APC_NS_PER_S;
    struct tm t;
    page_begin(p->out, "Report", p->window->plant);
    fputs(p->window->title[0] ? "<p><b>" : "", p->out);
    page_text(p->out, p->window->title);
    fputs(p->window->title[0] ? "</b></p>\n" : "", p->out);
    if (localtime_r(&begin, &t))
        (void)strftime(zone, sizeof zone, "UTC%z", &t);
    fprintf(p->out, "<p>From %s", report_time(p->window, p->range.since, text));
    fprintf(p->out, " until %s", report_time(p->window, p->range.until, text));
    if (p->window->zero)
        fputs(" of a simulation", p->out);
    else
        fprintf(p->out, ", local time (%s)", zone);
    fprintf(p->out, "; made %s, libapc %s</p>\n", report_time(&now, apc_clock_utc(NULL), text),
            apc_version());
}

static int put_report(struct page *p)
{
    put_report_head(p);
    put_key_figures(p);
    int rc = put_loops(p);
    if (rc == 0)
        rc = put_predictions(p);
    if (rc == 0)
        rc = put_outages(p);
    if (rc == 0)
        rc = put_alarms(p);
    if (rc == 0)
        rc = put_report_events(p, "Log book", logbook_is_entry);
    if (rc == 0)
        rc = put_report_events(p, "What people wrote", is_of_people);
    if (rc == 0)
        rc = put_report_events(p, "What else happened", is_of_system);
    fputs(rc == 0 ? "<h2>Trends</h2>\n" : "", p->out);
    if (rc == 0)
        rc = put_trends(p);
    fputs("</body>\n</html>\n", p->out);
    return rc;
}

int report_page(FILE *out, struct apc_store *store, const struct page_window *window, struct apc_error *why)
{
    struct page p = {.out = out,
                     .store = store,
                     .window = window,
                     .range = {.since = window->from, .until = window->until}};
    int rc = known_load(&p.plant, store);
    if (rc < 0)
        apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
    else if ((rc = read_report(&p, why)) == 0 && (rc = put_report(&p)) < 0)
        apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
    alarm_figures_free(&p.figures);
    alarm_summary_close(&p.alarms);
    outages_free(&p.outages);
    kpis_free(&p.kpis);
    known_free(&p.plant);
    return rc;
}
