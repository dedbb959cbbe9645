/* SPDX-License-Identifier: BSD-3-Clause */
#include "report.h"

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

int report_write(const char *dir, const struct experiment *e, const char *title, struct apc_error *why)
{
    struct figure f = {.e = e, .title = title};
    int rc = report_read(&f.data, dir, why);

    if (rc == 0)
        rc = gnuplot_draw(dir, write_figure, &f, "report", why);
    report_free(&f.data);
    return rc;
}
