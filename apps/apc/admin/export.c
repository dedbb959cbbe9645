/* SPDX-License-Identifier: BSD-3-Clause */
/* apc export: a controller of an experiment for other tools, as an FMU. */
#include <stdlib.h>
#include <string.h>

#include "apc/common/cli.h"
#include "experiment/experiment.h"
#include "fmu_archive.h"

struct options {
    const char *controller, *out;
    unsigned version; /* place among the versions */
};

static const char *const versions[] = {"3", "2", NULL};

#define AT(member) .to = offsetof(struct options, member)
static const struct option_spec own_options[] = {
    {"controller", 0, "NAME", "The controller to export; required if the file has several", OPTION_TEXT,
     AT(controller)},
    {"fmi", 0, "VERSION", "Version of the standard: 3 (default) or 2", OPTION_CHOICE, AT(version),
     .choices = versions, .must = "be 2 or 3"},
    {"output", 'o', "FILE.fmu",
     "The file to write; default: the experiment's name, and the controller's if there are several",
     OPTION_TEXT, AT(out), .must = "name a file"},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "fmu EXPERIMENT",
    .doc =
        "Make an FMU for co-simulation (fmi-standard.org) of a controller, for tools that import FMUs: its "
        "law with settings, tuning, estimator, limits, rate limits and backup law. Inputs are its "
        "measurements, disturbances and setpoints; outputs are its outputs. Tuning, target modes (NAME.mode) "
        "and the output in Man (NAME.manual) are parameters that may be set between steps. With "
        "follow.schedule 1 the experiment's scheduler sets the setpoints. A step is a tick: from the inputs "
        "at its beginning, the controller computes the outputs that act until its end. A step is as long as "
        "the period, or a multiple. A measurement that is not finite is Bad. The FMU holds the experiment "
        "file, the library of controllers for this kind of processor, and libconfig; it needs the C library "
        "of this system or a newer one. These cannot be exported: laws of your own, a law that takes the "
        "model of a plant of your own, and a controller whose output is another one's setpoint.",
    .min_args = 2,
    .max_args = 2,
    .options = own_options,
};

static int export_controller(const struct cli *cli, const struct options *o, const struct experiment *e)
{
    const struct controller *c;
    struct standalone *s = NULL;
    struct apc_error why;
    char *text = NULL, out[2 * APC_TAG_LEN + 8];
    int rc = standalone_find(e, o->controller, &c, &why);

    if (rc == 0)
        rc = model_files_embed(e, &text, &why);
    /* as it will be read: beside no other file */
    const struct experiment_source from = {.file = "/experiment.conf", .text = text};
    if (rc == 0)
        rc = standalone_create(&s, &from, c->name, &why);
    if (rc == 0) {
        snprintf(out, sizeof out, "%s%s%s.fmu", e->name, e->n_controllers > 1 ? "-" : "",
                 e->n_controllers > 1 ? c->name : "");
        const char *const file = o->out ? o->out : out;
        rc = fmu_archive_write(file, s, text, o->version == 0 ? 3 : 2, &why);
        if (rc == 0)
            printf("%s made: controller %s, one step is %g s\n", file, c->name,
                   apc_ns_to_s(c->rhythm.period));
    }
    if (rc < 0)
        rc = cli_error(cli, rc, "%s", why.text);
    standalone_destroy(s);
    free(text);
    return rc;
}

int command_export(int argc, char **argv)
{
    struct options o = {0};
    struct cli cli;
    struct experiment e;
    struct apc_error why;

    cli_parse(&cli, &spec, &o, argc, argv);
    if (strcmp(cli.args[0], "fmu") != 0)
        return cli_usage(&cli, "\"%s\": must be fmu, the only format", cli.args[0]);
    int rc = experiment_load(&e, cli.args[1], EXPERIMENT_LAW, NULL, &why);
    if (rc < 0)
        return cli_error(&cli, rc, "%s", why.text);
    rc = export_controller(&cli, &o, &e);
    experiment_free(&e);
    return cli_done(&cli, rc);
}
