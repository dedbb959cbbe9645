/* SPDX-License-Identifier: BSD-3-Clause */
/* Why an output moved, as it is told: of a run folder or a store, with who wrote what, upwards from loop to loop. */
#include "simulation.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "files/files.h"

#define DEPTH 4 /* loops above one another that are followed */
#define LEAD  2 /* ticks before those of a move: what is read of a store at first */
#define MORE  8 /* as many times as many, where these do not tell */
#define MOST  1024

/* ---- Words ----------------------------------------------------------------------------------- */

const char *why_kind_name(enum why_kind kind)
{
    static const char *const name[] = {[WHY_SETPOINT] = "setpoint",
                                       [WHY_MEASUREMENT] = "measurement",
                                       [WHY_DISTURBANCE] = "disturbance",
                                       [WHY_TUNING] = "tuning",
                                       [WHY_MODE] = "mode",
                                       [WHY_MANUAL] = "manual output",
                                       [WHY_BELOW] = "loop below",
                                       [WHY_ABOVE] = "loop above",
                                       [WHY_ACTING] = "promoted",
                                       [WHY_LAW] = "law"};
    return name[kind];
}

const char *why_state_name(enum apc_loop_state state)
{
    static const char *const name[APC_LOOP_END] = {
        [APC_LOOP_OOS] = "OOS",       [APC_LOOP_MAN] = "Man",           [APC_LOOP_AUTO] = "Auto",
        [APC_LOOP_CAS] = "Cas",       [APC_LOOP_INIT] = "IMan",         [APC_LOOP_HOLD] = "held",
        [APC_LOOP_BACKUP] = "backup", [APC_LOOP_FAULT] = "fault value", [APC_LOOP_SHADOW] = "shadow"};
    return state > 0 && state < APC_LOOP_END ? name[state] : "none";
}

const char *why_cause_name(const struct why *w, const struct why_cause *cause)
{
    return cause->tag ? cause->tag->name : w->by->of->name;
}

/* ---- Who wrote it ---------------------------------------------------------------------------- */

static bool begins_with(const char *text, const struct apc_tag *tag)
{
    const size_t n = tag ? strlen(tag->name) : 0;
    return n > 0 && strncmp(text, tag->name, n) == 0 && (text[n] == ':' || text[n] == ' ' || text[n] == '.');
}

/* "mode: Auto -> Man" of all loops, "base mode: ..." of those of a controller. */
static bool is_of_modes(const struct replay *r, const char *text)
{
    bool is = strncmp(text, "mode: ", 6) == 0;
    for (size_t i = 0; i < r->e.n_controllers && !is; i++) {
        const size_t n = strlen(r->e.controllers[i].name);
        is = strncmp(text, r->e.controllers[i].name, n) == 0 && strncmp(text + n, " mode: ", 7) == 0;
    }
    return is;
}

/* An output that is moved by hand is called as the output is, or as the variable that it is written to. */
static bool is_of_cause(const struct replay *r, const char *kind, const char *text,
                        const struct why_cause *cause)
{
    return strcmp(kind, "operator") == 0 &&
           (begins_with(text, cause->tag) || begins_with(text, cause->moves) ||
            (cause->kind == WHY_MODE && is_of_modes(r, text)));
}

struct author_search {
    const struct replay *replay;
    const struct why_cause *cause;
    struct why_author *author;
};

static int take_author(void *ctx, const struct apc_event *event)
{
    const struct author_search *s = ctx;
    if (!is_of_cause(s->replay, event->kind, event->text, s->cause))
        return 0;
    snprintf(s->author->source, sizeof s->author->source, "%s", event->source);
    snprintf(s->author->text, sizeof s->author->text, "%s", event->text);
    return 1; /* what else the write did, as to take a setpoint from the scheduler, follows */
}

/* The row itself says who; the event, where there is one at its time, says why too. */
static int find_author_in_store(const struct why_question *q, const struct why_cause *cause,
                                struct why_author *author, struct apc_error *why)
{
    struct apc_store *store = q->store;
    const struct apc_range range = {.since = cause->row->time - APC_NS_PER_US,
                                    .until = cause->row->time + APC_NS_PER_US};
    struct author_search search = {q->replay, cause, author};
    char name[APC_AUTHOR_LEN] = "";
    const int rc = apc_store_events(store, &range, take_author, &search);
    if (rc < 0)
        return apc_fail(why, rc, "%s", apc_store_error(store));
    if (cause->row->author > 0 && apc_store_author_name(store, cause->row->author, name) >= 0 && name[0])
        snprintf(author->source, sizeof author->source, "%s", name);
    return 0;
}

static int find_author_in_folder(const struct why_question *q, const struct why_cause *cause,
                                 struct why_author *author, struct apc_error *why)
{
    char path[600];
    struct csv *csv;
    int rc = 0;
    snprintf(path, sizeof path, "%.580s/events.csv", q->dir);
    if (csv_open(&csv, path, why) < 0)
        return 0;
    const double at = apc_ns_to_s(cause->row->time - q->replay->start);
    while (!author->source[0] && csv_expect(csv, "time,severity,source,kind,text", why) == 0 &&
           (rc = csv_next(csv, why)) > 0) {
        double t;
        if (!is_of_cause(q->replay, csv_text(csv, 3), csv_text(csv, 4), cause) ||
            csv_number(csv, 0, &t, why) < 0 || fabs(t - at) > 1e-6)
            continue;
        snprintf(author->source, sizeof author->source, "%s", csv_text(csv, 2));
        snprintf(author->text, sizeof author->text, "%s", csv_text(csv, 4));
    }
    csv_close(csv);
    return rc < 0 ? rc : 0;
}

int why_find_author(const struct why_question *q, const struct why_cause *cause, struct why_author *author,
                    struct apc_error *why)
{
    *author = (struct why_author){{0}, {0}};
    if (!cause->row || !cause->tag)
        return 0;
    return q->dir ? find_author_in_folder(q, cause, author, why)
                  : find_author_in_store(q, cause, author, why);
}

/* ---- The move -------------------------------------------------------------------------------- */

/* Only what the move needs is read: more where it does not come out of that. */
int why_ask(struct why *w, const struct why_question *q, struct apc_error *why)
{
    struct replay_part part = {.store = q->store,
                               .dir = q->dir,
                               .loop = q->loop,
                               .over = q->over,
                               .until = q->at,
                               .lead = LEAD,
                               .built_in = q->built_in,
                               .simulated = q->simulated};
    const apc_ns from = q->over > 0 ? q->at - q->over : q->at;
    int rc = APC_ESTATE;
    *w = (struct why){0};
    for (bool more = true; rc == APC_ESTATE && more && (q->dir || part.lead <= MOST); part.lead *= MORE) {
        why_free(w);
        replay_free(q->replay);
        rc = replay_load_part(q->replay, &part, why);
        q->replay->give_up = q->give_up;
        if (rc == 0)
            rc = why_find(w, q->replay, q->loop, from, q->at, why);
        more = q->replay->more && !w->restarted;
    }
    return rc;
}

const struct why_cause *why_moved_above(const struct why *w, const struct why_question *q)
{
    for (size_t i = 0; i < w->n && q->depth < DEPTH; i++)
        if (w->cause[i].effect != 0 && why_above(q->replay, &w->cause[i]))
            return &w->cause[i];
    return NULL;
}

struct why_question why_question_above(const struct why_question *q, const struct why_cause *moved,
                                       char loop[APC_TAG_LEN])
{
    struct why_question above = *q;
    snprintf(loop, APC_TAG_LEN, "%s", why_above(q->replay, moved));
    above.loop = loop;
    above.at = moved->row->time;
    above.depth++;
    return above;
}

/* ---- For programs ---------------------------------------------------------------------------- */

static double when_number(const struct why_question *q, apc_ns time)
{
    return apc_ns_to_s(q->replay->of_store ? time : time - q->replay->start);
}

static int cause_json(const struct why_question *q, const struct why *w, const struct why_cause *cause,
                      struct text *t, struct apc_error *why)
{
    char before[APC_STATUS_NAME_LEN], status[APC_STATUS_NAME_LEN];
    struct why_author author;
    const int rc = why_find_author(q, cause, &author, why);
    json_add(t, "{input:%s, kind:%s, unit:%s, before:%g, now:%g, status_before:%s, status:%s",
             why_cause_name(w, cause), why_kind_name(cause->kind), cause->tag ? cause->tag->unit : "",
             cause->before, cause->now, apc_status_format(cause->status_before, before),
             apc_status_format(cause->status, status));
    json_add(t, "written:%g, author:%-s, event:%-s, effect:%g}",
             cause->row ? when_number(q, cause->row->time) : (double)NAN, author.source, author.text,
             cause->effect);
    return rc < 0 ? rc : 0;
}

static int move_json(const struct why_question *q, const struct why *w, struct text *t, struct apc_error *why)
{
    int rc = 0;
    json_add(t, "output:%s, controller:%s, unit:%s, from:%g, time:%g, before:%g, now:%g", w->loop,
             w->by->of->name, w->output ? w->output->unit : NULL, when_number(q, w->before->time),
             when_number(q, w->tick->time), w->u_before, w->u);
    json_add(t, "state_before:%s, state:%s, reason:%-s, low:%e, high:%e, earlier:%g, together:%g, terms:[",
             why_state_name(w->state_before), why_state_name(w->state), w->reason, w->low, w->high,
             w->earlier, w->together);
    for (size_t i = 0; i < w->n_terms; i++)
        json_add(t, "{term:%s, of:%-s, before:%g, now:%g}", w->term[i].name, w->term[i].of, w->term[i].before,
                 w->term[i].now);
    json_add(t, "], inputs:[");
    for (size_t i = 0; i < w->n && rc == 0; i++)
        rc = cause_json(q, w, &w->cause[i], t, why);
    json_add(t, "]");
    return rc;
}

static int above_json(const struct why_question *q, const struct why *w, struct text *t,
                      struct apc_error *why)
{
    const struct why_cause *moved = why_moved_above(w, q);
    char loop[APC_TAG_LEN];
    if (!moved)
        return 0;
    const struct why_question above = why_question_above(q, moved, loop);
    json_add(t, "above:{");
    const int rc = why_json(&above, t, why);
    json_add(t, "}");
    return rc;
}

int why_json(const struct why_question *q, struct text *t, struct apc_error *why)
{
    struct why w;
    int rc = why_ask(&w, q, why);
    if (rc == 0) {
        rc = move_json(q, &w, t, why);
        rc = rc == 0 ? above_json(q, &w, t, why) : rc;
    } else if (q->depth > 0 && rc != APC_ENOMEM) {
        json_add(t, "output:%s, error:%s", q->loop, why->text);
        rc = 0;
    }
    why_free(&w);
    return rc;
}
