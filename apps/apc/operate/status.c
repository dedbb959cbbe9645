/* SPDX-License-Identifier: BSD-3-Clause */
/* apc status: everything about a plant on one screen. It reads; that parts are stale is no failure of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/all_plants.h"
#include "apc/common/past.h"
#include "apc/common/print.h"
#include "apc/folder/spools.h"
#include "common/room.h"
#include "common/storeuri.h"
#include "common/timing.h"
#include "status_loops.h"
#include "status_writes.h"

#define EVENTS 5
#define WINDOW (60 * APC_NS_PER_S)

struct options {
    const char *spools, *at;
    bool all;
};

#define AT(member) .to = offsetof(struct options, member)
static const struct option_spec own_options[] = {
    {"spool", 0, "DIR",
     "Folder of the daemons' spools, e.g. that of the run [APC_SPOOL]; shown even while the store is offline",
     OPTION_TEXT, AT(spools)},
    {"all", 0, NULL,
     "One line for each plant in the database that you may read, with the age of the newest measurement",
     OPTION_FLAG, AT(all)},
    PAST_OPTION(struct options),
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "",
    .doc = "Show the store, the mode, every measurement, setpoint and output with its age, the author of "
           "each operator's entry, the timing of each task over the last minute, and the last events. Where "
           "there are several loops, each controller has its last tick and its loops. A loop shows target "
           "and actual mode, with the reason where they differ, setpoint SP and its source, measurement PV, "
           "output OP and its limits. Predictive control also shows the result of the last plan, its solve "
           "time, and its active constraints. A measurement or output that was not written for 10 s, or for "
           "three of its periods if that is longer, is STALE. With --at, all is as of that time, without "
           "what is known of the present only, such as room in shared memory and spools.",
    .takes = CLI_STORE | CLI_FORMAT,
    .options = own_options,
};

/* All of it, read before any of it is shown. */
struct status {
    char store[400]; /* its URI without passwords */
    struct cli_plant plant;
    struct status_loops loops;
    int version; /* of the store's tables */
    struct apc_sample *samples;
    size_t n;
    struct status_writes writes;
    struct timing timing;
    struct apc_event events[EVENTS];
    size_t n_events;
    int has_history; /* as of apc_store_behind() */
    struct apc_behind behind;
    char away[512]; /* why the history cannot be asked */
    int has_room;   /* as of apc_store_room() */
    struct apc_store_room room;
    struct spools spools;
    apc_ns now;
};

/* ---- Reading ------------------------------------------------------------------------------ */

static int take_status_event(void *ctx, const struct apc_event *event)
{
    struct status *s = ctx;
    s->events[s->n_events++] = *event;
    return s->n_events == EVENTS;
}

/* What it cannot be asked is part of the status. */
static void load_history(struct status *s, struct apc_store *store)
{
    s->behind.size = sizeof s->behind;
    s->has_history = apc_store_behind(store, &s->behind);
    if (s->has_history < 0)
        snprintf(s->away, sizeof s->away, "%s", apc_store_error(store));
}

/* Says its own errors. */
static int load_status(const struct cli *cli, const struct past *past, struct status *s)
{
    struct apc_store *store = past->store;
    static const enum apc_table shown[] = {APC_SENSOR, APC_SETPOINT, APC_ACTUATOR, (enum apc_table)0};
    const struct apc_range last = {.last = EVENTS};
    int rc = cli_plant_load(cli, store, &s->plant);
    if (rc == 0)
        rc = cli_described(cli, &s->plant.tags, shown, &s->samples);
    if (rc < 0)
        return rc;
    s->n = (size_t)rc;
    rc = apc_store_read(store, s->samples, s->n);
    s->now = apc_store_now(store);
    if (rc >= 0)
        rc = timing_load(&s->timing, store, &(struct apc_range){.since = s->now - WINDOW}, "lateness");
    if (rc >= 0)
        rc = status_loops_load(&s->loops, store, &s->plant, &s->timing);
    if (rc >= 0)
        rc = status_writes_load(&s->writes, store, &s->plant.tags);
    if (rc >= 0)
        rc = apc_store_events(store, &last, take_status_event, s);
    s->room.size = sizeof s->room;
    if (rc >= 0)
        rc = s->has_room = apc_store_room(store, &s->room);
    s->version = apc_store_tables_version(store);
    if (rc < 0)
        cli_store_error(cli, rc, store);
    else
        load_history(s, store);
    return rc < 0 ? rc : past_check(past, cli, s->samples, s->n);
}

/* One loop is shown as its variables; what several show needs not be shown again. */
static bool by_loop(const struct status *s)
{
    return s->plant.loops.n > 1;
}

static bool is_stale_sample(const struct status *s, const struct apc_sample *sample)
{
    return status_is_stale(&s->plant.tags, sample, s->now);
}

static const char *mode_of_sample(const struct apc_sample *mode)
{
    return mode->seq > 0 && mode->value >= 0 ? apc_mode_name((int)mode->value) : NULL;
}

/* The mode that all loops have; NULL: they differ. */
static const char *common_mode(const struct status *s, int which)
{
    const char *mode = s->plant.loops.n > 0 ? mode_of_sample(&s->loops.row[which]) : NULL;
    for (size_t i = 1; i < s->plant.loops.n && mode; i++) {
        const char *other = mode_of_sample(&s->loops.row[LOOP_ROWS * i + (size_t)which]);
        if (!other || strcmp(mode, other) != 0)
            mode = NULL;
    }
    return mode;
}

/* ---- For people --------------------------------------------------------------------------- */

static int show_values(const struct status *s, bool colour)
{
    struct print_table table;
    size_t shown = 0;
    if (s->n == 0) {
        puts("\nno variables are described yet: `apc init FILE` describes those of an experiment");
        return 0;
    }
    print_table_open(&table, print_sample_columns, 6);
    for (size_t i = 0; i < s->n; i++) {
        if (by_loop(s) && status_loops_have(&s->loops, &s->samples[i]))
            continue;
        shown++;
        print_sample_cells(&table, &s->plant.tags, &s->samples[i], s->now,
                           is_stale_sample(s, &s->samples[i]) ? "STALE" : "");
    }
    if (shown > 0)
        putchar('\n');
    return print_table_end(&table, stdout, colour, 0);
}

/* Of controllers it stands with their loops. */
static bool has_place(const struct status *s, const struct timing_series *t)
{
    return by_loop(s) && loops_controller(&s->plant.loops, t->task);
}

static int show_timing(const struct status *s, bool colour)
{
    static const struct print_column columns[] = {
        {"TASK", PRINT_LEFT}, {"PERIOD", PRINT_RIGHT}, {"LATE p50", PRINT_RIGHT}, {"p99", PRINT_RIGHT},
        {"MAX", PRINT_RIGHT}, {"TICKS", PRINT_RIGHT},  {"MISSED", PRINT_RIGHT}};
    char text[PRINT_LEN];
    struct print_table table;
    if (s->timing.n == 0) {
        puts("\nno task has reported its timing in the last minute");
        return 0;
    }
    print_table_open(&table, columns, 7);
    for (size_t i = 0; i < s->timing.n; i++) {
        const struct timing_series *t = &s->timing.series[i];
        if (has_place(s, t))
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", t->task);
        print_cell(&table, PRINT_PLAIN, "%s", print_duration(t->period, text));
        print_cell(&table, PRINT_PLAIN, "%s", print_duration(t->p50, text));
        print_cell(&table, PRINT_PLAIN, "%s", print_duration(t->p99, text));
        print_cell(&table, PRINT_PLAIN, "%s", print_duration(t->max, text));
        print_cell(&table, PRINT_PLAIN, "%llu", (unsigned long long)t->count);
        print_cell(&table, t->missed ? PRINT_WARN : PRINT_PLAIN, "%llu", (unsigned long long)t->missed);
    }
    putchar('\n');
    return print_table_end(&table, stdout, colour, 0);
}

static int show_recent_events(const struct status *s, bool colour)
{
    static const struct print_column columns[] = {
        {"TIME", PRINT_LEFT}, {"EVENT", PRINT_LEFT}, {"SOURCE", PRINT_LEFT}, {"TEXT", PRINT_LEFT}};
    char text[PRINT_LEN];
    struct print_table table;
    if (s->n_events == 0) {
        puts("\nno events");
        return 0;
    }
    print_table_open(&table, columns, 4);
    for (size_t i = 0; i < s->n_events; i++) {
        const struct apc_event *e = &s->events[i];
        print_cell(&table, PRINT_PLAIN, "%s", print_second(e->time, text));
        print_cell(&table, print_severity_ink(e->severity), "%s", print_severity(e->severity));
        print_cell(&table, PRINT_PLAIN, "%s", e->source);
        print_cell(&table, PRINT_PLAIN, "%s", e->text);
    }
    putchar('\n');
    return print_table_end(&table, stdout, colour, 0);
}

static int show_spools(const struct status *s, bool colour)
{
    static const struct print_column columns[] = {{"SPOOL OF", PRINT_LEFT},
                                                  {"SAMPLES", PRINT_RIGHT},
                                                  {"EVENTS", PRINT_RIGHT},
                                                  {"BYTES", PRINT_RIGHT},
                                                  {"OLDEST", PRINT_RIGHT}};
    char text[PRINT_LEN];
    struct print_table table;
    if (s->spools.n == 0)
        return 0;
    print_table_open(&table, columns, 5);
    for (size_t i = 0; i < s->spools.n; i++) {
        const struct apc_spool_stats *w = &s->spools.info[i].stats;
        enum print_ink ink = w->oldest ? PRINT_WARN : PRINT_PLAIN;
        print_cell(&table, ink, "%s", s->spools.info[i].writer);
        print_cell(&table, ink, "%llu", (unsigned long long)w->samples);
        print_cell(&table, ink, "%llu", (unsigned long long)w->events);
        print_cell(&table, PRINT_PLAIN, "%llu", (unsigned long long)w->bytes);
        print_cell(&table, ink, "%s", w->oldest ? print_duration(s->now - w->oldest, text) : "-");
    }
    putchar('\n');
    return print_table_end(&table, stdout, colour, 0);
}

static void show_mode(const struct status *s)
{
    const char *target = mode_of_sample(&s->loops.row[LOOP_TARGET]),
               *actual = mode_of_sample(&s->loops.row[LOOP_ACTUAL]);
    printf("mode   target %s, actual %s%s", target ? target : "none", actual ? actual : "none",
           s->loops.reason[0][0] ? ": " : "");
    print_clean(stdout, s->loops.reason[0]);
    putchar('\n');
    const struct entry_note *entry = status_loops_entry(&s->loops, 0);
    if (entry && !s->loops.reason[0][0] && strcmp(entry->code, "man") != 0)
        printf("       %s\n", entry->text);
    status_plan_show(&s->loops.plan[0], s->now);
    const char *owner = status_loops_owner(&s->loops, 0);
    if (owner && !strcmp(owner, loops_owner_name(true))) {
        const char *setpoint = cli_tag(&s->plant.tags, APC_SETPOINT, s->plant.loops.at->setpoint)->name;
        printf("       ");
        print_clean(stdout, setpoint);
        puts(" is Local: `apc remote` gives it back to the scheduler");
    }
}

static void show_history(const struct status *s)
{
    char text[PRINT_LEN];
    if (s->has_history < 0)
        printf("       %s\n", s->away);
    else if (s->has_history > 0 && s->behind.rows == 0)
        puts("       the history has all");
    else if (s->has_history > 0 && s->behind.nothing)
        printf("       the history has nothing yet: %llu rows wait for it\n",
               (unsigned long long)s->behind.rows);
    else if (s->has_history > 0 && s->behind.time < APC_NS_PER_S)
        puts("       the history has all but the newest rows");
    else if (s->has_history > 0)
        printf("       the history is %llu rows behind, %s\n", (unsigned long long)s->behind.rows,
               print_duration(s->behind.time, text));
}

/* What was refused and has its row by now is still a sign that the store is small. */
static void show_room(const struct status *s)
{
    char text[ROOM_LEN], when[PRINT_LEN];
    if (s->room.full) {
        const struct apc_tag *tag = cli_tag(&s->plant.tags, s->room.table, s->room.id);
        room_text(&s->room, tag ? tag->name : NULL, text);
        fputs("       ", stdout);
        print_clean(stdout, text);
        putchar('\n');
    }
    if (s->room.refused > 0)
        printf("       %llu rows found no room, the last at %s\n", (unsigned long long)s->room.refused,
               print_second(s->room.refused_at, when));
}

static int show_status(const struct status *s, const struct past *past, const struct cli *cli)
{
    bool colour = cli_colour();
    int rc = 0;

    past_show(past, cli);
    fputs("store  ", stdout);
    print_clean(stdout, s->store);
    printf("\n       connected, schema version %d\n", s->version);
    show_history(s);
    show_room(s);
    if (by_loop(s))
        rc = status_loops_show(&s->loops, colour);
    else if (s->plant.loops.n == 1)
        show_mode(s);
    status_ramps_show(&s->loops, NULL);
    if (rc == 0)
        rc = show_values(s, colour);
    if (rc == 0)
        rc = status_writes_show(&s->writes, colour);
    if (rc == 0)
        rc = show_timing(s, colour);
    if (rc == 0)
        rc = show_recent_events(s, colour);
    return rc == 0 ? show_spools(s, colour) : rc;
}

/* ---- For programs ------------------------------------------------------------------------- */

/* What the experiment file says of a variable. */
static void json_tag(const struct apc_tag *tag, struct text *t)
{
    const bool scale = tag && tag->display_low < tag->display_high;
    json_add(t, "low:%e, high:%e, area:%-s, display_low:%g, display_high:%g", tag ? tag->low : -APC_VALUE_MAX,
             tag ? tag->high : APC_VALUE_MAX, tag ? tag->area : "", scale ? tag->display_low : (double)NAN,
             scale ? tag->display_high : (double)NAN);
}

static void json_values(const struct status *s, struct text *t)
{
    for (size_t i = 0; i < s->n; i++) {
        json_add(t, ",\n{");
        print_sample_members(t, &s->samples[i], &s->plant.tags, s->now);
        json_tag(cli_tag(&s->plant.tags, s->samples[i].table, s->samples[i].id), t);
        json_add(t, "stale:%i}", is_stale_sample(s, &s->samples[i]));
    }
}

static void json_timing(const struct status *s, struct text *t)
{
    for (size_t i = 0; i < s->timing.n; i++) {
        const struct timing_series *of = &s->timing.series[i];
        json_add(
            t, ",\n{task:%s, period_ns:%jd, ticks:%ju, missed:%ju, lateness_ns:{p50:%jd, p99:%jd, max:%jd}}",
            of->task, of->period, of->count, of->missed, of->p50, of->p99, of->max);
    }
}

static void json_history(const struct status *s, struct text *t)
{
    const bool is = s->has_history > 0;
    if (s->has_history != 0)
        json_add(t, ",\nhistory:{behind:%jd, late_s:%.3f, error:%-s}",
                 is ? (int64_t)s->behind.rows : JSON_NONE,
                 is && !s->behind.nothing ? apc_ns_to_s(s->behind.time) : (double)NAN, is ? "" : s->away);
}

static void json_room(const struct status *s, struct text *t)
{
    const struct apc_store_room *r = &s->room;
    if (s->has_room > 0)
        json_add(t,
                 ",\nroom:{variables:%ju, variables_max:%ju, cells:%ju, cells_max:%ju, refused:%ju, full:%i}",
                 r->variables, r->variables_max, r->cells, r->cells_max, r->refused, r->full);
}

static void json_spools(const struct status *s, struct text *t)
{
    json_add(t, ",\nspools:[");
    for (size_t i = 0; i < s->spools.n; i++) {
        const struct apc_spool_stats *w = &s->spools.info[i].stats;
        json_add(t, ",\n{writer:%s, samples:%ju, events:%ju, bytes:%ju, damaged:%i, age_s:%.3f}",
                 s->spools.info[i].writer, w->samples, w->events, w->bytes, w->damaged != 0,
                 w->oldest ? apc_ns_to_s(s->now - w->oldest) : (double)NAN);
    }
    json_add(t, "]");
}

/* @why: it could not be read. */
static void show_status_json(const struct status *s, const struct past *past, const char *why)
{
    struct text t = {.out = stdout};
    json_add(&t, "{store:{uri:%s, connected:%i, version:%jd, error:%-s}", s->store, !why,
             why ? JSON_NONE : s->version, why ? why : "");
    if (past->is && !why)
        past_json(past, &t);
    if (!past->is)
        json_spools(s, &t);
    if (why) {
        json_add(&t, "}\n");
        return;
    }
    json_history(s, &t);
    json_room(s, &t);
    json_add(&t, ",\nmode:{target:%s, actual:%s},\n", common_mode(s, LOOP_TARGET),
             common_mode(s, LOOP_ACTUAL));
    status_loops_json(&s->loops, &t);
    json_add(&t, ",\n");
    status_ramps_json(&s->loops, &t);
    json_add(&t, ",\nvariables:[");
    json_values(s, &t);
    json_add(&t, "],\n");
    status_writes_json(&s->writes, s->now, &t);
    json_add(&t, ",\ntiming:[");
    json_timing(s, &t);
    json_add(&t, "],\nevents:[");
    for (size_t i = 0; i < s->n_events; i++) {
        json_add(&t, ",\n");
        print_event_json(&t, &s->events[i]);
    }
    json_add(&t, "]}\n");
}

int command_status(int argc, char **argv)
{
    struct status status = {.version = 0};
    struct past past;
    struct cli cli;

    struct options options = {.spools = getenv("APC_SPOOL")};
    struct apc_error why;
    cli_parse(&cli, &spec, &options, argc, argv);
    const char *dir = options.at ? NULL : options.spools;
    if (options.all && options.at)
        return cli_usage(&cli, "--at shows one plant: leave --all out");
    if (cli.format == CLI_CSV)
        return cli_usage(&cli, "--csv: a status is not one table: use --json");
    if (options.all)
        return all_plants_show(&cli);
    store_name(cli.store, status.store, sizeof status.store);
    status.now = apc_clock_utc(NULL);
    if (dir && *dir && spools_look(&status.spools, dir, &why) < 0)
        cli_error(&cli, 0, "%s", why.text);
    for (size_t i = 0; i < status.spools.n; i++) {
        if (status.spools.info[i].stats.damaged)
            cli_error(&cli, 0, "%s is damaged: what can be read of it is counted, and apc drain stores it",
                      status.spools.path[i]);
    }
    int rc = past_open(&cli, "at", options.at, &past);
    if (rc == 0)
        rc = load_status(&cli, &past, &status);
    if (rc < 0 && past.is)
        ; /* it is said */
    else if (cli.format == CLI_JSON)
        show_status_json(&status, &past, rc < 0 ? apc_store_error(past.store) : NULL);
    else if (rc < 0)
        show_spools(&status, cli_colour());
    else if ((rc = show_status(&status, &past, &cli)) < 0)
        cli_error(&cli, rc, "out of memory");
    if (rc >= 0)
        past_note(&past, &cli);
    free(status.samples);
    status_loops_free(&status.loops);
    status_writes_free(&status.writes);
    cli_plant_free(&status.plant);
    timing_free(&status.timing);
    past_close(&past);
    return cli_done(&cli, exit_code_of(rc));
}
