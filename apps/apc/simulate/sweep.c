/* SPDX-License-Identifier: BSD-3-Clause */
#include "sweep.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/common/setting.h"
#include "apc/report/gnuplot.h"
#include "campaign_summary.h"

#define MOST 1000 /* values */
#define ROWS 8    /* loops in a figure */

static const enum metric shown[] = {METRIC_IAE, METRIC_OVERSHOOT, METRIC_EFFORT};
#define SHOWN (sizeof shown / sizeof *shown)

/* Of one value and loop. */
struct point {
    struct statistic of[METRICS];
    unsigned made, diverged;
};

struct swept {
    const struct sweep *sweep;
    const struct campaign *campaign; /* [sweep->n] */
    struct point *point;             /* [sweep->n * loops] */
    double now;
};

int sweep_parse(const char *text, struct sweep *s, struct apc_error *why)
{
    static const char wanted[] = "expected PATH=FROM..TO:N, as controller.Kp=0.1..1:10";
    const char *equals = setting_equals(text), *dots = equals ? strstr(equals, "..") : NULL,
               *colon = dots ? strrchr(dots, ':') : NULL;
    char from[64], to[64];
    double n = 0;

    if (!colon || equals == text || (size_t)(equals - text) >= sizeof s->path)
        return apc_fail(why, APC_EINVAL, "\"%s\": %s", text, wanted);
    snprintf(s->path, sizeof s->path, "%.*s", (int)(equals - text), text);
    snprintf(from, sizeof from, "%.*s", (int)(dots - equals - 1), equals + 1);
    snprintf(to, sizeof to, "%.*s", (int)(colon - dots - 2), dots + 2);
    if (apc_number_parse(from, &s->from) < 0 || apc_number_parse(to, &s->to) < 0)
        return apc_fail(why, APC_EINVAL, "\"%s\": a sweep goes over numbers: %s", text, wanted);
    if (apc_number_parse(colon + 1, &n) < 0 || !(n >= 2 && n <= MOST && n == floor(n)))
        return apc_fail(why, APC_EINVAL, "\"%s\": N must be 2 to %d values", text, MOST);
    if (s->from == s->to)
        return apc_fail(why, APC_EINVAL, "\"%s\": goes from a value to the same one", text);
    s->n = (unsigned)n;
    return 0;
}

static double value_of(const struct sweep *s, unsigned i)
{
    char text[40];
    double value = s->to;
    sweep_value(s, i, text);
    (void)apc_number_parse(text, &value);
    return value;
}

/* Twelve digits: 0.3, not 0.30000000000000004. */
void sweep_value(const struct sweep *s, unsigned i, char text[40])
{
    double value = s->from + (s->to - s->from) * i / (s->n - 1);
    char digits[40];
    snprintf(digits, sizeof digits, "%.12g", i + 1 == s->n ? s->to : value);
    (void)apc_number_parse(digits, &value);
    (void)apc_number_format(value, text, 40);
}

/* ---- What they gave ------------------------------------------------------------------------ */

static const struct point *point_of(const struct swept *z, unsigned i, size_t loop)
{
    return &z->point[i * z->campaign->loops + loop];
}

static int gather_sweep(struct swept *z)
{
    const struct campaign *c = z->campaign;
    const unsigned runs = c->options->runs;
    struct column column = {calloc(runs, sizeof(double)), calloc(runs, sizeof(uint64_t)), 0};
    z->point = calloc(z->sweep->n * c->loops + 1, sizeof *z->point);
    const bool good = column.value && column.seed && z->point;
    for (unsigned i = 0; good && i < z->sweep->n; i++)
        for (size_t loop = 0; loop < c->loops; loop++) {
            struct point *p = &z->point[i * c->loops + loop];
            for (int m = 0; m < METRICS; m++)
                p->of[m] = summary_of(&c[i], loop, (enum metric)m, NULL, &column);
            for (unsigned run = 0; run < runs; run++) {
                p->made += campaign_trial(&c[i], run)->made;
                p->diverged += campaign_trial(&c[i], run)->diverged;
            }
        }
    free(column.value);
    free(column.seed);
    return good ? 0 : APC_ENOMEM;
}

/* Nothing for none. */
static void put_count(struct print_table *t, unsigned n)
{
    if (n > 0)
        print_cell(t, PRINT_PLAIN, "%u", n);
    else
        print_cell(t, PRINT_PLAIN, "%s", "");
}

static int put_table(const struct swept *z)
{
    const struct campaign *c = z->campaign;
    const bool several = c->options->runs > 1;
    const struct print_column columns[] = {
        {z->sweep->path, PRINT_POINT}, {"loop", PRINT_LEFT},     {"runs", PRINT_RIGHT},
        {"diverged", PRINT_RIGHT},     {"IAE", PRINT_POINT},     {"+- 95 %", PRINT_POINT},
        {"overshoot %", PRINT_POINT},  {"+- 95 %", PRINT_POINT}, {"control effort", PRINT_POINT},
        {"+- 95 %", PRINT_POINT}};
    struct print_table t;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (unsigned i = 0; i < z->sweep->n; i++)
        for (size_t loop = 0; loop < c->loops; loop++) {
            const struct point *p = point_of(z, i, loop);
            print_cell(&t, PRINT_PLAIN, "%.12g", value_of(z->sweep, i));
            print_cell(&t, PRINT_PLAIN, "%s", c->loop[loop].name);
            put_count(&t, several ? p->made : 0);
            put_count(&t, p->diverged);
            for (size_t k = 0; k < SHOWN; k++) {
                print_number(&t, 5, p->of[shown[k]].mean);
                if (several)
                    print_number(&t, 3, p->of[shown[k]].half);
                else
                    print_cell(&t, PRINT_PLAIN, "%s", "");
            }
        }
    return print_table_end(&t, c->options->talk, false, 0);
}

static int put_sweep_csv(const struct swept *z, struct apc_error *why)
{
    const struct campaign *c = z->campaign;
    const char *path = c->options->csv;
    FILE *out = !strcmp(path, "-") ? stdout : fopen(path, "we");
    char text[PRINT_LEN];
    if (!out)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    fputs("value,loop,runs,diverged", out);
    for (int m = 0; m < METRICS; m++)
        fprintf(out, ",%s,%s_half95", metric_key((enum metric)m), metric_key((enum metric)m));
    fputc('\n', out);
    for (unsigned i = 0; i < z->sweep->n; i++)
        for (size_t loop = 0; loop < c->loops; loop++) {
            const struct point *p = point_of(z, i, loop);
            fprintf(out, "%s,%zu,%u,%u", print_exact(value_of(z->sweep, i), text), loop + 1, p->made,
                    p->diverged);
            for (int m = 0; m < METRICS; m++) {
                const double pair[] = {p->of[m].mean, p->of[m].half};
                for (int k = 0; k < 2; k++)
                    fprintf(out, ",%s",
                            isinf(pair[k])   ? "inf"
                            : isnan(pair[k]) ? ""
                                             : print_exact(pair[k], text));
            }
            fputc('\n', out);
        }
    bool failed = ferror(out) != 0;
    failed |= out == stdout ? fflush(out) != 0 : fclose(out) != 0;
    return failed ? apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno)) : 0;
}

static void put_sweep_json(const struct swept *z)
{
    const struct campaign *c = z->campaign;
    struct text t = {.out = stdout};
    json_add(&t, "{experiment:%s, path:%s, now:%g, seed:%ju, runs:%u, points:[", c->e->name, z->sweep->path,
             z->now, (uintmax_t)c->options->seed, c->options->runs);
    for (unsigned i = 0; i < z->sweep->n; i++) {
        json_add(&t, ",\n{value:%g, loops:[", value_of(z->sweep, i));
        for (size_t loop = 0; loop < c->loops; loop++) {
            const struct point *p = point_of(z, i, loop);
            json_add(&t, "{loop:%s, runs:%u, diverged:%u", c->loop[loop].name, p->made, p->diverged);
            for (int m = 0; m < METRICS; m++)
                json_add(&t, "%s:{mean:%g, half95:%g}", metric_key((enum metric)m), p->of[m].mean,
                         p->of[m].half);
            json_add(&t, "}");
        }
        json_add(&t, "]}");
    }
    json_add(&t, "]}\n");
}

/* ---- The figure ---------------------------------------------------------------------------- */

static size_t rows_of(const struct swept *z)
{
    return z->campaign->loops < ROWS ? z->campaign->loops : ROWS;
}

/* A row each value: of each figure its mean, and within which it is; 1 where the plant diverged or the loop
 * never came to rest. */
static void put_points(FILE *script, const struct swept *z, size_t loop)
{
    for (unsigned i = 0; i < z->sweep->n; i++) {
        const struct point *p = point_of(z, i, loop);
        fprintf(script, "%#.12g", value_of(z->sweep, i));
        for (size_t k = 0; k < SHOWN; k++) {
            const struct statistic *s = &p->of[shown[k]];
            const double half = isfinite(s->half) ? s->half : 0;
            if (isfinite(s->mean))
                fprintf(script, " %.7g %.7g %.7g 0", s->mean, s->mean - half, s->mean + half);
            else
                fprintf(script, " NaN NaN NaN %d", isinf(s->mean) != 0);
        }
        fputc('\n', script);
    }
}

static void put_sweep(FILE *script, void *ctx)
{
    const struct swept *z = ctx;
    fprintf(script, "loops = %zu\npoints = %u\nseveral = %d\narray name[loops]\n", rows_of(z), z->sweep->n,
            z->campaign->options->runs > 1);
    fprintf(script, "low = %.12g\nhigh = %.12g\n", fmin(z->sweep->from, z->sweep->to),
            fmax(z->sweep->from, z->sweep->to));
    if (isfinite(z->now)) /* it is set */
        fprintf(script, "now = %.12g\n", z->now);
    gnuplot_string(script, "path", z->sweep->path);
    for (size_t loop = 0; loop < rows_of(z); loop++) {
        gnuplot_text(script, "name", loop, z->campaign->loop[loop].name);
        fprintf(script, "$loop%zu << END\n", loop + 1);
        put_points(script, z, loop);
        fputs("END\n", script);
    }
}

/* ---- All of it ----------------------------------------------------------------------------- */

static void keep_first_error(int *rc, int next)
{
    if (*rc >= 0)
        *rc = next;
}

/* A plant that diverges is a result; what else ends a run is none. */
static int failures(const struct swept *z, unsigned i, struct apc_error *why)
{
    const struct campaign *c = &z->campaign[i];
    char value[40];
    sweep_value(z->sweep, i, value);
    for (unsigned run = 0; run < c->options->runs; run++) {
        const struct trial *t = campaign_trial(c, run);
        if (t->made && t->rc < 0 && !t->diverged)
            return apc_fail(why, t->rc, "%s = %s, seed %llu: %s", z->sweep->path, value,
                            (unsigned long long)(c->options->seed + run), t->why);
        if (!t->made && atomic_load(&c->pool->stop))
            return apc_fail(why, APC_ESTATE, "ended by a signal: %s = %s: not all runs were made",
                            z->sweep->path, value);
        if (!t->made)
            return 0;
    }
    return 0;
}

static int show_sweep(const struct swept *z, const char *figure, struct apc_error *why)
{
    const struct campaign_options *o = z->campaign->options;
    int rc = 0;
    if (o->json)
        put_sweep_json(z);
    else if (put_table(z) < 0)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (o->csv)
        keep_first_error(&rc, put_sweep_csv(z, why));
    if (figure && rc == 0 &&
        (rc = gnuplot_figure(figure, figure_sweep, put_sweep, (void *)(uintptr_t)z, why)) == 0)
        fprintf(o->talk, "figure:  %s.svg, %s.png%s\n", figure, figure,
                rows_of(z) < z->campaign->loops ? ": of the first loops" : "");
    return rc;
}

int sweep_run(const struct sweep *sweep, const struct experiment *e, double now,
              const struct campaign_options *options, const char *figure, struct apc_error *why)
{
    struct loop *loop = calloc(controllers_loops(e) + 1, sizeof *loop);
    struct campaign *c = calloc(sweep->n, sizeof *c);
    struct swept z = {.sweep = sweep, .campaign = c, .now = now};
    struct apc_error next;

    if (!loop || !c) {
        free(loop);
        free(c);
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    int rc = campaigns_make(c, sweep->n, e, loop, options, why);
    if (rc == 0) {
        rc = campaigns_run(c, sweep->n, why);
        const int said = gather_sweep(&z) < 0 ? apc_fail(&next, APC_ENOMEM, "out of memory")
                                              : show_sweep(&z, figure, &next);
        if (rc == 0 && (rc = said) < 0)
            *why = next;
        for (unsigned i = 0; i < sweep->n && rc == 0; i++)
            rc = failures(&z, i, why);
    }
    campaigns_end(c, sweep->n);
    free(z.point);
    free(loop);
    free(c);
    return rc;
}
