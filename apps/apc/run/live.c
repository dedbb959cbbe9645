/* SPDX-License-Identifier: BSD-3-Clause */
#include "live.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/storeuri.h"
#include "control_verdict.h"
#include "operate/operate.h"

#define BAR          24                 /* at most */
#define PLAIN_EVERY  (5 * APC_NS_PER_S) /* between two lines when stdout is no terminal */
#define TIMING_EVERY (5 * APC_NS_PER_S) /* the daemons' windows */
#define WIDTH        240
#define LOOK         250                /* ms between two looks at the store */
#define PATIENCE     5000               /* ms for the line to end: it may be waiting for the store */
#define TEXT         256                /* of a message */
#define FEW          2                  /* loops of which a line has the values */
#define RECENT       (5 * APC_NS_PER_S) /* the daemons begin so long before t = 0 */

struct live {
    pid_t pid;
    int pipe; /* messages, a severity's digit and a line each; '0': show it once more */
};

struct sight {
    int64_t seq;
    apc_ns at; /* monotonic: when it was first seen */
};

/* What the process that shows it has. */
struct view {
    struct apc_store *store;
    const struct experiment *e;
    apc_ns start, printed, asked;
    double duration;
    bool terminal;
    apc_ns worst;               /* lateness so far */
    struct apc_sample *samples; /* [n] ROWS of each loop */
    struct sight *sights;       /* of each */
    size_t n;
    struct apc_vector *tick; /* of each controller */
    struct sight *ticked;
    struct control control;
    int64_t heard; /* number of the newest event: its time may lie before that of one that came earlier */
    apc_ns begin;  /* monotonic, of t = 0 */
    size_t done;   /* of the experiment's actions */
    struct loops loops;
    struct apc_tag *tags; /* [n_tags] of its variables */
    size_t n_tags;
};

/* Of each loop. */
enum { SP, PV, OP, MODE, ROWS };

static void name_live_rows(struct apc_sample *row, const struct loops_loop *loop)
{
    row[SP] = (struct apc_sample){.table = APC_SETPOINT, .id = loop->setpoint};
    row[PV] = (struct apc_sample){.table = APC_SENSOR, .id = loop->measurement};
    row[OP] = (struct apc_sample){.table = loop->table, .id = loop->output};
    row[MODE] = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, loop->id)};
}

static int begin_view(struct view *l, const char *store, const struct experiment *e, apc_ns start,
                      apc_ns zero, double duration)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc run", .spool = ""};
    struct apc_error why;

    *l = (struct view){.e = e, .start = start, .duration = duration, .begin = zero};
    l->terminal = isatty(STDOUT_FILENO);
    if (controllers_describe(e, &l->loops) < 0)
        return APC_ENOMEM;
    l->n = ROWS * l->loops.n;
    l->samples = calloc(l->n, sizeof *l->samples);
    l->sights = calloc(l->n, sizeof *l->sights);
    l->tags = provision_tags(e, &l->n_tags);
    l->tick = calloc(l->loops.n_controllers, sizeof *l->tick);
    l->ticked = calloc(l->loops.n_controllers, sizeof *l->ticked);
    if (!l->samples || !l->sights || !l->tags || !l->tick || !l->ticked)
        return APC_ENOMEM;
    for (size_t i = 0; i < l->loops.n; i++)
        name_live_rows(l->samples + ROWS * i, &l->loops.at[i]);
    for (size_t i = 0; i < l->loops.n_controllers; i++)
        l->tick[i] = (struct apc_vector){.table = APC_TICK, .id = l->loops.controller[i].number};
    control_begin(&l->control, l->e->plant.external, apc_watchdog_make(l->e->client.rhythm.period, 0).link,
                  start);
    return store_open(&l->store, store, &options, &why);
}

static int take_worst(void *ctx, const struct apc_timing_row *row)
{
    struct view *l = ctx;
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
static void add_to_line(struct line *line, const char *fmt, ...) APC_PRINTF(2, 3);
static void add_to_line(struct line *line, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(line->text + line->used, WIDTH - line->used, fmt, args);
    va_end(args);
    line->used = n < 0 ? line->used : line->used + (size_t)n;
    if (line->used >= WIDTH)
        line->used = WIDTH - 1;
}

static int take_live_event(void *ctx, const struct apc_event *event)
{
    struct view *l = ctx;
    bool commanded;
    if (control_hears(&l->control, event, &commanded))
        control_command(&l->control, event->time, commanded);
    l->heard = event->number;
    return 0;
}

static int look_at_loops(struct view *l, apc_ns now, apc_ns mono)
{
    struct apc_rows rows = {.size = sizeof rows,
                            .sample = l->samples,
                            .n_samples = l->n,
                            .vector = l->tick,
                            .n_vectors = l->loops.n_controllers};
    int rc = apc_store_read_rows(l->store, &rows);
    for (size_t i = 0; i < l->n && rc >= 0; i++)
        if (l->samples[i].seq != l->sights[i].seq)
            l->sights[i] = (struct sight){l->samples[i].seq, mono};
    for (size_t i = 0; i < l->loops.n_controllers && rc >= 0; i++)
        if (l->tick[i].seq != l->ticked[i].seq)
            l->ticked[i] = (struct sight){l->tick[i].seq, mono};
    if (rc >= 0)
        rc = apc_store_events(l->store, &(struct apc_range){.since = l->start - RECENT, .after = l->heard},
                              take_live_event, l);
    if (rc >= 0 && mono - l->asked > TIMING_EVERY) {
        const struct apc_range range = {.since = l->asked ? now - 2 * TIMING_EVERY : l->start};
        apc_store_timing(l->store, &range, take_worst, l);
        l->asked = mono;
    }
    return rc;
}

/* How long nothing new has come, when that is longer than it may be: else 0. */
static apc_ns overdue(const struct sight *sight, apc_ns period)
{
    apc_ns age = sight->seq > 0 ? apc_clock_mono(NULL) - sight->at : 0;
    return age > 3 * period && age > APC_NS_PER_S ? age : 0;
}

/* A value that belongs to an earlier run, or to none, shows as a dash. @period: in which the next one has to
 * come; 0: it holds until somebody moves it. */
static void add_value(const struct view *l, struct line *line, const char *name, size_t i, apc_ns period)
{
    const struct apc_sample *s = &l->samples[i];
    const enum apc_severity severity = apc_status_severity(s->status);
    const apc_ns age = period > 0 ? overdue(&l->sights[i], period) : 0;
    double size = s->value < 0 ? -s->value : s->value;

    if (s->seq == 0 || (period > 0 && s->time < l->start - APC_NS_PER_S))
        add_to_line(line, "  %.12s %7s", name, "-");
    else if (severity == APC_SEVERITY_BAD)
        add_to_line(line, "  %.12s %7s", name, "bad");
    else
        add_to_line(line, size < 1e4 ? "  %.12s %7.3f%s" : "  %.12s %7.2e%s", name, s->value,
                    severity == APC_SEVERITY_GOOD ? "" : "?");
    if (age > 0)
        add_to_line(line, " (%.0f s old)", apc_ns_to_s(age));
}

static const char *name_of_sample(const struct view *l, const struct apc_sample *s)
{
    for (size_t i = 0; i < l->n_tags; i++)
        if (l->tags[i].table == s->table && l->tags[i].id == s->id)
            return l->tags[i].name;
    return "";
}

/* "no controller": it no longer ticks. One that ticks goes on in a mode that an earlier run may have written. */
static const char *mode_of_loop(const struct view *l, size_t loop)
{
    const struct apc_sample *mode = &l->samples[ROWS * loop + MODE];
    const size_t controller = l->loops.at[loop].controller;
    const bool ticks = l->tick[controller].seq > 0 && l->tick[controller].time >= l->start - RECENT;
    const char *name = ticks && mode->seq > 0 && mode->value >= 0 ? apc_mode_name((int)mode->value) : NULL;
    if (overdue(&l->ticked[controller], l->loops.controller[controller].period))
        return "no controller";
    return name ? name : "-";
}

static void add_one(const struct view *l, struct line *line)
{
    const apc_ns period[] = {[SP] = 0, [PV] = l->e->client.rhythm.period, [OP] = l->loops.controller->period};
    for (size_t k = SP; k <= OP; k++)
        if (l->samples[k].id > 0)
            add_value(l, line, name_of_sample(l, &l->samples[k]), k, period[k]);
    add_to_line(line, "  %-4s", mode_of_loop(l, 0));
}

/* As many as fit in a line: mode, measurement and setpoint of each. */
static void add_few(const struct view *l, struct line *line)
{
    for (size_t i = 0; i < l->loops.n; i++) {
        const struct apc_sample *row = &l->samples[ROWS * i];
        add_to_line(line, "  %.12s %s", l->loops.at[i].name, mode_of_loop(l, i));
        if (row[PV].seq > 0)
            add_to_line(line, apc_status_severity(row[PV].status) == APC_SEVERITY_GOOD ? " %.4g" : " %.4g?",
                        row[PV].value + 0.0);
        if (row[SP].seq > 0)
            add_to_line(line, "/%.4g", row[SP].value + 0.0);
    }
}

/* How many are in which mode, and those first that are where nobody wants them. */
static void add_many(const struct view *l, struct line *line)
{
    static const char *const modes[] = {"Cas", "Auto", "Man", "OOS", "IMan", "LO", "no controller", "-"};
    bool first = true;
    add_to_line(line, "  %zu loops:", l->loops.n);
    for (size_t k = 0; k < sizeof modes / sizeof *modes; k++) {
        const char *name = NULL;
        size_t n = 0;
        for (size_t i = 0; i < l->loops.n; i++)
            if (!strcmp(mode_of_loop(l, i), modes[k])) {
                name = name ? name : l->loops.at[i].name;
                n++;
            }
        if (n == 0)
            continue;
        add_to_line(line, "%s %zu %s", first ? "" : ",", n, modes[k]);
        if (k > 2 && n <= 2)
            add_to_line(line, " (%.12s%s)", name, n > 1 ? ", ..." : "");
        first = false;
    }
}

static void add_values(const struct view *l, struct line *line)
{
    if (l->loops.n == 1)
        add_one(l, line);
    else if (l->loops.n <= FEW)
        add_few(l, line);
    else
        add_many(l, line);
    if (!l->control.commanded)
        add_to_line(line, l->e->plant.external ? "  no command" : "  plant at its safe value");
}

static void add_bar(const struct view *l, struct line *line, double t)
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
    add_to_line(line, "  [%.*s%.*s] %3.0f %%", filled, full, bar - filled, empty, 100 * done);
}

static void show_live_line(struct view *l, bool last)
{
    struct line line = {.used = 0};
    apc_ns now = apc_clock_utc(NULL), mono = apc_clock_mono(NULL);
    double t = apc_ns_to_s(now - l->start);
    int rc = look_at_loops(l, now, mono);

    if (t < 0 || (!l->terminal && !last && mono - l->printed < PLAIN_EVERY))
        return;
    add_to_line(&line, "%7.1f s", t);
    if (rc < 0)
        add_to_line(&line, "  no data: %.100s", apc_store_error(l->store));
    else
        add_values(l, &line);
    if (l->worst > 0)
        add_to_line(&line, "  late %.2f ms", (double)l->worst * 1e-6);
    add_bar(l, &line, t);
    if (l->terminal)
        printf("\r%-*.*s", (int)columns() - 1, (int)columns() - 1, line.text);
    else
        puts(line.text);
    fflush(stdout);
    l->printed = mono;
}

static void say_above_line(struct view *l, int severity, const char *text)
{
    struct apc_event event = {.time = apc_clock_utc(NULL),
                              .severity = (enum apc_event_severity)severity,
                              .source = "apc-run",
                              .kind = "stop"};
    if (l->terminal)
        printf("\r%-*s\r", (int)columns() - 1, "");
    puts(text);
    fflush(stdout);
    snprintf(event.text, sizeof event.text, "%.*s", (int)sizeof event.text - 1, text);
    apc_store_append_events(l->store, &event, 1);
}

/* ms until the next action is due, or the next look; one that is overdue has just been tried. */
static int time_until_look(const struct view *l)
{
    const apc_ns look = LOOK * APC_NS_PER_MS;
    apc_ns left = look;
    if (l->done < l->e->n_actions)
        left = l->begin + l->e->action[l->done].at - apc_clock_mono(NULL);
    return left <= 0 || left > look ? LOOK : (int)((left + APC_NS_PER_MS - 1) / APC_NS_PER_MS);
}

/* The experiment's actions that are due. While the store is away they wait: an operator would. */
static void operate_due_actions(struct view *l)
{
    for (; l->done < l->e->n_actions; l->done++) {
        const struct action *action = &l->e->action[l->done];
        char text[TEXT];
        if (l->begin + action->at > apc_clock_mono(NULL))
            return;
        if (action->kind != ACTION_WRITE) /* the supervisor's */
            continue;
        int rc = action_do(l->store, &l->loops, l->tags, l->n_tags, action, apc_clock_utc(NULL), "apc-run");
        if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
            return;
        if (rc == 0)
            continue;
        snprintf(text, sizeof text, "the action of %g s was not possible: %.150s", apc_ns_to_s(action->at),
                 apc_store_error(l->store));
        say_above_line(l, APC_EVENT_WARNING, text);
    }
}

/* Until the other end of the pipe is closed, also by the death of who holds it. */
static void follow_messages(struct view *l, FILE *messages)
{
    struct pollfd p = {.fd = fileno(messages), .events = POLLIN};
    char text[TEXT];

    for (;;) {
        operate_due_actions(l);
        if (poll(&p, 1, time_until_look(l)) <= 0) {
            show_live_line(l, false);
            continue;
        }
        if (!fgets(text, sizeof text, messages))
            return;
        text[strcspn(text, "\n")] = '\0';
        if (text[0] == '0')
            show_live_line(l, true);
        else
            say_above_line(l, text[0] - '0', text + 1);
    }
}

int live_start(struct live **out, const char *store, const struct experiment *e, apc_ns start, apc_ns zero,
               double duration)
{
    struct live *l = calloc(1, sizeof *l);
    struct view view;
    int ends[2];

    *out = NULL;
    if (!l || pipe2(ends, O_CLOEXEC) < 0) {
        free(l);
        return APC_ENOMEM;
    }
    fflush(stdout);
    l->pid = fork();
    if (l->pid == 0) {
        close(ends[1]);
        FILE *messages = fdopen(ends[0], "r");
        if (!messages)
            _exit(1);
        setvbuf(messages, NULL, _IONBF, 0); /* what is read is what poll() looks at */
        int rc = begin_view(&view, store, e, start, zero, duration);
        if (rc >= 0)
            follow_messages(&view, messages);
        apc_store_close(rc >= 0 ? view.store : NULL);
        if (rc >= 0 && view.terminal && view.printed)
            putchar('\n');
        fflush(stdout);
        _exit(rc < 0);
    }
    close(ends[0]);
    l->pipe = ends[1];
    fcntl(l->pipe, F_SETFL, O_NONBLOCK);
    if (l->pid < 0) {
        close(l->pipe);
        free(l);
        return APC_ESYS;
    }
    *out = l;
    return 0;
}

void live_say(struct live *l, enum apc_event_severity severity, const char *fmt, ...)
{
    char text[TEXT] = {(char)('0' + (int)severity)};
    va_list args;
    va_start(args, fmt);
    vsnprintf(text + 1, sizeof text - 2, fmt, args);
    va_end(args);
    size_t n = strlen(text);
    text[n] = '\n';
    if (write(l->pipe, text, n + 1) < 0) /* it hangs, or has died: then at least it is said */
        printf("%.*s\n", (int)n - 1, text + 1);
    fflush(stdout);
}

void live_end(struct live *l, bool whole)
{
    if (!l)
        return;
    ssize_t told = whole ? write(l->pipe, "0\n", 2) : 0;
    (void)told; /* one that hears nothing is killed */
    close(l->pipe);
    for (int waited = 0; waitpid(l->pid, NULL, WNOHANG) == 0; waited += 10) {
        if (waited == PATIENCE)
            kill(l->pid, SIGKILL);
        poll(NULL, 0, 10);
    }
    free(l);
}
