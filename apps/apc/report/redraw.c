/* SPDX-License-Identifier: BSD-3-Clause */
/* apc report: the figure of a run folder again, and its figures. */
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "apc/common/cli.h"
#include "apc/common/print.h"
#include "apc/common/print_figures.h"
#include "apc/common/print_kpis.h"
#include "apc/common/print_prediction.h"
#include "apc/folder/folder.h"
#include "apc/folder/kpi_window.h"
#include "apc/folder/run_recovery.h"
#include "apc/folder/runstore.h"
#include "apc/folder/spools.h"
#include "common/storeuri.h"
#include "experiment/experiment.h"
#include "report.h"
#include "simulation/simulation.h"

#define ROWS 60 /* of figures */
#define DAY  (86400 * APC_NS_PER_S)

struct report_options {
    bool json;
    const char *from, *to, *at, *html, *day;
};

#define AT(member) .to = offsetof(struct report_options, member)
static const struct option_spec own_options[] = {
    {"json", 'J', NULL, "JSON on stdout; draw nothing", OPTION_FLAG, AT(json)},
    {"from", 0, "TIME",
     "Only the KPIs, from TIME on, and draw nothing: s since the start of the run; of a store RFC 3339, or "
     "before now, as -10m, -2h, -1d; default: a day before --to",
     OPTION_TEXT, AT(from)},
    {"to", 0, "TIME", "The same until TIME", OPTION_TEXT, AT(to)},
    {"at", 0, "TIME",
     "Compare the predictions of predictive laws at TIME with the measurements that followed: a table "
     "instead of the figures, and curves in report.png",
     OPTION_TEXT, AT(at)},
    {"html", 0, "FILE",
     "Write a report for printing: the loops' KPIs and trends, predictions, outages, alarms, log book, "
     "operators' writes, other events. It is made from --store or the run's store. If a run has none, it is "
     "made from the run's files, with --from and --to in s. FILE may be a folder; the name is then that of "
     "plant and day. -: stdout",
     OPTION_TEXT, AT(html)},
    {"day", 0, "DATE",
     "With a store: that day, in local time, as 2026-01-31, today or yesterday; instead of --from and --to",
     OPTION_TEXT, AT(day)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[DIR]",
    .doc = "Draw report.svg and report.png of the run folder DIR, from its CSV files. Print its figures: how "
           "well each loop was controlled from each event to the next. Print its KPIs: time in service and "
           "at limits, standard deviations in and out of service, and how well predictions came true. "
           "Without DIR: the KPIs of the history of --store. A killed run has no samples.csv. It is then "
           "made first, from the store DIR/store.db, else from that of --store or APC_STORE.",
    .takes = CLI_STORE | CLI_OWN_STORE,
    .max_args = 1,
    .options = own_options,
};

/* What the daemons could not store belongs to it as well, as at the end of a run. */
static int recover_from(const struct cli *cli, struct apc_store *store, const char *uri,
                        const struct experiment *e, struct apc_error *why)
{
    const char *dir = cli->args[0];
    char differs[PROVISION_TEXT];
    int rc = provision_check(store, e, differs);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_EPERM ? differs : apc_store_error(store));
    rc = spools_drain(dir, uri, cli->timeout, why);
    if (rc < 0 && rc != APC_EPROTO)
        return rc;
    apc_ns length = 0;
    (void)apc_ns_from_s(e->duration, &length);
    int err = folder_export(dir, store, e, e->start, 0, e->start, length > 0 ? e->start + length : 0, why);
    return err < 0 ? err : rc;
}

/* The record of a run that came to no end is in its store. */
static int recover(const struct cli *cli, const struct experiment *e, FILE *talk, struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = cli->timeout};
    char path[600], own[RUNSTORE_LEN];
    const char *uri = cli->store;
    struct apc_store *store;

    int rc = recovery_of_killed_run(cli->args[0], cli->store, cli->timeout, why);
    if (rc < 0 && rc != APC_EPROTO && rc != APC_EBUSY)
        return rc;
    snprintf(path, sizeof path, "%.580s/store.db", cli->args[0]);
    snprintf(own, sizeof own, "sqlite:%s", path);
    if (rc == APC_EBUSY ? runstore_uri(cli->args[0], own, why) == 0 : access(path, F_OK) == 0)
        uri = own;
    if (!e->start || !uri)
        return apc_fail(
            why, APC_ENOTFOUND, "%.300s/samples.csv: there is none, %s", cli->args[0],
            e->start ? "nor a store.db: name the store of this run with --store"
                     : "and no record.conf says when the run began: apc history shows what is in its store");
    rc = store_open(&store, uri, &options, why);
    if (rc == 0)
        rc = recover_from(cli, store, uri, e, why);
    if (rc == 0)
        fprintf(talk, "samples: %s/samples.csv, from the store\n", cli->args[0]);
    apc_store_close(store);
    return rc;
}

static int put_kpis(const struct kpis *m, const struct experiment *e, apc_ns start, bool json)
{
    struct text t = {.out = stdout};
    if (!json)
        return kpis_print(m, stdout);
    json_add(&t, "{");
    if (e)
        json_add(&t, "experiment:%s", e->name);
    kpis_members(m, start, &t);
    json_add(&t, "}\n");
    return 0;
}

/* A day of local time, which may have 23 or 25 hours. */
static int take_day(const struct cli *cli, const char *day, apc_ns *from, apc_ns *to)
{
    const bool yesterday = !strcmp(day, "yesterday");
    time_t now = apc_clock_utc(NULL) / APC_NS_PER_S;
    struct tm t;
    if (!localtime_r(&now, &t))
        return cli_error(cli, APC_ESYS, "--day: the local time is not known");
    t.tm_hour = t.tm_min = t.tm_sec = 0;
    t.tm_mday -= yesterday;
    if (!yesterday && strcmp(day, "today") != 0) {
        const char *end = strptime(day, "%Y-%m-%d", &t);
        if (!end || *end || t.tm_year < 70 || t.tm_year >= 360) /* what nanoseconds can say */
            return cli_usage(cli,
                             "--day \"%s\": must be a day from 1970 to 2259, as 2026-01-31, today or "
                             "yesterday",
                             day);
    }
    const int month = t.tm_mon, mday = t.tm_mday;
    t.tm_isdst = -1;
    *from = mktime(&t) * APC_NS_PER_S;
    if (!yesterday && (t.tm_mon != month || t.tm_mday != mday))
        return cli_usage(cli, "--day \"%s\": there is no such day", day);
    t.tm_mday++;
    t.tm_hour = 0; /* it may have begun at one o'clock */
    t.tm_isdst = -1;
    *to = mktime(&t) * APC_NS_PER_S;
    return EXIT_OK;
}

/* What --day, --from and --to say of a store; none of them: the last day. */
static int take_store_window(const struct cli *cli, const struct report_options *o, apc_ns *from, apc_ns *to)
{
    *to = apc_clock_utc(NULL);
    if (o->day)
        return take_day(cli, o->day, from, to);
    if (cli_time(cli, "to", o->to, to))
        return EXIT_USAGE;
    *from = *to - DAY;
    return cli_time(cli, "from", o->from, from);
}

/* ---- A page ------------------------------------------------------------------------------- */

/* The newest that was measured, or nothing. */
static int find_report_end(const struct cli *cli, struct apc_store *store, const struct known_plant *plant,
                           apc_ns *end)
{
    struct apc_sample newest = {.table = APC_SENSOR};
    *end = 0;
    for (size_t i = 0; i < plant->view.n; i++) {
        newest.id = plant->tag[i].id;
        const int rc = plant->tag[i].table == APC_SENSOR ? apc_store_read(store, &newest, 1) : 0;
        if (rc < 0)
            return cli_store_error(cli, rc, store);
        *end = newest.seq > 0 && newest.time >= *end ? newest.time + 1 : *end;
    }
    return *end > 0 ? EXIT_OK
                    : cli_error(cli, APC_ENOTFOUND,
                                "no measurement is on record there: there is nothing to report");
}

/* Of a run's files in s since its start; no later than they end. */
static int take_files_window(const struct cli *cli, const struct report_options *o, apc_ns begin, apc_ns end,
                             apc_ns *from, apc_ns *to)
{
    double s[2];
    apc_ns after[2] = {0, end - begin};
    const int first = cli_seconds(cli, "from", o->from, &s[0]),
              status = first == EXIT_OK ? cli_seconds(cli, "to", o->to, &s[1]) : first;
    for (int i = 0; i < 2 && status == EXIT_OK; i++)
        if (!isnan(s[i]) && (apc_ns_from_s(s[i], &after[i]) < 0 || after[i] > end - begin))
            after[i] = end - begin;
    *from = begin + after[0];
    *to = begin + after[1];
    return status;
}

/* @p begin: of a run's files; 0: of a store. Nothing else said, of a run from its start to its end. */
static int take_page_window(const struct cli *cli, const struct report_options *o, struct apc_store *store,
                            apc_ns begin, apc_ns *from, apc_ns *to)
{
    struct known_plant plant;
    int rc = known_load(&plant, store), status = rc < 0 ? cli_store_error(cli, rc, store) : EXIT_OK;
    const apc_ns now = apc_store_now(store);
    const bool whole = !o->from && !o->to && !o->day;
    if (status == EXIT_OK && (begin || (cli->folder && whole)))
        status = find_report_end(cli, store, &plant, to);
    if (status == EXIT_OK)
        status = begin && !o->day       ? take_files_window(cli, o, begin, *to, from, to)
                 : cli->folder && whole ? cli_time(cli, "from", "0", from)
                                        : take_store_window(cli, o, from, to);
    known_free(&plant);
    *to = *to < now ? *to : now;
    if (status == EXIT_OK && *from >= *to)
        return cli_usage(cli, "the window is empty: it ends before it begins, or is in the future");
    return status;
}

/* The page appears whole or not at all. */
static int write_page(const char *path, struct apc_store *store, const struct page_window *w,
                      struct apc_error *why)
{
    char part[PATH_MAX + 32];
    snprintf(part, sizeof part, "%.4000s.%d.part", path, (int)getpid()); /* somebody else may write it too */
    FILE *out = fopen(part, "we");
    if (!out)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    int rc = report_page(out, store, w, why);
    const bool failed = ferror(out);
    if ((fclose(out) != 0 || failed) && rc == 0)
        rc = apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    if (rc < 0)
        (void)remove(part);
    return rc < 0 ? rc : folder_replace(part, path, why);
}

static void name_page(const char *html, const struct page_window *w, char path[PATH_MAX])
{
    char day[PRINT_LEN];
    struct stat at;
    if (stat(html, &at) == 0 && S_ISDIR(at.st_mode))
        snprintf(path, PATH_MAX, "%.3800s/%s%s%.10s.html", html, w->plant, w->plant[0] && !w->zero ? "-" : "",
                 w->zero ? "" : report_time(w, w->from, day));
    else
        snprintf(path, PATH_MAX, "%.4000s", html);
}

/* @p run: whose files the store was made of; NULL: it is one. */
static int put_page(const struct cli *cli, const struct report_options *o, struct apc_store *store,
                    const struct experiment *run)
{
    const apc_ns begin = !run ? 0 : run->start ? run->start : SIMULATION_BEGIN;
    struct page_window w = {.plant = "", .title = "", .folder = run, .zero = run && !run->start ? begin : 0};
    struct apc_error why;
    struct experiment e = {0};
    int64_t revision;
    char path[PATH_MAX];
    const int status = take_page_window(cli, o, store, begin, &w.from, &w.until);
    if (status != EXIT_OK)
        return status;
    int rc = experiment_stored(&e, store, &revision, &why);
    if (rc > 0) {
        w.plant = e.name;
        w.title = e.title;
    }
    name_page(o->html, &w, path);
    if (rc >= 0)
        rc = strcmp(o->html, "-") != 0 ? write_page(path, store, &w, &why)
                                       : report_page(stdout, store, &w, &why);
    experiment_free(&e);
    if (rc == 0 && strcmp(o->html, "-") != 0)
        printf("report: %s\n", path);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

/* Of a run whose store is none or gone, as is that of a simulation. */
static int make_page_of_files(const struct cli *cli, const struct report_options *o)
{
    struct apc_store *store = NULL;
    struct experiment e;
    struct apc_error why;
    int rc = experiment_load(&e, cli->args[0], EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why);
    if (rc == 0 && o->day && !e.start) {
        experiment_free(&e);
        return cli_usage(cli, "--day: a simulation has no days: --from and --to, in s since its start");
    }
    if (rc == 0)
        rc = folder_store(&store, cli->args[0], &e, e.start ? e.start : SIMULATION_BEGIN, &why);
    const int status = rc == 0 ? put_page(cli, o, store, &e) : cli_error(cli, rc, "%s", why.text);
    apc_store_close(store);
    experiment_free(&e);
    return status;
}

static int make_page(struct cli *cli, const struct report_options *o)
{
    struct apc_store *store = NULL;
    struct apc_error why;
    char uri[RUNSTORE_LEN];
    if (cli->n_args > 0 && cli->store_given)
        return cli_usage(cli, "expected a run folder or --store, not both");
    if (cli->n_args > 0 && runstore_uri(cli->args[0], uri, &why) == APC_ENOTFOUND)
        return make_page_of_files(cli, o);
    if (cli->n_args > 0) {
        cli->store = cli->args[0];
        cli_find_store(cli);
    }
    int status = exit_code_of(cli_open(cli, &store));
    if (status == EXIT_OK)
        status = put_page(cli, o, store, NULL);
    apc_store_close(store);
    return status;
}

/* Of a part of a run. */
static int report_window(const struct cli *cli, const struct report_options *o, const struct experiment *e)
{
    struct kpis kpis = {0};
    struct apc_error why;
    double from, to;
    int status = cli_seconds(cli, "from", o->from, &from);
    if (status == EXIT_OK)
        status = cli_seconds(cli, "to", o->to, &to);
    if (status != EXIT_OK)
        return status;
    int rc = window_of_run(&kpis, e, cli->args[0], from, to, NULL, &why);
    if (rc == 0 && (rc = put_kpis(&kpis, e, 0, o->json)) < 0)
        apc_fail(&why, rc, "out of memory");
    kpis_free(&kpis);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

/* Of a store's history. */
static int report_of_store(const struct cli *cli, const struct report_options *o)
{
    struct kpis kpis = {0};
    struct apc_store *store = NULL;
    struct apc_error why;
    apc_ns to = 0, from = 0;
    const int status = take_store_window(cli, o, &from, &to);
    if (status != EXIT_OK)
        return status;
    int rc = cli_open(cli, &store);
    if (rc < 0)
        return exit_code_of(rc);
    rc = window_of_store(&kpis, store, from, to, &why);
    if (rc == 0 && (rc = put_kpis(&kpis, NULL, 0, o->json)) < 0)
        apc_fail(&why, rc, "out of memory");
    if (rc < 0)
        cli_error(cli, rc, "%s", why.text);
    kpis_free(&kpis);
    apc_store_close(store);
    return exit_code_of(rc);
}

/* Of a run, laid over the figure; of a store, a table. */
static int put_prediction(const struct prediction *o, const struct experiment *e, bool json)
{
    struct text t = {.out = stdout};
    if (!json)
        return prediction_print(o, stdout);
    json_add(&t, "{");
    if (e)
        json_add(&t, "experiment:%s", e->name);
    prediction_member(o, &t);
    json_add(&t, "}\n");
    return 0;
}

static int report_prediction_of_run(const struct cli *cli, const struct report_options *o,
                                    const struct experiment *e)
{
    struct prediction prediction = {0};
    struct apc_error why;
    double at;
    const int status = cli_seconds(cli, "at", o->at, &at);
    if (status != EXIT_OK)
        return status;
    int rc = window_prediction_of_run(&prediction, e, cli->args[0], at, &why);
    const int drawn =
        rc == 0 && !o->json ? report_leave(cli, cli->args[0], e, e->title, &prediction, &why) : 0;
    if (rc == 0 && (rc = put_prediction(&prediction, e, o->json)) < 0)
        apc_fail(&why, rc, "out of memory");
    rc = drawn < 0 && rc == 0 ? drawn : rc;
    if (rc == 0 && drawn > 0)
        printf("report: %s/report.png, report.svg\n", cli->args[0]);
    prediction_free(&prediction);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

static int report_prediction_of_store(const struct cli *cli, const struct report_options *o)
{
    struct prediction prediction = {0};
    struct apc_store *store = NULL;
    struct apc_error why;
    apc_ns at = 0;
    if (cli_time(cli, "at", o->at, &at))
        return EXIT_USAGE;
    int rc = cli_open(cli, &store);
    if (rc < 0)
        return exit_code_of(rc);
    rc = window_prediction_of_store(&prediction, store, at, &why);
    if (rc == 0 && (rc = put_prediction(&prediction, NULL, o->json)) < 0)
        apc_fail(&why, rc, "out of memory");
    if (rc < 0)
        cli_error(cli, rc, "%s", why.text);
    prediction_free(&prediction);
    apc_store_close(store);
    return exit_code_of(rc);
}

static int put_run_figures(const char *dir, const struct experiment *e, bool json, struct apc_error *why)
{
    struct figures figures = {0};
    struct kpis kpis = {0};
    struct trajectory trajectory;
    int rc = trajectory_load(&trajectory, dir, e, why);
    if (rc == 0 && (rc = figures_make(&figures, &trajectory, e)) < 0)
        apc_fail(why, rc, "out of memory");
    if (rc == 0)
        rc = window_of_run(&kpis, e, dir, (double)NAN, (double)NAN, NULL, why);
    if (rc == 0 && json) {
        struct text t = {.out = stdout};
        json_add(&t, "{experiment:%s, title:%s", e->name, e->title);
        figures_members(&figures, &trajectory, e, &t);
        kpis_members(&kpis, 0, &t);
        json_add(&t, "}\n");
    } else if (rc == 0) {
        rc = figures_print(&figures, &trajectory, e, ROWS, stdout);
        if (rc == 0)
            rc = kpis_print(&kpis, stdout);
    }
    kpis_free(&kpis);
    figures_free(&figures);
    trajectory_free(&trajectory);
    return rc;
}

int command_report(int argc, char **argv)
{
    struct cli cli;
    struct experiment e;
    struct apc_error why;
    char path[600];
    struct stat at;
    struct report_options options = {0};

    umask(077);
    cli_parse(&cli, &spec, &options, argc, argv);
    if (cli.n_args == 0 && !cli.store)
        return cli_usage(&cli, "expected a run folder, or --store");
    if (options.at && (options.from || options.to))
        return cli_usage(&cli, "--at shows one time: leave --from and --to out");
    if (options.day && (options.from || options.to || options.at))
        return cli_usage(&cli, "--day is the whole day: leave --from, --to and --at out");
    if (options.html && (options.at || options.json))
        return cli_usage(&cli, "--html shows a window, as a page: leave --at and --json out");
    if (options.day && cli.n_args > 0 && !options.html)
        return cli_usage(&cli, "--day of a run folder goes with --html: add it, or give --store");
    if (cli.n_args > 0 && stat(cli.args[0], &at) == 0 && !S_ISDIR(at.st_mode))
        return cli_error(&cli, APC_EINVAL,
                         "%s is a file: expected the folder of a run, as apc run and apc simulate -o make it",
                         cli.args[0]);
    if (options.html)
        return cli_done(&cli, make_page(&cli, &options));
    if (cli.n_args == 0)
        return cli_done(&cli, options.at ? report_prediction_of_store(&cli, &options)
                                         : report_of_store(&cli, &options));
    const bool json = options.json;
    int rc = experiment_load(&e, cli.args[0], EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why);
    snprintf(path, sizeof path, "%.580s/samples.csv", cli.args[0]);
    const bool complete = rc == 0 && access(path, F_OK) == 0;
    if (complete && cli.store_given) {
        experiment_free(&e);
        return cli_usage(&cli, "%.300s has its own record, samples.csv: leave --store out", cli.args[0]);
    }
    if (rc == 0 && !complete)
        rc = recover(&cli, &e, json ? stderr : stdout, &why);
    if (rc == 0 && (options.from || options.to || options.at)) {
        const int status =
            options.at ? report_prediction_of_run(&cli, &options, &e) : report_window(&cli, &options, &e);
        experiment_free(&e);
        return cli_done(&cli, status);
    }
    if (rc == 0 && !json)
        folder_columns(cli.args[0]);
    struct apc_error unread;
    const int drawn = rc == 0 && !json ? report_leave(&cli, cli.args[0], &e, e.title, NULL, &unread) : 0;
    if (rc == 0)
        rc = put_run_figures(cli.args[0], &e, json, &why);
    experiment_free(&e);
    if (rc < 0)
        return cli_error(&cli, rc, "%s", why.text);
    if (drawn < 0) /* what the figures are made of is there */
        return cli_done(&cli, cli_error(&cli, drawn, "%s", unread.text));
    if (drawn > 0)
        printf("report: %s/report.png, report.svg\n", cli.args[0]);
    return cli_done(&cli, EXIT_OK);
}
