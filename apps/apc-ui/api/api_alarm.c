/* SPDX-License-Identifier: BSD-3-Clause */
/* The alarms as they stand, what they did, and what people want of them. */
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "record/record.h"

#define JOURNAL_MAX    1000
#define JOURNAL_LAST   200
#define SEARCH_MOST    127 /* bytes */
#define FIGURES_BACK   (86400 * APC_NS_PER_S)
#define FIGURES_MOST   (31 * FIGURES_BACK)
#define TRIAL_PATIENCE (10 * APC_NS_PER_S)
#define UNTIL_MAX      INT64_C(10000000000) /* Unix seconds: it is not milliseconds */

int desks_init(struct desk desk[DESKS])
{
    int rc = 0;
    for (size_t i = 0; i < DESKS && rc == 0; i++)
        rc = pthread_mutex_init(&desk[i].mutex, NULL) ? APC_ESYS : 0;
    return rc;
}

void desks_free(struct desk desk[DESKS])
{
    for (size_t i = 0; i < DESKS; i++) {
        alarm_summary_close(&desk[i].board);
        pthread_mutex_destroy(&desk[i].mutex);
    }
}

/* The alarms that the store describes, as they stand; none where it describes none. False: fault set. In
 * either case give_desk_back(). */
static bool take_desk(struct desk *desk, struct request *r, struct apc_store *store)
{
    struct apc_error why;
    pthread_mutex_lock(&desk->mutex);
    int rc = alarm_summary_open(&desk->board, store, &why);
    if (rc == APC_ENOTFOUND)
        return true;
    if (rc < 0)
        return fault_set(&r->fault, 503, "store", NULL, "%.150s", why.text);
    if ((rc = alarm_summary_read(&desk->board, store)) < 0)
        fault_store(r, rc, store);
    return rc == 0;
}

/* The same, and which of them are first out. */
static bool take_marked_desk(struct desk *desk, struct request *r, struct apc_store *store)
{
    const bool ok = take_desk(desk, r, store);
    const int rc = ok ? alarm_summary_mark(&desk->board, store) : 0;
    if (rc < 0)
        fault_store(r, rc, store);
    return ok && rc == 0;
}

static void give_desk_back(struct desk *desk)
{
    pthread_mutex_unlock(&desk->mutex);
}

/* ---- As they stand ------------------------------------------------------------------------- */

static void alarms_json(const struct alarm_summary *board, struct apc_store *store, struct text *t)
{
    json_add(t, "evaluated:%i, time:%.6jd, alarms:[", alarm_summary_lives(board, apc_store_now(store)),
             json_some(board->tick.seq > 0 ? board->tick.time : 0));
    for (size_t i = 0; i < board->e.n_alarms; i++) {
        json_add(t, "{alarm:%s", board->e.alarm[i].name);
        alarm_stands_members(&board->at[i], store, t);
        alarm_described_members(&board->e.alarm[i], t);
        json_add(t, "}");
    }
    json_add(t, "]");
}

/* Its alarms are those that were described then: none of them is the desk's. */
static void alarms_then(struct request *r, struct apc_store *store)
{
    struct desk desk = {.mutex = PTHREAD_MUTEX_INITIALIZER};
    struct apc_store *past = request_past(r, store);
    if (past && take_marked_desk(&desk, r, past)) {
        json_add(&r->reply, "{");
        past_members(past, &r->reply);
        alarms_json(&desk.board, past, &r->reply);
        json_add(&r->reply, "}");
    }
    if (past)
        give_desk_back(&desk);
    alarm_summary_close(&desk.board);
    apc_store_close(past);
}

void get_alarms(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct desk *desk = &ui->desk[DESK_PAST];
    if (request_query(r, "at")) {
        alarms_then(r, store);
        return;
    }
    if (take_marked_desk(desk, r, store)) {
        json_add(&r->reply, "{t:%.6jd", apc_clock_utc(NULL));
        alarms_json(&desk->board, store, &r->reply);
        json_add(&r->reply, "}");
    }
    give_desk_back(desk);
}

/* ---- Journal ------------------------------------------------------------------------------ */

static void transition_json(const struct experiment *e, const struct alarm_transition *tr,
                            struct apc_store *store, struct text *t)
{
    const struct alarm *alarm = &e->alarm[tr->alarm - 1];
    json_add(t, "{number:%jd, time:%.6jd, alarm:%s, priority:%d, raised:%i, state:%s, before:%s", tr->number,
             json_some(tr->time), alarm->name, alarm->is.priority, alarm_is_raised(tr),
             apc_alarm_state_name(tr->state), apc_alarm_state_name(tr->before));
    alarm_author_member(store, tr->author, t);
    json_add(t, "}");
}

/* Words, each of which it has somewhere. */
static bool has_words(const struct alarm *alarm, const char *words)
{
    while (words && *(words += strspn(words, " ")) != '\0') {
        char word[APC_TAG_LEN * 2];
        const size_t n = strcspn(words, " ");
        snprintf(word, sizeof word, "%.*s", (int)n, words);
        if (!strcasestr(alarm->name, word) && !strcasestr(alarm->message, word) &&
            !strcasestr(alarm->area, word) && !strcasestr(apc_alarm_kind_name(alarm->is.kind), word))
            return false;
        words += n;
    }
    return true;
}

/* Or below it. */
static bool is_in_area(const struct alarm *alarm, const char *area)
{
    const size_t n = area ? strlen(area) : 0;
    return n == 0 || (strncmp(alarm->area, area, n) == 0 && (alarm->area[n] == '/' || !alarm->area[n]));
}

static bool query_priorities(struct request *r, unsigned *priorities)
{
    const char *text = request_query(r, "priority");
    bool ok = true;
    *priorities = text ? 0 : ~0u;
    while (text && ok) {
        ok = *text >= '1' && *text <= '4' && (!text[1] || (text[1] == ',' && text[2]));
        if (ok)
            *priorities |= 1u << (*text - '0');
        text = ok && text[1] ? text + 2 : NULL;
    }
    return ok || fault_set(&r->fault, 400, "parameter", "priority",
                           "\"priority\" must be 1, 2, 3 or 4, or several of them with commas between");
}

/* Whether the condition is there or not. */
static bool query_states(struct request *r, uint32_t *states)
{
    const char *text = request_query(r, "state");
    const size_t n = text ? strlen(text) : 0;
    for (int state = 1; text && state < APC_ALARM_STATES; state++) {
        const char *name = apc_alarm_state_name((enum apc_alarm_state)state);
        if (name && strncmp(name, text, n) == 0 && (!name[n] || strcmp(name + n, ", Active") == 0))
            *states |= UINT32_C(1) << state;
    }
    return !text || *states ||
           fault_set(&r->fault, 400, "parameter", "state",
                     "\"state\" must be the name of a state, as Unacknowledged Active");
}

/* Of the experiment's alarms those that are asked for; s->of to be freed. False: the fault is set. */
static bool query_search(struct request *r, const struct experiment *e, struct alarm_search *s)
{
    const char *text = request_query(r, "text"), *area = request_query(r, "area");
    unsigned priorities;
    if (!query_priorities(r, &priorities) || !query_states(r, &s->states) ||
        !query_whole(r, "before", 1, APC_SEQ_MAX, &s->before))
        return false;
    if (text && strlen(text) > SEARCH_MOST)
        return fault_set(&r->fault, 422, "parameter", "text", "\"text\" must have at most %d bytes",
                         SEARCH_MOST);
    s->of = calloc(e->n_alarms + 1, sizeof *s->of);
    for (size_t i = 0; s->of && i < e->n_alarms; i++) {
        const struct alarm *alarm = &e->alarm[i];
        s->of[i] =
            (priorities >> alarm->is.priority & 1) && is_in_area(alarm, area) && has_words(alarm, text);
    }
    return s->of || fault_set(&r->fault, 503, "busy", NULL, "out of memory");
}

static bool journal_range(struct request *r, struct apc_range *range)
{
    const apc_ns now = apc_clock_utc(NULL);
    int64_t last = JOURNAL_LAST;
    if (!query_time(r, "since", now, &range->since) || !query_time(r, "until", now, &range->until) ||
        !query_whole(r, "last", 1, JOURNAL_MAX, &last))
        return false;
    range->last = (size_t)last;
    return range->until == 0 || range->since < range->until ||
           fault_set(&r->fault, 422, "parameter", "since", "\"since\" must be before \"until\"");
}

static void journal_page_json(const struct experiment *e, const struct alarm_journal *j, size_t most,
                              struct apc_store *store, struct text *t)
{
    const size_t first = j->n > most ? j->n - most : 0;
    json_add(t, "{t:%.6jd, transitions:[", apc_clock_utc(NULL));
    for (size_t i = first; i < j->n; i++)
        transition_json(e, &j->at[i], store, t);
    json_add(t, "]");
    if (first > 0)
        json_add(t, "next:{before:%jd, until:%.6jd}", j->at[first].number, j->at[first].time + APC_NS_PER_US);
    else
        json_add(t, "next:null");
    json_add(t, "}");
}

void get_alarm_journal(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct desk *desk = &ui->desk[DESK_PAST];
    struct alarm_journal journal = {0};
    struct alarm_search search = {0};
    struct apc_range range = {0};
    if (!journal_range(r, &range))
        return;
    const size_t most = range.last++; /* one more says that there are more */
    const struct experiment *e = &desk->board.e;
    const bool ok = take_desk(desk, r, store) && query_search(r, e, &search);
    const int rc = ok ? alarm_journal_find(&journal, store, e->n_alarms, &range, &search) : 0;
    if (rc == APC_ERANGE)
        fault_set(&r->fault, 422, "parameter", "state",
                  "more than %d transitions to search: choose a shorter window", ALARM_SEARCH_MOST);
    else if (rc < 0)
        fault_store(r, rc, store);
    else if (ok)
        journal_page_json(e, &journal, most, store, &r->reply);
    free(search.of);
    alarm_journal_free(&journal);
    give_desk_back(desk);
}

/* ---- Figures ------------------------------------------------------------------------------- */

static void each_json(const struct alarm_figures *f, const struct experiment *e, struct text *t)
{
    json_add(t, "alarms:[");
    for (size_t i = 0; i < f->n; i++) {
        const struct alarm_figure *one = &f->alarm[i];
        if (one->raised > 0 || one->since != 0)
            json_add(t, "{id:%zu, alarm:%s, raised:%zu, chatters:%i, active:%.9jd, since:%.6jd}", i + 1,
                     e->alarm[i].name, one->raised, one->chatters, one->active, json_some(one->since));
    }
    json_add(t, "]");
}

static void figures_of(const struct alarm_figures *f, const struct experiment *e, struct text *t)
{
    json_add(t, "hours:%g, raised:%zu, by_priority:[%zu, %zu, %zu, %zu], per_hour:%g", f->hours, f->raised,
             f->by_priority[0], f->by_priority[1], f->by_priority[2], f->by_priority[3], f->per_hour);
    json_add(t, "most_in_ten_minutes:%zu, floods:%zu, windows:%zu, chattering:%zu, standing:%zu, stale:%zu",
             f->peak, f->floods, f->windows, f->chattering, f->standing, f->stale);
    json_add(t, "unacknowledged:%zu, to_acknowledge:%g", f->unacked, f->to_acknowledge); /* null: none was */
    each_json(f, e, t);
}

/* From when on there is a record within the range: figures are of that, and not of the time before it. */
static apc_ns recorded_since(struct model *m, const struct alarm_journal *j, const struct apc_range *range)
{
    pthread_mutex_lock(&m->mutex);
    apc_ns begin = m->plant.start;
    pthread_mutex_unlock(&m->mutex);
    if (j->n > 0 && (begin == 0 || j->at[0].time < begin)) /* of a run before, or nobody knows */
        begin = j->at[0].time;
    return begin > range->since && begin < range->until ? begin : range->since;
}

void get_alarm_figures(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct desk *desk = &ui->desk[DESK_PAST];
    struct alarm_journal journal = {0};
    struct alarm_figures figures = {0};
    struct apc_range range = {0};
    if (!query_range(r, FIGURES_BACK, FIGURES_MOST, &range.since, &range.until))
        return;
    const bool ok = take_desk(desk, r, store);
    const struct experiment *e = &desk->board.e;
    int rc = ok ? alarm_journal_load(&journal, store, e->n_alarms, &range) : 0;
    if (ok && rc == 0) {
        range.since = recorded_since(&ui->model, &journal, &range);
        rc = alarm_figures_make(&figures, &journal, e, range.since, range.until);
    }
    if (rc < 0)
        fault_store(r, rc, store);
    if (ok && rc == 0) {
        json_add(&r->reply, "{");
        range_json(&r->reply, range.since, range.until);
        figures_of(&figures, e, &r->reply);
        json_add(&r->reply, "}");
    }
    alarm_figures_free(&figures);
    alarm_journal_free(&journal);
    give_desk_back(desk);
}

/* ---- Other settings ------------------------------------------------------------------------ */

static void fault_trial(struct request *r, int rc, const struct apc_error *why)
{
    if (rc == APC_EINVAL || rc == APC_ENOTFOUND || rc == APC_ETIMEDOUT)
        fault_set(&r->fault, 422, "trial", NULL, "%s", why->text);
    else
        fault_set(&r->fault, 503, "store", NULL, "the database is offline: %.150s", why->text);
}

static void try_settings_json(struct request *r, const struct alarm_summary *board,
                              const struct alarm_now *now, const struct apc_range *range,
                              struct apc_store *store)
{
    const struct alarm *alarm = alarm_summary_alarm(board, now);
    const apc_ns ticked = board->tick.seq > 0 ? board->tick.time : 0;
    struct alarm_trial trial;
    struct apc_error why;
    const int rc = alarm_trial_make(&trial, store, &board->e, alarm, ticked, range,
                                    apc_clock_mono(NULL) + TRIAL_PATIENCE, &why);
    if (rc < 0)
        fault_trial(r, rc, &why);
    else {
        json_add(&r->reply, "{t:%.6jd", apc_clock_utc(NULL));
        alarm_trial_members(&trial, alarm->name, &r->reply);
        json_add(&r->reply, "}");
    }
    alarm_trial_free(&trial);
}

void get_alarm_trial(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct desk *desk = &ui->desk[DESK_TRIAL];
    const char *name = request_query(r, "alarm");
    struct apc_range range = {0};
    if (!name) {
        fault_set(&r->fault, 400, "parameter", "alarm", "\"alarm\" is needed: the name of an alarm");
        return;
    }
    if (!query_range(r, FIGURES_BACK, FIGURES_MOST, &range.since, &range.until))
        return;
    if (take_desk(desk, r, store)) {
        const struct alarm_now *now =
            desk->board.e.n_alarms > 0 ? alarm_summary_find(&desk->board, name) : NULL;
        if (now)
            try_settings_json(r, &desk->board, now, &range, store);
        else
            fault_set(&r->fault, 404, "alarm", "alarm", "there is no alarm \"%.63s\"", name);
    }
    give_desk_back(desk);
}

/* ---- What is wanted ------------------------------------------------------------------------ */

struct order {
    struct write write;
    struct change change;
    enum apc_alarm_switch which;
    double value; /* of APC_ALARM_SHELF and APC_ALARM_SERVICE */
    int64_t seq;  /* of the alarm's row that was seen */
    char reason[REASON_LEN];
};

static bool read_end(struct request *r, const json_t *body, struct order *o)
{
    const json_t *once = json_object_get(body, "once");
    int64_t until;
    if (!member_whole(body, "until", 0, UNTIL_MAX, &until, &r->fault))
        return false;
    if (once && !json_is_boolean(once))
        return fault_set(&r->fault, 400, "json", "once", "\"once\" must be true or false");
    o->value = json_is_true(once) ? -(double)until : (double)until;
    return true;
}

static bool read_out(struct request *r, const json_t *body, struct order *o)
{
    const json_t *out = json_object_get(body, "out");
    if (!json_is_boolean(out))
        return fault_set(&r->fault, 400, "json", "out", "\"out\" must be true or false");
    o->value = json_is_true(out);
    return true;
}

static bool read_alarm_order(struct request *r, struct order *o)
{
    static const char *const ack[] = {"seq", "reason", "key", NULL};
    static const char *const shelve[] = {"until", "once", "seq", "reason", "key", NULL};
    static const char *const service[] = {"out", "seq", "reason", "key", NULL};
    json_t *body = body_parse(r->body, r->n,
                              o->which == APC_ALARM_ACK     ? ack
                              : o->which == APC_ALARM_SHELF ? shelve
                                                            : service,
                              &r->fault);
    const bool ok =
        body && request_key(r, body, o->write.key) &&
        member_whole(body, "seq", 0, APC_SEQ_MAX, &o->seq, &r->fault) && request_reason(r, body, o->reason) &&
        (o->which == APC_ALARM_ACK || (o->which == APC_ALARM_SHELF ? read_end : read_out)(r, body, o));
    json_decref(body);
    return ok;
}

static bool stale(struct request *r, const struct alarm_now *now, const struct alarm *alarm)
{
    char ref[REF_LEN];
    json_add(&r->extra, "current:{%s:", ref_format(APC_ALARM, now->row->id, ref));
    json_sample_add(&r->extra, now->row);
    json_add(&r->extra, "}");
    return fault_set(&r->fault, 409, "stale", NULL, "%s was changed meanwhile: it is %s now", alarm->name,
                     apc_alarm_state_name(alarm_summary_state(now)));
}

#define OUTCOME_UNKNOWN ", outcome unknown"

/* As snprintf(). */
static int words_of_order(const struct request *r, const struct order *o, const char *outcome, char *text,
                          size_t size)
{
    char what[192];
    alarm_summary_words(r->name, &o->change.after, NULL, what, sizeof what);
    return snprintf(text, size, "%s%s (from %s)%s%s", what, outcome, r->from->address,
                    o->reason[0] ? ": " : "", o->reason);
}

/* Of the event, for all of the reason? */
static bool reason_has_room(struct request *r, const struct order *o)
{
    char event[192];
    const int had = (int)strlen(o->reason),
              over = words_of_order(r, o, OUTCOME_UNKNOWN, event, sizeof event) - (int)sizeof event + 1;
    return had == 0 || over <= 0 ||
           fault_set(&r->fault, 422, "value", "reason",
                     "\"reason\" must have at most %d bytes beside the other words of its event, %.90s: "
                     "shorten it",
                     had - over, r->name);
}

/* May it be, as the alarm stands? Who acknowledges what has gone again since he looked means the same one:
 * whether it is, its evaluation says. */
static bool check_alarm_now(struct request *r, const struct alarm_summary *board, const struct alarm_now *now,
                            struct order *o, struct apc_store *store)
{
    const struct alarm *alarm = alarm_summary_alarm(board, now);
    const bool shelves = o->which == APC_ALARM_SHELF && (o->value < 0 || o->value > 0);
    struct apc_sample wanted;
    struct apc_error why;
    if (!alarm_summary_lives(board, o->write.time))
        return fault_set(&r->fault, 409, "alarm", NULL,
                         "apc-alarms does not run, so this would have no effect: nothing was written");
    if (o->seq > now->row->seq || (o->which != APC_ALARM_ACK && o->seq < now->row->seq))
        return stale(r, now, alarm);
    if (shelves && !alarm_summary_may_shelve(board, now, o->value, o->write.time, &why))
        return fault_set(&r->fault, 422, "limits", "until", "%s", why.text);
    if (!alarm_summary_want(board, now, store, o->which, o->value, o->write.time, &wanted, &why))
        return fault_set(&r->fault, 409, "alarm", NULL, "%s", why.text);
    wanted.value = o->change.after.value;
    o->change.after = wanted;
    return reason_has_room(r, o);
}

static void record_alarm_write(struct ui *ui, const struct request *r, const struct order *o,
                               struct apc_store *store, const char *outcome)
{
    struct apc_event event = {.time = o->write.time, .severity = APC_EVENT_INFO, .kind = "operator"};
    snprintf(event.source, sizeof event.source, "%s", o->write.user);
    if (words_of_order(r, o, outcome, event.text, sizeof event.text) > 0)
        audit(ui, store, &event);
}

static void end_alarm_write(struct ui *ui, struct request *r, struct order *o, enum write_state state,
                            int stored)
{
    struct text t = {0};
    const struct write ended = {.state = state, .stored = stored, .n = 1, .change = &o->change};
    writes_end(ui->writes, o->write.key, &ended, r->fault.http ? r->fault.message : "", apc_clock_plant(),
               &t);
    if (r->fault.http == 0) {
        r->reply = t;
        return;
    }
    if (state == WRITE_UNKNOWN)
        json_add(&r->extra, "write:%.*s", (int)t.n, t.at);
    text_free(&t);
}

static void carry_out_alarm(struct ui *ui, struct request *r, const struct alarm_summary *board,
                            const struct alarm_now *now, struct order *o, struct apc_store *store)
{
    struct apc_sample *after = &o->change.after;
    int rc = o->write.user[0] ? apc_store_author(store, o->write.user) : 0;
    if (rc < 0)
        fault_store(r, rc, store);
    if (rc < 0 || fault_history(r, store) || !check_alarm_now(r, board, now, o, store)) {
        end_alarm_write(ui, r, o, WRITE_FAILED, 0);
        return;
    }
    after->author = (uint32_t)rc;
    rc = apc_store_swap(store, after, 1);
    const bool unknown = rc == APC_ECONN || rc == APC_ETIMEDOUT;
    if (rc == APC_ECONFLICT)
        fault_set(&r->fault, 409, "stale", NULL,
                  "%s: another user changed it first, and nothing was written: look again", r->name);
    else if (unknown)
        fault_set(&r->fault, 504, "unknown", NULL,
                  "the database did not answer: whether it was written is not known");
    else if (rc < 0)
        fault_set(&r->fault, 503, "store", NULL, "the database refused it: %.150s", apc_store_error(store));
    after->seq += unknown; /* what it would have been given */
    end_alarm_write(ui, r, o,
                    rc >= 0   ? WRITE_ACCEPTED
                    : unknown ? WRITE_UNKNOWN
                              : WRITE_FAILED,
                    rc >= 0   ? 1
                    : unknown ? -1
                              : 0);
    if (rc >= 0 || unknown)
        record_alarm_write(ui, r, o, unknown ? NULL : store, unknown ? OUTCOME_UNKNOWN : "");
}

/* Who evaluates alarms is no controller. */
static const struct plant_view nobodys = {.loops = &(const struct loops){0}};

static void begin_alarm_write(struct ui *ui, struct request *r, const struct alarm_summary *board,
                              struct order *o, struct apc_store *store)
{
    const struct alarm_now *now = board->e.n_alarms > 0 ? alarm_summary_find(board, r->name) : NULL;
    if (!now) {
        fault_set(&r->fault, 404, "alarm", NULL, "there is no alarm \"%.63s\"", r->name);
        return;
    }
    if (!request_may_write(ui, r))
        return;
    const struct apc_sample *wanted = now->request[ALARM_SWITCH(o->which)];
    struct change_target to = {.table = wanted->table, .id = wanted->id};
    snprintf(to.name, sizeof to.name, "%s", r->name);
    change_make(&nobodys, &to, 0, &o->change);
    o->change.before = o->change.after = *wanted;
    o->change.after.value = o->which == APC_ALARM_ACK ? (double)o->seq : o->value;
    if (request_begin(ui, r, &o->write, store))
        carry_out_alarm(ui, r, board, now, o, store);
}

static void want_alarm_switch(struct ui *ui, struct request *r, struct apc_store *store,
                              enum apc_alarm_switch which)
{
    struct desk *desk = &ui->desk[DESK_WRITES];
    struct order o = {.which = which,
                      .write = {.kind = which == APC_ALARM_ACK     ? WRITE_ACK
                                        : which == APC_ALARM_SHELF ? WRITE_SHELVE
                                                                   : WRITE_SERVICE,
                                .time = apc_clock_utc(NULL) / APC_NS_PER_US * APC_NS_PER_US,
                                .n = 1}};
    o.write.change = &o.change;
    memcpy(o.write.user, r->session.user, sizeof o.write.user);
    if (!read_alarm_order(r, &o))
        return;
    if (take_desk(desk, r, store))
        begin_alarm_write(ui, r, &desk->board, &o, store);
    give_desk_back(desk);
}

void post_alarm_ack(struct ui *ui, struct request *r, struct apc_store *store)
{
    want_alarm_switch(ui, r, store, APC_ALARM_ACK);
}

void post_alarm_shelve(struct ui *ui, struct request *r, struct apc_store *store)
{
    want_alarm_switch(ui, r, store, APC_ALARM_SHELF);
}

void post_alarm_service(struct ui *ui, struct request *r, struct apc_store *store)
{
    want_alarm_switch(ui, r, store, APC_ALARM_SERVICE);
}
