/* SPDX-License-Identifier: BSD-3-Clause */
/* What the main thread of a daemon looks out for while the task runs. Each look compares with the one before. */
#ifndef APC_WATCH_H
#define APC_WATCH_H

#include <apcbase.h>

/* The wall clock against the monotonic one. */
struct clock_watch {
    const struct apc_clock *clock; /* NULL: the system's */
    apc_ns offset;
};
void clock_watch_init(struct clock_watch *w, const struct apc_clock *clock);
/* By how much the wall clock was stepped since the last look; 0 when it was not, or slewed. */
apc_ns clock_watch_look(struct clock_watch *w);

/* The alarm of a task that misses its ticks. Zeroed: none. */
struct overrun_watch {
    uint64_t alarms;
    bool on;
};
enum overrun_change { OVERRUN_SAME = 0, OVERRUN_BEGAN, OVERRUN_ENDED };
/* Given what apc_task_overruns() says. One that began and ended between two looks began now and ends at the
 * next look. */
enum overrun_change overrun_watch_look(struct overrun_watch *w, uint64_t in_a_row, uint64_t alarms);

/* Does a task tick? Zeroed at the beginning. */
struct tick_watch {
    bool begun;
    uint64_t ticks, overruns; /* when the last tick was first seen */
};
/* Given how many ticks have returned, and what apc_task_overruns() says: false while one is being missed and
 * none has returned since. */
bool tick_watch_look(struct tick_watch *w, uint64_t ticks, uint64_t overruns);

/* What is to be told of a connection that comes and goes. `up` is what it was at first, the rest zeros. So
 * many changes are told at once, and one more after each pause; what was held back is followed by how it is
 * then. It is for people: who judges by the state reads the state. */
#define STATE_CHANGES 4
#define STATE_AGAIN   (15 * APC_NS_PER_S)
struct state_watch {
    bool up;
    unsigned held;  /* changes not told of */
    unsigned count; /* of CHANGE_MANY */
    apc_ns full;    /* when STATE_CHANGES may be told at once again */
};
enum state_change { CHANGE_NONE = 0, CHANGE_ONE, CHANGE_MANY };
/* CHANGE_ONE: it is now what it was not. CHANGE_MANY: it changed `count` times since it was last told of; now
 * it is `up`. */
enum state_change state_watch_look(struct state_watch *w, bool up, apc_ns now);

/* A history that gets what a live store gets. Zeroed: it has all. */
#define LAG_LIMIT (30 * APC_NS_PER_S) /* later than that it is slow */
struct lag_watch {
    bool away, slow;
    apc_ns late; /* the most, since the trouble began */
};
enum lag_change { LAG_SAME = 0, LAG_AWAY, LAG_SLOW, LAG_ENDED };
/*
 * Given whether it takes nothing, how many rows it had not got after the last that it took, and for how long
 * it has not had all. LAG_AWAY: it takes nothing from now on. LAG_SLOW: it takes what comes, and is late all
 * the same; not of one that comes back and has to catch up. LAG_ENDED: it has all again, whichever it was.
 */
enum lag_change lag_watch_look(struct lag_watch *w, bool away, uint64_t behind, apc_ns late);

#endif
