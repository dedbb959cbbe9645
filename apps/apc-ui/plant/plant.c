/* SPDX-License-Identifier: BSD-3-Clause */
#include "plant.h"

#include <stdlib.h>
#include <string.h>

/* ---- Refs --------------------------------------------------------------------------------- */

char *ref_format(enum apc_table table, int id, char ref[REF_LEN])
{
    snprintf(ref, REF_LEN, "%s.%d", apc_table_name(table), id);
    return ref;
}

bool ref_parse(const char *ref, enum apc_table *table, int *id)
{
    char name[16], *end;
    const char *dot = strchr(ref, '.');
    if (!dot || dot - ref >= (ptrdiff_t)sizeof name || dot[1] < '0' || dot[1] > '9' || strlen(dot) > 11 ||
        (dot[1] == '0' && dot[2])) /* one variable, one ref */
        return false;
    snprintf(name, sizeof name, "%.*s", (int)(dot - ref), ref);
    long long number = strtoll(dot + 1, &end, 10);
    *table = apc_table_parse(name);
    *id = (int)number;
    return *table != 0 && *end == '\0' && number <= INT32_MAX;
}

/* ---- Taking over -------------------------------------------------------------------------- */

/* The mode of all loops is nobody's; whose a setpoint is, is the scheduler's matter, and who acts, no controller's. */
static bool is_variable_shown(const struct apc_tag *tag)
{
    return tag->table == APC_OPMODE
               ? tag->controller[0] != '\0' || loops_is_owner_id(tag->id) || tag->id / LOOPS_IDS == 2
               : (tag->table < APC_STATE && tag->table != APC_DIM) || tag->table == APC_ACTUAL ||
                     tag->table == APC_ESTIMATE;
}

static bool same_tag(const struct apc_tag *a, const struct apc_tag *b)
{
    return a->table == b->table && a->id == b->id && !strcmp(a->name, b->name) && !strcmp(a->unit, b->unit) &&
           !strcmp(a->description, b->description) && !strcmp(a->controller, b->controller) &&
           !(a->period < b->period || a->period > b->period) && !(a->low < b->low || a->low > b->low) &&
           !(a->high < b->high || a->high > b->high);
}

static bool same_loop(const struct loops_loop *a, const struct loops_loop *b)
{
    return a->measurement == b->measurement && a->setpoint == b->setpoint;
}

static bool same_controller(const struct loops_controller *a, const struct loops_controller *b)
{
    return !strcmp(a->name, b->name) && a->number == b->number && a->period == b->period;
}

static bool differs(const struct plant *p, const struct plant *next)
{
    const struct loops *was = &p->loops, *is = &next->loops;
    bool found =
        next->n != p->n || is->n != was->n || is->n_controllers != was->n_controllers || p->revision == 0;
    for (size_t i = 0; i < next->n && !found; i++)
        found = !same_tag(&next->tag[i], &p->tag[i]);
    for (size_t i = 0; i < is->n && !found; i++)
        found = !same_loop(&is->at[i], &was->at[i]);
    for (size_t i = 0; i < is->n_controllers && !found; i++)
        found = !same_controller(&is->controller[i], &was->controller[i]);
    found = found || is->n_steps != was->n_steps;
    for (size_t i = 0; i < is->n_steps && !found; i++)
        found = is->step[i].id != was->step[i].id || is->step[i].most != was->step[i].most;
    return found;
}

void plant_forget(struct plant *p)
{
    free(p->tag);
    loops_free(&p->loops);
    p->tag = NULL;
    p->n = 0;
}

static int by_table(const void *a, const void *b)
{
    const struct apc_tag *x = a, *y = b;
    return x->table != y->table ? (x->table > y->table) - (x->table < y->table)
                                : (x->id > y->id) - (x->id < y->id);
}

bool plant_describe(struct plant *p, const struct apc_tag *tags, size_t n, struct loops *loops)
{
    struct plant next = *p;
    next.tag = calloc(n + 1, sizeof *next.tag);
    next.n = 0;
    next.loops = *loops;
    *loops = (struct loops){0};
    for (size_t i = 0; i < n && next.tag; i++)
        if (is_variable_shown(&tags[i]))
            next.tag[next.n++] = tags[i];
    if (next.tag)
        qsort(next.tag, next.n, sizeof *next.tag, by_table);
    if (!next.tag || !differs(p, &next)) {
        plant_forget(&next);
        return false;
    }
    plant_forget(p);
    *p = next;
    p->revision++;
    return true;
}

bool plant_rhythm(struct plant *p, const char *task, apc_ns period)
{
    size_t i = 0;
    while (i < p->rhythms && strcmp(p->rhythm[i].task, task) != 0)
        i++;
    if (i == p->rhythms) {
        struct rhythm_of *more = realloc(p->rhythm, (i + 1) * sizeof *more);
        if (!more)
            return false;
        p->rhythm = more;
        p->rhythm[p->rhythms++] = (struct rhythm_of){0};
        snprintf(p->rhythm[i].task, sizeof p->rhythm->task, "%s", task);
    }
    if (p->rhythm[i].period == period)
        return false;
    p->rhythm[i].period = period;
    p->revision++;
    return true;
}

void plant_free(struct plant *p)
{
    plant_forget(p);
    free(p->rhythm);
    p->rhythm = NULL;
    p->rhythms = 0;
}

/* ---- Questions ---------------------------------------------------------------------------- */

int find_plant_tag(const struct plant *p, enum apc_table table, int id)
{
    size_t low = 0, high = p->n;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        const struct apc_tag *tag = &p->tag[middle];
        if (tag->table == table && tag->id == id)
            return (int)middle;
        if (tag->table < table || (tag->table == table && tag->id < id))
            low = middle + 1;
        else
            high = middle;
    }
    return -1;
}

int plant_controller(const struct plant *p, enum apc_table table, int id)
{
    const int at = find_plant_tag(p, table, id);
    const struct loops_controller *c = at < 0 ? NULL : loops_taker(&p->loops, &p->tag[at]);
    return c ? (int)(c - p->loops.controller) : -1;
}

bool table_wanted(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_OPMODE || table == APC_TUNING || table == APC_MANUAL;
}

static apc_ns rhythm(const struct plant *p, const char *task)
{
    for (size_t i = 0; i < p->rhythms; i++)
        if (!strcmp(p->rhythm[i].task, task))
            return p->rhythm[i].period;
    return 0;
}

apc_ns plant_tick_time(const struct plant *p, size_t controller)
{
    const apc_ns said = rhythm(p, p->loops.controller[controller].name);
    return said > 0 ? said : p->loops.controller[controller].period;
}

static apc_ns described_period(double period)
{
    apc_ns ns;
    return apc_period_from_s(period, &ns, NULL) < 0 ? 0 : ns;
}

apc_ns plant_period(const struct plant *p, enum apc_table table, int id)
{
    const int controller = plant_controller(p, table, id), at = find_plant_tag(p, table, id);
    const apc_ns client = rhythm(p, "client"), plant = rhythm(p, "plant"),
                 said = client > plant ? client : plant;
    if (at < 0 || (table != APC_SENSOR && table != APC_ACTUATOR && table != APC_ESTIMATE))
        return 0;
    if (controller >= 0)
        return plant_tick_time(p, (size_t)controller);
    const apc_ns own = described_period(p->tag[at].period); /* a measurement may come seldom */
    return table == APC_SENSOR && said > own ? said : own;
}

bool loop_may(const struct loops_loop *loop, enum apc_mode mode)
{
    return mode == APC_MODE_MAN || mode == APC_MODE_AUTO || mode == APC_MODE_OOS ||
           (mode == APC_MODE_CAS && loop->above >= 0);
}

/* ---- For the page ------------------------------------------------------------------------- */

static void plant_variable_json(const struct plant *p, const struct apc_tag *tag, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{ref:%s, table:%s, id:%d, name:%s, unit:%s, description:%s, low:%e, high:%e, area:%s",
             ref_format(tag->table, tag->id, ref), apc_table_name(tag->table), tag->id, tag->name, tag->unit,
             tag->description, tag->low, tag->high, tag->area);
    if (tag->display_low < tag->display_high)
        json_add(t, "display:[%g, %g]", tag->display_low, tag->display_high);
    else
        json_add(t, "display:null");
    json_add(t, "period:%.9jd}", json_some(plant_period(p, tag->table, tag->id)));
}

static void controller_json(const struct plant *p, size_t i, struct text *t)
{
    json_add(t, "{number:%d, name:%s, period:%.9jd}", p->loops.controller[i].number,
             p->loops.controller[i].name, json_some(plant_tick_time(p, i)));
}

/* What stands behind NAME and a dot; NULL: it does not begin so. */
static const char *name_tail(const char *text, const char *name)
{
    const size_t n = strlen(name);
    return n > 0 && !strncmp(text, name, n) && text[n] == '.' ? text + n + 1 : NULL;
}

static const char *without_controller(const struct plant *p, const struct loops_loop *loop, const char *name)
{
    const char *rest = name_tail(name, p->loops.controller[loop->controller].name);
    return rest ? rest : name;
}

static void partner_json(struct text *t, const char *member, enum apc_table table, int id)
{
    char ref[REF_LEN];
    json_add(t, "%s:%-s", member, id > 0 ? ref_format(table, id, ref) : "");
}

static const char *measurement_of(const struct plant *p, const struct loops_loop *loop)
{
    const int at = find_plant_tag(p, APC_SENSOR, loop->measurement);
    return at < 0 ? "" : p->tag[at].name;
}

/* Whose a parameter is, by its name. */
struct whose {
    const struct loops_controller *controller; /* NULL: it is no parameter */
    bool of_loop;                              /* of one of the controller's */
    int measurement, other; /* the measurements of its loops that it may be of; 0: none, no second one */
};

static struct whose whose_is(const struct plant *p, const struct apc_tag *tag)
{
    struct whose w = {.controller = tag->table == APC_TUNING ? loops_taker(&p->loops, tag) : NULL};
    for (size_t i = 0; i < p->loops.n && w.controller; i++) {
        const struct loops_loop *loop = &p->loops.at[i];
        if (&p->loops.controller[loop->controller] != w.controller)
            continue;
        w.of_loop = w.of_loop || name_tail(tag->name, loop->name);
        if (name_tail(without_controller(p, loop, tag->name), measurement_of(p, loop)))
            *(w.measurement && w.measurement != loop->measurement ? &w.other : &w.measurement) =
                loop->measurement;
    }
    return w;
}

/* What a parameter is called in a loop, "Kp" of "u1.Kp"; NULL: it is not the loop's. What is of the law or of
 * a measurement that no loop has, is that of each loop of the controller. */
static const char *parameter_name(const struct plant *p, const struct loops_loop *loop,
                                  const struct apc_tag *tag, const struct whose *w)
{
    if (w->controller != &p->loops.controller[loop->controller])
        return NULL;
    const char *own = name_tail(tag->name, loop->name);
    const bool of_others = w->of_loop || w->other || (w->measurement && w->measurement != loop->measurement);
    return own ? own : of_others ? NULL : without_controller(p, loop, tag->name);
}

static void tunings_json(const struct plant *p, const struct loops_loop *loop, const struct whose *whose,
                         struct text *t)
{
    struct text names = {0};
    char ref[REF_LEN];
    json_add(t, "tuning:[");
    for (size_t i = 0; i < p->n; i++) {
        const char *name = parameter_name(p, loop, &p->tag[i], &whose[i]);
        if (!name)
            continue;
        json_add(t, "%s", ref_format(APC_TUNING, p->tag[i].id, ref));
        json_add(&names, "%s", name);
    }
    json_add(t, "], parameters:[%.*s]", (int)names.n, names.at);
    text_free(&names);
}

/* A loop is called as what it controls; a second one of the same measurement, as its modes. */
static const char *plant_loop_name(const struct plant *p, const struct loops_loop *loop)
{
    const char *name = measurement_of(p, loop);
    for (const struct loops_loop *one = p->loops.at; one < loop; one++)
        if (one->measurement == loop->measurement)
            name = "";
    return name[0] ? name : loop->name;
}

static void mode_json(const struct loops_loop *loop, struct text *t)
{
    char target[REF_LEN], actual[REF_LEN];
    static const enum apc_mode modes[] = {APC_MODE_OOS, APC_MODE_MAN, APC_MODE_AUTO, APC_MODE_CAS};
    json_add(t, "mode:{target:%s, actual:%s, targets:[", ref_format(APC_OPMODE, loop->id, target),
             ref_format(APC_ACTUAL, apc_variable_number(APC_OPMODE, loop->id), actual));
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i++)
        if (loop_may(loop, modes[i]))
            json_add(t, "%s", apc_mode_name((int)modes[i]));
    json_add(t, "]}");
}

static void plant_loop_json(const struct plant *p, const struct loops_loop *loop, const struct whose *whose,
                            struct text *t)
{
    json_add(t, "{id:%d, name:%s, called:%s, controller:%s", loop->id, plant_loop_name(p, loop), loop->name,
             p->loops.controller[loop->controller].name);
    partner_json(t, "measurement", APC_SENSOR, loop->measurement);
    partner_json(t, "setpoint", APC_SETPOINT, loop->setpoint);
    partner_json(t, "output", loop->table, loop->output);
    partner_json(t, "manual", APC_MANUAL, loop->manual);
    partner_json(t, "would", APC_ESTIMATE, loop->would);
    partner_json(t, "owner", APC_OPMODE,
                 loops_scheduled(&p->loops, loop->setpoint) ? LOOPS_OWNER(loop->setpoint) : 0);
    json_add(t, "above:%jd", loop->above >= 0 ? p->loops.at[loop->above].id : JSON_NONE);
    mode_json(loop, t);
    tunings_json(p, loop, whose, t);
    json_add(t, "}");
}

void plant_members(const struct plant *p, struct text *t)
{
    json_add(t, "name:%s, title:%s, version:%s, revision:%u, start:%.6jd, variables:[", p->name, p->title,
             apc_version(), p->revision, p->start ? p->start : JSON_NONE);
    for (size_t i = 0; i < p->n; i++)
        plant_variable_json(p, &p->tag[i], t);
    json_add(t, "], controllers:[");
    for (size_t i = 0; i < p->loops.n_controllers; i++)
        controller_json(p, i, t);
    json_add(t, "], loops:[");
    struct whose *whose = calloc(p->n + 1, sizeof *whose);
    t->failed = t->failed || !whose;
    for (size_t i = 0; i < p->n && whose; i++)
        whose[i] = whose_is(p, &p->tag[i]);
    for (size_t i = 0; i < p->loops.n && whose; i++)
        plant_loop_json(p, &p->loops.at[i], whose, t);
    free(whose);
    json_add(t, "], modes:[");
    for (int mode = APC_MODE_MAN; mode <= APC_MODE_LO; mode++)
        json_add(t, "%s", apc_mode_name(mode));
    json_add(t, "]");
}
