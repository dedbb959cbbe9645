/* SPDX-License-Identifier: BSD-3-Clause */
#include <unistd.h>

#include "cli.h"
#include "report.h"

#include "common/experiment.h"

static const struct cli_spec spec = {
    .args_doc = "DIR",
    .doc = "Draw report.svg and report.png of the run folder DIR again, from its samples.csv and timing.csv.",
    .min_args = 1,
    .max_args = 1,
};

int command_report(int argc, char **argv)
{
    struct cli cli;
    struct experiment e;
    struct apc_error why;
    char path[600];

    cli_parse(&cli, &spec, NULL, argc, argv);
    snprintf(path, sizeof path, "%.580s/run.conf", cli.args[0]);
    int rc = experiment_load(&e, path, 0, NULL, &why);
    if (rc == 0) {
        rc = report_write(cli.args[0], e.title, &why);
        experiment_free(&e);
    }
    if (rc < 0) {
        snprintf(path, sizeof path, "%.580s/samples.csv", cli.args[0]);
        return cli_error(
            &cli, rc, "%s%s", why.text,
            access(path, F_OK) == 0 || access(cli.args[0], F_OK) != 0
                ? ""
                : "; a run that was killed has its record in its store only (apc history, apc copy)");
    }
    printf("report: %s/report.png, report.svg\n", cli.args[0]);
    return EXIT_OK;
}
