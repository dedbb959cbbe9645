/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool is_loop(const struct apc_tag *tag)
{
    return tag->table == APC_OPMODE && tag->id > 0 && tag->id < LOOPS_IDS && tag->controller[0];
}

/* ---- Controllers --------------------------------------------------------------------------- */

/* They have numbers in the order of their loops. */
static size_t controller_of_tag(struct loops *l, const struct apc_tag *tag)
{
    struct loops_controller *last = l->n_controllers ? &l->controller[l->n_controllers - 1] : NULL;
    if (!last || strcmp(last->name, tag->controller) != 0) {
        last = &l->controller[l->n_controllers++];
        last->number = (int)l->n_controllers;
        last->first = l->n;
        snprintf(last->name, sizeof last->name, "%s", tag->controller);
    }
    last->n++;
    return l->n_controllers - 1;
}

static void find_periods(struct loops *l, const struct apc_tag *tag, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (tag[i].table == APC_TICK && tag[i].id >= 1 && (size_t)tag[i].id <= l->n_controllers)
            (void)apc_ns_from_s(tag[i].period, &l->controller[tag[i].id - 1].period);
}

/* ---- Setpoints ----------------------------------------------------------------------------- */

/* Those that have a switch. */
static void find_scheduled(struct loops *l, const struct apc_tag *tag, size_t n)
{
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < n && tag[i].table == APC_SETPOINT; k++)
            if (tag[k].table == APC_OPMODE && tag[k].id == LOOPS_OWNER(tag[i].id))
                l->scheduled[l->n_scheduled++] = tag[i].id;
}

bool loops_scheduled(const struct loops *l, int setpoint)
{
    size_t i = 0;
    while (i < l->n_scheduled && l->scheduled[i] != setpoint)
        i++;
    return i < l->n_scheduled;
}

static void find_steps(struct loops *l, const struct apc_tag *tag, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (tag[i].table == APC_DIM && tag[i].id >= LOOPS_STEP((enum apc_table)0, 0))
            l->step[l->n_steps++] = (struct loops_step){tag[i].id, tag[i].high};
}

double loops_step(const struct loops *l, enum apc_table table, int id)
{
    for (size_t i = 0; i < l->n_steps; i++)
        if (l->step[i].id == LOOPS_STEP(table, id))
            return l->step[i].most;
    return 0;
}

double loops_second(const struct loops *l, enum apc_table table, int id)
{
    for (size_t i = 0; i < l->n_steps; i++)
        if (l->step[i].id == LOOPS_SECOND(table, id))
            return l->step[i].most;
    return 0;
}

bool loops_is_owner_id(int id)
{
    return id >= LOOPS_IDS && id < 2 * LOOPS_IDS;
}

bool loops_is_owner(const struct apc_sample *row)
{
    return row->table == APC_OPMODE && loops_is_owner_id(row->id);
}

const char *loops_owner_name(bool local)
{
    return local ? "Local" : "Remote";
}

bool loops_is_local(const struct apc_sample *owner)
{
    return owner->seq > 0 && !(owner->value >= 1);
}

/* ---- Outputs ------------------------------------------------------------------------------- */

/* Is it CONTROLLER.NAME? */
static bool is_loop_name(const char *loop, const char *name)
{
    const size_t n = strlen(loop), of = strlen(name);
    return of > 0 && of < n && loop[n - of - 1] == '.' && !strcmp(loop + n - of, name);
}

static void find_output(struct loops_loop *l, const struct apc_tag *tag, size_t n)
{
    size_t longest = 0;
    for (size_t i = 0; i < n; i++) {
        const bool named = !strcmp(tag[i].name, l->name);
        if ((tag[i].table == APC_SETPOINT || tag[i].table == APC_ACTUATOR) &&
            is_loop_name(l->name, tag[i].name) && strlen(tag[i].name) > longest) {
            longest = strlen(tag[i].name);
            l->table = tag[i].table;
            l->output = tag[i].id;
        }
        if (named && (tag[i].table == APC_ACTUATOR || (tag[i].table == APC_SENSOR && !l->table))) {
            l->table = tag[i].table;
            l->output = tag[i].id;
            longest = sizeof l->name;
        }
    }
}

/* The id of LOOP.what in that table, of the only loop, of what; 0: there is none. */
static int find_of(const struct loops *l, const char *loop, enum apc_table table, const char *what,
                   const struct apc_tag *tag, size_t n)
{
    char name[APC_TAG_LEN];
    snprintf(name, sizeof name, "%.56s.%s", loop, what);
    for (size_t k = 0; k < n; k++)
        if (tag[k].table == table &&
            (!strcmp(tag[k].name, name) || (l->n == 1 && !strcmp(tag[k].name, what))))
            return tag[k].id;
    return 0;
}

static void find_own_loops(struct loops *l, const struct apc_tag *tag, size_t n)
{
    for (struct loops_loop *loop = l->at; loop < l->at + l->n; loop++) {
        loop->manual = find_of(l, loop->name, APC_MANUAL, "manual", tag, n);
        if (l->controller[loop->controller].choice)
            loop->would = find_of(l, loop->name, APC_ESTIMATE, "output", tag, n);
    }
}

/* ---- Who acts ------------------------------------------------------------------------------ */

static bool is_loop_acting(const struct loops *l, const struct loops_loop *loop)
{
    return l->controller[loop->controller].acts;
}

static void find_above(struct loops *l)
{
    for (size_t i = 0; i < l->n; i++) {
        l->at[i].above = -1;
        for (size_t k = 0; k < l->n && l->at[i].setpoint; k++)
            if (l->at[k].table == APC_SETPOINT && l->at[k].output == l->at[i].setpoint &&
                is_loop_acting(l, &l->at[k]))
                l->at[i].above = (int)k;
    }
}

/* A switch has the number of an output of theirs. Until somebody sets it the first one acts. */
static void find_choices(struct loops *l, const struct apc_tag *tag, size_t n)
{
    for (size_t i = 0; i < l->n_controllers; i++)
        l->controller[i].acts = true;
    for (size_t k = 0; k < n; k++) {
        bool any = false;
        for (size_t i = 0; i < l->n && tag[k].table == APC_OPMODE && tag[k].id >= LOOPS_IDS; i++) {
            struct loops_controller *c = &l->controller[l->at[i].controller];
            if (!l->at[i].table || LOOPS_ACTING(l->at[i].table, l->at[i].output) != tag[k].id || c->choice)
                continue;
            c->choice = tag[k].id;
            c->acts = !any;
            any = true;
        }
    }
}

bool loops_choose(struct loops *l, int id, double number)
{
    bool known = false, changed = false;
    for (size_t i = 0; i < l->n_controllers; i++)
        known = known || (l->controller[i].choice == id && l->controller[i].number == number);
    for (size_t i = 0; i < l->n_controllers && known; i++)
        if (l->controller[i].choice == id) {
            const bool acts = l->controller[i].number == number;
            changed = changed || l->controller[i].acts != acts;
            l->controller[i].acts = acts;
        }
    find_above(l);
    return changed;
}

static int read_choices(struct loops *l, struct apc_store *store)
{
    struct apc_sample *row = calloc(l->n_controllers + 1, sizeof *row);
    size_t n = 0;
    if (!row)
        return APC_ENOMEM;
    for (size_t i = 0; i < l->n_controllers; i++)
        if (l->controller[i].choice)
            row[n++] = (struct apc_sample){.table = APC_OPMODE, .id = l->controller[i].choice};
    int rc = n > 0 ? apc_store_read(store, row, n) : 0;
    for (size_t i = 0; i < n && rc >= 0; i++)
        if (row[i].seq > 0)
            (void)loops_choose(l, row[i].id, row[i].value);
    free(row);
    return rc < 0 ? rc : 0;
}

/* ---- All ----------------------------------------------------------------------------------- */

static int read_pairs(struct loops *l, struct apc_store *store)
{
    struct apc_sample *dim = calloc(2 * l->n + 1, sizeof *dim);
    if (!dim)
        return APC_ENOMEM;
    for (size_t i = 0; i < 2 * l->n; i++)
        dim[i] = (struct apc_sample){.table = APC_DIM, .id = 2 + 2 * l->at[i / 2].id + (int)(i % 2)};
    int rc = apc_store_read(store, dim, 2 * l->n);
    for (size_t i = 0; i < 2 * l->n && rc >= 0; i++) {
        const bool there = dim[i].seq > 0 && dim[i].value >= 0 && dim[i].value <= 1e6;
        int *to = i % 2 ? &l->at[i / 2].setpoint : &l->at[i / 2].measurement;
        *to = there ? (int)dim[i].value : 0;
    }
    free(dim);
    return rc < 0 ? rc : 0;
}

int loops_load(struct loops *l, struct apc_store *store, const struct apc_tag *tag, size_t n)
{
    *l = (struct loops){.at = calloc(n + 1, sizeof *l->at),
                        .controller = calloc(n + 1, sizeof *l->controller),
                        .scheduled = calloc(n + 1, sizeof *l->scheduled),
                        .step = calloc(n + 1, sizeof *l->step)};
    if (!l->at || !l->controller || !l->scheduled || !l->step)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++) { /* they stand by table and id */
        if (!is_loop(&tag[i]))
            continue;
        struct loops_loop *loop = &l->at[l->n];
        loop->id = tag[i].id;
        loop->controller = controller_of_tag(l, &tag[i]);
        snprintf(loop->name, sizeof loop->name, "%s", tag[i].name);
        find_output(loop, tag, n);
        l->n++;
    }
    find_periods(l, tag, n);
    find_scheduled(l, tag, n);
    find_steps(l, tag, n);
    int rc = l->n > 0 ? read_pairs(l, store) : 0;
    find_choices(l, tag, n);
    find_own_loops(l, tag, n);
    find_above(l);
    return rc < 0 ? rc : read_choices(l, store);
}

void loops_free(struct loops *l)
{
    free(l->at);
    free(l->controller);
    free(l->scheduled);
    free(l->step);
    *l = (struct loops){0};
}

/* ---- Looking for one ----------------------------------------------------------------------- */

/* "trial.u", or "first.u" of the one that is called "u". */
static bool is_loop_called(const struct loops *l, const struct loops_loop *loop, const char *name)
{
    const char *controller = l->controller[loop->controller].name;
    const size_t n = strlen(controller);
    return !strcmp(loop->name, name) ||
           (!strncmp(name, controller, n) && name[n] == '.' && !strcmp(name + n + 1, loop->name));
}

const struct loops_loop *loops_find(const struct loops *l, const char *name)
{
    for (size_t i = 0; i < l->n; i++) {
        const struct loops_loop *loop = &l->at[i];
        if (!is_loop_called(l, loop, name))
            continue;
        return is_loop_acting(l, loop) || loop->table == APC_SETPOINT || strchr(name, '.')
                   ? loop
                   : loops_of(l, loop->table, loop->output);
    }
    return NULL;
}

const struct loops_controller *loops_controller(const struct loops *l, const char *name)
{
    for (size_t i = 0; i < l->n_controllers; i++)
        if (!strcmp(l->controller[i].name, name))
            return &l->controller[i];
    return NULL;
}

const struct loops_controller *loops_taker(const struct loops *l, const struct apc_tag *tag)
{
    const struct loops_controller *c = tag ? loops_controller(l, tag->controller) : NULL;
    if (!c || c->acts ||
        (tag->table != APC_SETPOINT && tag->table != APC_ACTUATOR && tag->table != APC_SENSOR))
        return c;
    for (size_t i = 0; i < l->n_controllers; i++)
        if (l->controller[i].choice == c->choice && l->controller[i].acts)
            return &l->controller[i];
    return c;
}

static bool loop_has_variable(const struct loops_loop *l, enum apc_table table, int id)
{
    return (table == APC_OPMODE && l->id == id) || (table == APC_MANUAL && l->manual == id) ||
           (l->table == table && l->output == id) || (table == APC_SETPOINT && l->setpoint == id);
}

const struct loops_loop *loops_of(const struct loops *l, enum apc_table table, int id)
{
    const struct loops_loop *found = NULL;
    int best = -1;
    for (size_t i = 0; i < l->n; i++) {
        const struct loops_loop *loop = &l->at[i];
        /* a setpoint is first of all that of the loop below */
        const int rank = 2 * (table != APC_SETPOINT || loop->setpoint == id) + is_loop_acting(l, loop);
        if (!loop_has_variable(loop, table, id) || rank <= best)
            continue;
        found = loop;
        best = rank;
    }
    return found;
}

int loops_owned(const struct loops *l, const struct apc_sample *row)
{
    const struct loops_loop *loop = loops_of(l, APC_OPMODE, row->id);
    for (size_t i = 0; i < l->n_scheduled && loops_is_owner(row); i++)
        if (LOOPS_OWNER(l->scheduled[i]) == row->id)
            return l->scheduled[i];
    return loop && loop->id == row->id ? loop->setpoint : 0;
}

bool loops_is_from(const struct loops *loops, const struct loops_controller *c, const char *source)
{
    char own[sizeof((struct apc_event *)0)->source]; /* as it is cut there */
    snprintf(own, sizeof own, loops->n_controllers > 1 ? "apc-controller %.*s" : "apc-controller",
             (int)sizeof own, c->name);
    const size_t n = strlen(own); /* behind it the name of one that stands by */
    return !strncmp(source, own, n) && (source[n] == '\0' || source[n] == ' ');
}
