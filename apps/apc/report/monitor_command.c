/* SPDX-License-Identifier: BSD-3-Clause */
/* apc monitor: which loops need somebody, and what is wrong with them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/cli.h"
#include "apc/common/print.h"
#include "apc/folder/kpi_window.h"
#include "common/health_json.h"
#include "experiment/experiment.h"

struct monitor_options {
    bool json, notify;
    const char *from, *to;
    double horizon; /* s; 0: as health_series has it */
};

#define AT(member) .to = offsetof(struct monitor_options, member)
static const struct option_spec own_options[] = {
    {"json", 'J', NULL, "JSON on stdout", OPTION_FLAG, AT(json)},
    {"from", 0, "TIME",
     "From TIME on: s since the start of the run; of a store RFC 3339, or before now, as -10m, -2h, -1d; "
     "default: a day before --to",
     OPTION_TEXT, AT(from)},
    {"to", 0, "TIME", "The same until TIME", OPTION_TEXT, AT(to)},
    {"horizon", 0, "SECONDS",
     "How far the least variance looks ahead; with the loop's dead time plus a period the index is the "
     "Harris index; default: 10 periods",
     OPTION_NUMBER, AT(horizon), .high = 366 * 86400.0, .must = "be seconds, from 0 to 366 days"},
    {"notify", 0, NULL,
     "Write an event of kind \"health\" into --store for each loop whose health differs from that of its "
     "last such event within 30 days; apc-monitor@.timer does so every night",
     OPTION_FLAG, AT(notify)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[RUN]",
    .doc =
        "Judge each loop by its record, in run folder RUN or in the history of --store, the worst first. Can "
        "its sensor be trusted? Does its valve stick? Does it oscillate, by itself or by a disturbance? Do "
        "deviations last? The index is the least variance that any controller could have, over the recorded "
        "one: 1 is the best. The longest time in service with one setpoint is judged; it needs 500 ticks.",
    .takes = CLI_STORE | CLI_OWN_STORE,
    .max_args = 1,
    .options = own_options,
};

/* ---- For people --------------------------------------------------------------------------- */

static enum print_ink ink_of(enum health_verdict verdict)
{
    return verdict <= HEALTH_SWINGS ? PRINT_WARN : verdict == HEALTH_GOOD ? PRINT_PLAIN : PRINT_FAINT;
}

static int print_health(const struct kpis *m)
{
    static const struct print_column columns[] = {
        {"loop", PRINT_LEFT},          {"health", PRINT_LEFT},    {"service %", PRINT_POINT},
        {"at limits %", PRINT_POINT},  {"index", PRINT_POINT},    {"oscillation s", PRINT_POINT},
        {"friction", PRINT_POINT},     {"travel/h", PRINT_POINT}, {"reversals/h", PRINT_POINT},
        {"ticks judged", PRINT_POINT},
    };
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (const struct kpis_loop *l = m->loop; l < m->loop + m->n_loops; l++) {
        const struct health *h = &l->health;
        print_cell(&table, PRINT_PLAIN, "%s", l->name);
        print_cell(&table, ink_of(h->verdict), "%s", health_name(h->verdict));
        print_number(&table, 4, 100 * l->service);
        print_number(&table, 4, 100 * (l->low + l->high));
        print_number(&table, 2, h->index);
        print_number(&table, 3, h->swing);
        print_number(&table, 2, h->friction);
        print_number(&table, 3, h->travel);
        print_number(&table, 3, h->reversals);
        print_cell(&table, PRINT_PLAIN, "%zu", h->n);
    }
    return print_table_end(&table, stdout, cli_colour(), 0);
}

/* A verdict in a sentence, with what it rests on. */
static void print_words(const struct kpis_loop *l)
{
    struct text evidence = {0};
    health_evidence(&l->health, &evidence);
    printf("%s: %s%s%s\n", l->name, health_words(l->health.verdict), evidence.n > 1 ? "; " : "",
           evidence.at ? evidence.at : "");
    text_free(&evidence);
}

static int show_health(const struct kpis *m)
{
    const int rc = print_health(m);
    size_t unknown = 0;
    double least = 0;
    for (size_t i = 0; i < m->n_loops && rc == 0; i++) {
        unknown += m->loop[i].health.verdict == HEALTH_UNKNOWN;
        if (m->loop[i].health.verdict == HEALTH_UNKNOWN)
            least = fmax(least, m->loop[i].health.least);
        if (m->loop[i].health.verdict <= HEALTH_SLOW)
            print_words(&m->loop[i]);
    }
    if (unknown > 0 && rc == 0)
        printf("%zu of %zu: %s; %d ticks take %.4g s\n", unknown, m->n_loops, health_words(HEALTH_UNKNOWN),
               HEALTH_TICKS, least);
    return rc;
}

/* ---- For programs ------------------------------------------------------------------------- */

static void show_json(const struct kpis *m)
{
    struct text t = {.out = stdout};
    json_add(&t, "{from_s:%g, until_s:%g, loops:[", apc_ns_to_s(m->from), apc_ns_to_s(m->until));
    for (const struct kpis_loop *l = m->loop; l < m->loop + m->n_loops; l++) {
        json_add(&t, "\n{");
        health_members(l, &t);
        json_add(&t, "}");
    }
    json_add(&t, "\n]}\n");
}

/* ---- For who looks at events --------------------------------------------------------------- */

#define TELL_AGAIN (INT64_C(30) * 86400 * APC_NS_PER_S)

struct told {
    const struct kpis *m;
    enum health_verdict *last; /* [n_loops] 0: nothing */
};

/* Of two at once each would tell what the other one tells. The claim ends with the store. A role of people's, which
 * cannot claim anything, tells without it. */
static int claim_telling(const struct cli *cli, struct apc_store *store)
{
    struct apc_sample telling = {.table = APC_TICK, .id = 0}; /* controllers count from 1 */
    const int rc = apc_store_claim_set(store, &telling, 1);
    return rc == APC_EBUSY             ? cli_error(cli, rc,
                                                   "another apc monitor --notify is at work in this store (%s): wait for "
                                                               "its end",
                                                   apc_store_error(store))
           : rc < 0 && rc != APC_EPERM ? cli_store_error(cli, rc, store)
                                       : EXIT_OK;
}

/* "u: valve: the valve sticks ..." */
static void name_health(const struct kpis_loop *l, enum health_verdict verdict, char *text, size_t size)
{
    snprintf(text, size, "%.63s: %s: %s", l->name, health_name(verdict), health_words(verdict));
}

static int take_health_event(void *ctx, const struct apc_event *event)
{
    struct told *t = ctx;
    char text[sizeof event->text];
    for (size_t i = 0; i < t->m->n_loops && !strcmp(event->kind, "health"); i++)
        for (enum health_verdict v = HEALTH_SENSOR; v <= HEALTH_GOOD; v++) {
            name_health(&t->m->loop[i], v, text, sizeof text);
            if (!strcmp(event->text, text))
                t->last[i] = v;
        }
    return 0;
}

/* Of nothing told before, good is no news. */
static int tell_changes(const struct told *t, struct apc_store *store, apc_ns now)
{
    int rc = 0;
    for (size_t i = 0; i < t->m->n_loops && rc >= 0; i++) {
        const enum health_verdict verdict = t->m->loop[i].health.verdict,
                                  last = t->last[i] ? t->last[i] : HEALTH_GOOD;
        struct apc_event event = {.time = now,
                                  .severity = verdict < HEALTH_UNKNOWN ? APC_EVENT_WARNING : APC_EVENT_INFO,
                                  .source = "apc-monitor",
                                  .kind = "health"};
        if (verdict == HEALTH_UNKNOWN || verdict == last)
            continue;
        name_health(&t->m->loop[i], verdict, event.text, sizeof event.text);
        rc = apc_store_append_events(store, &event, 1);
    }
    return rc < 0 ? rc : 0;
}

static int tell_health(const struct cli *cli, struct apc_store *store, const struct kpis *m)
{
    const apc_ns now = apc_clock_utc(NULL);
    const struct apc_range range = {.since = now - TELL_AGAIN};
    struct told told = {m, calloc(m->n_loops + 1, sizeof *told.last)};
    int rc = told.last ? apc_store_events(store, &range, take_health_event, &told) : APC_ENOMEM;
    if (rc >= 0)
        rc = tell_changes(&told, store, now);
    free(told.last);
    return rc == APC_ENOMEM ? cli_error(cli, rc, "out of memory")
           : rc < 0         ? cli_store_error(cli, rc, store)
                            : EXIT_OK;
}

/* ---- The command -------------------------------------------------------------------------- */

static int monitor_run(const struct cli *cli, const struct monitor_options *o, struct kpis *m)
{
    struct apc_error why;
    struct experiment e;
    double from, to;
    int status = cli_seconds(cli, "from", o->from, &from);
    if (status == EXIT_OK)
        status = cli_seconds(cli, "to", o->to, &to);
    if (status != EXIT_OK)
        return status;
    int rc = experiment_load(&e, cli->args[0], EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why);
    if (rc == 0)
        rc = window_of_run(m, &e, cli->args[0], from, to, &o->horizon, &why);
    experiment_free(&e);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

static int monitor_store(const struct cli *cli, const struct monitor_options *o, struct kpis *m)
{
    struct apc_store *store = NULL;
    struct apc_error why;
    const struct health_asked asked = {.horizon = o->horizon, .give_up = INT64_MAX};
    apc_ns to = apc_clock_utc(NULL), from;
    if (cli_time(cli, "to", o->to, &to) != EXIT_OK)
        return EXIT_USAGE;
    from = to - 86400 * APC_NS_PER_S;
    if (cli_time(cli, "from", o->from, &from) != EXIT_OK)
        return EXIT_USAGE;
    int rc = cli_open(cli, &store);
    if (rc < 0)
        return exit_code_of(rc);
    *m = (struct kpis){.from = from, .until = to};
    int status = o->notify ? claim_telling(cli, store) : EXIT_OK;
    if (status == EXIT_OK && (rc = health_window_of_store(m, store, &asked, &why)) < 0)
        status = cli_error(cli, rc, "%s", why.text);
    if (status == EXIT_OK && o->notify)
        status = tell_health(cli, store, m);
    apc_store_close(store);
    return status;
}

int command_monitor(int argc, char **argv)
{
    struct monitor_options options = {0};
    struct kpis kpis = {0};
    struct cli cli;

    cli_parse(&cli, &spec, &options, argc, argv);
    if (cli.n_args == 0 && !cli.store)
        return cli_usage(&cli, "expected a run folder, or --store");
    if (cli.n_args > 0 && cli.store_given)
        return cli_usage(&cli, "expected a run folder or --store, not both");
    if (cli.n_args > 0 && options.notify)
        return cli_usage(&cli, "--notify writes into a store: give --store in place of the run folder");
    int status = cli.n_args == 0 ? monitor_store(&cli, &options, &kpis) : monitor_run(&cli, &options, &kpis);
    if (status == EXIT_OK && kpis.loop) {
        kpis_sort_by_health(&kpis);
        if (options.json)
            show_json(&kpis);
        else if (show_health(&kpis) < 0)
            status = cli_error(&cli, APC_ENOMEM, "out of memory");
    }
    kpis_free(&kpis);
    return cli_done(&cli, status);
}
