/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcalarm.h
 * Alarms: the states of ANSI/ISA-18.2 (IEC 62682) with what OPC UA Part 9 says of each, and the core that
 * evaluates the alarms of a plant. docs/alarms.md is about using them.
 */
#ifndef APCALARM_H
#define APCALARM_H

#include "apcmodules.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- States ------------------------------------------------------------------------------- */

/**
 * The state of an alarm; the letters are those of ISA-18.2. The last eight come in pairs, the second one
 * while the condition that is alarmed of is there. The numbers stand in stores.
 */
enum apc_alarm_state {
    APC_ALARM_NORMAL = 1,      /**< A */
    APC_ALARM_UNACKED,         /**< B: active, unacknowledged */
    APC_ALARM_ACKED,           /**< C: active, acknowledged */
    APC_ALARM_RETURNED,        /**< D: returned to normal, unacknowledged */
    APC_ALARM_LATCHED_UNACKED, /**< E: of one that latches: returned, unacknowledged */
    APC_ALARM_LATCHED,         /**< F: of one that latches: returned, acknowledged, to be reset */
    APC_ALARM_SHELVED,         /**< G: by an operator, until a time */
    APC_ALARM_SHELVED_ACTIVE,
    APC_ALARM_ONE_SHOT, /**< G: until it has returned to normal, or until a time */
    APC_ALARM_ONE_SHOT_ACTIVE,
    APC_ALARM_SUPPRESSED, /**< H: by design */
    APC_ALARM_SUPPRESSED_ACTIVE,
    APC_ALARM_OUT_OF_SERVICE, /**< I */
    APC_ALARM_OUT_OF_SERVICE_ACTIVE,
    APC_ALARM_STATES
};

/** What happens to an alarm. */
enum apc_alarm_event {
    APC_ALARM_COMES = 1, /**< its condition is there, after the delay */
    APC_ALARM_GOES,      /**< and is no more */
    APC_ALARM_ACKNOWLEDGE,
    APC_ALARM_RESET, /**< of one that latches */
    APC_ALARM_SHELVE,
    APC_ALARM_SHELVE_ONCE,
    APC_ALARM_UNSHELVE, /**< by an operator, or the time is up */
    APC_ALARM_SUPPRESS,
    APC_ALARM_UNSUPPRESS,
    APC_ALARM_REMOVE,  /**< from service */
    APC_ALARM_RESTORE, /**< to service */
    APC_ALARM_EVENTS
};

/** The state after that; the same where the event means nothing in it. Total and pure. [tick] */
APC_API enum apc_alarm_state apc_alarm_next(enum apc_alarm_state state, enum apc_alarm_event event,
                                            bool latching);
/* What OPC UA Part 9 calls ActiveState, AckedState (its contrary), LatchedState, SuppressedOrShelved. Of a
 * number that is no state all are false. */
APC_API bool apc_alarm_is_active(enum apc_alarm_state state);  /**< the condition is there. [tick] */
APC_API bool apc_alarm_is_unacked(enum apc_alarm_state state); /**< it waits for an acknowledgement. [tick] */
APC_API bool apc_alarm_is_latched(enum apc_alarm_state state); /**< E or F. [tick] */
APC_API bool
apc_alarm_is_masked(enum apc_alarm_state state); /**< shelved, suppressed, out of service. [tick] */
/** Is it shown to operators: active, unacknowledged or latched, and not masked? [tick] */
APC_API bool apc_alarm_is_standing(enum apc_alarm_state state);
/** "Unacknowledged Active" and so on; NULL for a number that is no state. Static. [any] */
APC_API const char *apc_alarm_state_name(enum apc_alarm_state state);

/* ---- Definitions -------------------------------------------------------------------------- */

/** The numbers stand in no store. */
enum apc_alarm_kind {
    APC_ALARM_LOW_LOW = 1, /**< a signal below its limit */
    APC_ALARM_LOW,
    APC_ALARM_HIGH, /**< above it */
    APC_ALARM_HIGH_HIGH,
    APC_ALARM_DEVIATION, /**< from another signal, by more than the limit */
    APC_ALARM_RATE,      /**< of change, from sample to sample, in units a second */
    APC_ALARM_FROZEN,    /**< no change by more than the deadband */
    APC_ALARM_BAD,       /**< Bad, or no new sample for the horizon */
    APC_ALARM_AT_LIMIT,  /**< at one of its two limits */
    APC_ALARM_MODE,      /**< of a loop: the actual mode is not the target */
    APC_ALARM_STOPPED,   /**< of a controller: no tick for the horizon */
    APC_ALARM_OVERRUN,   /**< of a controller: it missed at least `limit` ticks since the last look */
    APC_ALARM_KINDS
};
/** "high-high" and so on; NULL for another number. Static. [any] */
APC_API const char *apc_alarm_kind_name(enum apc_alarm_kind kind);
/** The kind of that name, or 0. [any] */
APC_API enum apc_alarm_kind apc_alarm_kind_parse(const char *name);

#define APC_ALARM_PRIORITIES 4 /**< 1 is the most urgent */

/** When an alarm is suppressed by design. */
struct apc_alarm_suppression {
    int alarm;            /**< while the condition of that one is there: its number, from 1; 0: none */
    enum apc_table table; /**< or while that signal is below `below` or above `above`; 0: none */
    int id;
    double below, above; /**< -HUGE_VAL, HUGE_VAL: not */
    apc_ns hold;         /**< and for so long after */
};

/** An alarm. Values are in the signal's own unit. */
struct apc_alarm {
    const char *name; /**< borrowed */
    enum apc_alarm_kind kind;
    enum apc_table table;       /**< of the signal; MODE: APC_OPMODE; STOPPED, OVERRUN: APC_TICK */
    int id;                     /**< of the signal; of the loop; of the controller */
    enum apc_table other_table; /**< of DEVIATION, with its id: from what */
    int other;
    double limit;
    double low, high;           /**< of AT_LIMIT */
    double deadband;            /**< so far back from the limit before it returns to normal */
    apc_ns on_delay, off_delay; /**< so long must it be, be gone */
    apc_ns horizon; /**< a signal without a new row for so long is stale; 0: it never is. Required for BAD and
                       STOPPED */
    bool latching;
    int priority; /**< 1 .. APC_ALARM_PRIORITIES */
    struct apc_alarm_suppression suppression;
};

/** Most alarms of a plant: their switches have ids of their own in table opmode. */
#define APC_ALARMS_MAX 4095

/** Requests for alarm number @p alarm, from 1, are rows of table opmode with these ids: */
enum apc_alarm_switch {
    APC_ALARM_ACK = 3,    /**< acknowledged, or if it is latched and acknowledged reset: seq of the newest
                             row of table alarm that was seen */
    APC_ALARM_SHELF = 4,  /**< shelved: until, s UTC; once: minus that; 0: not */
    APC_ALARM_SERVICE = 5 /**< 1 out of service, 0 in service */
};
APC_API int apc_alarm_switch_id(enum apc_alarm_switch which, int alarm); /**< [tick] */

/* ---- Core --------------------------------------------------------------------------------- */

/** Zero means default, but for those marked required. */
struct apc_alarms_options {
    size_t size;
    size_t n;                      /**< required: 1 .. APC_ALARMS_MAX */
    const struct apc_alarm *alarm; /**< [n] required; copied, but for the names */
    int number;                    /**< id of its tick row; required: another than any controller's */
    apc_ns shelve_max;             /**< nothing is shelved for longer; default 8 h */
};

/** Elements of its tick row: how many alarms there are in some states. */
enum apc_alarms_tick {
    APC_ALARMS_JOURNAL = 0, /**< number of the last transition */
    APC_ALARMS_ACTIVE,      /**< standing and active */
    APC_ALARMS_UNACKED,     /**< standing and unacknowledged */
    APC_ALARMS_SHELVED,
    APC_ALARMS_SUPPRESSED,
    APC_ALARMS_OUT_OF_SERVICE,
    APC_ALARMS_STANDING, /**< with the next three: standing ones of priority 1 .. 4 */
    APC_ALARMS_TICK = APC_ALARMS_STANDING + APC_ALARM_PRIORITIES
};

/**
 * The alarms of a plant, alarm number i the one with id i in table alarm. A row of that table is a
 * transition. Its value is the new state, its status the quality of the judged measurement, its author the
 * person who requested it. Its origin is its number in the journal, which counts the transitions of all
 * alarms from 1. An alarm without a row is NORMAL.
 *
 * A request (enum apc_alarm_switch) has its outcome in table actual, as any other.
 *
 * The core knows no store. Around it stands a shell:
 *
 *     if (!apc_alarms_pending(alarms)) {
 *         rc = apc_store_read_rows(store, apc_alarms_in(alarms));
 *         if (rc >= 0)
 *             apc_alarms_compute(alarms, now, &notice);
 *     }
 *     rc = apc_store_append_rows(store, apc_alarms_out(alarms));
 *     if (rc >= 0)
 *         apc_alarms_stored(alarms);
 */
struct apc_alarms;

/** [setup] Returns 0, APC_EINVAL (an option or an alarm that makes no sense; @p why names it), APC_ENOMEM. */
APC_API int apc_alarms_create(struct apc_alarms **alarms, const struct apc_alarms_options *options,
                              struct apc_error *why);
APC_API void apc_alarms_destroy(struct apc_alarms *alarms); /**< NULL is legal. [setup] */

/** The rows to read at each tick, and those that the last tick wrote. They are the core's own memory; leave
 * table and id as they are. [any] */
APC_API struct apc_rows *apc_alarms_in(struct apc_alarms *alarms);
APC_API struct apc_rows *apc_alarms_out(struct apc_alarms *alarms); /**< transitions first. [any] */
/** The rows that a restart continues from. Fill it, then apc_alarms_resume(). [any] */
APC_API struct apc_rows *apc_alarms_former(struct apc_alarms *alarms);
/** Go on from apc_alarms_former() as the store filled it, also where nothing is stored; before the first
 * tick. [setup] */
APC_API void apc_alarms_resume(struct apc_alarms *alarms);

/**
 * Judge apc_alarms_in() and fill apc_alarms_out(). It does nothing while the rows of the last call are not
 * stored. The notice reports a request that is refused; other requests then wait for the next tick. Returns
 * how many transitions there are. [tick]
 */
APC_API int apc_alarms_compute(struct apc_alarms *alarms, struct apc_now now, struct apc_notice *notice);
/** Is there what is made and not stored yet? [tick] */
APC_API bool apc_alarms_pending(const struct apc_alarms *alarms);
/** All rows of apc_alarms_out() are stored. To append them once more is harmless until then. [tick] */
APC_API void apc_alarms_stored(struct apc_alarms *alarms);

#ifdef __cplusplus
}
#endif
#endif
