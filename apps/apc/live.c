/* SPDX-License-Identifier: BSD-3-Clause */
#include "live.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define BAR          24                 /* at most */
#define PLAIN_EVERY  (5 * APC_NS_PER_S) /* between two lines when stdout is no terminal */
#define TIMING_EVERY (5 * APC_NS_PER_S) /* the daemons' windows */
#define WIDTH        240

struct live {
    struct apc_store *store;
    const struct experiment *e;
    apc_ns start, printed, asked;
    double duration;
    bool terminal;
    apc_ns worst;               /* lateness so far */
    struct apc_sample *samples; /* z, y, u of each loop, then the actual mode */
    size_t n;
};

static size_t loops(const struct experiment *e)
{
    size_t n = e->dim.ny < e->dim.nz ? e->dim.ny : e->dim.nz;
    n = n < e->dim.nu ? n : e->dim.nu;
    return n < 3 ? n : 3; /* more do not fit on a line */
}

int live_create(struct live **out, struct apc_store *store, const struct experiment *e, apc_ns start,
                double duration)
{
    struct live *l = calloc(1, sizeof *l);
    *out = NULL;
    if (!l)
        return APC_ENOMEM;
    *l = (struct live){.store = store, .e = e, .start = start, .duration = duration};
    l->terminal = isatty(STDOUT_FILENO);
    l->n = 3 * loops(e) + 1;
    l->samples = calloc(l->n, sizeof *l->samples);
    if (!l->samples) {
        free(l);
        return APC_ENOMEM;
    }
    for (size_t i = 0; i < loops(e); i++) {
        l->samples[3 * i] = (struct apc_sample){.table = APC_SETPOINT, .id = (int)i + 1};
        l->samples[3 * i + 1] = (struct apc_sample){.table = APC_SENSOR, .id = (int)i + 1};
        l->samples[3 * i + 2] = (struct apc_sample){.table = APC_ACTUATOR, .id = (int)i + 1};
    }
    l->samples[l->n - 1] = (struct apc_sample){.table = APC_OPMODE, .id = 1};
    *out = l;
    return 0;
}

void live_destroy(struct live *l)
{
    if (!l)
        return;
    free(l->samples);
    free(l);
}

static int take_worst(void *ctx, const struct apc_timing_row *row)
{
    struct live *l = ctx;
    if (!strcmp(row->quantity, "lateness") && row->max > l->worst)
        l->worst = row->max;
    return 0;
}

static size_t columns(void)
{
    struct winsize size;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 20)
        return size.ws_col;
    return 80;
}

struct line {
    char text[WIDTH];
    size_t used;
};

/* What does not fit is cut. */
static void add(struct line *line, const char *fmt, ...) APC_PRINTF(2, 3);
static void add(struct line *line, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(line->text + line->used, WIDTH - line->used, fmt, args);
    va_end(args);
    line->used = n < 0 ? line->used : line->used + (size_t)n;
    if (line->used >= WIDTH)
        line->used = WIDTH - 1;
}

/* A value that belongs to an earlier run, or to none, shows as a dash. */
static void add_value(const struct live *l, struct line *line, const char *name, const struct apc_sample *s)
{
    double size = s->value < 0 ? -s->value : s->value;
    if (s->seq == 0 || s->time < l->start - APC_NS_PER_S)
        add(line, "  %.12s %7s", name, "-");
    else
        add(line, size < 1e4 ? "  %.12s %7.3f" : "  %.12s %7.2e", name, s->value);
}

static void add_values(const struct live *l, struct line *line)
{
    const struct experiment *e = l->e;
    for (size_t i = 0; i < loops(e); i++) {
        add_value(l, line, e->z[i].tag.name, &l->samples[3 * i]);
        add_value(l, line, e->y[i].tag.name, &l->samples[3 * i + 1]);
        add_value(l, line, e->u[i].tag.name, &l->samples[3 * i + 2]);
    }
    const struct apc_sample *mode = &l->samples[l->n - 1];
    const char *name = mode->seq > 0 && mode->time >= l->start ? apc_mode_name((int)mode->value) : NULL;
    add(line, "  %-4s", name ? name : "-");
}

static void add_bar(const struct live *l, struct line *line, double t)
{
    static const char full[] = "########################", empty[] = "........................";
    if (l->duration <= 0)
        return;
    double done = t / l->duration;
    done = done < 0 ? 0 : done > 1 ? 1 : done;
    int room = (int)columns() - (int)line->used - (int)sizeof "  [] 100 %";
    int bar = !l->terminal || room > BAR ? BAR : room;
    if (bar < BAR / 4)
        return;
    int filled = (int)(done * bar + 0.5);
    add(line, "  [%.*s%.*s] %3.0f %%", filled, full, bar - filled, empty, 100 * done);
}

void live_show(struct live *l, bool last)
{
    struct line line = {.used = 0};
    apc_ns now = apc_clock_utc(NULL), mono = apc_clock_mono(NULL);
    double t = apc_ns_to_s(now - l->start);
    if (!l->terminal && !last && mono - l->printed < PLAIN_EVERY)
        return;
    int rc = apc_store_read(l->store, l->samples, l->n);
    if (rc >= 0 && mono - l->asked > TIMING_EVERY) {
        const struct apc_range range = {.since = l->asked ? now - 2 * TIMING_EVERY : l->start};
        apc_store_timing(l->store, &range, take_worst, l);
        l->asked = mono;
    }
    add(&line, "%7.1f s", t < 0 ? 0 : t);
    if (rc < 0)
        add(&line, "  no data: %.100s", apc_store_error(l->store));
    else
        add_values(l, &line);
    if (l->worst > 0)
        add(&line, "  late %.2f ms", (double)l->worst * 1e-6);
    add_bar(l, &line, t);
    if (l->terminal)
        printf("\r%-*.*s", (int)columns() - 1, (int)columns() - 1, line.text);
    else
        puts(line.text);
    fflush(stdout);
    l->printed = mono;
}

void live_say(struct live *l, const char *fmt, ...)
{
    va_list args;
    if (l->terminal)
        printf("\r%-*s\r", (int)columns() - 1, "");
    va_start(args, fmt);
    vprintf(fmt, args);
    va_end(args);
    putchar('\n');
    fflush(stdout);
}

void live_end(struct live *l)
{
    if (l->terminal && l->printed)
        putchar('\n');
    fflush(stdout);
}
