/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/base_internal.h"
#include "files/files.h"

int change_fail(struct change_fault *why, int err, const char *code, const char *fmt, ...)
{
    va_list args;
    why->err = err;
    why->code = code;
    va_start(args, fmt);
    vsnprintf(why->text, sizeof why->text, fmt, args);
    va_end(args);
    return err;
}

int change_in_past(struct apc_store *store, struct change_fault *why)
{
    struct apc_store_clock clock = {.size = sizeof clock};
    return apc_store_clock(store, &clock) > 0 && (clock.reached < 0 || clock.rewind > 0)
               ? change_fail(why, APC_ESTATE, "simulation",
                             "the simulated plant is being rewound: do this again when that is done")
               : 0;
}

/* ---- In words ------------------------------------------------------------------------------ */

char *change_text(const struct apc_sample *s, char text[CHANGE_TEXT])
{
    const bool is_mode = s->table == APC_OPMODE && s->id < LOOPS_IDS && s->value >= 0;
    const char *word = loops_is_owner(s) ? loops_owner_name(loops_is_local(s))
                       : s->seq == 0     ? "no value yet"
                       : is_mode         ? apc_mode_name((int)s->value)
                                         : NULL;
    if (!word)
        return decimal_shortest(s->value, 6, text);
    snprintf(text, CHANGE_TEXT, "%s", word);
    return text;
}

char *change_age(apc_ns age, char text[CHANGE_TEXT])
{
    double s = apc_ns_to_s(age);
    if (s < -0.5)
        snprintf(text, CHANGE_TEXT, "%.1f s ahead", -s);
    else if (s < 9.95)
        snprintf(text, CHANGE_TEXT, "%.1f s", s > 0 ? s : 0);
    else if (s < 99.5)
        snprintf(text, CHANGE_TEXT, "%.0f s", s);
    else if (s < 99.5 * 60)
        snprintf(text, CHANGE_TEXT, "%.0f min", s / 60);
    else if (s < 47.5 * 3600)
        snprintf(text, CHANGE_TEXT, "%.0f h", s / 3600);
    else
        snprintf(text, CHANGE_TEXT, "%.0f d", s / 86400);
    return text;
}

/* ---- What is meant ------------------------------------------------------------------------- */

const struct apc_tag *plant_tag(const struct plant_view *p, enum apc_table table, int id)
{
    for (size_t i = 0; i < p->n; i++)
        if (p->tag[i].table == table && p->tag[i].id == id)
            return &p->tag[i];
    return NULL;
}

int known_load(struct known_plant *p, struct apc_store *store)
{
    const int n = apc_store_get_tags(store, NULL, 0);
    *p = (struct known_plant){0};
    p->tag = n >= 0 ? calloc((size_t)n + 1, sizeof *p->tag) : NULL;
    const int got = n < 0 ? n : p->tag ? apc_store_get_tags(store, p->tag, (size_t)n) : APC_ENOMEM;
    p->view = (struct plant_view){p->tag, got < 0 ? 0 : (size_t)(got < n ? got : n), &p->loops};
    const int rc = got < 0 ? got : loops_load(&p->loops, store, p->tag, p->view.n);
    return rc < 0 ? rc : 0;
}

void known_free(struct known_plant *p)
{
    free(p->tag);
    loops_free(&p->loops);
    *p = (struct known_plant){0};
}

bool change_is_of(const struct apc_tag *tag)
{
    return tag->table == APC_SETPOINT || tag->table == APC_TUNING || tag->table == APC_MANUAL ||
           (tag->table == APC_OPMODE && tag->id > 0 && (tag->id < LOOPS_IDS || loops_is_owner_id(tag->id)));
}

/* Of a mode and tuning that of the controller. */
static double second_of_tag(const struct plant_view *p, const struct apc_tag *tag)
{
    const bool is_of_all = tag->table == APC_TUNING || (tag->table == APC_OPMODE && tag->id < LOOPS_IDS);
    const struct loops_controller *by = is_of_all ? loops_controller(p->loops, tag->controller) : NULL;
    return by ? loops_second(p->loops, APC_TICK, by->number) : loops_second(p->loops, tag->table, tag->id);
}

int change_at(const struct plant_view *p, enum apc_table table, int id, struct change_target *to,
              struct change_fault *why)
{
    const struct apc_tag *tag = plant_tag(p, table, id), *output;
    *to = (struct change_target){.table = table, .id = id};
    if (!tag || !tag->name[0])
        return change_fail(why, APC_ENOTFOUND, "variable",
                           "%s.%d is not described, so its limits are not known", apc_table_name(table), id);
    to->loop = loops_of(p->loops, table, id);
    output = table == APC_MANUAL && to->loop ? plant_tag(p, to->loop->table, to->loop->output) : NULL;
    snprintf(to->name, sizeof to->name, "%s", output ? output->name : tag->name);
    to->low = output ? output->low : tag->low;
    to->high = output ? output->high : tag->high;
    to->step = output ? loops_step(p->loops, output->table, output->id) : loops_step(p->loops, table, id);
    to->second = second_of_tag(p, output ? output : tag);
    return 0;
}

/* Is the tag called so, by its name or as TABLE.ID? */
static bool tag_is_called(const struct apc_tag *tag, const char *name)
{
    char place[APC_TAG_LEN];
    snprintf(place, sizeof place, "%s.%d", apc_table_name(tag->table), tag->id);
    return !strcmp(tag->name, name) || !strcmp(place, name) ||
           (tag->table == APC_TUNING && former_is(name, tag->name));
}

/* TABLE.ID of a table that may be written so. */
static bool is_writable_place(const char *name, unsigned kinds, enum apc_table *table, int *id)
{
    const char *dot = strchr(name, '.');
    char of[16], *end;
    if (!dot || (size_t)(dot - name) >= sizeof of || dot[1] < '0' || dot[1] > '9')
        return false;
    snprintf(of, sizeof of, "%.*s", (int)(dot - name), name);
    const long number = strtol(dot + 1, &end, 10);
    *table = apc_table_parse(of);
    *id = (int)number;
    return !*end && number <= 1000000 &&
           ((*table == APC_SETPOINT && (kinds & CHANGE_SETPOINT)) ||
            (*table == APC_TUNING && (kinds & CHANGE_TUNING)) ||
            (*table == APC_MANUAL && (kinds & CHANGE_OUTPUT)));
}

/* The manual output of the loop that has this output; 0: no loop has it. */
static int manual_of_output(const struct plant_view *p, const struct apc_tag *output)
{
    const struct loops_loop *loop = loops_of(p->loops, output->table, output->id);
    return loop && loop->table ? loop->manual : 0;
}

static bool find_named(const struct plant_view *p, const char *name, unsigned kinds, enum apc_table *table,
                       int *id)
{
    for (size_t i = 0; i < p->n; i++) {
        const struct apc_tag *tag = &p->tag[i];
        const bool own = (tag->table == APC_SETPOINT && (kinds & CHANGE_SETPOINT)) ||
                         (tag->table == APC_TUNING && (kinds & CHANGE_TUNING)) ||
                         (tag->table == APC_MANUAL && (kinds & CHANGE_OUTPUT));
        const int manual =
            tag->table == APC_ACTUATOR && (kinds & CHANGE_OUTPUT) ? manual_of_output(p, tag) : 0;
        if ((!own && !manual) || !tag_is_called(tag, name))
            continue;
        *table = own ? tag->table : APC_MANUAL;
        *id = own ? tag->id : manual;
        return true;
    }
    return false;
}

/* What may be meant instead: one that is alike, else all. */
static void list_alike(const struct plant_view *p, const char *name, unsigned kinds, char *text, size_t size)
{
    struct nearest nearest = {.wanted = name};
    size_t used = (size_t)snprintf(text, size, "; there are: "), n = 0;
    for (size_t i = 0; i < p->n; i++) {
        const struct apc_tag *tag = &p->tag[i];
        const bool is_loop = tag->table == APC_OPMODE && tag->id > 0 && tag->id < LOOPS_IDS;
        if (!((tag->table == APC_SETPOINT && (kinds & CHANGE_SETPOINT)) ||
              (tag->table == APC_ACTUATOR && (kinds & CHANGE_OUTPUT) && manual_of_output(p, tag)) ||
              (tag->table == APC_TUNING && (kinds & CHANGE_TUNING)) || (is_loop && (kinds & CHANGE_MODE))))
            continue;
        nearest_look(&nearest, tag->name);
        if (used + strlen(tag->name) + 8 < size)
            used += (size_t)snprintf(text + used, size - used, "%s%s", n++ ? ", " : "", tag->name);
        else if (used + 6 < size && strcmp(text + used - 3, "...") != 0)
            used += (size_t)snprintf(text + used, size - used, ", ...");
    }
    for (size_t i = 0; i < p->loops->n_controllers && (kinds & CHANGE_MODE); i++)
        nearest_look(&nearest, p->loops->controller[i].name);
    if (nearest.name)
        snprintf(text, size, ": did you mean \"%.60s\"?", nearest.name);
    else if (n == 0)
        text[0] = '\0';
}

static int unknown_name(const struct plant_view *p, const char *name, unsigned kinds,
                        struct change_fault *why)
{
    char instead[90];
    /* parameters are many, and are not mistaken for what is set */
    list_alike(p, name, kinds & (CHANGE_SETPOINT | CHANGE_OUTPUT) ? kinds & ~(unsigned)CHANGE_TUNING : kinds,
               instead, sizeof instead);
    return change_fail(why, APC_ENOTFOUND, "variable",
                       kinds == CHANGE_MODE     ? "there is no loop or controller \"%.60s\"%s"
                       : kinds == CHANGE_TUNING ? "there is no parameter of a control law \"%.60s\"%s"
                                                : "there is no \"%.60s\" to be set%s",
                       name, instead);
}

int change_find(const struct plant_view *p, const char *name, unsigned kinds, struct change_target *to,
                struct change_fault *why)
{
    const struct loops_loop *loop = loops_find(p->loops, name);
    enum apc_table table;
    int id;
    if (kinds == CHANGE_MODE) {
        if (loop)
            return change_at(p, APC_OPMODE, loop->id, to, why);
        return loops_controller(p->loops, name)
                   ? change_fail(why, APC_ENOTFOUND, "variable",
                                 "%.60s is a controller: say which of its loops", name)
                   : unknown_name(p, name, kinds, why);
    }
    if (find_named(p, name, kinds, &table, &id))
        return change_at(p, table, id, to, why);
    if (loop && loop->manual && loop->table && (kinds & CHANGE_OUTPUT))
        return change_at(p, APC_MANUAL, loop->manual, to, why);
    if (is_writable_place(name, kinds, &table, &id))
        return change_at(p, table, id, to, why);
    return unknown_name(p, name, kinds, why);
}

/* ---- To what ------------------------------------------------------------------------------- */

int change_number(const char *text, double *value, struct change_fault *why)
{
    return apc_number_parse(text, value) == 0
               ? 0
               : change_fail(why, APC_EINVAL, "value", "\"%.60s\" is not a finite number", text);
}

int change_mode(const char *text, double *mode, struct change_fault *why)
{
    for (int i = APC_MODE_MAN; i <= APC_MODE_CAS; i++)
        if (!strcasecmp(text, apc_mode_name(i))) {
            *mode = i;
            return 0;
        }
    return change_fail(why, APC_EINVAL, "value",
                       "mode \"%.30s\" cannot be requested: it must be Man, Auto, Cas or OOS", text);
}

int change_reason(const char *reason, struct change_fault *why)
{
    return strlen(reason) <= CHANGE_REASON
               ? 0
               : change_fail(why, APC_EINVAL, "value", "\"reason\" must have at most %d bytes",
                             CHANGE_REASON);
}

static int fail_outside(const char *name, double low, double high, double value, struct change_fault *why)
{
    const bool has_low = low > -APC_VALUE_MAX, has_high = high < APC_VALUE_MAX;
    const bool above = value > high || value >= APC_VALUE_MAX;
    if (has_low && has_high)
        return change_fail(why, APC_ERANGE, "limits", "%.60s = %.15g lies outside its limits %.15g to %.15g",
                           name, value, low, high);
    return change_fail(why, APC_ERANGE, "limits",
                       above ? "%.60s = %.15g lies above its limit %.15g"
                             : "%.60s = %.15g lies below its limit %.15g",
                       name, value, above ? high : low);
}

int change_limits(const char *name, double low, double high, double value, struct change_fault *why)
{
    if (!isfinite(value)) {
        char text[CHANGE_TEXT];
        snprintf(text, sizeof text, "%g", value);
        return change_number(text, &value, why);
    }
    return fabs(value) < APC_VALUE_MAX && value >= low && value <= high
               ? 0
               : fail_outside(name, low, high, value, why);
}

int change_cascade(const char *loop, bool below, double mode, struct change_fault *why)
{
    return below || mode < (double)APC_MODE_CAS
               ? 0
               : change_fail(why, APC_EPERM, "value",
                             "%.60s cannot be in Cas: no controller moves its setpoint", loop);
}

int change_check(const struct change_target *to, double value, struct change_fault *why)
{
    const int rc = change_limits(to->name, to->low, to->high, value, why);
    if (rc < 0 || to->table != APC_OPMODE || to->id >= LOOPS_IDS)
        return rc;
    if (value > floor(value) || !(value <= (double)APC_MODE_CAS))
        return change_fail(why, APC_EINVAL, "value", "%g is no mode: 0 Man, 1 Auto, 2 out of service, 3 Cas",
                           value);
    return to->loop ? change_cascade(to->loop->name, to->loop->above >= 0, value, why) : 0;
}

/* ---- As things stand ----------------------------------------------------------------------- */

bool change_asks_mode(const struct change_target *to)
{
    return to->loop && (to->table == APC_MANUAL ||
                        (to->table == APC_SETPOINT && to->loop->above >= 0 && to->loop->setpoint == to->id));
}

int change_now(const struct plant_view *p, const struct change_target *to, const struct apc_sample *mode,
               struct change_fault *why)
{
    const bool man =
        mode->seq > 0 && mode->value >= (double)APC_MODE_MAN && mode->value <= (double)APC_MODE_MAN;
    char text[CHANGE_TEXT];
    if (!change_asks_mode(to))
        return 0;
    if (to->table == APC_MANUAL && !man && mode->seq == 0)
        return change_fail(
            why, APC_EPERM, "mode",
            "%.60s cannot be set while its loop has no mode: set the target mode of %.60s to Man first",
            to->name, to->loop->name);
    if (to->table == APC_MANUAL && !man)
        return change_fail(why, APC_EPERM, "mode",
                           "%.60s is controlled in mode %s: set the target mode of %.60s to Man first",
                           to->name, change_text(mode, text), to->loop->name);
    if (to->table == APC_SETPOINT && man) {
        const struct apc_tag *y = plant_tag(p, APC_SENSOR, to->loop->measurement);
        return change_fail(why, APC_EPERM, "mode", "%.50s follows %.50s while %.50s is in Man", to->name,
                           y ? y->name : "its measurement", to->loop->name);
    }
    return 0;
}

int change_stale(const char *name, const struct apc_sample *now, struct change_fault *why)
{
    char text[CHANGE_TEXT];
    return change_fail(why, APC_ECONFLICT, "stale", "%.60s was changed meanwhile: it is %s now", name,
                       change_text(now, text));
}

int change_role(const char *user, const char *role, const char *wanted, struct change_fault *why)
{
    return change_fail(why, APC_EPERM, "role", "%.40s is an %s: this takes an %s", user, role, wanted);
}
