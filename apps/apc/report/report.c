/* SPDX-License-Identifier: BSD-3-Clause */
#include "report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "report_panels.h"

struct figure {
    const char *title;
    struct report_panels *panels;
    struct report_histograms *histograms;
};

static void put_run(FILE *script, void *ctx)
{
    const struct figure *f = ctx;
    gnuplot_string(script, "title", f->title);
    report_histograms_put(script, f->histograms);
    report_panels_put(script, f->panels);
}

static int draw_run(const char *dir, const char *called, const struct report_data *data,
                    const struct experiment *e, const char *title, struct apc_error *why)
{
    struct figure f = {.title = title};
    char *name = NULL;
    int rc = report_histograms_create(&f.histograms, data, e);
    if (rc == 0)
        rc = report_panels_create(&f.panels, data, e);
    if (rc == 0 && asprintf(&name, "%s/%s", dir, called) < 0)
        rc = APC_ENOMEM;
    rc = rc < 0 ? apc_fail(why, rc, "out of memory") : gnuplot_figure(name, figure_report, put_run, &f, why);
    report_panels_destroy(f.panels);
    report_histograms_destroy(f.histograms);
    free(name);
    return rc;
}

/* A horizon before and one after what was expected: at the length of a run nobody could see it. */
static void show_prediction_horizon(struct report_data *data, const struct prediction *expected)
{
    double begin = HUGE_VAL, end = 0;
    for (size_t i = 0; i < expected->n; i++) {
        const struct prediction_trajectory *c = &expected->trajectory[i];
        const double made = apc_ns_to_s(c->made), horizon = prediction_ahead(c, c->n - 1);
        begin = fmin(begin, fmax(0, made - horizon));
        end = fmax(end, made + 2 * horizon);
    }
    report_clip(data, begin, end);
    data->expected = expected;
}

int report_leave(const struct cli *cli, const char *dir, const struct experiment *e, const char *title,
                 const struct prediction *expected, struct apc_error *why)
{
    struct report_data data;
    const int read = report_read(&data, dir, why);

    if (read == 0 && expected)
        show_prediction_horizon(&data, expected);
    const int drawn = read == 0 ? draw_run(dir, "report", &data, e, title, why) : read;
    report_free(&data);
    if (read == 0 && drawn < 0)
        cli_error(cli, drawn, "there is no figure: %s; `apc report %s` draws it once that is mended",
                  why->text, dir);
    return read < 0 ? read : drawn == 0;
}

int report_leave_part(const char *dir, const struct experiment *e, const char *title,
                      const struct report_part *part, struct apc_error *why)
{
    struct report_data data;
    int rc = report_read(&data, dir, why);
    if (rc == 0) {
        report_clip(&data, part->begin, part->end);
        rc = draw_run(dir, part->name, &data, e, title, why);
    }
    report_free(&data);
    return rc;
}
