/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A simulation goes on as another experiment. What can change while a plant runs may be another: laws,
 * tuning, setpoints, what acts on the plant from without, what its sensors do, its parameters. What it is
 * made of, and when its tasks tick, stays.
 */
#include "simulation_internal.h"

#include <fnmatch.h>
#include <libconfig.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "files/settings.h"
#include "modules/controller.h"

/* ---- What differs --------------------------------------------------------------------------- */

static const char *const changeable[] = {"title",
                                         "duration",
                                         "seed",
                                         "actions",
                                         "plant.parameters",
                                         "plant.noise",
                                         "plant.disturbances",
                                         "plant.faults",
                                         "scheduler.sequence",
                                         "scheduler.repeat",
                                         "measurements.*.noise",
                                         "measurements.*.quantum",
                                         "measurements.*.faults",
                                         "outputs.*.faults",
                                         "setpoints.*.initial",
                                         NULL};

/* Of a controller all but these. */
static const char *const fixed[] = {"name",    "period",       "phase",     "execution", "jitter",
                                    "overrun", "measurements", "setpoints", "outputs",   "disturbances",
                                    "shadow",  "alarms",       NULL};

static bool is_branch_name(const char *const *names, const char *name)
{
    while (*names && fnmatch(*names, name, 0) != 0)
        names++;
    return *names;
}

static bool may_branch_change(const char *path)
{
    unsigned place;
    int end = 0;
    if (!strncmp(path, "controller.", strlen("controller.")))
        return !is_branch_name(fixed, path + strlen("controller."));
    if (sscanf(path, "controllers.[%5u].%n", &place, &end) == 1 && end > 0)
        return !is_branch_name(fixed, path + end);
    return is_branch_name(changeable, path);
}

/* The first setting in which two differ that @p skip does not name, by its path behind @p path. */
struct difference {
    bool (*skip)(const char *path);
    char path[200];
};

static double number_of_member(const config_setting_t *at)
{
    const int type = config_setting_type(at);
    return type == CONFIG_TYPE_FLOAT  ? config_setting_get_float(at)
           : type == CONFIG_TYPE_BOOL ? config_setting_get_bool(at)
                                      : (double)config_setting_get_int64(at);
}

static bool same_scalar(const config_setting_t *a, const config_setting_t *b)
{
    const char *text[2] = {config_setting_get_string(a), config_setting_get_string(b)};
    if (text[0] || text[1])
        return text[0] && text[1] && !strcmp(text[0], text[1]);
    return number_of_member(a) >= number_of_member(b) && number_of_member(a) <= number_of_member(b);
}

static bool settings_differ(struct difference *d, const config_setting_t *a, const config_setting_t *b);

/* @p name: of a member, or "[INDEX]". */
static bool differ_in(struct difference *d, const char *name, const config_setting_t *a,
                      const config_setting_t *b)
{
    const size_t n = strlen(d->path);
    snprintf(d->path + n, sizeof d->path - n, "%s%s", n ? "." : "", name);
    const bool other = !d->skip(d->path) && (!a || !b || settings_differ(d, a, b));
    if (!other)
        d->path[n] = '\0';
    return other;
}

static bool members_differ(struct difference *d, const config_setting_t *a, const config_setting_t *b)
{
    for (int i = 0; i < config_setting_length(a); i++) {
        const config_setting_t *member = config_setting_get_elem(a, (unsigned)i);
        const char *name = config_setting_name(member);
        if (differ_in(d, name, member, config_setting_get_member(b, name)))
            return true;
    }
    for (int i = 0; i < config_setting_length(b); i++) {
        const config_setting_t *member = config_setting_get_elem(b, (unsigned)i);
        const char *name = config_setting_name(member);
        if (!config_setting_get_member(a, name) && differ_in(d, name, NULL, member))
            return true;
    }
    return false;
}

/* The innermost is left in d->path. */
static bool settings_differ(struct difference *d, const config_setting_t *a, const config_setting_t *b)
{
    char place[16];
    if (config_setting_is_group(a) && config_setting_is_group(b))
        return members_differ(d, a, b);
    if (!config_setting_is_aggregate(a) || !config_setting_is_aggregate(b))
        return config_setting_is_aggregate(a) || config_setting_is_aggregate(b) || !same_scalar(a, b);
    if (config_setting_is_group(a) || config_setting_is_group(b) ||
        config_setting_length(a) != config_setting_length(b))
        return true;
    for (int i = 0; i < config_setting_length(a); i++) {
        snprintf(place, sizeof place, "[%d]", i);
        if (differ_in(d, place, config_setting_get_elem(a, (unsigned)i),
                      config_setting_get_elem(b, (unsigned)i)))
            return true;
    }
    return false;
}

/* The two texts, open. */
struct texts {
    config_t was, is;
};

static int compare_experiments(struct texts *t, const struct experiment *was, const struct experiment *is,
                               struct apc_error *why)
{
    struct difference d = {.skip = may_branch_change};
    int rc = settings_parse(&t->was, was->file, was->text, why);
    const int other = settings_parse(&t->is, is->file, is->text, rc == 0 ? why : NULL);
    rc = rc < 0 ? rc : other;
    if (rc == 0 && settings_differ(&d, config_root_setting(&t->was), config_root_setting(&t->is)))
        rc =
            apc_fail(why, APC_EINVAL,
                     "%s is another than in the run: in the middle of a run laws, tuning, settings, modes, "
                     "setpoints, parameters and disturbances of the plant, noise of measurements, faults and "
                     "actions may change, nothing else",
                     d.path);
    if (rc == 0 && was->plant.model != is->plant.model &&
        strcmp(was->plant.model->name, is->plant.model->name) != 0)
        rc =
            apc_fail(why, APC_EINVAL, "the plant is %s, and was %s: in the middle of a run it stays the same",
                     is->plant.model->name, was->plant.model->name);
    return rc;
}

static const config_setting_t *controller_in(const config_t *config, size_t i)
{
    const config_setting_t *list = config_lookup(config, "controllers");
    return list ? config_setting_get_elem(list, (unsigned)i) : config_lookup(config, "controller");
}

/* What is in the store, and taken up from there, makes no other controller. */
static bool is_stored(const char *path)
{
    return !strncmp(path, "tuning", strlen("tuning")) || !strcmp(path, "mode");
}

static bool are_same_numbers(const double *a, const double *b, size_t n)
{
    size_t i = 0;
    while (i < n && a[i] >= b[i] && a[i] <= b[i])
        i++;
    return i == n;
}

/* ---- Taking it up --------------------------------------------------------------------------- */

static int change_plant(struct simulation *s, const struct experiment *was, struct apc_error *why)
{
    const struct experiment *e = s->e;
    const size_t np = e->plant.model->np;
    const struct apc_plantserver_options world = {.size = sizeof world,
                                                  .model = e->plant.model,
                                                  .noise = e->plant.noise,
                                                  .disturbance = e->plant.disturbance,
                                                  .n_disturbances = e->plant.n_disturbances,
                                                  .sensor = e->sensor,
                                                  .actuator = e->actuator};
    double *p = calloc(2 * np + 1, sizeof *p);
    int rc = p ? experiment_draw(was, s->seed, p, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = experiment_draw(e, s->seed, p + np, why);
    if (rc == 0 && !are_same_numbers(p, p + np, np))
        rc = apc_plant_change(s->plant, p + np, why);
    free(p);
    return rc < 0 ? rc : apc_plantserver_change(s->server, &world, why);
}

static bool same_sequence(const struct experiment *a, const struct experiment *b)
{
    const size_t n = a->scheduler.steps * a->scheduler.n;
    return a->scheduler.steps == b->scheduler.steps && a->scheduler.n == b->scheduler.n &&
           a->scheduler.repeat == b->scheduler.repeat &&
           are_same_numbers(a->scheduler.sequence, b->scheduler.sequence, n);
}

/* Where the sequence is another one, so is the step at hand. */
static int change_scheduler(struct simulation *s, const struct experiment *was, bool recorded,
                            struct apc_error *why)
{
    const bool same = same_sequence(was, s->e);
    if (s->e->scheduler.steps == 0 || (same && !recorded))
        return 0;
    apc_scheduler_destroy(s->scheduler);
    int rc = module_scheduler(s->e, &s->scheduler, why);
    if (rc == 0 && (rc = apc_store_read_rows(s->store, apc_scheduler_in(s->scheduler))) < 0)
        return apc_fail(why, rc, "%s", apc_store_error(s->store));
    if (rc == 0 && same && s->schedules)
        apc_scheduler_resume(s->scheduler, s->step, SIMULATION_BEGIN + s->step_began - s->zero);
    if (rc == 0 && s->schedules)
        simulation_look(s);
    return rc;
}

static const struct apc_sample *find_branch_sample(const struct apc_sample *rows, size_t n,
                                                   const struct apc_sample *wanted)
{
    for (size_t i = 0; i < n; i++)
        if (rows[i].table == wanted->table && rows[i].id == wanted->id)
            return &rows[i];
    return NULL;
}

/* Whose tuning parameter it is; NULL: it is none. */
static const struct controller *tuned(const struct experiment *e, const struct apc_sample *row)
{
    for (size_t i = 0; i < e->n_controllers && row->table == APC_TUNING; i++) {
        const struct controller *c = &e->controllers[i];
        if (row->id >= c->first_tuning && row->id < c->first_tuning + (int)controllers_parameters(c))
            return c;
    }
    return NULL;
}

/* The file begins with another value than the run's did, or with one of another law. */
static bool is_other(const struct simulation *s, const struct experiment *was,
                     const struct apc_sample *former, const struct apc_sample *row)
{
    const struct controller *c = tuned(s->e, row), *before = former ? tuned(was, former) : NULL;
    struct apc_sample newest = *row;
    if (!former || former->value < row->value || former->value > row->value)
        return true;
    if (c &&
        (!before || strcmp(c->law->name, before->law->name) != 0 || c->first_tuning != before->first_tuning))
        return true;
    return apc_store_read(s->store, &newest, 1) < 0 || newest.seq == 0;
}

static int change_rows(struct simulation *s, const struct experiment *was, struct apc_error *why)
{
    size_t n[2];
    struct apc_sample *first[2] = {module_first(was, SIMULATION_BEGIN, &n[0]),
                                   module_first(s->e, SIMULATION_BEGIN, &n[1])};
    int rc = first[0] && first[1] ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n[1] && rc == 0; i++) {
        const struct action action = {.kind = ACTION_WRITE, .to = first[1][i], .n = 1};
        if (is_other(s, was, find_branch_sample(first[0], n[0], &first[1][i]), &first[1][i]))
            simulation_do(s, &action, "operator");
    }
    free(first[0]);
    free(first[1]);
    return rc;
}

/* Is it made otherwise than before? @p a, @p b: its settings. */
static int look_at_controller(const struct simulated *c, const struct controller *of,
                              const config_setting_t *a, const config_setting_t *b, bool *other,
                              struct apc_error *why)
{
    struct difference d = {.skip = is_stored};
    struct apc_controller *core;
    int rc = module_controller(c->s->e, of, false, &core, why);
    if (rc < 0)
        return rc;
    *other = !c->core || (a && b && settings_differ(&d, a, b)) ||
             !are_same_numbers(c->core->mark, core->mark, 2) || of->first_tuning != c->of->first_tuning ||
             of->first_estimate != c->of->first_estimate || of->first_prediction != c->of->first_prediction ||
             of->first_output != c->of->first_output;
    apc_controller_destroy(core);
    return 0;
}

/* Measurements that are made anew have numbers of their own: the one that the last tick had is not new. */
static int match_measurements(struct simulated *c)
{
    struct apc_controller *core = c->core;
    for (size_t k = 0; k < core->dim.ny && core->resumed_at; k++) {
        const apc_ns taken = apc_ns_since(core->resumed_at, apc_ns_read(core->y_age[k]));
        const struct apc_range until = {.until = taken + c->s->e->client.rhythm.period / 2, .last = 1};
        struct samples one = {0};
        const int rc = samples_collect_one(&one, c->s->store, APC_SENSOR, core->in.sample[k].id, &until);
        if (rc == 0 && one.n > 0)
            core->y_seq[k] = one.at[0].seq;
        samples_free(&one);
        if (rc < 0)
            return rc;
    }
    return 0;
}

static int change_controllers(struct simulation *s, const struct texts *t, bool recorded,
                              struct apc_error *why)
{
    int rc = 0;
    for (size_t i = 0; i < s->e->n_controllers && rc == 0; i++) {
        struct simulated *c = &s->controller[i];
        const struct controller *of = &s->e->controllers[i];
        const bool lives = recorded || c->core; /* else it was killed */
        bool other = false;
        rc = look_at_controller(c, of, controller_in(&t->was, i), controller_in(&t->is, i), &other, why);
        if (rc == 0 && other && c->core)
            simulation_kill(c);
        c->of = of;
        if (rc == 0 && other && lives)
            rc = simulation_start(c, why);
        if (rc == 0 && recorded && (rc = match_measurements(c)) < 0)
            apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(s->store));
    }
    return rc;
}

struct branch {
    struct simulation *s;
    const struct experiment *was, *is;
    struct texts texts;
    int rc;
    struct apc_error *why;
};

static void on_branch(void *ctx)
{
    struct branch *b = ctx;
    struct simulation *s = b->s;
    const struct playback *playback = s->playback;
    apc_ns now = 0;
    (void)apc_ns_from_s(s->ended, &now);
    s->playback = NULL;
    s->e = b->is;
    if ((b->rc = simulation_take_faults(s, b->was)) < 0)
        apc_fail(b->why, b->rc, "out of memory");
    if (b->rc == 0 && playback && (b->rc = playback_end(playback, s->store)) < 0)
        apc_fail(b->why, b->rc, "the run cannot be continued from its record: %s", apc_err_text(b->rc));
    if (b->rc == 0 && simulation_schedule_actions(s, now) < 0)
        b->rc = apc_fail(b->why, APC_ENOMEM, "out of memory");
    if (b->rc == 0)
        b->rc = change_plant(s, b->was, b->why);
    if (b->rc == 0)
        b->rc = change_scheduler(s, b->was, playback, b->why);
    if (b->rc == 0)
        b->rc = change_rows(s, b->was, b->why);
    if (b->rc == 0)
        b->rc = change_controllers(s, &b->texts, playback, b->why);
}

int simulation_branch(struct simulation *s, const struct experiment *e, struct apc_error *why)
{
    struct branch b = {.s = s, .was = s->e, .is = e, .why = why};
    if (s->rc < 0)
        return apc_fail(why, s->rc, "%s", s->why.text);
    b.rc = compare_experiments(&b.texts, b.was, e, why);
    if (b.rc == 0 && simulation_happen(s, on_branch, &b) < 0 && b.rc == 0)
        b.rc = apc_fail(why, s->rc, "%s", s->why.text);
    config_destroy(&b.texts.was);
    config_destroy(&b.texts.is);
    if (b.rc < 0 && s->rc == 0) {
        s->rc = b.rc;
        s->why = *why;
    }
    return b.rc;
}
