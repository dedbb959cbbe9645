/* SPDX-License-Identifier: BSD-3-Clause */
/* The condition of an alarm, judged from what a tick has read. */
#ifndef APC_MODULES_ALARM_H
#define APC_MODULES_ALARM_H

#include "apcalarm.h"

/** Is it of a controller, judged by its tick row? [any] */
static inline bool apc_alarm_is_of_controller(enum apc_alarm_kind kind)
{
    return kind == APC_ALARM_STOPPED || kind == APC_ALARM_OVERRUN;
}

/** What a condition remembers. Zeroed: nothing was seen. */
struct apc_alarm_condition {
    bool is;      /* after the delays */
    bool raw;     /* as of the last look at what can be judged */
    bool differs; /* raw from is, since: */
    apc_ns since; /* mono */
    bool begun;   /* there was a look, first at: */
    apc_ns began; /* mono */
    struct apc_freshness fresh;
    struct { /* sample that the rate, or a frozen signal, is judged against; of OVERRUN the tick's index */
        int64_t seq;
        apc_ns time;
        double value;
    } before;
    bool poor; /* it is judged by what was known last */
};

/** What an alarm is judged by, of one snapshot; the second one of DEVIATION, and of MODE the actual mode; the
 * vector of STOPPED and OVERRUN. */
struct apc_alarm_inputs {
    const struct apc_sample *signal, *other;
    const struct apc_vector *tick;
};

/** Judge; returns c->is. [tick] */
bool apc_alarm_judge(struct apc_alarm_condition *c, const struct apc_alarm *alarm,
                     const struct apc_alarm_inputs *inputs, struct apc_now now);

#endif
