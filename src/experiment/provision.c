/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment.h"
#include "operate/operate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* "LEFT.RIGHT"; what is too long is cut on the left, which is the user's own word. */
static void join_names(const char *left, const char *right, char name[APC_TAG_LEN])
{
    const int room = APC_TAG_LEN - 2 - (int)strnlen(right, APC_TAG_LEN / 2);
    snprintf(name, APC_TAG_LEN, "%.*s.%.*s", room, left, APC_TAG_LEN / 2, right);
}

/* Names of what belongs to a loop: "Kp" when there is one loop, "u1.Kp" when there are more. */
static void name_of_loop(const struct experiment *e, struct controller_loop loop, const char *what,
                         char name[APC_TAG_LEN])
{
    char left[APC_TAG_LEN];
    controllers_loop_name(e, loop, left);
    if (controllers_loops(e) == 1)
        snprintf(name, APC_TAG_LEN, "%.63s", what);
    else
        join_names(left, what, name);
}

/* ---- Tags --------------------------------------------------------------------------------- */

static struct apc_tag plain_tag(enum apc_table table, int id, const char *name, const char *description,
                                double low, double high)
{
    struct apc_tag tag = {.table = table, .id = id, .low = low, .high = high};
    snprintf(tag.name, sizeof tag.name, "%s", name);
    snprintf(tag.description, sizeof tag.description, "%s", description);
    return tag;
}

/* The list of tags as it grows; all of them are of one controller, or of none. */
struct tags {
    const struct experiment *e;
    const struct controller *of;
    struct apc_tag *at;
    size_t n;
};

static struct apc_tag *add_tag(struct tags *t, struct apc_tag tag)
{
    snprintf(tag.controller, sizeof tag.controller, "%s", t->of ? t->of->name : "");
    t->at[t->n] = tag;
    return &t->at[t->n++];
}

/* Of a backup law "backup.Kp" stands for "Kp". */
static void name_tuning(const struct tags *t, const struct controller *law, struct apc_law_parameter at,
                        char name[APC_TAG_LEN])
{
    char what[APC_TAG_LEN], of[APC_TAG_LEN];
    snprintf(what, sizeof what, "%s%.48s", law == t->of ? "" : "backup.", law->param[at.number].name);
    if (at.scope == APC_OF_OUTPUT) {
        name_of_loop(t->e, (struct controller_loop){t->of, at.of}, what, name);
        return;
    }
    if (at.scope == APC_OF_MEASUREMENT)
        join_names(t->e->y[t->of->y[at.of].at].tag.name, what, of);
    else
        snprintf(of, sizeof of, "%.63s", what);
    if (t->e->n_controllers == 1)
        snprintf(name, APC_TAG_LEN, "%s", of);
    else
        join_names(t->of->name, of, name);
}

/* In the unit of a law's parameter "u" and "y" stand for that of its output, its measurement. */
static void tuning_unit(const struct tags *t, struct apc_law_parameter at, const char *of,
                        char unit[APC_TAG_LEN])
{
    const char *own = at.scope == APC_OF_MEASUREMENT ? t->e->y[t->of->y[at.of].at].tag.unit
                      : at.scope == APC_OF_OUTPUT
                          ? controllers_output(t->e, (struct controller_loop){t->of, at.of})->unit
                          : "";
    if (!*own)
        own = "1";
    if (!strcmp(of, "u") || !strcmp(of, "y"))
        snprintf(unit, APC_TAG_LEN, "%s", own);
    else if (!strcmp(of, "u/s"))
        snprintf(unit, APC_TAG_LEN, "%.61s/s", own);
    else if (!strcmp(of, "1/u"))
        snprintf(unit, APC_TAG_LEN,
                 strchr(own, '/')   ? "1/(%.59s)"
                 : strcmp(own, "1") ? "1/%.61s"
                                    : "%s",
                 own);
    else
        snprintf(unit, APC_TAG_LEN, "%s", of);
}

static void add_tuning(struct tags *t, const struct controller *law)
{
    const size_t n = apc_law_parameters(law->law, &law->dim);
    char name[APC_TAG_LEN];

    for (size_t k = 0; k < n; k++) {
        const struct apc_law_parameter at = apc_law_parameter_at(law->law, &law->dim, k);
        const struct apc_param *p = &law->param[at.number];
        name_tuning(t, law, at, name);
        struct apc_tag *tag = add_tag(t, plain_tag(APC_TUNING, law->first_tuning + (int)k, name,
                                                   p->description ? p->description : "", p->low, p->high));
        tuning_unit(t, at, p->unit ? p->unit : "", tag->unit);
    }
}

/* What is called by the loop: its target and actual mode, what an operator puts out, what it controls. */
static void add_loop(struct tags *t, struct controller_loop loop)
{
    const struct apc_tag *of = controllers_output(t->e, loop);
    const int id = t->of->first_loop + (int)loop.u;
    char name[APC_TAG_LEN];

    controllers_loop_name(t->e, loop, name);
    add_tag(t, plain_tag(APC_OPMODE, id, name, "target mode: 0 Man, 1 Auto, 2 out of service, 3 Cas", 0, 3));
    name_of_loop(t->e, loop, "mode.actual", name);
    add_tag(t, plain_tag(APC_ACTUAL, apc_variable_number(APC_OPMODE, id), name,
                         "actual mode; besides 4 initialising, 5 at the fault value", 0, 5));
    name_of_loop(t->e, loop, "manual", name);
    struct apc_tag *manual = add_tag(t, plain_tag(APC_MANUAL, controllers_loop_id(loop), name,
                                                  "operator's output in mode Man", of->low, of->high));
    memcpy(manual->unit, of->unit, sizeof manual->unit);

    snprintf(name, sizeof name, "dim.u%d.y", id);
    add_tag(t, plain_tag(APC_DIM, 2 + 2 * id, name, "measurement that the output controls", 1, 1e6));
    snprintf(name, sizeof name, "dim.u%d.z", id);
    add_tag(t, plain_tag(APC_DIM, 3 + 2 * id, name, "setpoint that it controls it to; 0: none", 0, 1e6));
}

struct publishing {
    struct tags *tags;
    int estimate, prediction; /* ids of the next ones */
};

static void add_published(void *ctx, size_t output, const struct apc_published *published)
{
    struct publishing *p = ctx;
    struct tags *t = p->tags;
    const bool trajectory = published->length > 0;
    char name[APC_TAG_LEN];
    if (!t->of->law->whole)
        name_of_loop(t->e, (struct controller_loop){t->of, output}, published->name, name);
    else if (t->e->n_controllers == 1)
        snprintf(name, sizeof name, "%.63s", published->name);
    else
        join_names(t->of->name, published->name, name);
    struct apc_tag *tag = add_tag(t, plain_tag(trajectory ? APC_PREDICTION : APC_ESTIMATE,
                                               trajectory ? p->prediction++ : p->estimate++, name,
                                               published->description ? published->description : "",
                                               -APC_VALUE_MAX, APC_VALUE_MAX));
    snprintf(tag->unit, sizeof tag->unit, "%s", published->unit ? published->unit : "");
    tag->period = apc_ns_to_s(t->of->rhythm.period);
    tag->step = published->step;
    tag->length = (int)published->length;
}

/* Of several for the same outputs: each output as this one puts it out or would, and who acts. */
static void add_outputs(struct tags *t)
{
    char name[APC_TAG_LEN];
    for (size_t k = 0; k < t->of->dim.nu; k++) {
        const struct controller_loop loop = {t->of, k};
        const struct apc_tag *of = controllers_output(t->e, loop);
        name_of_loop(t->e, loop, "output", name);
        struct apc_tag *tag =
            add_tag(t, plain_tag(APC_ESTIMATE, t->of->first_output + (int)k, name,
                                 "as it puts it out or, in shadow, would", of->low, of->high));
        memcpy(tag->unit, of->unit, sizeof tag->unit);
        tag->period = apc_ns_to_s(t->of->rhythm.period);
    }
    if (t->of->shadow)
        return;
    const int id = t->of->acting;
    join_names(controllers_output(t->e, (struct controller_loop){t->of, 0})->name, "acting", name);
    t->of = NULL; /* whoever acts */
    add_tag(t, plain_tag(APC_OPMODE, id, name, "number of the controller that acts", 1,
                         (double)t->e->n_controllers));
}

static int add_controllers(struct tags *t)
{
    int rc = 0;
    for (size_t i = 0; i < t->e->n_controllers; i++) {
        const struct controller *c = t->of = &t->e->controllers[i];
        add_tag(t, plain_tag(APC_TICK, c->number, c->name, "what its ticks were made from", 0, 0))->period =
            apc_ns_to_s(c->rhythm.period);
        add_tuning(t, c);
        if (c->backup)
            add_tuning(t, c->backup);
        for (size_t k = 0; k < c->dim.nu; k++)
            add_loop(t, (struct controller_loop){c, k});
        struct publishing publishing = {t, c->first_estimate, c->first_prediction};
        const struct apc_law_setup setup = module_law_setup(c);
        if (c->n_published > 0)
            rc = apc_law_published(c->law, &setup, add_published, &publishing, NULL);
        if (c->acting)
            add_outputs(t);
        if (rc < 0)
            return rc;
    }
    t->of = NULL;
    return 0;
}

static void add_limit(struct tags *t, int id, const char *of, const char *what, const char *description,
                      double limit)
{
    char name[APC_TAG_LEN];
    if (!(limit > 0))
        return;
    join_names(of, what, name);
    add_tag(t, plain_tag(APC_DIM, id, name, description, limit, limit));
}

static void add_second(struct tags *t, int id, const char *of, double second)
{
    add_limit(t, id, of, "second_person", "s that a write waits for a second person", second);
}

/* Those that have to be confirmed, or take a second person. */
static void add_limits(struct tags *t, const struct signal *signal, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_tag *of = &signal[i].tag;
        add_limit(t, LOOPS_STEP(of->table, of->id), of->name, "confirm",
                  "step above which a write has to be confirmed", signal[i].confirm);
        add_second(t, LOOPS_SECOND(of->table, of->id), of->name, signal[i].second);
    }
}

/* Of the setpoints that the scheduler moves: whose they are, and what they will be. */
static void add_owners(struct tags *t)
{
    char name[APC_TAG_LEN];
    for (size_t i = 0; i < t->e->scheduler.n; i++) {
        const struct apc_tag *of = &t->e->z[t->e->scheduler.z[i].at].tag;
        join_names(of->name, "owner", name);
        add_tag(t, plain_tag(APC_OPMODE, LOOPS_OWNER(of->id), name,
                             "who moves the setpoint: 0 Local, the operator; 1 Remote, the scheduler", 0, 1));
        join_names(of->name, "plan", name);
        struct apc_tag *plan = add_tag(
            t, plain_tag(APC_PLAN, of->id, name, "what it will be: pairs of seconds from then on and value",
                         -APC_VALUE_MAX, APC_VALUE_MAX));
        const size_t pairs = t->e->scheduler.steps + 1;
        plan->length = 2 * (int)(pairs < APC_PLAN_PAIRS ? pairs : APC_PLAN_PAIRS);
    }
}

static void add_alarms(struct tags *t)
{
    for (size_t i = 0; i < t->e->n_alarms; i++) {
        const struct alarm *alarm = &t->e->alarm[i];
        struct apc_tag *tag = add_tag(t, plain_tag(APC_ALARM, (int)i + 1, alarm->name, alarm->message,
                                                   APC_ALARM_NORMAL, APC_ALARM_STATES - 1));
        snprintf(tag->area, sizeof tag->area, "%s", alarm->area);
    }
    if (t->e->n_alarms == 0)
        return;
    struct apc_tag *tick = add_tag(t, plain_tag(APC_TICK, module_alarms_number(t->e), "alarms",
                                                "how many alarms are in which state", 0, 0));
    tick->period = apc_ns_to_s(t->e->alarms.rhythm.period);
    tick->length = APC_ALARMS_TICK;
}

static size_t count_tuning(const struct experiment *e)
{
    size_t n = 0;
    for (size_t i = 0; i < e->n_controllers; i++)
        n += controllers_parameters(&e->controllers[i]);
    return n;
}

static size_t count_published_tags(const struct experiment *e)
{
    size_t n = 0;
    for (size_t i = 0; i < e->n_controllers; i++)
        n += (size_t)e->controllers[i].n_published +
             (e->controllers[i].acting ? 1 + e->controllers[i].dim.nu : 0);
    return n;
}

struct apc_tag *provision_tags(const struct experiment *e, size_t *count)
{
    const struct apc_dim *dim = &e->dim;
    const size_t ny = dim->ny + e->n_signals;
    struct tags t = {.e = e,
                     .at = calloc(ny + dim->nz + dim->nu + e->n_controllers + count_tuning(e) +
                                      count_published_tags(e) + 5 * controllers_loops(e) +
                                      2 * (dim->nz + dim->nu) + e->n_controllers + 2 * e->scheduler.n +
                                      e->n_alarms + 6,
                                  sizeof *t.at)};
    if (!t.at)
        return NULL;
    for (size_t i = 0; i < ny; i++) {
        t.of = controllers_above(e, (struct wire){APC_SENSOR, i}).of;
        const apc_ns own = e->y[i].period > 0 ? e->y[i].period : e->client.rhythm.period;
        add_tag(&t, e->y[i].tag)->period = apc_ns_to_s(t.of ? t.of->rhythm.period : own);
    }
    for (size_t i = 0; i < dim->nz; i++) {
        t.of = controllers_taker(e, (struct wire){APC_SETPOINT, i});
        add_tag(&t, e->z[i].tag);
    }
    for (size_t i = 0; i < dim->nu; i++) {
        t.of = controllers_above(e, (struct wire){APC_ACTUATOR, i}).of;
        add_tag(&t, e->u[i].tag)->period = t.of ? apc_ns_to_s(t.of->rhythm.period) : 0;
    }
    if (add_controllers(&t) < 0) { /* it was made before: there is no memory */
        free(t.at);
        return NULL;
    }
    add_owners(&t);
    add_limits(&t, e->z, dim->nz);
    add_limits(&t, e->u, dim->nu);
    for (size_t i = 0; i < e->n_controllers; i++)
        add_second(&t, LOOPS_SECOND(APC_TICK, e->controllers[i].number), e->controllers[i].name,
                   e->controllers[i].second);
    add_alarms(&t);
    add_tag(&t, plain_tag(APC_DIM, 1, "dim.y", "number of measurements", 1, 1e6));
    add_tag(&t, plain_tag(APC_DIM, 2, "dim.z", "number of setpoints", 1, 1e6));
    add_tag(&t, plain_tag(APC_DIM, 3, "dim.u", "number of manipulated variables", 1, 1e6));
    add_tag(&t, plain_tag(APC_OPMODE, 0, "mode", "target mode of all loops", 0, 3));
    add_tag(&t, plain_tag(APC_STATE, 0, "experiment", e->name, 0, 0));
    *count = t.n;
    return t.at;
}

/* What a store is told of an experiment. */
struct description {
    struct apc_tag *tag;
    size_t n;
    char *own;        /* to be freed; NULL: it is the file's */
    const char *text; /* the catalogue */
};

static int make_description(struct description *d, const struct experiment *e)
{
    *d = (struct description){.tag = NULL};
    d->tag = provision_tags(e, &d->n);
    const int rc = d->tag ? model_files_embed(e, &d->own, NULL) : APC_ENOMEM;
    d->text = d->own ? d->own : e->text; /* a model file has gone since: without it */
    return rc == APC_ENOMEM ? rc : 0;
}

static void free_description(struct description *d)
{
    free(d->own);
    free(d->tag);
}

/* 0: it will refuse it, and say why. */
static int has_room_for(struct apc_store *store, const struct description *d)
{
    struct apc_store_room room = {.size = sizeof room};
    const int rc = apc_store_room(store, &room);
    return rc <= 0 ? rc + (rc == 0) : d->n <= room.tags_max && strlen(d->text) < room.catalogue_max;
}

/* ---- Whose store it is -------------------------------------------------------------------- */

static const struct apc_tag *signal_of_table(const struct experiment *e, enum apc_table table, size_t i)
{
    if (table == APC_SENSOR)
        return i < e->dim.ny + e->n_signals ? &e->y[i].tag : NULL;
    if (table == APC_SETPOINT)
        return i < e->dim.nz ? &e->z[i].tag : NULL;
    return i < e->dim.nu ? &e->u[i].tag : NULL;
}

static bool is_signal(const struct apc_tag *tag)
{
    return tag->table == APC_SENSOR || tag->table == APC_SETPOINT || tag->table == APC_ACTUATOR;
}

int provision_compare(const struct experiment *e, const struct apc_tag *tag, size_t n,
                      char why[PROVISION_TEXT])
{
    const size_t own_signals = e->dim.ny + e->n_signals + e->dim.nz + e->dim.nu;
    size_t signals = 0;
    for (size_t i = 0; i < n; i++) {
        if (!is_signal(&tag[i]))
            continue;
        signals++;
        const struct apc_tag *own = signal_of_table(e, tag[i].table, (size_t)tag[i].id - 1);
        if (own && !strcmp(own->name, tag[i].name) && !strcmp(own->unit, tag[i].unit))
            continue;
        snprintf(why, PROVISION_TEXT,
                 "it belongs to another experiment: its %s.%d is \"%s\" [%s], that of %s is \"%s\" [%s]",
                 apc_table_name(tag[i].table), tag[i].id, tag[i].name, tag[i].unit, e->name,
                 own ? own->name : "none", own ? own->unit : "");
        return APC_EPERM;
    }
    if (signals == 0 || signals == own_signals)
        return 0;
    snprintf(why, PROVISION_TEXT, "it belongs to another experiment: it has %zu signals, %s has %zu", signals,
             e->name, own_signals);
    return APC_EPERM;
}

/* The one that was described last says its name. */
static int compare_names(const struct experiment *e, const struct apc_tag *tag, size_t n,
                         char why[PROVISION_TEXT])
{
    for (size_t i = 0; i < n; i++)
        if (tag[i].table == APC_STATE && tag[i].id == 0 && strcmp(tag[i].description, e->name) != 0) {
            snprintf(why, PROVISION_TEXT, "it belongs to experiment %s, this is %s", tag[i].description,
                     e->name);
            return APC_EPERM;
        }
    return 0;
}

int provision_check(struct apc_store *store, const struct experiment *e, char why[PROVISION_TEXT])
{
    int n = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *tag = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *tag);
    if (!tag)
        return n < 0 ? n : APC_ENOMEM;
    int rc = apc_store_get_tags(store, tag, (size_t)n);
    if (rc >= 0) {
        size_t there = (size_t)(rc < n ? rc : n);
        if ((rc = compare_names(e, tag, there, why)) == 0)
            rc = provision_compare(e, tag, there, why);
    }
    free(tag);
    return rc;
}

/* ---- Writing ------------------------------------------------------------------------------ */

/* Write those of n samples that are not there yet (KEEP) or have another value (RESET). */
static int put_initial_values(struct apc_store *store, struct apc_sample *wanted, size_t n,
                              enum provision how)
{
    struct apc_sample *there = calloc(n + 1, sizeof *there);
    size_t changed = 0;
    if (!there)
        return APC_ENOMEM;
    memcpy(there, wanted, n * sizeof *there);
    int rc = apc_store_read(store, there, n);
    for (size_t i = 0; i < n && rc >= 0; i++)
        if (there[i].seq == 0 || (how == PROVISION_RESET && there[i].value != wanted[i].value))
            wanted[changed++] = wanted[i];
    if (rc >= 0 && changed > 0)
        rc = apc_store_put(store, wanted, changed);
    free(there);
    return rc < 0 ? rc : 0;
}

/*
 * Where the store says that a number of table tuning is another parameter, of another law or of another
 * version of it, what an operator wrote there is not meant for this one: it becomes the file's. @wanted is
 * [n] from id 1 on.
 */
static int put_renamed(struct apc_store *store, const struct description *d, const struct apc_sample *wanted,
                       size_t n)
{
    const int most = apc_store_get_tags(store, NULL, 0);
    const struct apc_tag *new = d->tag;
    size_t renamed = 0;
    struct apc_tag *was = calloc(most > 0 ? (size_t)most : 1, sizeof *was);
    struct apc_sample *moved = calloc(n + 1, sizeof *moved);
    int rc = most < 0 ? most : was && moved ? apc_store_get_tags(store, was, (size_t)most) : APC_ENOMEM;

    for (int i = 0; i < rc && i < most; i++)
        for (size_t k = 0; was[i].table == APC_TUNING && k < d->n; k++)
            if (new[k].table == APC_TUNING &&new[k].id == was[i].id && strcmp(new[k].name, was[i].name) != 0)
                moved[renamed++] = wanted[new[k].id - 1];
    if (rc >= 0)
        rc = put_initial_values(store, moved, renamed, PROVISION_RESET);
    free(moved);
    free(was);
    return rc;
}

static struct apc_sample *add_limit_row(struct apc_sample *next, int id, double limit)
{
    *next = (struct apc_sample){.table = APC_DIM, .id = id, .value = limit};
    return next + (limit > 0);
}

static struct apc_sample *add_limit_rows(struct apc_sample *next, const struct signal *signal, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_tag *of = &signal[i].tag;
        next = add_limit_row(next, LOOPS_STEP(of->table, of->id), signal[i].confirm);
        next = add_limit_row(next, LOOPS_SECOND(of->table, of->id), signal[i].second);
    }
    return next;
}

/* Of table dim: how many there are of each, what the laws say that each loop controls, great steps, and how long
 * a second person is waited for. */
static int put_dimensions(struct apc_store *store, const struct experiment *e, apc_ns now)
{
    const size_t loops = controllers_loops(e), n = 3 + 2 * loops;
    struct apc_sample *wanted =
                          calloc(n + 2 * (e->dim.nz + e->dim.nu) + e->n_controllers + 1, sizeof *wanted),
                      *next = wanted;
    if (!wanted)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++)
        wanted[i] = (struct apc_sample){.table = APC_DIM, .id = (int)i + 1};
    next++->value = (double)e->dim.ny;
    next++->value = (double)e->dim.nz;
    next++->value = (double)e->dim.nu;
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        for (size_t k = 0; k < c->dim.nu; k++) { /* the law knows its own, from 1 */
            const size_t y = c->pair[k].measurement, z = c->pair[k].setpoint;
            next++->value = y ? (double)c->y[y - 1].at + 1 : 0;
            next++->value = z ? (double)c->z[z - 1].at + 1 : 0;
        }
    }
    next = add_limit_rows(add_limit_rows(next, e->z, e->dim.nz), e->u, e->dim.nu);
    for (size_t i = 0; i < e->n_controllers; i++)
        next =
            add_limit_row(next, LOOPS_SECOND(APC_TICK, e->controllers[i].number), e->controllers[i].second);
    for (struct apc_sample *row = wanted; row < next; row++)
        row->time = now;
    const int rc = put_initial_values(store, wanted, (size_t)(next - wanted), PROVISION_RESET);
    free(wanted);
    return rc;
}

/* What operators set in a former run is no output of this one, whatever the clock said then: nothing is
 * deleted, but the newest rows are no good any more. */
static int forget_manual(struct apc_store *store, const struct experiment *e, apc_ns now)
{
    const size_t loops = controllers_loops(e);
    struct apc_sample *rows = calloc(loops, sizeof *rows);
    size_t n = 0;
    if (!rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < loops; i++)
        rows[i] = (struct apc_sample){.table = APC_MANUAL, .id = (int)i + 1};
    int rc = apc_store_read(store, rows, loops);
    for (size_t i = 0; i < loops && rc >= 0; i++)
        if (rows[i].seq > 0 && apc_status_severity(rows[i].status) != APC_SEVERITY_BAD)
            rows[n++] = (struct apc_sample){
                .table = APC_MANUAL, .id = rows[i].id, .time = now, .status = APC_BAD_NO_DATA};
    if (rc >= 0 && n > 0)
        rc = apc_store_put(store, rows, n);
    free(rows);
    return rc < 0 ? rc : 0;
}

/* What is in force of setpoints before anybody moves them. */
static int put_setpoints(struct apc_store *store, const struct experiment *e, apc_ns now, enum provision how)
{
    struct apc_sample *wanted = calloc(e->dim.nz + 1, sizeof *wanted);
    size_t n = 0;
    if (!wanted)
        return APC_ENOMEM;
    for (size_t i = 0; i < e->dim.nz; i++)
        if (!isnan(e->z[i].initial))
            wanted[n++] = (struct apc_sample){
                .table = APC_SETPOINT, .id = (int)i + 1, .time = now, .value = e->z[i].initial};
    const int rc = put_initial_values(store, wanted, n, how);
    free(wanted);
    return rc;
}

static double initial_mode_of(const struct experiment *e, struct controller_loop loop)
{
    const bool cascade = loop.of->mode != APC_MODE_CAS || controllers_is_below(e, loop);
    return cascade ? loop.of->mode : APC_MODE_AUTO;
}

/*
 * The target of each loop, and under id 0, for who asks for one mode only, that of the first. What is put
 * there is put to every loop that the same put does not name: so they are named.
 */
static int put_modes(struct apc_store *store, const struct experiment *e, apc_ns now, enum provision how)
{
    const size_t n = 1 + controllers_loops(e);
    struct apc_sample *there = calloc(n, sizeof *there), *wanted = calloc(n, sizeof *wanted);
    size_t changed = 0;
    int rc = there && wanted ? 0 : APC_ENOMEM;

    for (size_t i = 0; i < n && rc == 0; i++) {
        there[i] = wanted[i] = (struct apc_sample){.table = APC_OPMODE, .id = (int)i, .time = now};
        wanted[i].value = initial_mode_of(e, controllers_loop(e, i > 0 ? i - 1 : 0));
    }
    if (rc == 0)
        rc = apc_store_read(store, there, n);
    for (size_t i = 0; i < n && rc == 0; i++) {
        const bool is_there = there[i].seq > 0;
        if (is_there && how == PROVISION_KEEP)
            wanted[i].value = there[i].value;
        if (!is_there || there[i].value != wanted[i].value || (changed > 0 && wanted[0].id == 0))
            wanted[changed++] = wanted[i];
    }
    if (rc == 0 && changed > 0)
        rc = apc_store_put(store, wanted, changed);
    free(wanted);
    free(there);
    return rc < 0 ? rc : 0;
}

/* Who acts. */
static int put_choices(struct apc_store *store, const struct experiment *e, apc_ns now, enum provision how)
{
    struct apc_sample *wanted = calloc(e->n_controllers, sizeof *wanted);
    size_t n = 0;
    if (!wanted)
        return APC_ENOMEM;
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        if (c->acting && !c->shadow)
            wanted[n++] =
                (struct apc_sample){.table = APC_OPMODE, .id = c->acting, .time = now, .value = c->number};
    }
    const int rc = put_initial_values(store, wanted, n, how);
    free(wanted);
    return rc;
}

/* Whose the setpoints are. */
static int put_owners(struct apc_store *store, const struct experiment *e, apc_ns now, enum provision how)
{
    struct apc_sample *wanted = calloc(e->scheduler.n + 1, sizeof *wanted);
    if (!wanted)
        return APC_ENOMEM;
    for (size_t i = 0; i < e->scheduler.n; i++)
        wanted[i] = (struct apc_sample){
            .table = APC_OPMODE, .id = LOOPS_OWNER((int)e->scheduler.z[i].at + 1), .time = now, .value = 1};
    const int rc = put_initial_values(store, wanted, e->scheduler.n, how);
    free(wanted);
    return rc;
}

static bool has_alarm(const struct apc_tag *tag, size_t n, int id, const char *name)
{
    for (size_t i = 0; i < n; i++)
        if (tag[i].table == APC_ALARM && tag[i].id == id)
            return strcmp(tag[i].name, name) == 0;
    return false;
}

#define ALARM_ROWS 3 /* its state, and the two switches that keep it from being announced */

/*
 * Where the store does not say that alarm i is the file's, what stood of another one under that number, and
 * who kept that one quiet, is nothing of this one: @rows is [ALARM_ROWS * n_alarms] as the store has them,
 * and becomes what is to be appended. Returns how many that is.
 */
static size_t renew(const struct experiment *e, const struct apc_tag *was, size_t n_was, int64_t journal,
                    apc_ns now, struct apc_sample *rows)
{
    size_t n = 0;
    for (size_t i = 0; i < ALARM_ROWS * e->n_alarms; i++) {
        struct apc_sample row = rows[i];
        const bool state = row.table == APC_ALARM;
        const double wanted = state ? APC_ALARM_NORMAL : 0;
        if (row.seq == 0 || row.value == wanted ||
            has_alarm(was, n_was, (int)(i / ALARM_ROWS) + 1, e->alarm[i / ALARM_ROWS].name))
            continue;
        row = (struct apc_sample){
            .table = row.table, .id = row.id, .seq = APC_SEQ_ANY, .time = now, .value = wanted};
        if (state) {
            row.seq = rows[i].seq + 1;
            row.origin = ++journal;
        }
        rows[n++] = row;
    }
    return n;
}

static int renew_alarms(struct apc_store *store, const struct experiment *e, apc_ns now)
{
    const size_t own = ALARM_ROWS * e->n_alarms;
    const int most = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *was = calloc(most > 0 ? (size_t)most : 1, sizeof *was);
    struct apc_sample *rows = calloc(own + (most > 0 ? (size_t)most : 0) + 1, sizeof *rows);
    size_t n = own;
    int64_t journal = 0;
    int rc = most < 0 ? most : was && rows ? apc_store_get_tags(store, was, (size_t)most) : APC_ENOMEM;
    const size_t n_was = rc < 0 ? 0 : (size_t)(rc < most ? rc : most);

    for (size_t i = 0; i < e->n_alarms && rc >= 0; i++) {
        struct apc_sample *of = rows + ALARM_ROWS * i;
        const int id = (int)i + 1;
        of[0] = (struct apc_sample){.table = APC_ALARM, .id = id};
        of[1] = (struct apc_sample){.table = APC_OPMODE, .id = apc_alarm_switch_id(APC_ALARM_SHELF, id)};
        of[2] = (struct apc_sample){.table = APC_OPMODE, .id = apc_alarm_switch_id(APC_ALARM_SERVICE, id)};
    }
    for (size_t i = 0; i < n_was; i++) /* the journal goes on from all that there were */
        if (was[i].table == APC_ALARM)
            rows[n++] = (struct apc_sample){.table = APC_ALARM, .id = was[i].id};
    if (rc >= 0 && own > 0)
        rc = apc_store_read(store, rows, n);
    for (size_t i = 0; i < n && rc >= 0; i++)
        if (rows[i].table == APC_ALARM && rows[i].origin > journal)
            journal = rows[i].origin;
    if (rc >= 0 && (n = renew(e, was, n_was, journal, now, rows)) > 0)
        rc = apc_store_append_rows(
            store, &(struct apc_rows){.size = sizeof(struct apc_rows), .sample = rows, .n_samples = n});
    free(rows);
    free(was);
    return rc < 0 ? rc : 0;
}

static int put_experiment_rows(struct apc_store *store, const struct experiment *e,
                               const struct description *d, enum provision how)
{
    const size_t n = count_tuning(e);
    const apc_ns now = apc_clock_utc(NULL);
    struct apc_sample *wanted = calloc(n + 1, sizeof *wanted), *next = wanted;
    int rc = wanted ? put_dimensions(store, e, now) : APC_ENOMEM;

    for (size_t i = 0; i < e->n_controllers && rc >= 0; i++)
        for (const struct controller *law = &e->controllers[i]; law; law = law->backup)
            for (size_t k = 0; k < apc_law_parameters(law->law, &law->dim); k++, next++)
                *next = (struct apc_sample){.table = APC_TUNING,
                                            .id = (int)(next - wanted) + 1,
                                            .time = now,
                                            .value = law->tuning[k]};
    if (rc >= 0 && how == PROVISION_KEEP)
        rc = put_renamed(store, d, wanted, n);
    if (rc >= 0)
        rc = put_initial_values(store, wanted, n, how);
    if (rc >= 0)
        rc = put_setpoints(store, e, now, how);
    if (rc >= 0)
        rc = put_modes(store, e, now, how);
    if (rc >= 0)
        rc = put_choices(store, e, now, how);
    if (rc >= 0)
        rc = put_owners(store, e, now, how);
    if (rc >= 0 && how == PROVISION_RESET)
        rc = forget_manual(store, e, now);
    if (rc >= 0)
        rc = renew_alarms(store, e, now);
    free(wanted);
    return rc;
}

int provision(struct apc_store *store, const struct experiment *e, enum provision how)
{
    struct description d;
    int rc = make_description(&d, e);
    if (rc == 0 && (rc = has_room_for(store, &d)) > 0)
        rc = put_experiment_rows(store, e, &d, how);
    if (rc >= 0)
        rc = apc_store_describe(store, d.tag, d.n, d.text);
    free_description(&d);
    return rc < 0 ? rc : 0;
}
