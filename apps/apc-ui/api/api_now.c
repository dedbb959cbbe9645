/* SPDX-License-Identifier: BSD-3-Clause */
/* What is answered from memory: description, state, diagnostics, writes, metrics, health. */
#include <inttypes.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "base/text.h"

/* Locked. */
static void tell_plant(struct ui *ui, struct text *t)
{
    const struct model *m = &ui->model;
    json_add(t, "{");
    plant_members(&m->plant, t);
    json_add(t, "graphic:%i, displays:%i, alarms:", ui->graphic.n > 0, ui->displays[0] != '\0');
    json_text_add(t, &m->alarms_are);
    json_add(t, "}");
}

/* Of a thousand signals it is 50 ms of work, which all pages ask for: zipped, it is kept until it is another. */
void get_plant(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct model *m = &ui->model;
    (void)store;
    pthread_mutex_lock(&m->mutex);
    const bool known = m->plant.revision > 0;
    if (known && m->plant_zipped.n > 0 && m->zipped_of == m->plant.revision && request_takes_zip(r)) {
        text_put(&r->reply, m->plant_zipped.at, m->plant_zipped.n);
        r->zipped = true;
    } else if (known) {
        tell_plant(ui, &r->reply);
        zip_reply(r);
        if (r->zipped) {
            text_free(&m->plant_zipped);
            text_put(&m->plant_zipped, r->reply.at, r->reply.n);
            m->zipped_of = m->plant.revision;
        }
    }
    pthread_mutex_unlock(&m->mutex);
    if (!known)
        fault_set(&r->fault, 503, "store", NULL, "the database has not been reached yet");
}

/* As it is in the file: the page takes of it what is a picture, and nobody is to take it for a page. */
void get_graphic(struct ui *ui, struct request *r, struct apc_store *store)
{
    (void)store;
    if (ui->graphic.n == 0) {
        fault_set(
            &r->fault, 404, "graphic", NULL,
            "there is no drawing of this plant: an SVG beside the experiment file, with its name, is one");
        return;
    }
    text_put(&r->reply, ui->graphic.at, ui->graphic.n);
    r->type = "image/svg+xml";
    r->sandbox = true;
}

void get_state(struct ui *ui, struct request *r, struct apc_store *store)
{
    if (store && request_query(r, "at"))
        state_then(ui, r, store);
    else
        model_state_json(ui, &r->reply);
}

void get_writes(struct ui *ui, struct request *r, struct apc_store *store)
{
    const char *key = request_query(r, "key");
    const bool waits = atomic_load(&ui->writing) > 0; /* before the look: what is done with by then is seen */
    (void)store;
    json_add(&r->reply, "{writes:[");
    size_t n = writes_json(ui->writes, key, &r->reply);
    json_add(&r->reply, "]}");
    if (key && n == 0 && waits)
        fault_set(&r->fault, 503, "busy", "key",
                  "writes are waiting, and this may be one of them: ask again");
    else if (key && n == 0)
        fault_set(&r->fault, 404, "write", "key", "there was no such write since this server began");
}

/* ---- Diagnostics -------------------------------------------------------------------------- */

static void tasks_json(const struct model *m, apc_ns now, struct text *t)
{
    json_add(t, "tasks:[");
    for (size_t i = 0; i < m->tasks; i++)
        task_json(&m->task[i], now, t);
    json_add(t, "]");
}

/* What apc-client measures of its exchanges with the plant. Nobody else measures any. */
static void exchange_json(const struct task *exchange, struct text *t)
{
    json_add(t, "round_trip:");
    window_json(exchange ? &exchange->last[RUN] : NULL, t);
    if (exchange && exchange->last[RUN].count > 0)
        json_add(t, "failed:%ju", exchange->missed_total);
    else
        json_add(t, "failed:null");
}

#define CLIENT "apc-client"

/* A client whose link never changed has said nothing of it: what it measures tells. */
static bool measures(const struct model *m, apc_ns now)
{
    bool up = false;
    for (size_t i = 0; i < m->plant.n; i++)
        up |= m->now[i].table == APC_SENSOR && m->now[i].seq > 0 && !model_stale(m, i, now) &&
              apc_status_severity(m->now[i].status) != APC_SEVERITY_BAD;
    return up;
}

static bool has_client(const struct model *m)
{
    for (size_t i = 0; i < m->plant.n; i++)
        if (m->plant.tag[i].table == APC_SENSOR)
            return true;
    return false;
}

static void silent_link_json(const struct model *m, apc_ns now, struct text *t)
{
    const bool up = measures(m, now);
    json_add(t, "{name:%s, up:%i, since:null, text:%s, changes:0", CLIENT, up,
             up ? "measurements arrive" : "no measurements arrive");
    exchange_json(&m->exchange, t);
    json_add(t, "}");
}

static void links_json(const struct model *m, apc_ns now, struct text *t)
{
    bool client = false;
    json_add(t, "links:[");
    for (size_t i = 0; i < m->links; i++) {
        const struct link_state *link = &m->link[i];
        const bool is_client = !strcmp(link->name, CLIENT);
        client |= is_client;
        json_add(t, "{name:%s, up:%i, since:%.6jd, text:%s, changes:%ju", link->name, link->up, link->since,
                 link->text, link->changes);
        exchange_json(is_client ? &m->exchange : NULL, t);
        json_add(t, "}");
    }
    if (!client && has_client(m))
        silent_link_json(m, now, t);
    json_add(t, "]");
}

static void signals_json(const struct model *m, apc_ns now, struct text *t)
{
    char ref[REF_LEN], status[APC_STATUS_NAME_LEN];
    json_add(t, "signals:[");
    for (size_t i = 0; i < m->plant.n; i++) {
        const struct apc_sample *s = &m->now[i];
        apc_ns age = model_age(m, i, now), period = plant_period(&m->plant, s->table, s->id);
        json_add(t, "{ref:%s, age:%.9jd, period:%.9jd, stale:%i, status:%s}",
                 ref_format(s->table, s->id, ref), age >= 0 ? age : JSON_NONE, json_some(period),
                 model_stale(m, i, now), apc_status_format(s->seq > 0 ? s->status : APC_BAD_NO_DATA, status));
    }
    json_add(t, "]");
}

static void duration_stats_json(struct duration_stats *m, const char *name, struct text *t)
{
    struct apc_summary summary;
    duration_stats_summary(m, &summary);
    json_add(t, "%s:", name);
    summary_json(&summary, t);
}

static void spool_json(const struct ui *ui, struct text *t)
{
    const struct apc_spool_stats *s = &ui->model.spool;
    if (ui->options.spool)
        json_add(t, "{depth:%ju, age:%.9jd}", s->samples + s->events,
                 s->oldest > 0 ? apc_clock_utc(NULL) - s->oldest : 0);
    else
        json_add(t, "null");
}

void get_diagnostics(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct model *m = &ui->model;
    struct text *t = &r->reply;
    struct stream_stats stream;
    apc_ns now = apc_clock_plant();
    (void)store;

    stream_stats(ui->stream, &stream);
    json_add(t, "{t:%.6jd, uptime:%.9jd", apc_clock_utc(NULL), apc_clock_mono(NULL) - ui->began);
    pthread_mutex_lock(&m->mutex);
    tasks_json(m, now, t);
    links_json(m, now, t);
    signals_json(m, now, t);
    json_add(t, "store:{");
    store_state_members(m, t);
    json_add(t, "connects:%ju, spool:", m->connects);
    spool_json(ui, t);
    pthread_mutex_unlock(&m->mutex);
    duration_stats_json(&ui->reads, "read", t);
    duration_stats_json(&ui->stores, "write", t);
    json_add(t, "}, stream:{clients:%zu, messages:%ju, dropped:%ju", stream.readers, stream.messages,
             stream.dropped);
    duration_stats_json(&ui->lag, "lag", t);
    json_add(t, "}}");
}

/* ---- Prometheus --------------------------------------------------------------------------- */

static void metric(struct text *t, const char *name, const char *type, const char *help)
{
    text_add(t, "# HELP %s %s\n# TYPE %s %s\n", name, help, name, type);
}

/* A label's value: names of tasks and sources are bytes that anybody may have written. */
static void label(struct text *t, const char *value)
{
    char instead;
    text_put(t, "\"", 1);
    for (size_t n; *value; value += n) {
        n = text_step(value, &instead);
        if (*value == '"' || *value == '\\')
            text_add(t, "\\%c", *value);
        else
            text_put(t, instead ? &instead : value, instead ? 1 : n);
    }
    text_put(t, "\"", 1);
}

static void task_summary(const struct model *m, struct text *t, const char *name, int q, const char *help)
{
    metric(t, name, "summary", help);
    for (size_t i = 0; i < m->tasks; i++) {
        const struct task *task = &m->task[i];
        const struct {
            const char *quantile;
            apc_ns value;
        } part[] = {{"0.5", task->last[q].p50}, {"0.99", task->last[q].p99}, {"1", task->last[q].max}};
        for (size_t k = 0; k < sizeof part / sizeof *part && task->last[q].count > 0; k++) {
            text_add(t, "%s{task=", name);
            label(t, task->name);
            text_add(t, ",quantile=\"%s\"} %.9g\n", part[k].quantile, apc_ns_to_s(part[k].value));
        }
        text_add(t, "%s_sum{task=", name);
        label(t, task->name);
        text_add(t, "} %.9g\n%s_count{task=", task->total[q].sum, name);
        label(t, task->name);
        text_add(t, "} %" PRIu64 "\n", task->total[q].count);
    }
}

static void task_metrics(const struct model *m, struct text *t)
{
    task_summary(m, t, "apc_task_jitter_seconds", JITTER,
                 "Time from start to start minus the period, in seconds; quantiles of the last window.");
    task_summary(m, t, "apc_task_exec_seconds", RUN, "Start to end of a tick; quantiles of the last window.");
    metric(t, "apc_task_overruns_total", "counter", "Ticks missed since this server began.");
    for (size_t i = 0; i < m->tasks; i++) {
        text_add(t, "apc_task_overruns_total{task=");
        label(t, m->task[i].name);
        text_add(t, "} %" PRIu64 "\n", m->task[i].missed_total);
    }
}

static void link_metric(struct text *t, const char *name, const char *link, uint64_t value)
{
    text_add(t, "%s{link=", name);
    label(t, link);
    text_add(t, "} %" PRIu64 "\n", value);
}

static void link_metrics(const struct model *m, apc_ns now, struct text *t)
{
    bool client = false;
    metric(t, "apc_link_up", "gauge", "1: connected.");
    for (size_t i = 0; i < m->links; i++) {
        link_metric(t, "apc_link_up", m->link[i].name, m->link[i].up);
        client |= !strcmp(m->link[i].name, CLIENT);
    }
    if (!client && has_client(m))
        link_metric(t, "apc_link_up", CLIENT, measures(m, now));
    metric(t, "apc_link_reconnects_total", "counter", "Number of times that the link was lost or restored.");
    for (size_t i = 0; i < m->links; i++)
        link_metric(t, "apc_link_reconnects_total", m->link[i].name, m->link[i].changes);
    if (!client && has_client(m))
        link_metric(t, "apc_link_reconnects_total", CLIENT, 0);
}

static void exchange_metrics(const struct task *exchange, struct text *t)
{
    const struct task_figures *last = &exchange->last[RUN], *total = &exchange->total[RUN];
    if (last->count == 0)
        return;
    metric(t, "apc_link_round_trip_seconds", "summary",
           "Time from a command sent to its reply read, in seconds; quantiles of the last window.");
    text_add(t,
             "apc_link_round_trip_seconds{link=\"apc-client\",quantile=\"0.5\"} %.9g\n"
             "apc_link_round_trip_seconds{link=\"apc-client\",quantile=\"0.99\"} %.9g\n"
             "apc_link_round_trip_seconds_sum{link=\"apc-client\"} %.9g\n"
             "apc_link_round_trip_seconds_count{link=\"apc-client\"} %" PRIu64 "\n",
             apc_ns_to_s(last->p50), apc_ns_to_s(last->p99), total->sum, total->count);
    metric(t, "apc_link_failed_total", "counter", "Exchanges that failed since this server began.");
    text_add(t, "apc_link_failed_total{link=\"apc-client\"} %" PRIu64 "\n", exchange->missed_total);
}

static void signal_metric(const struct model *m, size_t i, struct text *t, const char *name, double value)
{
    text_add(t, "%s{table=\"%s\",name=", name, apc_table_name(m->now[i].table));
    label(t, m->plant.tag[i].name);
    text_add(t, ",unit=");
    label(t, m->plant.tag[i].unit);
    text_add(t, "} %.17g\n", value);
}

static void signal_metrics(const struct model *m, apc_ns now, struct text *t)
{
    metric(t, "apc_signal_value", "gauge",
           "The newest value of each variable; modes as numbers: 0 Man, 1 Auto, 2 OOS, 3 Cas, 4 IMan, 5 LO.");
    for (size_t i = 0; i < m->plant.n; i++)
        if (m->now[i].seq > 0)
            signal_metric(m, i, t, "apc_signal_value", m->now[i].value);
    metric(t, "apc_signal_good", "gauge", "1: the newest value exists, is Good and not stale.");
    for (size_t i = 0; i < m->plant.n; i++)
        signal_metric(m, i, t, "apc_signal_good",
                      m->now[i].seq > 0 && !model_stale(m, i, now) &&
                          apc_status_severity(m->now[i].status) == APC_SEVERITY_GOOD);
    metric(t, "apc_signal_age_seconds", "gauge", "Age of the newest sample in seconds.");
    for (size_t i = 0; i < m->plant.n; i++)
        if (m->now[i].seq > 0)
            signal_metric(m, i, t, "apc_signal_age_seconds", apc_ns_to_s(model_age(m, i, now)));
}

/* What is not known has no sample. */
static void standing_metrics(const struct model *m, apc_ns now, struct text *t)
{
    metric(t, "apc_control_running", "gauge", "1: the controller ticks.");
    for (size_t i = 0; i < m->plant.loops.n_controllers; i++) {
        const int ticks = model_ticks(m, i, now);
        if (ticks < 0)
            continue;
        text_add(t, "apc_control_running{controller=");
        label(t, m->plant.loops.controller[i].name);
        text_add(t, "} %d\n", ticks);
    }
    metric(t, "apc_plant_safe", "gauge",
           "1: the plant gets no command; a simulated plant is at its safe value.");
    if (m->standing.safe >= 0)
        text_add(t, "apc_plant_safe %d\n", m->standing.safe);
    metric(t, "apc_task_age_seconds", "gauge", "Time since a task last reported ticks, in seconds.");
    for (size_t i = 0; i < m->tasks; i++) {
        text_add(t, "apc_task_age_seconds{task=");
        label(t, m->task[i].name);
        text_add(t, "} %.9g\n", apc_ns_to_s(now - m->task[i].heard));
    }
}

static void room_metrics(const struct apc_store_room *room, struct text *t)
{
    if (room->cells_max == 0)
        return;
    metric(t, "apc_store_full", "gauge", "1: shared memory has no room for a variable.");
    text_add(t, "apc_store_full %d\n", room->full);
    metric(t, "apc_store_refused_rows_total", "counter", "Rows refused for lack of room in shared memory.");
    text_add(t, "apc_store_refused_rows_total %" PRIu64 "\n", room->refused);
}

/* Where there is one store there is nothing of a history. */
static void history_metrics(const struct behind *b, struct text *t)
{
    if (b->state == 0)
        return;
    metric(t, "apc_history_up", "gauge", "1: the history answers.");
    text_add(t, "apc_history_up %d\n", b->state > 0);
    if (b->state < 0)
        return;
    metric(t, "apc_history_behind_rows", "gauge", "Samples and ticks that the history does not have yet.");
    text_add(t, "apc_history_behind_rows %" PRIu64 "\n", b->rows);
    if (b->nothing)
        return;
    metric(t, "apc_history_behind_seconds", "gauge",
           "How much older the history's newest row is than the live store's, in seconds.");
    text_add(t, "apc_history_behind_seconds %.9g\n", apc_ns_to_s(b->late));
}

/* As apc-alarms counted them last; while nobody does, they are not known. */
static void alarm_metrics(const struct model *m, apc_ns now, struct text *t)
{
    static const struct {
        const char *state;
        enum apc_alarms_tick at;
    } states[] = {{"active", APC_ALARMS_ACTIVE},
                  {"unacknowledged", APC_ALARMS_UNACKED},
                  {"shelved", APC_ALARMS_SHELVED},
                  {"suppressed", APC_ALARMS_SUPPRESSED},
                  {"out_of_service", APC_ALARMS_OUT_OF_SERVICE}};
    const bool live = model_alarms_live(m, now);
    if (m->alarms.id == 0)
        return;
    metric(t, "apc_alarms_evaluated", "gauge", "1: apc-alarms ticks.");
    text_add(t, "apc_alarms_evaluated %d\n", live);
    metric(t, "apc_alarms", "gauge", "Number of alarms in each state.");
    for (size_t i = 0; i < sizeof states / sizeof *states && live; i++)
        text_add(t, "apc_alarms{state=\"%s\"} %.17g\n", states[i].state, m->alarm_numbers[states[i].at]);
    metric(t, "apc_alarms_standing", "gauge",
           "Active or unacknowledged alarms by priority: 1 is the most urgent.");
    for (int i = 0; i < APC_ALARM_PRIORITIES && live; i++)
        text_add(t, "apc_alarms_standing{priority=\"%d\"} %.17g\n", i + 1,
                 m->alarm_numbers[APC_ALARMS_STANDING + i]);
    metric(t, "apc_alarm_transitions_total", "counter", "Number of the last transition in the journal.");
    if (live)
        text_add(t, "apc_alarm_transitions_total %.17g\n", m->alarm_numbers[APC_ALARMS_JOURNAL]);
}

/* As somebody asked for them last: nothing is judged here. */
static void health_metrics(struct verdicts *verdicts, struct text *t)
{
    pthread_mutex_lock(&verdicts->mutex);
    if (verdicts->until > 0) {
        metric(t, "apc_loop_health", "gauge",
               "1: the verdict on a loop, of the newest window that was judged.");
        for (size_t i = 0; i < verdicts->n; i++) {
            text_add(t, "apc_loop_health{loop=");
            label(t, verdicts->loop[i].name);
            text_add(t, ",health=\"%s\"} 1\n", verdicts->loop[i].health);
        }
        metric(t, "apc_loop_health_time_seconds", "gauge", "End of that window, in Unix seconds.");
        text_add(t, "apc_loop_health_time_seconds %.17g\n", apc_ns_to_s(verdicts->until));
    }
    pthread_mutex_unlock(&verdicts->mutex);
}

static void duration_stats_metrics(struct duration_stats *m, struct text *t, const char *name,
                                   const char *help)
{
    struct apc_summary s;
    duration_stats_summary(m, &s);
    pthread_mutex_lock(&m->mutex);
    uint64_t n = m->count;
    double sum = m->sum;
    pthread_mutex_unlock(&m->mutex);
    metric(t, name, "summary", help);
    if (s.count > 0)
        text_add(t, "%s{quantile=\"0.5\"} %.9g\n%s{quantile=\"0.99\"} %.9g\n", name, apc_ns_to_s(s.p50), name,
                 apc_ns_to_s(s.p99));
    text_add(t, "%s_sum %.9g\n%s_count %" PRIu64 "\n", name, sum, name, n);
}

void get_metrics(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct model *m = &ui->model;
    struct text *t = &r->reply;
    struct stream_stats stream;
    (void)store;

    r->type = "text/plain; version=0.0.4; charset=utf-8";
    stream_stats(ui->stream, &stream);
    pthread_mutex_lock(&m->mutex);
    const apc_ns now = apc_clock_plant();
    task_metrics(m, t);
    link_metrics(m, now, t);
    exchange_metrics(&m->exchange, t);
    signal_metrics(m, now, t);
    standing_metrics(m, now, t);
    alarm_metrics(m, now, t);
    metric(t, "apc_db_up", "gauge", "1: the database answers.");
    text_add(t, "apc_db_up %d\n", m->connected);
    metric(t, "apc_spool_depth", "gauge", "Samples and events that wait in spools for the database.");
    text_add(t, "apc_spool_depth %" PRIu64 "\n", m->spool.samples + m->spool.events);
    room_metrics(&m->room, t);
    history_metrics(&m->behind, t);
    pthread_mutex_unlock(&m->mutex);
    health_metrics(&ui->verdicts, t);
    duration_stats_metrics(&ui->stores, t, "apc_db_write_seconds", "This server's writes.");
    duration_stats_metrics(&ui->reads, t, "apc_db_read_seconds",
                           "This server's reads of all newest samples.");
    duration_stats_metrics(&ui->lag, t, "apc_ui_lag_seconds",
                           "From a sample's source time to its message on the stream.");
    metric(t, "apc_ui_clients", "gauge", "Open event streams (/events) of browsers and programs.");
    text_add(t, "apc_ui_clients %zu\n", stream.readers);
    metric(t, "apc_ui_requests_total", "counter", "Requests answered.");
    for (int i = 1; i < 6; i++)
        text_add(t, "apc_ui_requests_total{status=\"%dxx\"} %" PRIu64 "\n", i, (uint64_t)ui->requests[i]);
    metric(t, "apc_build_info", "gauge", "The library's version.");
    text_add(t, "apc_build_info{version=\"%s\"} 1\n", apc_version());
}

/* ---- Health ------------------------------------------------------------------------------- */

#define STUCK (30 * APC_NS_PER_S) /* a store's time-out is 2 s */

const char *stuck_thread(const struct ui *ui)
{
    static const char *const names[] = {"reads values", "reads events"};
    for (size_t i = 0; i < 2; i++)
        if (apc_clock_mono(NULL) - ui->round[i] > STUCK)
            return names[i];
    return NULL;
}

void get_livez(struct ui *ui, struct request *r, struct apc_store *store)
{
    const char *stuck = stuck_thread(ui);
    (void)store;
    r->type = "text/plain; charset=utf-8";
    r->status = stuck ? 503 : 200;
    if (stuck)
        text_add(&r->reply, "the thread that %s has stopped\n", stuck);
    else
        text_add(&r->reply, "ok\n");
}

void get_readyz(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct model *m = &ui->model;
    size_t wrong = 0;
    (void)store;
    pthread_mutex_lock(&m->mutex);
    if (m->connected)
        wrong = model_silent(m, apc_clock_plant(), &r->reply);
    char full[ROOM_LEN] = "";
    const bool is_full = m->connected && model_full(m, r->session.user[0], full);
    bool ready = m->connected && wrong == 0 && !is_full;
    pthread_mutex_unlock(&m->mutex);
    if (wrong > 0 && !r->session.user[0]) { /* names are not for strangers */
        text_free(&r->reply);
        text_add(&r->reply, "signals or tasks that do not tick: %zu\n", wrong);
    }
    r->type = "text/plain; charset=utf-8";
    r->status = ready ? 200 : 503;
    if (is_full)
        text_add(&r->reply, "%s\n", r->session.user[0] ? full : "the store is full");
    if (ready)
        text_add(&r->reply, "ok\n");
    else if (wrong == 0 && !is_full)
        text_add(&r->reply, "the database is offline\n");
}
