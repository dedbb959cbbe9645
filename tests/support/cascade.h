/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Two loops, one above the other, by the rules of src/modules/loop.c, with a PI law each, an operator and a
 * process. Around the rules there is only as much of a controller as they need, so that a million situations
 * take seconds. What must hold whenever something happens is looked at whenever something happens.
 *
 * Everything that an actor does is two steps, for others to come between: it reads a snapshot, and appends.
 */
#ifndef APC_TEST_CASCADE_H
#define APC_TEST_CASCADE_H

#include "modules/modules_internal.h"

#define BASE       (500 * APC_NS_PER_MS) /* period of the loop below */
#define TOP        (2000 * APC_NS_PER_MS)
#define LOSS(p)    (3 * (p) + 100 * APC_NS_PER_MS)
#define START      (1000 * APC_NS_PER_S)
#define SHED_AFTER 3u

enum who { LOWER, UPPER, OPERATOR };
enum result { GOOD, LATE, INFEASIBLE, FAILED };

enum { NOTHING, PUT, MODE }; /* what an operator wants */

struct row {
    int64_t seq, origin;
    double value;
    apc_status status;
    enum who author;
    apc_ns time;
};

/* All that the actors have in common. */
struct cascade_store {
    struct row setpoint; /* r, of the loop below */
    struct row actual;   /* of r */
    struct row out;      /* v, the actuator */
    enum apc_mode target[2];
    int64_t target_seq[2];
    enum apc_mode mode[2]; /* actual */
    int64_t tick[2];       /* seq of the newest tick row, and its time */
    apc_ns tick_time[2];
    double travel, told; /* how far the loop above ever moved r, and when `actual` was made */
};

struct law {
    double Kp, integral; /* integral: Kp Ts / tau_i */
};

struct integral {
    double x, e; /* e: the error that x was last made from */
};

/* What a tick row holds. */
struct memory {
    struct apc_loop_memory loop;
    struct integral law, backup;
    double u, z, y;
    int64_t seen; /* newest seq of the setpoint */
    double out;   /* what was really out when the laws were updated */
    bool begun;
};

struct cascade_side {
    struct law law, backup;
    double low, high;
    bool has_backup;
    apc_ns period, hold;
    struct memory now, stored;
    apc_ns stored_time;
    struct apc_freshness of_row, of_tick;
    bool alive, pending;
    enum result answers;
    bool measured; /* its sensor is in order */
    bool lost;     /* its next append is left out as a whole */
    bool missed;   /* its setpoint was left out of the last append */

    /* The tick under way: what was read, and what will be written. */
    struct cascade_store seen;
    struct apc_loop_inputs facts;
    struct apc_loop_move move;
    struct row row, setpoint;
    bool write_row, write_setpoint, write_actual;
    struct row actual;
    unsigned limited; /* what the loop below says of it */
    double e, slack;
    struct memory before;
};

#define NOTES 24

struct cascade {
    struct cascade_store store;
    struct cascade_side side[2];
    apc_ns now;
    double level, flow; /* measurements: of the loop above, of the one below */
    double w;           /* setpoint of the loop above */
    double gain;        /* of the process below */
    struct {            /* the operator's request, and what was read for it */
        int what;
        bool pending;
        double value;
        enum apc_mode mode;
        struct cascade_store seen;
    } operator;
    double manual[2];
    int64_t put;  /* seq of the operator's newest put; a change of mode gives a setpoint, too, */
    double slack; /* which may be as far from what is in force as the loop above moved it meanwhile */
    uint64_t entered, shed, taken;
    const char *broken;
    struct note {
        apc_ns at;
        const char *what;
        enum who who;
        const char *state, *reason;
        double u, z;
        struct cascade_store store;
    } notes[NOTES];
    size_t n_notes;
    uint64_t ticks;
};

void cascade_init(struct cascade *w, double sign); /* sign: of the gain of the process below */
void cascade_reads(struct cascade *w, enum who who);
void cascade_appends(struct cascade *w, enum who who);
void cascade_kill(struct cascade *w, enum who who);
void cascade_start(struct cascade *w, enum who who);
/* An operator who writes as apc set, apc mode and apc remote do: w->operator says what is wanted. */
void cascade_operator_reads(struct cascade *w);
void cascade_operator_appends(struct cascade *w);
void cascade_process(struct cascade *w); /* a period of the loop below goes by, the clock's apart */
/* So many periods of the loop below in which each of those that are alive ticks in time. */
void cascade_run(struct cascade *w, int periods);
/* Fail, and say what happened last, when a rule was broken. */
void cascade_check(const struct cascade *w);
/* A rule of the caller's. */
void cascade_must(struct cascade *w, bool holds, const char *rule);

#endif
