/* SPDX-License-Identifier: BSD-3-Clause */
/* apc report: the figure of a run folder again, and its figures. */
#include <sys/stat.h>
#include <unistd.h>

#include "cli.h"
#include "common/storeuri.h"
#include "folder.h"
#include "print.h"
#include "print_figures.h"
#include "report.h"
#include "run/run_internal.h"
#include "spools.h"

#define ROWS 60 /* of figures */

static error_t parse(int key, char *arg, struct argp_state *state)
{
    bool *json = state->input;
    (void)arg;
    if (key != 'J')
        return ARGP_ERR_UNKNOWN;
    *json = true;
    return 0;
}

static const struct argp_option option_list[] = {
    {"json", 'J', NULL, 0, "The figures as JSON on stdout, and draw nothing", 0}, {0}};
static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct cli_spec spec = {
    .args_doc = "DIR",
    .doc = "Draw report.svg and report.png of the run folder DIR again, from its CSV files, and print its "
           "figures: how well each loop was controlled, from each event to the next. Of "
           "a run that was killed, and so has left no samples.csv, they are first taken from its store: "
           "DIR/store.db or, "
           "where there is none, that of --store or APC_STORE.",
    .takes = CLI_STORE | CLI_OWN_STORE,
    .min_args = 1,
    .max_args = 1,
    .extra = &extra,
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
    char path[600], own[620];
    const char *uri = cli->store;
    struct apc_store *store;

    snprintf(path, sizeof path, "%.580s/store.db", cli->args[0]);
    snprintf(own, sizeof own, "sqlite:%s", path);
    if (access(path, F_OK) == 0)
        uri = own;
    if (!e->start || !uri)
        return apc_fail(
            why, APC_ENOTFOUND, "%.300s/samples.csv: there is none, %s", cli->args[0],
            e->start ? "nor a store.db: name the store of this run with --store"
                     : "and no record.conf says when the run began: apc history shows what is in its store");
    int rc = store_open(&store, uri, &options, why);
    if (rc == 0)
        rc = recover_from(cli, store, uri, e, why);
    if (rc == 0)
        fprintf(talk, "samples: %s/samples.csv, from the store\n", cli->args[0]);
    apc_store_close(store);
    return rc;
}

static int put_figures(const char *dir, const struct experiment *e, bool json, struct apc_error *why)
{
    struct figures figures = {0};
    struct course course;
    int rc = course_load(&course, dir, e, why);
    if (rc == 0 && (rc = figures_make(&figures, &course, e)) < 0)
        apc_fail(why, rc, "out of memory");
    if (rc == 0 && json) {
        putchar('{');
        print_json_text(stdout, "experiment", e->name);
        putchar(',');
        print_json_text(stdout, "title", e->title);
        putchar(',');
        figures_json(&figures, &course, e, stdout);
        puts("}");
    } else if (rc == 0) {
        rc = figures_print(&figures, &course, e, ROWS, stdout);
    }
    figures_free(&figures);
    course_free(&course);
    return rc;
}

int command_report(int argc, char **argv)
{
    struct cli cli;
    struct experiment e;
    struct apc_error why;
    char path[600];
    bool json = false;

    umask(077);
    cli_parse(&cli, &spec, &json, argc, argv);
    int rc = experiment_load(&e, cli.args[0], EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why);
    snprintf(path, sizeof path, "%.580s/samples.csv", cli.args[0]);
    if (rc == 0 && access(path, F_OK) != 0)
        rc = recover(&cli, &e, json ? stderr : stdout, &why);
    if (rc == 0 && !json)
        rc = report_write(cli.args[0], &e, e.title, &why);
    if (rc == 0)
        rc = put_figures(cli.args[0], &e, json, &why);
    experiment_free(&e);
    if (rc < 0)
        return cli_error(&cli, rc, "%s", why.text);
    if (!json)
        printf("report: %s/report.png, report.svg\n", cli.args[0]);
    return cli_done(&cli, EXIT_OK);
}
