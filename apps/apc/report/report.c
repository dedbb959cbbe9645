/* SPDX-License-Identifier: BSD-3-Clause */
#include "report.h"

#include <math.h>

#include "gnuplot.h"
#include "report_figure.h"

struct figure {
    struct report_data data;
    const struct experiment *e;
    const char *title;
};

static int write_figure(FILE *script, void *ctx)
{
    struct figure *f = ctx;

    return report_figure(script, &f->data, f->e, f->title);
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
    struct figure f = {.e = e, .title = title};
    const int read = report_read(&f.data, dir, why);

    if (read == 0 && expected)
        show_prediction_horizon(&f.data, expected);
    const int drawn = read == 0 ? gnuplot_draw(dir, write_figure, &f, "report", why) : read;
    report_free(&f.data);
    if (read == 0 && drawn < 0)
        cli_error(cli, drawn, "there is no figure: %s; `apc report %s` draws it once that is mended",
                  why->text, dir);
    return read < 0 ? read : drawn == 0;
}
