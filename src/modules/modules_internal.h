/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_MODULES_INTERNAL_H
#define APC_MODULES_INTERNAL_H

#include "apcmodules.h"

#include "control/control_internal.h"

/** Vectors of a module are at most this long; a frame holds no more. */
#define APC_VECTOR_MAX 8192

/**
 * Note what came to pass, unless the same tick has already seen something graver: a tick gives one
 * notice, and the operator wants the worst. Returns false when it was not noted for that reason, true also
 * when nobody listens (NULL).
 */
bool apc_note(struct apc_notice *notice, enum apc_notice_kind kind, const char *fmt, ...) APC_PRINTF(3, 4);

/** What comes every @p period has been lost when it is missing for longer than this. */
static inline apc_ns apc_loss_limit(apc_ns period)
{
    return 3 * period + 100 * APC_NS_PER_MS;
}

/** A period that a module may be given: above 0 and at most 366 days, so that no sum of them overflows. */
static inline bool apc_period_ok(apc_ns period)
{
    return period > 0 && period <= INT64_C(366) * 86400 * APC_NS_PER_S;
}

/** Copy limits (NULL: none) of @p n values. APC_EINVAL when one is not a number, or they cross. */
int apc_limits_copy(double *low, double *high, const double *from_low, const double *from_high, size_t n,
                    struct apc_error *why);
/** Copy values (NULL: zeros) to fall back on. APC_EINVAL when one lies outside its limits; @p what names
 * them.
 */
int apc_fallback_copy(double *to, const double *from, const double *low, const double *high, size_t n,
                      const char *what, struct apc_error *why);

/** A sensor and what it remembers. */
struct apc_reading {
    const struct apc_sensor *sensor;
    struct apc_random noise, faulty; /* faulty: of faults */
    apc_ns before;                   /* of its last look */
    double shown;                    /* then */
    bool frozen;                     /* the time of what it shows stands still */
};

/** Check @p n sensors. Returns 0 or APC_EINVAL. */
int apc_sensors_check(const struct apc_sensor *sensor, size_t n, struct apc_error *why);
/** Begin reading sensor number @p i, from 0. [setup] */
void apc_reading_init(struct apc_reading *reading, const struct apc_sensor *sensor, uint64_t seed, size_t i);
/** Does it look at a tick @p t after the first one? [tick] */
bool apc_reading_due(const struct apc_reading *reading, apc_ns t);
/** What it shows at @p t since the first tick, of @p value; *@p status tells how good that is. [tick] */
double apc_reading_take(struct apc_reading *reading, apc_ns t, double value, apc_status *status);

/** Check @p n actuators. Returns 0 or APC_EINVAL. */
int apc_actuators_check(const struct apc_actuator *actuator, size_t n, struct apc_error *why);
/** Where it stands from @p t since the first tick on, which was at @p position since @p before. [tick] */
double apc_actuator_move(const struct apc_actuator *actuator, apc_ns before, apc_ns t, double command,
                         double position);

/**
 * What a loop remembers from tick to tick, besides the seqs that were taken; all of it stands in the tick
 * row. Zeroed: a loop that has not begun.
 */
struct apc_loop_memory {
    enum apc_loop_state state;
    bool holding;  /* without input or, in Backup, the backup law without input or answer, since: */
    apc_ns held;   /* mono */
    unsigned poor; /* answers in a row that were not good; from shed_after on, also good ones since */
    bool linked;   /* its setpoint is the upper controller's: in Cas, and in Hold out of it */
    int64_t asked; /* seq of the `actual` row of its setpoint that first asked to be initialised; 0: it does
                      not ask */
};
/** Has the loop been without input for @p hold, or shed its law after @p shed_after (above 0) answers? Told
 * at the beginning of a tick. [tick] */
bool apc_loop_expired(const struct apc_loop_memory *loop, bool input, apc_ns now, apc_ns hold,
                      unsigned shed_after);
/** Does a loop in Backup go on waiting for input or answer of its backup law? Told at the beginning of a
 * tick, or once more after the answer. [tick] */
bool apc_loop_bridges(const struct apc_loop_memory *loop, apc_ns now, apc_ns hold);
/** Count an answer of the law, wherever it is asked; @p good: good or suboptimal. [tick] */
void apc_loop_answered(struct apc_loop_memory *loop, bool good, unsigned shed_after);
/**
 * Close a tick that @p inputs brought into @p state. @p next is the seq that the next `actual` row of the
 * loop's setpoint will have. Where it says no more than the one before it need not be written: the answer to
 * that makes it say more. [tick]
 */
void apc_loop_settle(struct apc_loop_memory *loop, const struct apc_loop_inputs *inputs,
                     enum apc_loop_state state, apc_ns now, int64_t next);

/** What an upper loop sees of the one whose setpoint it writes, all in one snapshot. */
struct apc_loop_below {
    bool cascade;      /* its target is Cas */
    bool fresh;        /* its controller's newest tick row */
    apc_status status; /* of the `actual` row of the setpoint; none: Bad */
    double value;      /* the same row's: the setpoint that the loop below has */
    double newest;     /* row of the setpoint */
};
bool apc_loop_taken(const struct apc_loop_below *below);   /**< [tick] */
bool apc_loop_invited(const struct apc_loop_below *below); /**< It wants value, by swap. [tick] */

/** What a loop sees of its setpoint, all in one snapshot. */
struct apc_loop_above {
    enum apc_mode target; /* its own */
    bool theirs;          /* the newest row of the setpoint is the acting upper controller's */
    bool fresh;           /* that row is younger than 3 of its periods + 100 ms */
    bool able;            /* the upper loop's actual mode is not LO or OOS */
    int64_t origin;       /* of the newest row: seq of the `actual` row that it was made from */
    double value;         /* of the newest row */
    double working;       /* the setpoint in force since the loop's last tick */
};
bool apc_loop_remote(const struct apc_loop_memory *loop, const struct apc_loop_above *above); /**< [tick] */
/** Is the newest row of the setpoint to be taken? Else it comes too late or from nobody that is listened to,
 * and the setpoint in force is put back, by swap. [tick] */
bool apc_loop_takes(const struct apc_loop_memory *loop, const struct apc_loop_above *above);
/** Status of the `actual` row of a loop's setpoint, after settling. @p limited: enum apc_limited, how the
 * loop's measurement cannot follow. [tick] */
apc_status apc_loop_status(const struct apc_loop_memory *loop, enum apc_mode target, unsigned limited);
/** Which way, enum apc_limited, a measurement cannot follow its setpoint while the output is @p limited: the
 * way that it lacks, whatever the sign of the process's gain is. [tick] */
unsigned apc_loop_lacks(unsigned limited, double setpoint, double measurement);
/** enum apc_limited of a status's limit bits. [tick] */
unsigned apc_loop_limited(apc_status status);

#endif
