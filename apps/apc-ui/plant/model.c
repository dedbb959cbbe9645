/* SPDX-License-Identifier: BSD-3-Clause */
#include <stdlib.h>
#include <string.h>

#include "apc-ui/ui.h"

/* ---- Durations ---------------------------------------------------------------------------- */

#define STATS_TURN (60 * APC_NS_PER_S)

int duration_stats_init(struct duration_stats *m)
{
    m->since = apc_clock_mono(NULL);
    if (pthread_mutex_init(&m->mutex, NULL))
        return APC_ESYS;
    int rc = apc_histogram_create(&m->past);
    return rc < 0 ? rc : apc_histogram_create(&m->now);
}

void duration_stats_free(struct duration_stats *m)
{
    apc_histogram_destroy(m->past);
    apc_histogram_destroy(m->now);
    pthread_mutex_destroy(&m->mutex);
}

void duration_stats_record(struct duration_stats *m, apc_ns value)
{
    apc_ns now = apc_clock_mono(NULL);
    pthread_mutex_lock(&m->mutex);
    if (now - m->since > STATS_TURN) {
        struct apc_histogram *old = m->past;
        m->past = m->now;
        m->now = old;
        m->since = now;
        apc_histogram_clear(m->now);
    }
    apc_histogram_record(m->now, value);
    m->count++;
    m->sum += apc_ns_to_s(value);
    pthread_mutex_unlock(&m->mutex);
}

void duration_stats_summary(struct duration_stats *m, struct apc_summary *summary)
{
    struct apc_histogram *both;
    *summary = (struct apc_summary){0};
    if (apc_histogram_create(&both) < 0)
        return;
    pthread_mutex_lock(&m->mutex);
    apc_histogram_merge(both, m->past);
    apc_histogram_merge(both, m->now);
    pthread_mutex_unlock(&m->mutex);
    apc_histogram_summary(both, summary);
    apc_histogram_destroy(both);
}

/* ---- Model -------------------------------------------------------------------------------- */

int model_init(struct model *m)
{
    m->since = apc_clock_utc(NULL);
    m->standing.safe = -1;
    snprintf(m->error, sizeof m->error, "not connected yet");
    return pthread_mutex_init(&m->mutex, NULL) ? APC_ESYS : 0;
}

static void free_values(struct model *m)
{
    free(m->now);
    free(m->moved);
    free(m->tick);
    free(m->ticked);
    free(m->standing.trouble);
}

void model_free(struct model *m)
{
    plant_free(&m->plant);
    free_values(m);
    text_free(&m->alarms_are);
    text_free(&m->alarms_stand);
    text_free(&m->plant_zipped);
    text_free(&m->ramps);
    pthread_mutex_destroy(&m->mutex);
}

/* Nothing is known of it yet. False: no memory. */
static bool new_values(struct model *m)
{
    const struct plant *p = &m->plant;
    m->now = calloc(2 * p->n + 1, sizeof *m->now);
    m->moved = calloc(2 * p->n + 1, sizeof *m->moved);
    m->tick = calloc(p->loops.n_controllers + 1, sizeof *m->tick);
    m->ticked = calloc(p->loops.n_controllers + 1, sizeof *m->ticked);
    m->standing.trouble = calloc(p->loops.n + 1, sizeof *m->standing.trouble);
    m->count = 0;
    return m->now && m->moved && m->tick && m->ticked && m->standing.trouble;
}

static void name_values(struct model *m)
{
    const struct plant *p = &m->plant;
    for (size_t i = 0; i < p->n; i++)
        m->now[m->count++] = (struct apc_sample){.table = p->tag[i].table, .id = p->tag[i].id};
    for (size_t i = 0; i < p->n; i++)
        if (table_wanted(p->tag[i].table))
            m->now[m->count++] = (struct apc_sample){
                .table = APC_ACTUAL, .id = apc_variable_number(p->tag[i].table, p->tag[i].id)};
    for (size_t i = 0; i < p->loops.n_controllers; i++)
        m->tick[i] = (struct apc_vector){.table = APC_TICK, .id = p->loops.controller[i].number};
}

/* Who evaluates the alarms is described by its tick row. Returns whether that is another than before. */
static bool describe_alarms(struct model *m, const struct apc_tag *tags, size_t n)
{
    int id = 0;
    for (size_t i = 0; i < n; i++)
        if (tags[i].table == APC_TICK && tags[i].length == APC_ALARMS_TICK &&
            !strcmp(tags[i].name, "alarms")) {
            id = tags[i].id;
            (void)apc_ns_from_s(tags[i].period, &m->alarms_period);
        }
    if (id == m->alarms.id)
        return false;
    m->alarms = (struct apc_vector){.table = APC_TICK, .id = id};
    return true;
}

/* New descriptions, and which loops they make: what was read is unknown again. Returns true when they
 * changed. */
static bool describe_model(struct model *m, const struct apc_tag *tags, size_t n, struct loops *loops,
                           int64_t catalogue)
{
    pthread_mutex_lock(&m->mutex);
    const bool changed = plant_describe(&m->plant, tags, n, loops), other = describe_alarms(m, tags, n);
    m->plant.revision += !changed && (other || (m->alarms.id > 0 && catalogue != m->catalogue));
    m->catalogue = catalogue;
    if (changed) {
        free_values(m);
        if (new_values(m))
            name_values(m);
        else
            plant_forget(&m->plant);
    }
    pthread_mutex_unlock(&m->mutex);
    return changed;
}

int model_load(struct model *m, struct apc_store *store)
{
    struct loops loops = {0};
    int64_t catalogue = 0;
    int n = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *tags = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *tags);
    if (n >= 0 && !tags)
        return APC_ENOMEM;
    int rc = n < 0 ? n : apc_store_get_tags(store, tags, (size_t)n);
    const size_t kept = (size_t)(rc < n ? rc : n);
    if (rc >= 0)
        rc = loops_load(&loops, store, tags, kept);
    if (rc >= 0)
        rc = apc_store_catalogue(store, NULL, 0, &catalogue);
    if (rc >= 0)
        describe_model(m, tags, kept, &loops, catalogue);
    loops_free(&loops);
    free(tags);
    return rc < 0 ? rc : 0;
}

apc_ns model_age(const struct model *m, size_t i, apc_ns now)
{
    return m->now[i].seq > 0 ? now - m->moved[i] : -1;
}

static bool too_old(apc_ns age, apc_ns period)
{
    return period > 0 && (age < 0 || age > (3 * period > APC_NS_PER_S ? 3 * period : APC_NS_PER_S));
}

bool model_stale(const struct model *m, size_t i, apc_ns now)
{
    return too_old(model_age(m, i, now), plant_period(&m->plant, m->now[i].table, m->now[i].id));
}

apc_ns model_tick_age(const struct model *m, size_t controller, apc_ns now)
{
    return m->tick[controller].seq > 0 ? now - m->ticked[controller] : -1;
}

bool model_alarms_live(const struct model *m, apc_ns now)
{
    return m->alarms.seq > 0 && !too_old(now - m->alarms_ticked, m->alarms_period);
}

int model_ticks(const struct model *m, size_t controller, apc_ns now)
{
    const apc_ns period = plant_tick_time(&m->plant, controller);
    return period == 0 ? -1 : !too_old(model_tick_age(m, controller, now), period);
}

/* ---- What stands -------------------------------------------------------------------------- */

#define REPORT (5 * APC_NS_PER_S) /* between two windows of a task */

/* What an event says of a loop: what stands behind its name, or all of what names none. NULL: it is of
 * another. */
static const char *said_of(const struct plant *p, const struct loops_loop *loop, const char *text)
{
    for (const struct loops_loop *one = p->loops.at; one < p->loops.at + p->loops.n; one++) {
        const size_t n = strlen(one->name);
        if (!strncmp(text, one->name, n) && !strncmp(text + n, ": ", 2))
            return one == loop ? text + n + 2 : NULL;
    }
    return text;
}

/* "mode LO: output at its fault value" says why; "mode Auto" that all is well. */
static const char *why_of(const char *text)
{
    const char *why = strncmp(text, "mode ", 5) ? NULL : strstr(text, ": ");
    return why ? why + 2 : "";
}

/* A controller calls itself apc-controller, where there are several with its name behind that, and where
 * others stand by for it with its own behind that. */
static bool is_source(const char *source, const char *controller)
{
    char named[sizeof((struct apc_event *)0)->source];
    const int n = snprintf(named, sizeof named, "apc-controller %.16s", controller);
    return !strcmp(source, "apc-controller") ||
           (!strncmp(source, named, (size_t)n) && (source[n] == '\0' || source[n] == ' '));
}

static void take_trouble(struct model *m, const struct apc_event *event, bool mode)
{
    for (size_t i = 0; i < m->plant.loops.n; i++) {
        const struct loops_loop *loop = &m->plant.loops.at[i];
        const char *text = said_of(&m->plant, loop, event->text);
        if (!text || !is_source(event->source, m->plant.loops.controller[loop->controller].name))
            continue;
        if (mode)
            text = why_of(text);
        else if (event->severity == APC_EVENT_INFO)
            text = "";
        snprintf(m->standing.trouble[i], TROUBLE_LEN, "%s", text);
    }
}

void model_take_event(struct model *m, const struct apc_event *event)
{
    const bool plant = !strcmp(event->source, "apc-plant"), client = !strcmp(event->source, "apc-client"),
               good = event->severity == APC_EVENT_INFO, start = !strcmp(event->kind, "start"),
               mode = !strcmp(event->kind, "mode"), command = client && !strcmp(event->kind, "command");
    struct standing *s = &m->standing;
    pthread_mutex_lock(&m->mutex);
    s->external |= command; /* of such a plant its client knows */
    if (command || (start && client && s->external) ||
        (plant && !s->external && (start || !strcmp(event->kind, "watchdog")))) {
        s->safe = !good || start; /* it starts there */
        s->safe_since = event->time;
    }
    if (mode || start || !strcmp(event->kind, "measurement"))
        take_trouble(m, event, mode);
    pthread_mutex_unlock(&m->mutex);
}

/* The ticks of a task that has reported are due: a window is written every 5 s if there was one in it.
 * Locked. */
static bool is_silent(const struct task *task, apc_ns now)
{
    return now - task->heard > 2 * REPORT + 3 * task->period;
}

/* The newest mode of this variable, by name; NULL: there is none. */
static const char *newest_mode_name(const struct model *m, enum apc_table table, int id)
{
    int at = find_plant_tag(&m->plant, table, id);
    return at < 0 || m->now[at].seq == 0 || m->now[at].value < 0 ? NULL
                                                                 : apc_mode_name((int)m->now[at].value);
}

static const char *actual_mode(const struct model *m, const struct loops_loop *loop)
{
    return newest_mode_name(m, APC_ACTUAL, apc_variable_number(APC_OPMODE, loop->id));
}

/* What nobody writes now is no news where it is an output whose loop is out of service, or whose controller
 * does not tick, which is said by itself; or of a law, which publishes where it is asked. */
static bool rests(const struct model *m, const struct apc_sample *u, apc_ns now)
{
    const struct loops_loop *loop =
        u->table == APC_ACTUATOR ? loops_of(&m->plant.loops, APC_ACTUATOR, u->id) : NULL;
    const char *actual = loop ? actual_mode(m, loop) : NULL;
    return u->table == APC_ESTIMATE || (actual && !strcmp(actual, "OOS")) ||
           (loop && model_ticks(m, loop->controller, now) == 0);
}

static void silence(struct text *t, const char *name, const char *what, apc_ns age)
{
    if (age < 0)
        text_add(t, "%s: no %s yet\n", name, what);
    else
        text_add(t, "%s: no %s for %.1f s\n", name, what, apc_ns_to_s(age));
}

/* An output of the plant is out of service, so that nobody is to command it. */
static bool excused(const struct model *m)
{
    for (size_t i = 0; i < m->plant.loops.n; i++) {
        const char *actual = actual_mode(m, &m->plant.loops.at[i]);
        if (m->plant.loops.at[i].table == APC_ACTUATOR && actual && !strcmp(actual, "OOS"))
            return true;
    }
    return false;
}

size_t model_silent(const struct model *m, apc_ns now, struct text *t)
{
    size_t n = 0;
    for (size_t i = 0; i < m->plant.n; i++)
        if (model_stale(m, i, now) && !rests(m, &m->now[i], now)) {
            silence(t, m->plant.tag[i].name, "sample", model_age(m, i, now));
            n++;
        }
    for (size_t i = 0; i < m->plant.loops.n_controllers; i++)
        if (model_ticks(m, i, now) == 0) {
            silence(t, m->plant.loops.controller[i].name, "tick", model_tick_age(m, i, now));
            n++;
        }
    for (size_t i = 0; i < m->tasks; i++)
        if (is_silent(&m->task[i], now)) {
            silence(t, m->task[i].name, "tick reported", now - m->task[i].heard);
            n++;
        }
    if (m->standing.safe > 0 && !excused(m)) {
        text_add(t, "the plant is given no command\n");
        n++;
    }
    return n;
}

/* The law does not act in the mode that is wanted: its backup law does. */
static bool by_backup(const struct model *m, const struct loops_loop *loop)
{
    const int at = find_plant_tag(&m->plant, APC_ACTUAL, apc_variable_number(APC_OPMODE, loop->id));
    return at >= 0 && m->now[at].status == APC_GOOD_LOCAL_OVERRIDE;
}

/* Why the actual mode is not the target, or not as it was meant, in the controller's words, or in ours where
 * they were lost; NULL: it is, or its controller does not tick, which is said once. */
static const char *reason(const struct model *m, size_t i, apc_ns now)
{
    const struct loops_loop *loop = &m->plant.loops.at[i];
    const char *target = newest_mode_name(m, APC_OPMODE, loop->id), *actual = actual_mode(m, loop);
    const bool same = target && actual && !strcmp(target, actual);
    if (!target || !actual || (same && !by_backup(m, loop)) || model_ticks(m, loop->controller, now) == 0)
        return NULL;
    if (m->standing.trouble[i][0])
        return m->standing.trouble[i];
    return same                      ? "the backup law acts"
           : !strcmp(actual, "LO")   ? "output at its fault value"
           : !strcmp(actual, "IMan") ? "what takes its output is not ready for it"
           : !strcmp(actual, "OOS")  ? "another controller acts"
           : !strcmp(target, "Cas")  ? "no setpoint from above"
                                     : NULL;
}

static struct apc_sample newest_row(const struct model *m, enum apc_table table, int id)
{
    const int at = find_plant_tag(&m->plant, table, id);
    return at >= 0 ? m->now[at] : (struct apc_sample){.table = table, .id = id};
}

static const struct entry_note *note_of_loop(const struct model *m, const struct loops_loop *loop, apc_ns now)
{
    const struct entry_seen seen = {
        .target = newest_row(m, APC_OPMODE, loop->id),
        .actual = newest_row(m, APC_ACTUAL, apc_variable_number(APC_OPMODE, loop->id)),
        .output = newest_row(m, loop->table, loop->output),
        .stopped = model_ticks(m, loop->controller, now) == 0,
        .safe = m->standing.safe > 0,
    };
    return entry_note(&seen);
}

void control_json(const struct model *m, apc_ns now, struct text *t)
{
    const struct standing *s = &m->standing;
    json_add(t, "{running:{");
    for (size_t i = 0; i < m->plant.loops.n_controllers; i++)
        json_add(t, "%s:%i", m->plant.loops.controller[i].name, model_ticks(m, i, now));
    json_add(t, "}, reasons:{");
    for (size_t i = 0; i < m->plant.loops.n; i++) {
        const char *why = reason(m, i, now);
        char id[16];
        snprintf(id, sizeof id, "%d", m->plant.loops.at[i].id);
        if (why)
            json_add(t, "%s:%s", id, why);
    }
    json_add(t, "}, entries:{");
    for (size_t i = 0; i < m->plant.loops.n; i++) {
        const struct entry_note *note = note_of_loop(m, &m->plant.loops.at[i], now);
        char id[16];
        snprintf(id, sizeof id, "%d", m->plant.loops.at[i].id);
        if (!note)
            continue;
        json_add(t, "%s:", id);
        entry_note_json(note, t);
    }
    json_add(t, "}, ramps:{");
    text_put(t, m->ramps.at, m->ramps.n);
    json_add(t, "}, shadow:[");
    for (size_t i = 0; i < m->plant.loops.n_controllers; i++)
        if (!m->plant.loops.controller[i].acts)
            json_add(t, "%s", m->plant.loops.controller[i].name);
    json_add(t, "], safe:%i, safe_since:%.6jd, alarms:%i}", s->safe, s->safe > 0 ? s->safe_since : JSON_NONE,
             m->alarms.id == 0 ? -1 : model_alarms_live(m, now));
}

bool model_full(const struct model *m, bool named, char text[ROOM_LEN])
{
    const char *name = NULL;
    for (size_t i = 0; i < m->plant.n && named; i++)
        if (m->plant.tag[i].table == m->room.table && m->plant.tag[i].id == m->room.id)
            name = m->plant.tag[i].name;
    if (m->room.full)
        room_text(&m->room, name, text);
    return m->room.full;
}

void store_state_members(const struct model *m, struct text *t)
{
    char full[ROOM_LEN];
    json_add(t, "connected:%i, since:%.6jd, error:%-s, full:%-s", m->connected, m->since,
             m->connected ? "" : m->error, model_full(m, true, full) ? full : "");
}

static void store_state_json(const struct model *m, struct text *t)
{
    json_add(t, "{");
    store_state_members(m, t);
    json_add(t, "}");
}

bool model_connected(struct ui *ui)
{
    pthread_mutex_lock(&ui->model.mutex);
    const bool connected = ui->model.connected;
    pthread_mutex_unlock(&ui->model.mutex);
    return connected;
}

void model_state_json(struct ui *ui, struct text *t)
{
    struct model *m = &ui->model;
    char ref[REF_LEN], id[STREAM_ID_LEN];
    stream_id(ui->stream, id); /* first: what comes meanwhile may be told twice, but is not left out */
    json_add(t, "{t:%.6jd, id:%s, store:{", apc_clock_utc(NULL), id);
    pthread_mutex_lock(&m->mutex);
    apc_ns now = apc_clock_plant();
    store_state_members(m, t);
    json_add(t, "}, values:{");
    for (size_t i = 0; i < m->plant.n; i++) {
        json_add(t, "%s:", ref_format(m->now[i].table, m->now[i].id, ref));
        json_sample_add(t, &m->now[i]);
    }
    json_add(t, "}, ages:{");
    for (size_t i = 0; i < m->plant.n; i++) {
        apc_ns age = model_age(m, i, now);
        json_add(t, "%s:%.9jd", ref_format(m->now[i].table, m->now[i].id, ref), age >= 0 ? age : JSON_NONE);
    }
    json_add(t, "}, alarms:[");
    text_put(t, m->alarms_stand.at, m->alarms_stand.n);
    json_add(t, "], control:");
    control_json(m, now, t);
    json_add(t, "history:");
    behind_json(m, t);
    json_add(t, "simulation:");
    simulated_json(m, t);
    json_add(t, "}");
    pthread_mutex_unlock(&m->mutex);
}

static void tell_store(struct ui *ui, struct text *t)
{
    if (t->n > 0 && !t->failed)
        stream_publish(ui->stream, "store", t->at, t->n, true);
    text_free(t);
}

void model_room(struct ui *ui, const struct apc_store_room *room)
{
    struct model *m = &ui->model;
    struct text t = {0};
    pthread_mutex_lock(&m->mutex);
    const bool changed = m->room.full != room->full || m->room.table != room->table || m->room.id != room->id;
    m->room = *room;
    if (changed)
        store_state_json(m, &t);
    pthread_mutex_unlock(&m->mutex);
    tell_store(ui, &t);
}

void model_store(struct ui *ui, bool connected, const char *error)
{
    struct model *m = &ui->model;
    struct text t = {0};
    pthread_mutex_lock(&m->mutex);
    bool changed = m->connected != connected;
    m->connected = connected;
    if (!connected)
        snprintf(m->error, sizeof m->error, "%s", error);
    if (changed) {
        m->since = apc_clock_utc(NULL);
        m->connects += connected;
        store_state_json(m, &t);
    }
    pthread_mutex_unlock(&m->mutex);
    if (!changed)
        return;
    apc_log_write(ui->log, connected ? APC_LOG_INFO : APC_LOG_WARN,
                  connected ? "store connected%s" : "store lost, trying again: %s", connected ? "" : error);
    tell_store(ui, &t);
}
