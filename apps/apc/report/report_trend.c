/* SPDX-License-Identifier: BSD-3-Clause */
/* The trend of a loop on a page: measurement and setpoint above, output below. */
#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "apc/common/print.h"
#include "apcmath.h"
#include "report.h"

#define BINS  640
#define LEFT  60.0
#define WIDTH 640.0
#define TICKS 8 /* of time, at most */

/* One pen, by bins; of those without a value NAN. */
struct pen {
    const struct page_window *window;
    double low[BINS], high[BINS], last[BINS];
};

struct frame {
    double top, height, low, high; /* in pixels; of the scale */
};

static int take_pen_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct pen *p = ctx;
    const apc_ns middle = bin->from + (bin->until - bin->from) / 2, begin = p->window->from;
    const size_t i = (size_t)(BINS * (apc_ns_to_s(middle - begin) / apc_ns_to_s(p->window->until - begin)));
    if (i < BINS && bin->count > 0) {
        p->low[i] = bin->min;
        p->high[i] = bin->max;
        p->last[i] = bin->last;
    }
    return 0;
}

/* What came seldom stands until the next, no longer than it may. */
static void hold_pen(struct pen *p, double value, double bins)
{
    double since = 0;
    for (size_t i = 0; i < BINS; i++) {
        if (!isnan(p->last[i])) {
            value = p->last[i];
            since = 0;
        } else if (since++ < bins) {
            p->low[i] = p->high[i] = p->last[i] = value;
        }
    }
}

static int take_setpoint_before(void *ctx, const struct apc_sample *row)
{
    *(double *)ctx = row->value;
    return 0;
}

static int load_pen(struct pen *p, struct apc_store *store, const struct known_plant *plant,
                    enum apc_table table, int id, const struct page_window *w)
{
    const struct apc_range before = {.until = w->from, .last = 1};
    const struct apc_tag *tag = plant_tag(&plant->view, table, id);
    const double bin = apc_ns_to_s(w->until - w->from) / BINS, period = tag ? tag->period : 0;
    double value = (double)NAN;
    p->window = w;
    for (size_t i = 0; i < BINS; i++)
        p->low[i] = p->high[i] = p->last[i] = (double)NAN;
    if (id == 0)
        return 0;
    int rc = apc_store_history_bins(store, table, id, w->from, w->until, BINS, take_pen_bin, p);
    if (rc >= 0 && table == APC_SETPOINT && w->from > 0)
        rc = apc_store_history(store, table, id, &before, take_setpoint_before, &value);
    hold_pen(p, value, table == APC_SETPOINT ? BINS : 3 * period / bin);
    return rc < 0 ? rc : 0;
}

/* ---- Scales -------------------------------------------------------------------------------- */

static void widen_frame(struct frame *f, const struct pen *p)
{
    for (size_t i = 0; i < BINS; i++) {
        f->low = fmin(f->low, p->low[i]);
        f->high = fmax(f->high, p->high[i]);
    }
}

/* 1, 2 or 5 times a power of ten. */
static double nice_step(double wide)
{
    const double power = apc_pow(10, floor(apc_log10(wide))), of = wide / power;
    return power * (of <= 1 ? 1 : of <= 2 ? 2 : of <= 5 ? 5 : 10);
}

static double at_value(const struct frame *f, double value)
{
    return f->top + f->height * (f->high - value) / (f->high - f->low);
}

static void put_scale(FILE *out, struct frame *f, int most)
{
    if (!(f->high - f->low > 1e-9 * fmax(fabs(f->low), fabs(f->high)))) {
        const double middle = isfinite(f->low) ? f->low : 0, room = fmax(1, fabs(middle)) / 2;
        f->low = middle - room;
        f->high = middle + room;
    }
    const double step = nice_step((f->high - f->low) / most);
    f->low = floor(f->low / step + 1e-9) * step;
    f->high = ceil(f->high / step - 1e-9) * step;
    const int lines = (int)lround((f->high - f->low) / step);
    for (int i = 0; i <= lines; i++) {
        const double value = f->low + i * step, y = at_value(f, value);
        fprintf(out,
                "<path d=\"M%g %.1fh%g\" stroke=\"#ddd\"/><text x=\"%g\" y=\"%.1f\" "
                "text-anchor=\"end\">%.6g</text>\n",
                LEFT, y, WIDTH, LEFT - 4, y + 3, fabs(value) < step / 2 ? 0 : value);
    }
}

static void put_times(FILE *out, const struct page_window *w, double top, double bottom)
{
    static const int steps[] = {1,       2,        5,         10,        15,     30,     60,
                                120,     300,      600,       900,       1800,   3600,   7200,
                                10800,   21600,    43200,     86400,     172800, 604800, 2592000,
                                7776000, 31536000, 315360000, 1576800000};
    const double length = apc_ns_to_s(w->until - w->from);
    const time_t begin = w->from / APC_NS_PER_S;
    struct tm t;
    size_t k = 0;
    while (k + 1 < sizeof steps / sizeof *steps && length / steps[k] > TICKS)
        k++;
    if (!localtime_r(&begin, &t))
        return;
    const apc_ns step = steps[k] * APC_NS_PER_S, offset = w->zero ? -w->zero : t.tm_gmtoff * APC_NS_PER_S;
    for (apc_ns on = (w->from + offset + step - 1) / step * step - offset; on <= w->until; on += step) {
        time_t second = on / APC_NS_PER_S;
        if (!localtime_r(&second, &t))
            return;
        if (steps[k] >= 86400 && !w->zero) /* midnight, also of the other half of the year */
            second += offset / APC_NS_PER_S - t.tm_gmtoff;
        const double x = LEFT + WIDTH * apc_ns_to_s(second * APC_NS_PER_S - w->from) / length;
        char text[PRINT_LEN];
        if (w->zero)
            report_time(w, on, text);
        else if (!localtime_r(&second, &t) || !strftime(text, sizeof text,
                                                        steps[k] < 60        ? "%H:%M:%S"
                                                        : steps[k] < 86400   ? "%H:%M"
                                                        : steps[k] < 2592000 ? "%m-%d"
                                                                             : "%Y-%m",
                                                        &t))
            return;
        fprintf(out,
                "<path d=\"M%.1f %gV%g\" stroke=\"#ddd\"/><text x=\"%.1f\" y=\"%g\" "
                "text-anchor=\"middle\">%s</text>\n",
                x, top, bottom, x, bottom + 12, text);
    }
}

/* ---- Pens ---------------------------------------------------------------------------------- */

/* All that it was, from the lowest to the highest of each bin. */
static void put_pen(FILE *out, const struct frame *f, const struct pen *p, const char *style)
{
    bool down = false;
    fprintf(out, "<path fill=\"none\" %s d=\"", style);
    for (size_t i = 0; i < BINS; i++) {
        if (!isnan(p->last[i])) {
            const double x = LEFT + WIDTH * ((double)i + 0.5) / BINS, low = at_value(f, p->low[i]),
                         high = at_value(f, p->high[i]);
            fprintf(out, "%s%.1f %.1f", down ? "L" : "M", x, low);
            fprintf(out, low - high >= 0.1 ? "V%.1f" : "h.1", high);
        }
        down = !isnan(p->last[i]);
    }
    fputs("\"/>\n", out);
}

static void put_border(FILE *out, const struct frame *f)
{
    fprintf(out, "<rect x=\"%g\" y=\"%g\" width=\"%g\" height=\"%g\" fill=\"none\" stroke=\"#666\"/>\n", LEFT,
            f->top, WIDTH, f->height);
}

static void put_caption(FILE *out, const struct known_plant *plant, const struct loops_loop *l)
{
    const struct apc_tag *y = plant_tag(&plant->view, APC_SENSOR, l->measurement),
                         *u = plant_tag(&plant->view, l->table, l->output);
    fputs("<figcaption><b>", out);
    page_text(out, l->name);
    fputs("</b>", out);
    for (int i = 0; i < 2; i++) {
        const struct apc_tag *tag = i == 0 ? y : u;
        if (!tag)
            continue;
        fputs(i == 0 ? ": " : "; below ", out);
        page_text(out, tag->name);
        fputs(tag->unit[0] ? " in " : "", out);
        page_text(out, tag->unit);
        fputs(tag->description[0] ? ", " : "", out);
        page_text(out, tag->description);
    }
    fputs("</figcaption>\n", out);
}

int report_trend(FILE *out, struct apc_store *store, const struct known_plant *plant,
                 const struct loops_loop *l, const struct page_window *w)
{
    struct pen *pens = calloc(3, sizeof *pens);
    struct frame above = {6, 100, HUGE_VAL, -HUGE_VAL}, below = {120, 44, HUGE_VAL, -HUGE_VAL};
    if (!pens)
        return APC_ENOMEM;
    struct pen *y = &pens[0], *z = &pens[1], *u = &pens[2];
    int rc = load_pen(y, store, plant, APC_SENSOR, l->measurement, w);
    if (rc == 0)
        rc = load_pen(z, store, plant, APC_SETPOINT, l->setpoint, w);
    if (rc == 0)
        rc = load_pen(u, store, plant, l->table, l->table ? l->output : 0, w);
    widen_frame(&above, y);
    widen_frame(&above, z);
    widen_frame(&below, u);
    fputs("<figure>\n", out);
    put_caption(out, plant, l);
    fputs(
        "<svg viewBox=\"0 0 708 180\" font-size=\"9\" font-family=\"sans-serif\" role=\"img\" aria-label=\"",
        out);
    page_text(out, l->name);
    fputs("\">\n", out);
    put_times(out, w, above.top, below.top + below.height);
    put_scale(out, &above, 4);
    put_scale(out, &below, 2);
    put_pen(out, &above, y, "stroke=\"#7a9cc6\" stroke-width=\"1.2\"");
    put_pen(out, &above, z, "stroke=\"#111\" stroke-dasharray=\"6 3\"");
    put_pen(out, &below, u, "stroke=\"#1b3a6b\"");
    put_border(out, &above);
    put_border(out, &below);
    fputs("</svg>\n</figure>\n", out);
    free(pens);
    return rc;
}
