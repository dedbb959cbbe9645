/* SPDX-License-Identifier: BSD-3-Clause */
/* Alarms as they stand, and what an operator wants of them, as `apc alarm` does it: who waits is Python's. */
#include <apcstore.h>
#include <stdio.h>
#include <stdlib.h>

#include "columns.h"
#include "record/record.h"

struct apc_alarm_summary {
    struct alarm_summary alarms;
};

_Static_assert((int)APC_FATE_WAITING == (int)OUTCOME_WAITING &&
                   (int)APC_FATE_APPLIED == (int)OUTCOME_APPLIED &&
                   (int)APC_FATE_SUPERSEDED == (int)OUTCOME_SUPERSEDED &&
                   (int)APC_FATE_REFUSED == (int)OUTCOME_REFUSED &&
                   (int)APC_FATE_NOBODY == (int)OUTCOME_NOBODY,
               "they are the same");

static int failed(struct apc_store *store, int rc, struct apc_error *why)
{
    return apc_fail(why, rc, "%s", apc_store_error(store));
}

struct apc_alarm_summary *apc_alarm_summary_new(void)
{
    return calloc(1, sizeof(struct apc_alarm_summary));
}

void apc_alarm_summary_free(struct apc_alarm_summary *board)
{
    if (board)
        alarm_summary_close(&board->alarms);
    free(board);
}

int apc_alarm_summary_read(struct apc_alarm_summary *board, struct apc_store *store, struct apc_error *why)
{
    int rc = alarm_summary_open(&board->alarms, store, why);

    if (rc == APC_ENOTFOUND)
        return 0;
    if (rc == 0 && (rc = alarm_summary_read(&board->alarms, store)) < 0)
        rc = failed(store, rc, why);
    return rc < 0 ? rc : (int)board->alarms.e.n_alarms;
}

bool apc_alarm_summary_lives(const struct apc_alarm_summary *board)
{
    return alarm_summary_lives(&board->alarms, apc_clock_utc(NULL));
}

void apc_alarm_summary_at(const struct apc_alarm_summary *board, struct apc_store *store, int i,
                          struct apc_standing *to)
{
    const struct alarm_now *const now = &board->alarms.at[i];
    const struct alarm *const alarm = alarm_summary_alarm(&board->alarms, now);
    const enum apc_alarm_state state = alarm_summary_state(now);

    *to = (struct apc_standing){.name = alarm->name,
                                .area = alarm->area,
                                .message = alarm->message,
                                .consequence = alarm->consequence,
                                .response = alarm->response,
                                .state = apc_alarm_state_name(state),
                                .id = now->row->id,
                                .priority = alarm->is.priority,
                                .active = apc_alarm_is_active(state),
                                .unacknowledged = apc_alarm_is_unacked(state),
                                .standing = apc_alarm_is_standing(state),
                                .seq = now->row->seq,
                                .time = now->row->seq > 0 ? now->row->time : 0,
                                .shelved = alarm_summary_shelved(now),
                                .shelve_max = board->alarms.e.alarms.shelve_max};
    if (now->row->author > 0 && apc_store_author_name(store, now->row->author, to->author) < 0)
        to->author[0] = '\0';
}

/* ---- What is wanted ------------------------------------------------------------------------ */

static int record(const struct apc_demand *d, const struct apc_sample *request, struct apc_store *store,
                  const char *author, const char *comment, struct apc_error *why)
{
    struct apc_event event = {.time = d->time, .severity = APC_EVENT_INFO, .kind = "operator"};
    int rc;

    snprintf(event.source, sizeof event.source, "%.31s", author);
    alarm_summary_words(d->name, request, comment, event.text, sizeof event.text);
    rc = apc_store_append_events(store, &event, 1);
    return rc < 0 ? failed(store, rc, why) : 0;
}

/* Of two who want something of one alarm at once the other one is told. */
static int swap(struct apc_sample *request, struct apc_store *store, struct apc_error *why)
{
    char name[APC_AUTHOR_LEN];
    const int rc = apc_store_swap(store, request, 1);

    if (rc != APC_ECONFLICT)
        return rc < 0 ? failed(store, rc, why) : 0;
    if (request->author == 0 || apc_store_author_name(store, request->author, name) < 0)
        snprintf(name, sizeof name, "somebody else");
    return apc_fail(why, rc, "%s was faster: look again", name);
}

int apc_alarm_summary_want(const struct apc_alarm_summary *board, struct apc_store *store,
                           struct apc_demand *d, const char *author, const char *comment,
                           struct apc_error *why)
{
    const struct alarm_now *const now = alarm_summary_find(&board->alarms, d->name);
    struct apc_sample request;
    int rc;

    d->time = apc_clock_utc(NULL);
    d->period = board->alarms.e.alarms.rhythm.period;
    if (!now)
        return apc_fail(why, APC_ENOTFOUND, "there is no alarm \"%s\"", d->name);
    if (!alarm_summary_want(&board->alarms, now, store, (enum apc_alarm_switch)d->which, d->value, d->time,
                            &request, why))
        return APC_EPERM;
    if (d->which == APC_ALARM_ACK && d->value > 0)
        request.value = d->value;
    d->value = request.value;
    if ((rc = apc_store_author(store, author)) < 0)
        return failed(store, rc, why);
    request.author = (uint32_t)rc;
    if ((rc = swap(&request, store, why)) < 0)
        return rc;
    d->seq = request.seq;
    d->id = request.id;
    return record(d, &request, store, author, comment, why);
}

int apc_alarm_summary_fate(struct apc_alarm_summary *board, struct apc_store *store, struct apc_demand *d,
                           struct apc_error *why)
{
    const struct alarm_now *now;
    const struct apc_sample request = {
        .table = APC_OPMODE, .id = d->id, .seq = d->seq, .time = d->time, .value = d->value};
    const int rc = apc_alarm_summary_read(board, store, why);
    enum outcome fate;

    if (rc < 0)
        return rc;
    if (!(now = alarm_summary_find(&board->alarms, d->name)))
        return OUTCOME_SUPERSEDED;
    fate = alarm_summary_outcome(&board->alarms, now, &request, apc_clock_utc(NULL));
    d->text[0] = '\0';
    if (fate == OUTCOME_REFUSED)
        (void)alarm_summary_refusal(&board->alarms, now, &request, store, d->text, sizeof d->text);
    return (int)fate;
}
