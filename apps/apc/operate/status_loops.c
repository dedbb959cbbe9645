/* SPDX-License-Identifier: BSD-3-Clause */
#include "status_loops.h"

#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "base/base_internal.h"

#define SENSIBLE (10 * APC_NS_PER_S) /* so old a value may be whatever its period */

/* ---- Reading ------------------------------------------------------------------------------ */

static void name_status_rows(struct apc_sample *row, const struct loops *loops, const struct loops_loop *l)
{
    const bool scheduled = loops_scheduled(loops, l->setpoint);
    row[LOOP_TARGET] = (struct apc_sample){.table = APC_OPMODE, .id = l->id};
    row[LOOP_ACTUAL] = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, l->id)};
    row[LOOP_SP] = (struct apc_sample){.table = l->setpoint ? APC_SETPOINT : 0, .id = l->setpoint};
    row[LOOP_OWNER] = (struct apc_sample){.table = scheduled ? APC_OPMODE : 0,
                                          .id = scheduled ? LOOPS_OWNER(l->setpoint) : 0};
    row[LOOP_PV] = (struct apc_sample){.table = l->measurement ? APC_SENSOR : 0, .id = l->measurement};
    row[LOOP_OP] = (struct apc_sample){.table = l->table, .id = l->output};
}

static int read_all(struct status_loops *s, struct apc_store *store)
{
    const size_t n = s->plant->loops.n * LOOP_ROWS;
    const size_t n_ticks = s->plant->loops.n_controllers;
    struct apc_sample *there = calloc(n + 1, sizeof *there);
    struct apc_vector *tick = calloc(n_ticks + 1, sizeof *tick);
    struct apc_rows rows = {.size = sizeof rows, .sample = there, .vector = tick};
    if (!there || !tick) {
        free(tick);
        free(there);
        return APC_ENOMEM;
    }
    for (size_t i = 0; i < n; i++)
        if (s->row[i].table)
            there[rows.n_samples++] = s->row[i];
    for (size_t i = 0; i < n_ticks; i++)
        if (s->tick[i].table)
            tick[rows.n_vectors++] = s->tick[i];
    const int rc = rows.n_samples > 0 ? apc_store_read_rows(store, &rows) : 0;
    for (size_t i = 0, k = 0; i < n && rc >= 0; i++)
        if (s->row[i].table)
            s->row[i] = there[k++];
    for (size_t i = 0, k = 0; i < n_ticks && rc >= 0; i++)
        if (s->tick[i].table)
            s->tick[i] = tick[k++];
    free(tick);
    free(there);
    return rc;
}

static int make_loops(struct status_loops *s, const struct cli_plant *plant, const struct timing *timing)
{
    const struct loops *l = &plant->loops;
    *s = (struct status_loops){.plant = plant,
                               .row = calloc(l->n + 1, LOOP_ROWS * sizeof *s->row),
                               .tick = calloc(l->n_controllers + 1, sizeof *s->tick),
                               .reason = calloc(l->n + 1, sizeof *s->reason),
                               .plan = calloc(l->n_controllers + 1, sizeof *s->plan),
                               .timing = timing};
    s->view = (struct plant_view){plant->tags.tag, plant->tags.n, l};
    return ramps_init(&s->ramps, &s->view, NULL) == 0 && s->row && s->tick && s->reason && s->plan
               ? 0
               : APC_ENOMEM;
}

static struct apc_vector tick_of_controller(const struct loops_controller *controller)
{
    return (struct apc_vector){.table = APC_TICK, .id = controller->number};
}

const struct loops_loop *status_loop_of_entry(const struct loops *loops, const struct apc_sample *of)
{
    const bool may_be_set = of->table == APC_SETPOINT || of->table == APC_MANUAL || of->table == APC_ACTUATOR;
    return may_be_set ? loops_of(loops, of->table, of->id) : NULL;
}

int status_entries_load(struct status_loops *s, struct apc_store *store, const struct cli_plant *plant,
                        const struct apc_sample *of, size_t n, bool ramps)
{
    const struct loops *l = &plant->loops;
    bool any = false;
    int rc = make_loops(s, plant, NULL);
    for (size_t i = 0; i < n && rc == 0; i++) {
        const struct loops_loop *loop = status_loop_of_entry(l, &of[i]);
        if (!loop)
            continue;
        struct apc_sample *row = s->row + LOOP_ROWS * (size_t)(loop - l->at);
        name_status_rows(row, l, loop);
        row[LOOP_SP].table = row[LOOP_OWNER].table = row[LOOP_PV].table = (enum apc_table)0;
        s->tick[loop->controller] = tick_of_controller(&l->controller[loop->controller]);
        any |= of[i].table != APC_ACTUATOR;
    }
    if (rc == 0)
        rc = read_all(s, store);
    if (rc >= 0 && ramps && any)
        rc = ramps_read(&s->ramps, store);
    s->now = apc_store_now(store);
    return rc < 0 ? rc : 0;
}

int status_loops_load(struct status_loops *s, struct apc_store *store, const struct cli_plant *plant,
                      const struct timing *timing)
{
    const struct loops *l = &plant->loops;
    int rc = make_loops(s, plant, timing);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < l->n; i++)
        name_status_rows(s->row + LOOP_ROWS * i, l, &l->at[i]);
    for (size_t i = 0; i < l->n_controllers; i++)
        s->tick[i] = tick_of_controller(&l->controller[i]);
    rc = read_all(s, store);
    for (size_t i = 0; i < l->n_controllers && rc >= 0; i++)
        rc = status_plan_load(&s->plan[i], store, &plant->tags, l->controller[i].name);
    if (rc >= 0)
        rc = ramps_read(&s->ramps, store);
    s->now = apc_store_now(store);
    for (size_t i = 0; i < l->n && rc >= 0; i++)
        (void)mode_reason_find(store, l, &l->at[i], &s->row[LOOP_ROWS * i + LOOP_TARGET],
                               &s->row[LOOP_ROWS * i + LOOP_ACTUAL], s->reason[i]);
    return rc < 0 ? rc : 0;
}

void status_loops_free(struct status_loops *s)
{
    for (size_t i = 0; s->plan && i < s->plant->loops.n_controllers; i++)
        status_plan_free(&s->plan[i]);
    ramps_free(&s->ramps);
    free(s->plan);
    free(s->row);
    free(s->tick);
    free(s->reason);
    *s = (struct status_loops){0};
}

/* ---- What it says ------------------------------------------------------------------------- */

bool status_is_stale(const struct cli_tags *tags, const struct apc_sample *sample, apc_ns now)
{
    const struct apc_tag *tag = cli_tag(tags, sample->table, sample->id);
    apc_ns sensible = SENSIBLE;
    if (tag && tag->period > apc_ns_to_s(SENSIBLE) / 3)
        (void)apc_ns_from_s(3 * tag->period, &sensible);
    return (sample->table == APC_SENSOR || sample->table == APC_ACTUATOR) && sample->seq > 0 &&
           apc_ns_since(now, sample->time) > sensible;
}

bool status_loops_have(const struct status_loops *s, const struct apc_sample *v)
{
    for (size_t i = 0; i < s->plant->loops.n * LOOP_ROWS; i++)
        if (s->row[i].table == v->table && s->row[i].id == v->id)
            return true;
    return false;
}

static const char *actual_mode_word(const struct apc_sample *mode)
{
    return mode->seq > 0 && mode->value >= 0 ? apc_mode_name((int)mode->value) : NULL;
}

const char *status_loops_owner(const struct status_loops *s, size_t i)
{
    const struct apc_sample *target = &s->row[LOOP_ROWS * i + LOOP_TARGET],
                            *owner = &s->row[LOOP_ROWS * i + LOOP_OWNER];
    if (s->plant->loops.at[i].above >= 0)
        return loops_owner_name(target->seq == 0 || target->value != (double)APC_MODE_CAS);
    return owner->table ? loops_owner_name(loops_is_local(owner)) : NULL;
}

static bool has_no_ticks(const struct status_loops *s, size_t controller)
{
    const struct loops_controller *c = &s->plant->loops.controller[controller];
    const struct apc_vector *tick = &s->tick[controller];
    return tick->seq == 0 || (c->period > 0 && s->now - tick->time > 3 * c->period + APC_NS_PER_S);
}

const struct entry_note *status_loops_entry(const struct status_loops *s, size_t i)
{
    const struct apc_sample *row = s->row + LOOP_ROWS * i;
    const struct entry_seen seen = {.target = row[LOOP_TARGET],
                                    .actual = row[LOOP_ACTUAL],
                                    .output = row[LOOP_OP],
                                    .stopped = has_no_ticks(s, s->plant->loops.at[i].controller)};
    return entry_note(&seen);
}

/* Which way a limit holds the output back, as its status says. */
static const char *limit_of(const struct apc_sample *op)
{
    static const char *const words[] = {NULL, "low", "high", "both"};
    return op->seq > 0 ? words[op->status >> 8 & 3] : NULL;
}

static const struct timing_series *lateness_of(const struct status_loops *s, const struct loops_controller *c)
{
    const struct timing_series *t = timing_find(s->timing, c->name, "lateness");
    return t || s->plant->loops.n_controllers > 1 ? t : timing_find(s->timing, "controller", "lateness");
}

/* ---- For people --------------------------------------------------------------------------- */

static void show_controller(const struct status_loops *s, size_t i)
{
    const struct loops_controller *c = &s->plant->loops.controller[i];
    const struct timing_series *t = lateness_of(s, c);
    const apc_ns age = s->now - s->tick[i].time;
    char text[PRINT_LEN];
    putchar('\n');
    print_clean(stdout, c->name);
    if (c->period > 0)
        printf("  every %s", print_duration(c->period, text));
    if (s->tick[i].seq == 0)
        fputs(", has not ticked yet", stdout);
    else
        printf(", last tick %s ago%s", print_age(age, text), has_no_ticks(s, i) ? ": IT DOES NOT TICK" : "");
    if (t) {
        printf(", late p99 %s", print_duration(t->p99, text));
        printf(", missed %llu of %llu", (unsigned long long)t->missed,
               (unsigned long long)(t->count + t->missed));
    }
    putchar('\n');
}

static void put_value(struct print_table *table, const struct status_loops *s, const struct apc_sample *v)
{
    const enum print_ink ink =
        status_is_stale(&s->plant->tags, v, s->now) ? PRINT_ALARM : print_ink_of(v->status);
    if (!v->table)
        print_cell(table, PRINT_PLAIN, "%s", "");
    else if (v->seq == 0)
        print_cell(table, PRINT_FAINT, "-");
    else
        print_cell(table, ink, "%.5g%s", v->value + 0.0,
                   apc_status_severity(v->status) == APC_SEVERITY_GOOD  ? ""
                   : apc_status_severity(v->status) == APC_SEVERITY_BAD ? " bad"
                                                                        : "?");
}

static void put_loop(struct print_table *table, const struct status_loops *s, size_t i)
{
    const struct loops_loop *l = &s->plant->loops.at[i];
    const struct apc_sample *row = s->row + LOOP_ROWS * i,
                            *aged = row[LOOP_PV].seq ? &row[LOOP_PV] : &row[LOOP_OP];
    const char *target = actual_mode_word(&row[LOOP_TARGET]), *actual = actual_mode_word(&row[LOOP_ACTUAL]);
    const struct apc_tag *tag = cli_tag(&s->plant->tags, l->table, l->output);
    const char *limit = limit_of(&row[LOOP_OP]), *owner = status_loops_owner(s, i);
    char text[PRINT_LEN];

    print_cell(table, PRINT_PLAIN, "%s", l->name);
    print_cell(table, PRINT_PLAIN, "%s", target ? target : "none");
    print_cell(table, s->reason[i][0] ? PRINT_WARN : PRINT_PLAIN, "%s", actual ? actual : "none");
    put_value(table, s, &row[LOOP_SP]);
    print_cell(table, PRINT_PLAIN, "%s", owner ? owner : "");
    put_value(table, s, &row[LOOP_PV]);
    put_value(table, s, &row[LOOP_OP]);
    if (limit)
        print_cell(table, PRINT_WARN, "at %s", limit);
    else if (tag && tag->low > -APC_VALUE_MAX && tag->high < APC_VALUE_MAX)
        print_cell(table, PRINT_FAINT, "%.4g..%.4g", tag->low, tag->high);
    else
        print_cell(table, PRINT_PLAIN, "%s", "");
    print_cell(table, PRINT_PLAIN, "%s", aged->seq ? print_age(apc_ns_since(s->now, aged->time), text) : "");
    print_cell(table, PRINT_ALARM, "%s", status_is_stale(&s->plant->tags, aged, s->now) ? "STALE" : "");
}

/* What the table does not show. */
static void show_loop_words(const struct status_loops *s, size_t i)
{
    const char *name = s->plant->loops.at[i].name;
    const struct entry_note *entry = status_loops_entry(s, i);
    if (s->reason[i][0]) {
        printf("%s is in %s: ", name, actual_mode_word(&s->row[LOOP_ROWS * i + LOOP_ACTUAL]));
        print_clean(stdout, s->reason[i]);
        putchar('\n');
    } else if (entry && !strcmp(entry->code, "held")) {
        printf("%s: %s\n", name, entry->text);
    }
}

int status_loops_show(const struct status_loops *s, bool colour)
{
    static const struct print_column columns[] = {
        {"LOOP", PRINT_LEFT},  {"TARGET", PRINT_LEFT}, {"ACTUAL", PRINT_LEFT}, {"SP", PRINT_POINT},
        {"OWNER", PRINT_LEFT}, {"PV", PRINT_POINT},    {"OP", PRINT_POINT},    {"LIMITS", PRINT_LEFT},
        {"AGE", PRINT_POINT},  {"", PRINT_LEFT}};
    int rc = 0;
    for (size_t i = 0; i < s->plant->loops.n_controllers && rc == 0; i++) {
        const struct loops_controller *c = &s->plant->loops.controller[i];
        struct print_table table;
        print_table_open(&table, columns, sizeof columns / sizeof *columns);
        for (size_t k = c->first; k < c->first + c->n; k++)
            put_loop(&table, s, k);
        show_controller(s, i);
        rc = print_table_end(&table, stdout, colour, 0);
        status_plan_show(&s->plan[i], s->now);
        for (size_t k = c->first; k < c->first + c->n; k++)
            show_loop_words(s, k);
    }
    return rc;
}

/* That of the output where it is of a manual one. */
static const char *name_of_ramp(const struct status_loops *s, const struct ramp *ramp)
{
    const struct loops_loop *loop =
        ramp->now.table == APC_MANUAL ? loops_of(&s->plant->loops, APC_MANUAL, ramp->now.id) : NULL;
    const struct apc_tag *output = loop ? cli_tag(&s->plant->tags, loop->table, loop->output) : NULL;
    return output ? output->name : ramp->tag->name;
}

void status_ramps_show(const struct status_loops *s, const struct apc_sample *of)
{
    char target[DECIMAL_LEN], age[PRINT_LEN];
    for (size_t i = 0; i < s->ramps.n; i++) {
        const struct ramp *ramp = &s->ramps.at[i];
        apc_ns to_go;
        if (!(ramp->rate.value > 0) || apc_ns_from_s(ramp_to_go(ramp), &to_go) < 0 ||
            (of && (of->table != ramp->now.table || of->id != ramp->now.id)))
            continue;
        print_clean(stdout, name_of_ramp(s, ramp));
        printf(" is on a ramp to %s, %s to go\n", decimal_shortest(ramp->target.value, 6, target),
               print_age(to_go, age));
    }
}

/* ---- For programs ------------------------------------------------------------------------- */

static void json_value(const struct status_loops *s, const char *key, const struct apc_sample *v,
                       struct text *t)
{
    const struct apc_tag *tag = v->table ? cli_tag(&s->plant->tags, v->table, v->id) : NULL;
    const bool is = v->seq > 0;
    char status[APC_STATUS_NAME_LEN];
    if (!v->table)
        json_add(t, "%s:null", key);
    else
        json_add(t, "%s:{name:%s, value:%g, status:%-s, age:%.3f, stale:%i}", key, tag ? tag->name : "",
                 is ? v->value : (double)NAN, is ? apc_status_format(v->status, status) : "",
                 is ? apc_ns_to_s(apc_ns_since(s->now, v->time)) : (double)NAN,
                 status_is_stale(&s->plant->tags, v, s->now));
}

static void status_loop_json(const struct status_loops *s, size_t i, struct text *t)
{
    const struct loops_loop *l = &s->plant->loops.at[i];
    const struct apc_sample *row = s->row + LOOP_ROWS * i;
    const struct apc_tag *tag = cli_tag(&s->plant->tags, l->table, l->output);
    json_add(t, ",\n{loop:%s, controller:%s, target:%s, actual:%s, reason:%-s, owner:%s", l->name,
             s->plant->loops.controller[l->controller].name, actual_mode_word(&row[LOOP_TARGET]),
             actual_mode_word(&row[LOOP_ACTUAL]), s->reason[i], status_loops_owner(s, i));
    json_value(s, "setpoint", &row[LOOP_SP], t);
    json_value(s, "measurement", &row[LOOP_PV], t);
    json_value(s, "output", &row[LOOP_OP], t);
    json_add(t, "entry:");
    entry_note_json(status_loops_entry(s, i), t);
    json_add(t, "low:%e, high:%e, at_limit:%s}", tag ? tag->low : -APC_VALUE_MAX,
             tag ? tag->high : APC_VALUE_MAX, limit_of(&row[LOOP_OP]));
}

static void json_controller(const struct status_loops *s, size_t i, struct text *t)
{
    const struct loops_controller *c = &s->plant->loops.controller[i];
    const struct timing_series *late = lateness_of(s, c);
    json_add(t, ",\n{controller:%s, number:%d, loops:%zu, period_ns:%jd, last_tick:", c->name, c->number,
             c->n, c->period);
    if (s->tick[i].seq > 0)
        json_add(t, "{seq:%jd, age:%.3f}", s->tick[i].seq, apc_ns_to_s(s->now - s->tick[i].time));
    else
        json_add(t, "null");
    if (late)
        json_add(t, "ticks:%ju, missed:%ju, lateness_ns:{p50:%jd, p99:%jd, max:%jd}", late->count,
                 late->missed, late->p50, late->p99, late->max);
    status_plan_json(&s->plan[i], s->now, t);
    json_add(t, "}");
}

void status_loops_json(const struct status_loops *s, struct text *t)
{
    json_add(t, "controllers:[");
    for (size_t i = 0; i < s->plant->loops.n_controllers; i++)
        json_controller(s, i, t);
    json_add(t, "],\nloops:[");
    for (size_t i = 0; i < s->plant->loops.n; i++)
        status_loop_json(s, i, t);
    json_add(t, "]");
}

void status_ramps_json(const struct status_loops *s, struct text *t)
{
    json_add(t, "ramps:[");
    for (size_t i = 0; i < s->ramps.n; i++) {
        const struct ramp *ramp = &s->ramps.at[i];
        if (ramp->rate.value > 0)
            json_add(t, "{name:%s, target:%g, rate:%g, to_go:%.3f}", name_of_ramp(s, ramp),
                     ramp->target.value, ramp->rate.value, ramp_to_go(ramp));
    }
    json_add(t, "]");
}
