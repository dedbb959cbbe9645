/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc watch: look at the newest samples again and again. On a terminal one table is drawn over itself
 * (each picture is one write, so that nothing flickers); elsewhere each new sample is one line. Signals
 * are blocked and waited for, so that Ctrl-C ends it between two looks and never inside one.
 */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <apctimer.h>

#include "apc/common/print.h"

struct watch_options {
    double interval; /* s */
    uint64_t count;  /* 0: for ever */
};

#define AT(member) .to = offsetof(struct watch_options, member)
static const struct option_spec own_options[] = {
    {"interval", 'i', "SECONDS", "Time between two polls; default 1, at least 0.01", OPTION_NUMBER,
     AT(interval), .low = 0.01, .high = 86400, .must = "be seconds, from 0.01 to 86400"},
    {"count", 0, "N", "End after N polls; default: at Ctrl-C", OPTION_WHOLE, AT(count), .low = 1,
     .high = 1e15, .must = "be a whole number from 1"},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[VARIABLE...]",
    .doc = "Follow the newest values of each VARIABLE, or of all measurements, setpoints, outputs and modes. "
           "On a terminal it is a table that keeps itself up to date; otherwise one line for each new sample "
           "(with --json one object, with --csv one row). Changes between two polls are not shown.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = -1,
    .options = own_options,
};

struct watch {
    const struct cli *cli;
    struct apc_store *store;
    struct cli_tags tags;
    struct apc_sample *samples; /* newest known; they stay when the store is lost */
    struct apc_sample *looked;  /* room for a look */
    int64_t *seen;              /* seq of those that were given out */
    size_t n;
    bool terminal, lost;
    char *why; /* it was lost */
    struct print_table table;
    size_t drawn; /* lines of the last picture: the cursor stands below them */
};

/* ---- Lines -------------------------------------------------------------------------------- */

static void put_watch_line(const struct watch *w, const struct apc_sample *s, int width)
{
    char time[APC_TIME_LEN], name[PRINT_LEN], value[PRINT_LEN], status[APC_STATUS_NAME_LEN];
    if (w->cli->format == CLI_JSON) {
        print_sample_json(&(struct text){.out = stdout}, s, &w->tags, 0);
        putchar('\n');
    } else if (w->cli->format == CLI_CSV) {
        print_sample_csv(stdout, s);
    } else {
        printf("%s  %-*s  %12s  %s\n", apc_time_format(s->time, time), width, print_name(&w->tags, s, name),
               print_value(s, value), apc_status_format(s->status, status));
    }
}

static void put_lines(struct watch *w)
{
    char name[PRINT_LEN];
    int width = 0;
    for (size_t i = 0; i < w->n; i++) {
        int length = (int)strlen(print_name(&w->tags, &w->samples[i], name));
        width = length > width ? length : width;
    }
    for (size_t i = 0; i < w->n; i++)
        if (w->samples[i].seq > w->seen[i]) {
            put_watch_line(w, &w->samples[i], width);
            w->seen[i] = w->samples[i].seq;
        }
    fflush(stdout);
}

/* ---- The picture -------------------------------------------------------------------------- */

static size_t screen_rows(void)
{
    struct winsize size;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_row > 4)
        return size.ws_row;
    return 24;
}

/* Lines are cut at the edge of the screen (?7l) and those that do not fit below are left out: otherwise
 * the way back up to the first line would not be known. */
static int draw_watch(struct watch *w)
{
    static const char eol[] = "\033[K\n";
    char now[PRINT_LEN], *picture = NULL;
    size_t size = 0, room = screen_rows() - 4, shown = w->n < room ? w->n : room;
    bool colour = cli_colour();
    apc_ns utc = apc_clock_utc(NULL);
    FILE *out = open_memstream(&picture, &size);
    if (!out)
        return APC_ENOMEM;
    print_table_clear(&w->table);
    for (size_t i = 0; i < w->n; i++)
        print_sample_cells(&w->table, &w->tags, &w->samples[i], utc, "");
    fputs("\033[?25l\033[?7l\r", out);
    if (w->drawn > 0)
        fprintf(out, "\033[%zuA", w->drawn);
    int rc = print_table_show(&w->table, out, colour, shown, eol);
    fprintf(out, "%s%s%s", colour ? "\033[2m" : "", print_second(utc, now), colour ? "\033[0m" : "");
    if (shown < w->n)
        fprintf(out, ", and %zu more variables than lines", w->n - shown);
    if (w->lost) {
        fputs(colour ? "  \033[1;31m" : "  ", out);
        print_clean(out, w->why ? w->why : "the store is lost");
        fputs(colour ? "\033[0m" : "", out);
    }
    fprintf(out, "%s\033[J\033[?7h\033[?25h", eol);
    w->drawn = shown + 2;
    if (fclose(out) != 0)
        rc = APC_ENOMEM;
    if (rc < 0)
        cli_error(w->cli, rc, "out of memory");
    else
        fwrite(picture, 1, size, stdout);
    fflush(stdout);
    free(picture);
    return rc;
}

/* ---- Looking ------------------------------------------------------------------------------ */

static bool may_come_back(int err)
{
    return err == APC_ECONN || err == APC_ETIMEDOUT;
}

static void lose(struct watch *w)
{
    free(w->why);
    w->why = strdup(apc_store_error(w->store));
    if (!w->lost && !w->terminal)
        cli_error(w->cli, APC_ECONN, "%s; trying again", apc_store_error(w->store));
    w->lost = true;
}

static void find_again(struct watch *w)
{
    if (w->lost && !w->terminal)
        cli_error(w->cli, 0, "the store is back");
    w->lost = false;
}

/* Returns 0 or an error: the store's at the very first look, later only one that waiting does not mend. */
static int look_for_samples(struct watch *w, bool first)
{
    memcpy(w->looked, w->samples, w->n * sizeof *w->looked);
    int rc = apc_store_read(w->store, w->looked, w->n);
    if (rc < 0 && (first || !may_come_back(rc))) {
        cli_store_error(w->cli, rc, w->store);
        return rc;
    }
    if (rc < 0) {
        lose(w);
    } else {
        find_again(w);
        memcpy(w->samples, w->looked, w->n * sizeof *w->samples);
    }
    if (w->terminal)
        return draw_watch(w);
    if (rc >= 0)
        put_lines(w);
    return ferror(stdout) ? APC_ESYS : 0;
}

/* Until the next look on the grid. Returns false when it is time to end. */
static bool wait_for(const sigset_t *signals, apc_ns until)
{
    apc_ns left = until - apc_clock_mono(NULL);
    left = left > 0 ? left : 0;
    const struct timespec time = {left / APC_NS_PER_S, left % APC_NS_PER_S};
    int got;
    do
        got = sigtimedwait(signals, NULL, &time);
    while (got < 0 && errno == EINTR);
    return got < 0;
}

static int follow_samples(struct watch *w, const struct watch_options *options)
{
    apc_ns start = apc_clock_mono(NULL), interval, next;
    sigset_t signals;
    int rc;

    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    sigprocmask(SIG_BLOCK, &signals, NULL);
    apc_ns_from_s(options->interval, &interval);
    for (int64_t looks = 1;; looks++) {
        rc = look_for_samples(w, looks == 1);
        if (rc < 0 || (options->count > 0 && (uint64_t)looks >= options->count))
            break;
        next = apc_grid_time(start, interval, apc_grid_next(start, interval, apc_clock_mono(NULL) + 1));
        if (!wait_for(&signals, next))
            break;
    }
    if (w->terminal)
        fputs("\r\033[K", stdout);
    return rc;
}

static int begin_watch(struct watch *w)
{
    static const enum apc_table shown[] = {APC_SENSOR, APC_SETPOINT, APC_ACTUATOR,
                                           APC_OPMODE, APC_ACTUAL,   (enum apc_table)0};
    int rc = cli_tags_load(w->cli, w->store, &w->tags);
    if (rc == 0)
        rc = cli_variables(w->cli, &w->tags, shown, &w->samples);
    if (rc < 0)
        return rc;
    w->n = (size_t)rc;
    w->seen = calloc(w->n, sizeof *w->seen);
    w->looked = calloc(w->n, sizeof *w->looked);
    if (!w->seen || !w->looked)
        return cli_error(w->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
    w->terminal = w->cli->format == CLI_TEXT && isatty(STDOUT_FILENO);
    if (w->cli->format == CLI_CSV)
        puts(PRINT_SAMPLE_HEADER);
    return 0;
}

int command_watch(int argc, char **argv)
{
    struct watch_options options = {.interval = 1};
    struct cli cli;
    struct watch watch = {.cli = &cli};

    cli_parse(&cli, &spec, &options, argc, argv);
    cli.timeout = 2 * APC_NS_PER_S; /* so that Ctrl-C is heard soon whatever the server does */
    print_table_open(&watch.table, print_sample_columns, 6);
    int rc = cli_open(&cli, &watch.store);
    if (rc == 0)
        rc = begin_watch(&watch);
    if (rc == 0)
        rc = follow_samples(&watch, &options);
    print_table_close(&watch.table);
    free(watch.why);
    free(watch.seen);
    free(watch.looked);
    free(watch.samples);
    cli_tags_free(&watch.tags);
    apc_store_close(watch.store);
    return cli_done(&cli, exit_code_of(rc));
}
