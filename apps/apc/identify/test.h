/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The parts of apc test. A plan says which signals are moved, how far and for how long; a bench is the plant,
 * simulated or live, on which it is carried out from tick to tick of the controller.
 */
#ifndef APC_TEST_H
#define APC_TEST_H

#include <signal.h>

#include <apcexcite.h>

#include "apc/common/cli.h"
#include "apc/common/setting.h"
#include "apc/folder/runstore.h"
#include "operate/operate.h"
#include "simulation/simulation.h"

#define TEST_SIGNALS 32

/* ---- The bench ------------------------------------------------------------------------------- */

struct test_bench {
    const struct experiment *e;
    struct simulation *s;    /* NULL: the plant is live */
    struct apc_store *store; /* of it */
    struct loops loops;
    struct apc_tag *tags; /* [n_tags] */
    size_t n_tags;
    apc_ns period, phase;   /* of the controller that is followed */
    struct apc_vector tick; /* its newest */
    int64_t ticks;          /* of it, in virtual time */
    apc_ns zero, now;       /* UTC of the first tick, and of the newest */
    char who[APC_AUTHOR_LEN];
    volatile sig_atomic_t *stop; /* a signal has come */
};

/* Simulated from @p seed on, or with a @p live store as it is. Returns 0 or a negative error;
 * test_bench_close() in either case. */
int test_bench_open(struct test_bench *b, const struct experiment *e, const struct controller *follow,
                    uint64_t seed, struct apc_store *live, struct apc_error *why);
void test_bench_close(struct test_bench *b);
/* To just before a tick of the controller in virtual time, live to just after one. Returns 0, also at a
 * signal, or why there is none. */
int test_bench_next(struct test_bench *b, struct apc_error *why);
/* As an operator. Returns 0 or the store's error. */
int test_bench_do(struct test_bench *b, const struct action *action, struct apc_error *why);
/* The newest rows, as apc_store_read(). */
int test_bench_read(struct test_bench *b, struct apc_sample *rows, size_t n, struct apc_error *why);

/* ---- The plan -------------------------------------------------------------------------------- */

enum test_kind { TEST_PRBS, TEST_STEPS, TEST_MULTISINE, TEST_RELAY, TEST_KINDS };

struct test_options {
    enum test_kind kind;
    char *move[TEST_SIGNALS];
    size_t moves;
    struct {
        char *name; /* "": of all */
        double value, high;
    } amplitude[TEST_SIGNALS], guard[TEST_SIGNALS];
    size_t amplitudes, guards;
    double settling, duration, from, to; /* s, s, Hz; 0: proposed */
    uint64_t seed;
    bool seeded, live, force;
    const char *out, *net;
    struct setting_list set;
};

/* A signal that is moved. */
struct test_move {
    const char *name;   /* of the tag */
    struct apc_tag tag; /* what an operator writes: its manual output, or the setpoint */
    const struct loops_loop *loop;
    bool taken;             /* it is ours to give back */
    double amplitude;       /* 0: to be proposed */
    double base, was, mode; /* moved around this; what was in force before, and the target mode */
    double written;         /* last */
    double *level;          /* [n] */
    double *gain;           /* [ny] of what the model of the file says; NAN: not known */
};

struct test_guard {
    double low, high; /* of the measurement */
    double base, noise;
};

enum test_end { TEST_WHOLE, TEST_STOPPED, TEST_GUARDED, TEST_TAKEN, TEST_LOST };

/* Of each move, behind measurements and outputs. */
enum test_row { TEST_WRITTEN, TEST_OUTPUT, TEST_TARGET, TEST_ACTUAL, TEST_ROWS };

struct test {
    struct cli cli;
    struct test_options own;
    struct experiment e;
    struct simulation simulation;
    struct apc_store *store; /* live */
    struct test_bench bench;
    const char *file;          /* the experiment, or the run folder that has it */
    char folder[RUNSTORE_LEN]; /* that of the store */
    char dir[600];

    struct test_move move[TEST_SIGNALS];
    size_t moves;
    struct test_guard *guard;   /* [ny] */
    double *gains;              /* memory of those of the moves */
    double Ts, settling;        /* s */
    const char *settled_by;     /* how that is known */
    size_t rest, lead, hold, n; /* samples: before anything is moved; at the base; one bit; of the signal */
    unsigned order;             /* of the PRBS */
    double *levels;             /* memory of those of the moves */

    struct apc_sample *row; /* [ny + nu + 4 moves], as they are read at each sample */
    size_t rows;
    double *u, *y; /* [room * nu], [room * ny] what was read, first at rest, then from the base on */
    size_t room, kept;
    unsigned bad; /* samples one after another without a measurement */
    apc_ns begin; /* UTC, of the record */
    int *held;    /* [n_held] setpoints that stay where they are, which the scheduler moves otherwise */
    size_t n_held;
    bool *varies;  /* [nu] */
    double *found; /* [ny * nu] gains that were identified so far; NAN: none */
    apc_ns shown;
    struct apc_relay relay;
    double sign; /* of the relay's plant; 0: not known yet */
    enum test_end end;
    struct apc_error why; /* of an end that came early */
};

/* What is moved, and what is known of the plant before it is looked at. */
int test_plan(struct test *z, struct apc_error *why);
/* Amplitudes, once noise and base are known. */
int test_plan_amplitudes(struct test *z, struct apc_error *why);
/* The signals themselves. */
int test_plan_levels(struct test *z, struct apc_error *why);
void test_plan_print(const struct test *z);

/* Carry it out, and give the plant back. Returns 0, also where it ended early: z->end. */
int test_run(struct test *z, struct apc_error *why);

/* The gains of what was read since the base. */
void test_gain_find(struct test *z);
/* "y1/v1 2.41  y2/v2 3.02" */
void test_gain_line(const struct test *z, char *text, size_t size);
void test_gain_print(const struct test *z);

#endif
