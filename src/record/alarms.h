/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What alarms did: the journal of a store, all transitions in their order, and the figures by which
 * ANSI/ISA-18.2 (16.) and EEMUA 191 judge how many there are.
 */
#ifndef APC_RUN_ALARMS_H
#define APC_RUN_ALARMS_H

#include "experiment/experiment.h"

#define ALARMS_WINDOW         (600 * APC_NS_PER_S) /* alarms are counted by ten minutes */
#define ALARMS_FLOOD          10                   /* more in one: nobody can follow */
#define ALARMS_CHATTER        3                    /* one alarm so often within: */
#define ALARMS_CHATTER_WINDOW (60 * APC_NS_PER_S)
#define ALARMS_STALE          (86400 * APC_NS_PER_S) /* standing for longer */

struct alarm_transition {
    int64_t number, seq; /* in the journal; of its row */
    apc_ns time;
    int alarm;
    enum apc_alarm_state before, state; /* before 0: not known */
    apc_status status;
    uint32_t author;
};

struct alarm_journal {
    struct alarm_transition *at; /* [n] by number */
    size_t n;
};

/* Those of alarms 1 .. @n in the range, whose `last` is of all of them together. Returns 0, APC_ENOMEM or the
 * store's error; alarm_journal_free() in either case. */
int alarm_journal_load(struct alarm_journal *journal, struct apc_store *store, size_t n,
                       const struct apc_range *range);
void alarm_journal_free(struct alarm_journal *journal);

/* Is an alarm raised by it: shown to operators as new? */
bool alarm_is_raised(const struct alarm_transition *t);

/* Of a new row of table alarm: the event that it is raised. Returns false where it is not, or is another row.
 */
bool alarm_event(const struct experiment *e, const struct apc_sample *row, struct apc_event *event);

/* Of one alarm. */
struct alarm_figure {
    size_t raised;
    apc_ns first;  /* time, when it was raised first; 0: it was not */
    apc_ns active; /* for how long it was active, masked or not */
    apc_ns since;  /* from when on it has been standing; 0: it is not */
    bool chatters;
    enum apc_alarm_state state; /* at the end */
};

struct alarm_figures {
    struct alarm_figure *alarm; /* [n] */
    size_t n;
    double hours;
    size_t raised, by_priority[APC_ALARM_PRIORITIES];
    double per_hour;
    size_t windows, floods, peak; /* of ten minutes: how many, those with a flood, the most in one */
    size_t chattering, standing, stale, unacked;
    size_t acknowledged;
    double to_acknowledge; /* s, mean; NAN: none was */
};

/* Of a journal that reaches from @since to @until. Returns 0 or APC_ENOMEM; alarm_figures_free() in either
 * case.
 */
int alarm_figures_make(struct alarm_figures *figures, const struct alarm_journal *journal,
                       const struct experiment *e, apc_ns since, apc_ns until);
void alarm_figures_free(struct alarm_figures *figures);

#endif
