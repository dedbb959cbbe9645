/* SPDX-License-Identifier: BSD-3-Clause */
/* apc alarm: the alarms as they stand, their journal; acknowledging, shelving. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "apc/common/cli.h"
#include "apc/common/past.h"
#include "apc/common/print.h"
#include "apc/common/print_alarms.h"
#include "base/text.h"
#include "operate.h"
#include "record/record.h"

#define PAUSE (50 * APC_NS_PER_MS)
#define GRACE (2 * APC_NS_PER_S) /* beyond three ticks */
#define LAST  50                 /* transitions that are shown without --since and --last */
#define WORST 5                  /* alarms that settings are tried of, where none is named */
#define DAY   (86400 * APC_NS_PER_S)

struct alarm_options {
    bool all, once, figures;
    const char *for_, *since, *until, *last, *at;
};

struct session {
    struct cli cli;
    struct alarm_options options;
    struct past past;
    struct apc_store *store; /* its own */
    struct alarm_summary summary;
    apc_ns now;      /* UTC of the last read */
    apc_ns duration; /* of --for */
};

#define AT(member) .to = offsetof(struct alarm_options, member)
static const struct option_spec own_options[] = {
    {"all", 'a', NULL, "list: also the normal ones; ack: all unacknowledged ones", OPTION_FLAG, AT(all)},
    {"for", 'f', "DURATION", "shelve: how long, as 30m or 2h; required", OPTION_TEXT, AT(for_)},
    {"once", 0, NULL, "shelve: only until it has returned to normal", OPTION_FLAG, AT(once)},
    {"since", 0, "TIME",
     "journal, try: only from TIME on, RFC 3339 or before now as -8h; default of try: -24h", OPTION_TEXT,
     AT(since)},
    {"until", 0, "TIME", "journal, try: only before TIME; default: now", OPTION_TEXT, AT(until)},
    {"last", 0, "N", "journal: the newest N transitions", OPTION_TEXT, AT(last)},
    {"figures", 0, NULL,
     "journal: numbers and rates of alarms, against the targets of ISA-18.2 and EEMUA 191", OPTION_FLAG,
     AT(figures)},
    PAST_OPTION(struct alarm_options),
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "list\nack NAME...\nshelve NAME...\nunshelve NAME...\nout NAME...\nin NAME...\njournal\ntry "
                "[NAME...]",
    .doc = "List the active alarms, or with --at those of that time. Acknowledge them (and reset those that "
           "latch), shelve them for some time, take them out of service and back in, or show the journal of "
           "their transitions. `try` applies other delays and deadbands to the record, for the alarms NAME "
           "or the five most frequent ones, and counts how often each would have been raised.",
    .takes = CLI_STORE | CLI_FORMAT | CLI_WRITES,
    .min_args = 1,
    .max_args = -1,
    .options = own_options,
};

static int read_alarm_summary(struct session *s)
{
    const int rc = alarm_summary_read(&s->summary, s->store);
    s->now = apc_store_now(s->store);
    return rc < 0 ? cli_store_error(&s->cli, rc, s->store) : EXIT_OK;
}

/* Whoever stands behind the number; "" where nobody does. */
static const char *author_of_transition(struct session *s, uint32_t number, char name[APC_AUTHOR_LEN])
{
    name[0] = '\0';
    if (number > 0 && apc_store_author_name(s->store, number, name) < 0)
        name[0] = '\0';
    return name;
}

static int check_named_alarms(const struct session *s)
{
    for (int i = 1; i < s->cli.n_args; i++)
        if (!alarm_summary_find(&s->summary, s->cli.args[i]))
            return cli_error(&s->cli, APC_ENOTFOUND,
                             "there is no alarm \"%s\": apc alarm list --all names them", s->cli.args[i]);
    return EXIT_OK;
}

/* ---- List --------------------------------------------------------------------------------- */

static bool is_listed(const struct session *s, const struct alarm_now *now)
{
    const enum apc_alarm_state state = alarm_summary_state(now);
    return s->options.all || apc_alarm_is_standing(state) ||
           (apc_alarm_is_masked(state) && state != APC_ALARM_SUPPRESSED);
}

/* The gravest first; among them what nobody has acknowledged, then the newest. */
static int by_urgency(const void *x, const void *y)
{
    const struct alarm_now *a = *(const struct alarm_now *const *)x, *b = *(const struct alarm_now *const *)y;
    const enum apc_alarm_state s = alarm_summary_state(a), t = alarm_summary_state(b);
    if (apc_alarm_is_standing(s) != apc_alarm_is_standing(t))
        return apc_alarm_is_standing(s) ? -1 : 1;
    if (apc_alarm_is_unacked(s) != apc_alarm_is_unacked(t))
        return apc_alarm_is_unacked(s) ? -1 : 1;
    return a->row->origin > b->row->origin ? -1 : a->row->origin < b->row->origin;
}

static void list_alarms_text(struct session *s, const struct alarm_now **at, size_t n)
{
    static const struct print_column columns[] = {
        {"ALARM", PRINT_LEFT}, {"PRIORITY", PRINT_RIGHT}, {"STATE", PRINT_LEFT},  {"AGE", PRINT_RIGHT},
        {"BY", PRINT_LEFT},    {"UNTIL", PRINT_LEFT},     {"MESSAGE", PRINT_LEFT}};
    struct print_table table;
    char text[PRINT_LEN], name[APC_AUTHOR_LEN];
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < n; i++) {
        const struct alarm *alarm = alarm_summary_alarm(&s->summary, at[i]);
        const enum apc_alarm_state state = alarm_summary_state(at[i]);
        const enum print_ink ink = !apc_alarm_is_standing(state) ? PRINT_FAINT
                                   : alarm->is.priority <= 2     ? PRINT_ALARM
                                                                 : PRINT_WARN;
        const apc_ns until =
            state >= APC_ALARM_SHELVED && state < APC_ALARM_SUPPRESSED ? alarm_summary_shelved(at[i]) : 0;
        print_cell(&table, ink, "%s", alarm->name);
        print_cell(&table, ink, "%d", alarm->is.priority);
        print_cell(&table, ink, "%s%s", apc_alarm_state_name(state), at[i]->first_out ? ", first out" : "");
        print_cell(&table, PRINT_PLAIN, "%s",
                   at[i]->row->seq > 0 ? print_age(s->now - at[i]->row->time, text) : "");
        print_cell(&table, PRINT_PLAIN, "%s", author_of_transition(s, at[i]->row->author, name));
        print_cell(&table, PRINT_PLAIN, "%s", until ? print_second(until, text) : "");
        print_cell(&table, PRINT_PLAIN, "%s", alarm->message);
    }
    (void)print_table_end(&table, stdout, cli_colour(), 0);
}

static const char *time_or_none(apc_ns time, char text[APC_TIME_LEN])
{
    return time ? apc_time_format(time, text) : "";
}

static void alarm_json(struct session *s, const struct alarm_now *now, struct text *t)
{
    const struct alarm *alarm = alarm_summary_alarm(&s->summary, now);
    const enum apc_alarm_state state = alarm_summary_state(now);
    char name[APC_AUTHOR_LEN], time[APC_TIME_LEN], until[APC_TIME_LEN];
    json_add(t, "{alarm:%s, id:%d, priority:%d, seq:%jd, journal:%jd", alarm->name, now->row->id,
             alarm->is.priority, now->row->seq, now->row->origin);
    json_add(t, "active:%i, unacknowledged:%i, standing:%i, state:%s", apc_alarm_is_active(state),
             apc_alarm_is_unacked(state), apc_alarm_is_standing(state), apc_alarm_state_name(state));
    json_add(t, "time:%-s, author:%-s, shelved_until:%-s",
             time_or_none(now->row->seq > 0 ? now->row->time : 0, time),
             author_of_transition(s, now->row->author, name),
             time_or_none(alarm_summary_shelved(now), until));
    json_add(t, "first_out:%i, area:%s, message:%s, consequence:%s, response:%s}", now->first_out,
             alarm->area, alarm->message, alarm->consequence, alarm->response);
}

static void list_json(struct session *s, const struct alarm_now **at, size_t n)
{
    struct text t = {.out = stdout};
    char time[APC_TIME_LEN];
    json_add(&t, "{");
    past_json(&s->past, &t);
    json_add(&t, "evaluated:%i, time:%-s, alarms:[", alarm_summary_lives(&s->summary, s->now),
             time_or_none(s->summary.tick.seq > 0 ? s->summary.tick.time : 0, time));
    for (size_t i = 0; i < n; i++)
        alarm_json(s, at[i], &t);
    json_add(&t, "]}\n");
}

static void say_life(const struct session *s)
{
    char age[PRINT_LEN];
    const double *n = s->summary.numbers;
    if (s->summary.tick.seq == 0 && s->past.is)
        puts("no alarm was evaluated by then");
    else if (s->summary.tick.seq == 0)
        puts("alarms have never been evaluated in this store: apc-alarms does not run");
    else if (!alarm_summary_lives(&s->summary, s->now))
        printf("alarms %s not evaluated: apc-alarms' last tick was %s %s\n", s->past.is ? "were" : "are",
               print_age(s->now - s->summary.tick.time, age), s->past.is ? "before" : "ago");
    else
        printf("%g unacknowledged, %g active; %g shelved, %g suppressed, %g out of service; of %zu\n",
               n[APC_ALARMS_UNACKED], n[APC_ALARMS_ACTIVE], n[APC_ALARMS_SHELVED], n[APC_ALARMS_SUPPRESSED],
               n[APC_ALARMS_OUT_OF_SERVICE], s->summary.e.n_alarms);
}

static int list_alarms(struct session *s)
{
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    const struct alarm_now **at = calloc(s->summary.e.n_alarms + 1, sizeof *at);
    size_t n = 0;
    if (!at)
        return cli_error(&s->cli, APC_ENOMEM, "out of memory");
    const int rc = alarm_summary_mark(&s->summary, s->store);
    if (rc < 0) {
        free(at);
        return cli_store_error(&s->cli, rc, s->store);
    }
    for (size_t i = 0; i < s->summary.e.n_alarms; i++)
        if (is_listed(s, &s->summary.at[i]))
            at[n++] = &s->summary.at[i];
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): and again */
    qsort(at, n, sizeof *at, by_urgency);
    if (s->cli.format == CLI_JSON) {
        list_json(s, at, n);
    } else {
        past_show(&s->past, &s->cli);
        say_life(s);
        list_alarms_text(s, at, n);
    }
    free(at);
    past_note(&s->past, &s->cli);
    return EXIT_OK;
}

/* ---- Journal ------------------------------------------------------------------------------ */

static void journal_json(struct session *s, const struct alarm_transition *tr)
{
    const struct alarm *alarm = &s->summary.e.alarm[tr->alarm - 1];
    struct text t = {.out = stdout};
    char name[APC_AUTHOR_LEN], time[APC_TIME_LEN];
    json_add(&t,
             "{number:%jd, time:%-s, alarm:%s, priority:%d, raised:%i, state:%s, before:%s, author:%-s, "
             "reason:%-s}\n",
             tr->number, time_or_none(tr->time, time), alarm->name, alarm->is.priority, alarm_is_raised(tr),
             apc_alarm_state_name(tr->state), apc_alarm_state_name(tr->before),
             author_of_transition(s, tr->author, name), tr->reason ? tr->reason : "");
}

static void journal_text(struct session *s, struct print_table *table, const struct alarm_transition *t)
{
    const struct alarm *alarm = &s->summary.e.alarm[t->alarm - 1];
    char text[APC_TIME_LEN], name[APC_AUTHOR_LEN];
    print_cell(table, PRINT_FAINT, "%lld", (long long)t->number);
    print_cell(table, PRINT_PLAIN, "%s", apc_time_format(t->time, text));
    print_cell(table, PRINT_PLAIN, "%d", alarm->is.priority);
    print_cell(table, alarm_is_raised(t) ? PRINT_WARN : PRINT_PLAIN, "%s", alarm->name);
    print_cell(table, PRINT_PLAIN, "%s", apc_alarm_state_name(t->state));
    print_cell(table, PRINT_PLAIN, "%s", author_of_transition(s, t->author, name));
    print_cell(table, PRINT_PLAIN, "%s", t->reason ? t->reason : "");
    print_cell(table, PRINT_PLAIN, "%s", alarm->message);
}

static int show_journal(struct session *s, const struct alarm_journal *j)
{
    static const struct print_column columns[] = {
        {"NUMBER", PRINT_RIGHT}, {"TIME", PRINT_LEFT}, {"PRIORITY", PRINT_RIGHT}, {"ALARM", PRINT_LEFT},
        {"STATE", PRINT_LEFT},   {"BY", PRINT_LEFT},   {"REASON", PRINT_LEFT},    {"MESSAGE", PRINT_LEFT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < j->n; i++)
        if (s->cli.format == CLI_JSON)
            journal_json(s, &j->at[i]);
        else
            journal_text(s, &table, &j->at[i]);
    const int rc = print_table_end(&table, stdout, cli_colour(), 0);
    return rc < 0 ? cli_error(&s->cli, rc, "out of memory") : EXIT_OK;
}

static int show_figures(struct session *s, const struct alarm_journal *j, const struct apc_range *range)
{
    struct alarm_figures figures;
    struct text t = {.out = stdout};
    const apc_ns until = range->until ? range->until : s->now, from = range->since ? range->since
                                                                      : j->n > 0   ? j->at[0].time
                                                                                   : until;
    int rc = alarm_figures_make(&figures, j, &s->summary.e, from, until);
    if (rc == 0 && s->cli.format == CLI_JSON) {
        json_add(&t, "{");
        alarms_member_json(&figures, &s->summary.e, from, &t);
        json_add(&t, "}\n");
    } else if (rc == 0)
        rc = alarms_print(&figures, &s->summary.e, from, stdout);
    alarm_figures_free(&figures);
    return rc < 0 ? cli_error(&s->cli, rc, "out of memory") : EXIT_OK;
}

static int journal(struct session *s)
{
    struct apc_range range = {0};
    struct alarm_journal j = {0};
    char *end = NULL;
    if (cli_time(&s->cli, "since", s->options.since, &range.since) != EXIT_OK ||
        cli_time(&s->cli, "until", s->options.until, &range.until) != EXIT_OK)
        return EXIT_USAGE;
    if (s->options.since && s->options.until && range.since >= range.until)
        return cli_usage(&s->cli, "--since: \"%s\" must be before %s", s->options.since, s->options.until);
    range.last = s->options.since || s->options.figures ? 0 : LAST;
    if (s->options.last) {
        errno = 0;
        const long last = strtol(s->options.last, &end, 10);
        if (errno || *end || last < 1)
            return cli_usage(&s->cli, "--last: \"%s\" must be a whole number above 0", s->options.last);
        range.last = (size_t)last;
    }
    int rc = alarm_journal_load(&j, s->store, s->summary.e.n_alarms, &range);
    if (rc == 0 && !s->options.figures)
        rc = alarm_journal_reasons(&j, s->store, &s->summary.e);
    if (rc < 0)
        rc = rc == APC_ENOMEM ? cli_error(&s->cli, rc, "out of memory")
                              : cli_store_error(&s->cli, rc, s->store);
    else
        rc = s->options.figures ? show_figures(s, &j, &range) : show_journal(s, &j);
    alarm_journal_free(&j);
    return rc;
}

/* ---- Other settings ------------------------------------------------------------------------ */

static void show_try(const struct cli_tags *tags, const struct apc_alarm *alarm, const struct alarm_try *one)
{
    char text[PRINT_LEN];
    const struct apc_tag *tag = cli_tag(tags, alarm->table, alarm->id);
    const char *unit = one->setting != ALARM_DEADBAND ? "s" : tag ? tag->unit : "";
    printf("; with %s %.6g%s%s%s: %zu", alarm_setting_name(one->setting), one->value, *unit ? " " : "", unit,
           one->setting == ALARM_DEADBAND && alarm->kind == APC_ALARM_RATE ? "/s" : "", one->raised);
    if (one->later > 0)
        printf(", up to %s later", print_duration(one->later, text));
    if (one->missed > 0)
        printf(", %zu never, which lasted up to %s", one->missed, print_duration(one->longest, text));
}

static void show_trial(const struct cli_tags *tags, const struct alarm *alarm, const struct alarm_trial *t)
{
    size_t n = 0;
    printf("%s: %zu alarm%s in %.3g h", alarm->name, t->at[0].raised, PLURAL(t->at[0].raised),
           apc_ns_to_s(t->until - t->since) / 3600);
    if (t->recorded != t->at[0].raised)
        printf(" (on record: %zu)", t->recorded);
    for (size_t i = 0; i < t->n; i++)
        if (t->at[i].proposed) {
            show_try(tags, &alarm->is, &t->at[i]);
            n++;
        }
    puts(n > 0 ? "" : "; no setting that was tried gives fewer");
}

static int try_alarm(struct session *s, const struct cli_tags *tags, const struct alarm *alarm,
                     const struct apc_range *range, struct text *t)
{
    struct alarm_trial trial;
    struct apc_error why;
    int rc = alarm_trial_make(&trial, s->store, &s->summary.e, alarm,
                              s->summary.tick.seq > 0 ? s->summary.tick.time : 0, range, 0, &why);
    if (rc < 0)
        rc = cli_error(&s->cli, rc, "%s", why.text);
    else if (s->cli.format == CLI_JSON) {
        json_add(t, "{");
        alarm_trial_members(&trial, alarm->name, t);
        json_add(t, "}");
    } else
        show_trial(tags, alarm, &trial);
    alarm_trial_free(&trial);
    return rc;
}

/* Those that came most often into @at; returns how many. */
static int find_worst_alarms(struct session *s, const struct apc_range *range, const struct alarm *at[WORST])
{
    struct alarm_journal j = {0};
    struct alarm_figures f = {0};
    int n = 0, rc = alarm_journal_load(&j, s->store, s->summary.e.n_alarms, range);
    if (rc == 0)
        rc = alarm_figures_make(&f, &j, &s->summary.e, range->since, range->until);
    for (; rc == 0 && n < WORST; n++) {
        struct alarm_figure *worst = NULL;
        for (size_t i = 0; i < f.n; i++)
            if (f.alarm[i].raised > (worst ? worst->raised : 0) &&
                !apc_table_vectors(s->summary.e.alarm[i].is.table))
                worst = &f.alarm[i];
        if (!worst)
            break;
        at[n] = &s->summary.e.alarm[worst - f.alarm];
        worst->raised = 0;
    }
    alarm_figures_free(&f);
    alarm_journal_free(&j);
    return rc < 0 ? rc : n;
}

/* Before it, as it may take a while. */
static void say_trial(const struct apc_range *range)
{
    char since[PRINT_LEN], until[PRINT_LEN];
    printf("what is on record from %s to %s:\n", print_second(range->since, since),
           print_second(range->until, until));
    fflush(stdout);
}

static int try_alarms_of(struct session *s, const struct cli_tags *tags, const struct apc_range *range)
{
    const struct alarm *worst[WORST];
    struct text t = {.out = stdout};
    const int named = s->cli.n_args - 1, n = named ? named : find_worst_alarms(s, range, worst);
    if (n < 0)
        return cli_store_error(&s->cli, n, s->store);
    int rc = EXIT_OK;
    if (s->cli.format == CLI_JSON)
        json_add(&t, "{alarms:[");
    else if (n == 0)
        puts("no alarm of a signal came in that time");
    else
        say_trial(range);
    for (int i = 0; i < n && rc == EXIT_OK; i++) {
        const struct alarm *alarm =
            named ? alarm_summary_alarm(&s->summary, alarm_summary_find(&s->summary, s->cli.args[i + 1]))
                  : worst[i];
        rc = try_alarm(s, tags, alarm, range, &t);
    }
    if (s->cli.format == CLI_JSON)
        json_add(&t, "]}\n");
    return rc;
}

static int try_settings(struct session *s)
{
    struct apc_range range = {.until = s->now};
    struct cli_tags tags;
    if (cli_time(&s->cli, "until", s->options.until, &range.until) != EXIT_OK)
        return EXIT_USAGE;
    range.since = range.until - DAY;
    if (cli_time(&s->cli, "since", s->options.since, &range.since) != EXIT_OK)
        return EXIT_USAGE;
    if (range.since >= range.until)
        return cli_usage(&s->cli, "--since: \"%s\" must be before %s", s->options.since,
                         s->options.until ? s->options.until : "now");
    int rc = check_named_alarms(s);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_tags_load(&s->cli, s->store, &tags));
    if (rc == EXIT_OK) {
        rc = try_alarms_of(s, &tags, &range);
        cli_tags_free(&tags);
    }
    return rc;
}

/* ---- What is wanted ------------------------------------------------------------------------ */

struct wanted {
    const struct alarm_now *now;
    struct apc_sample request;
};

static void describe_wanted(const struct session *s, const struct wanted *w, char *text, size_t size)
{
    alarm_summary_words(alarm_summary_alarm(&s->summary, w->now)->name, &w->request, s->cli.reason, text,
                        size);
}

static int record_wanted(struct session *s, const struct wanted *w)
{
    struct apc_event event = {.time = s->now, .severity = APC_EVENT_INFO, .kind = "operator"};
    describe_wanted(s, w, event.text, sizeof event.text);
    operate_who(event.source, sizeof event.source);
    const int rc = apc_store_append_events(s->store, &event, 1);
    return rc < 0 ? cli_error(&s->cli, rc, "it was done, but not recorded as an event: %s",
                              apc_store_error(s->store))
                  : EXIT_OK;
}

/* Whoever was faster. */
static int lost(struct session *s, const struct wanted *w)
{
    char name[APC_AUTHOR_LEN];
    return cli_error(&s->cli, APC_ECONFLICT, "%s: %s was faster: look again",
                     alarm_summary_alarm(&s->summary, w->now)->name,
                     *author_of_transition(s, w->request.author, name) ? name : "somebody else");
}

static int await_wanted(struct session *s, struct wanted *w)
{
    const apc_ns end = apc_clock_mono(NULL) + 3 * s->summary.e.alarms.rhythm.period + GRACE;
    const char *name = alarm_summary_alarm(&s->summary, w->now)->name;
    char text[192];
    struct apc_error ended;
    enum outcome outcome;
    int still = 0;
    while ((outcome = alarm_summary_outcome(&s->summary, w->now, &w->request, s->now)) == OUTCOME_WAITING &&
           (still = operate_still(s->store, &ended)) == 0 && apc_clock_mono(NULL) < end) {
        nanosleep(&(struct timespec){.tv_nsec = PAUSE}, NULL);
        const int rc = read_alarm_summary(s);
        if (rc != EXIT_OK)
            return rc;
    }
    describe_wanted(s, w, text, sizeof text);
    switch (outcome) {
    case OUTCOME_APPLIED:
        print_clean(stdout, text);
        puts(" (applied)");
        return EXIT_OK;
    case OUTCOME_SUPERSEDED:
        return cli_error(&s->cli, APC_EPERM, "%s: superseded by another user's change: see apc alarm list",
                         name);
    case OUTCOME_REFUSED:
        while (!alarm_summary_refusal(&s->summary, w->now, &w->request, s->store, text, sizeof text) &&
               apc_clock_mono(NULL) < end)
            nanosleep(&(struct timespec){.tv_nsec = PAUSE}, NULL);
        if (!text[0])
            snprintf(text, sizeof text, "%s: see the events", name);
        return cli_error(&s->cli, APC_EPERM, "refused: %s", text);
    case OUTCOME_WAITING:
    case OUTCOME_NOBODY:
        break;
    }
    if (still > 0) {
        print_clean(stdout, text);
        puts(OPERATE_PAUSED);
        return EXIT_OK;
    }
    return still < 0
               ? cli_error(&s->cli, still, "%s: written, but %s", name, ended.text)
               : cli_error(&s->cli, APC_ETIMEDOUT,
                           "%s: written, but apc-alarms has not come to it: does it run? See apc alarm list",
                           name);
}

static int put_alarm_switch(struct session *s, const struct alarm_now *now, enum apc_alarm_switch which,
                            double value)
{
    struct wanted w = {.now = now};
    struct apc_error why;
    char who[APC_AUTHOR_LEN], text[192];
    if (!alarm_summary_want(&s->summary, now, s->store, which, value, s->now, &w.request, &why))
        return cli_error(&s->cli, APC_EPERM, "%s", why.text);
    int rc = cli_live(&s->cli, s->store);
    if (rc != EXIT_OK)
        return rc;
    operate_who(who, sizeof who);
    rc = apc_store_author(s->store, who);
    if (rc > 0) {
        w.request.author = (uint32_t)rc;
        rc = apc_store_swap(s->store, &w.request, 1);
    }
    if (rc == APC_ECONFLICT)
        return lost(s, &w);
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        return cli_error(&s->cli, rc, "the store did not answer, so whether it was written is not known: %s",
                         apc_store_error(s->store));
    if (rc < 0)
        return cli_store_error(&s->cli, rc, s->store);
    rc = record_wanted(s, &w);
    if (rc == EXIT_OK && !s->cli.no_wait)
        return await_wanted(s, &w);
    describe_wanted(s, &w, text, sizeof text);
    print_clean(stdout, text);
    putchar('\n');
    return rc;
}

static int each(struct session *s, enum apc_alarm_switch which, double value)
{
    int rc = check_named_alarms(s);
    for (int i = 1; i < s->cli.n_args && rc != EXIT_ERROR && rc != EXIT_CONNECTION; i++) {
        const int done = put_alarm_switch(s, alarm_summary_find(&s->summary, s->cli.args[i]), which, value);
        rc = done > rc ? done : rc;
    }
    for (size_t i = 0; s->options.all && i < s->summary.e.n_alarms && rc == EXIT_OK; i++)
        if (apc_alarm_is_unacked(alarm_summary_state(&s->summary.at[i])))
            rc = put_alarm_switch(s, &s->summary.at[i], which, value);
    return rc;
}

static int want_of_alarm(struct session *s, enum apc_alarm_switch which, double value)
{
    s->options.all = s->options.all && which == APC_ALARM_ACK;
    if (!s->cli.no_wait && !alarm_summary_lives(&s->summary, s->now)) {
        say_life(s);
        return cli_error(&s->cli, APC_EPERM,
                         "apc-alarms would not take it now. Nothing was written; --no-wait writes it anyway");
    }
    return each(s, which, value);
}

static int shelve(struct session *s)
{
    const double until = floor(apc_ns_to_s(s->now + s->duration));
    return want_of_alarm(s, APC_ALARM_SHELF, s->options.once ? -until : until);
}

/* EXIT_OK, or what is wrong is said. */
static int check_request(struct session *s)
{
    static const char *const known[] = {"list", "journal", "try", "ack", "shelve", "unshelve", "out", "in"};
    const char *what = s->cli.args[0];
    size_t k = 0;
    while (k < sizeof known / sizeof known[0] && strcmp(what, known[k]) != 0)
        k++;
    if (k == sizeof known / sizeof known[0])
        return cli_usage(&s->cli, "\"%s\": must be list, ack, shelve, unshelve, out, in, journal or try",
                         what);
    if (k < 2 && s->cli.n_args > 1)
        return cli_usage(&s->cli, "%s takes no names: leave them out", what);
    if (s->options.at && k != 0)
        return cli_usage(&s->cli, "--at goes with apc alarm list");
    if (k >= 3 && s->cli.n_args < 2 && !(s->options.all && !strcmp(what, "ack")))
        return cli_usage(&s->cli, "%s wants the name of an alarm", what);
    if (k < 3 && cli_only_shows(&s->cli) != EXIT_OK)
        return EXIT_USAGE;
    if (!strcmp(what, "shelve") && !s->options.for_)
        return cli_usage(&s->cli, "shelve wants an end: --for 30m");
    return cli_duration(&s->cli, "for", s->options.for_, &s->duration);
}

static int act_on_alarms(struct session *s)
{
    const char *what = s->cli.args[0];
    if (!strcmp(what, "list"))
        return list_alarms(s);
    if (!strcmp(what, "journal"))
        return journal(s);
    if (!strcmp(what, "try"))
        return try_settings(s);
    if (!strcmp(what, "ack"))
        return want_of_alarm(s, APC_ALARM_ACK, 0);
    if (!strcmp(what, "shelve"))
        return shelve(s);
    if (!strcmp(what, "unshelve"))
        return want_of_alarm(s, APC_ALARM_SHELF, 0);
    return want_of_alarm(s, APC_ALARM_SERVICE, *what == 'o');
}

int command_alarm(int argc, char **argv)
{
    struct session s = {.cli = {.command = "apc alarm"}};
    struct apc_error why;
    cli_parse(&s.cli, &spec, &s.options, argc, argv);
    int rc = check_request(&s);
    if (rc != EXIT_OK)
        return rc;
    rc = exit_code_of(past_open(&s.cli, "at", s.options.at, &s.past));
    s.store = s.past.store;
    if (rc == EXIT_OK && (rc = alarm_summary_open(&s.summary, s.store, &why)) < 0)
        rc = rc == APC_ECONN ? cli_store_error(&s.cli, rc, s.store) : cli_error(&s.cli, rc, "%s", why.text);
    if (rc == EXIT_OK)
        rc = read_alarm_summary(&s);
    if (rc == EXIT_OK)
        rc = act_on_alarms(&s);
    alarm_summary_close(&s.summary);
    past_close(&s.past);
    return cli_done(&s.cli, rc);
}
