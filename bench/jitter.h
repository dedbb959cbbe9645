/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The driver of bench/jitter. A cell is a period on an idle or a loaded machine; in it the ways of ticking
 * take turns for a second each, round after round, so that what the machine did meanwhile it did to all.
 * A ratio is taken within a round, and its median over the rounds is what is judged.
 */
#ifndef APC_JITTER_H
#define APC_JITTER_H

#include <stdio.h>

#include <sys/types.h>
#include <sys/utsname.h>

#include <apcbase.h>

/* ---- Ways of ticking: jitter_run.c --------------------------------------------------------- */

enum jitter_way {
    WAY_DEADLINE,
    WAY_SPIN,
    WAY_NO_HOLD,
    WAY_OTHER,
    WAY_POSIX,
    WAY_LISTING,
    WAY_LOOP,
    WAY_PYTHON,
    WAY_CYCLIC,
    WAY_CYCLIC_AGAIN, /* the same: how much the reference differs from itself */
    WAY_CYCLIC_NO_HOLD,
    WAYS
};

struct jitter_way_about {
    const char *name;
    bool relative; /* no grid: a sample is an interval less the period */
};
extern const struct jitter_way_about jitter_ways[WAYS];

/* One run of one way. */
struct jitter_run {
    apc_ns *ns; /* samples, in the order of the ticks but for cyclictest; freed by the caller */
    size_t n;
    uint64_t missed;
    apc_ns wall, cpu;
};

/* Tools and helpers that a run needs; NULL or "": there is none. */
struct jitter_tools {
    char folder[4096]; /* of our own programs, and of what the disk load writes */
    bool fifo;         /* SCHED_FIFO is permitted */
    const char *cyclictest, *stress, *python;
};
void jitter_find_tools(struct jitter_tools *tools);

/* Run it. False: it failed, or was interrupted; *run is empty. */
bool jitter_run(const struct jitter_tools *tools, enum jitter_way way, apc_ns period, apc_ns duration,
                struct jitter_run *run);
/* All of @p ways at once; runs[i] is empty where one failed. */
void jitter_run_together(const struct jitter_tools *tools, const enum jitter_way *ways, size_t n,
                         apc_ns period, apc_ns duration, struct jitter_run *runs);
/* What a tick costs besides its callback, and its records; false: unknown. */
bool jitter_run_cost(const struct jitter_tools *tools, double *tick, double *records);

/* Load on every core and on the disk, which ends by itself after @p seconds at most. 0: none. */
pid_t jitter_load_start(const struct jitter_tools *tools, int seconds);
void jitter_load_stop(pid_t load);

/* From here on SIGINT, SIGTERM and SIGHUP end what runs, and then the program in good order. */
void jitter_catch_signals(void);
bool jitter_interrupted(void);

/* ---- Where it runs, and what else runs there: jitter_machine.c ------------------------------ */

struct jitter_place {
    struct utsname system;
    char cpu[256], governor[64], idle[64], time[APC_TIME_LEN];
    bool guest; /* of a hypervisor */
    long cores;
    double load;
};
void jitter_find_place(struct jitter_place *place);

/* CPU time since the boot, s. */
struct jitter_busy {
    double wall, all, own, stolen; /* own: this process and the children it has waited for */
};
void jitter_busy_now(struct jitter_busy *busy);
/* What has been used since, by others and by the hypervisor's other guests, in per cent of a core. */
void jitter_busy_since(const struct jitter_busy *then, double *others, double *stolen);

/* ---- Results: jitter_stats.c --------------------------------------------------------------- */

#define JITTER_ROUNDS_MIN 8 /* fewer give no median to speak of */
#define JITTER_ROUNDS_MAX 100

enum jitter_quantile { P50, P99, P999, QUANTILES };
extern const char *const jitter_quantiles[QUANTILES];

struct jitter_row {
    apc_ns *ns; /* of all rounds, rising after jitter_row_sort() */
    size_t n;
    uint64_t missed;
    apc_ns wall, cpu;
    double round[JITTER_ROUNDS_MAX][QUANTILES]; /* ns */
    bool failed;                                /* left out */
};

struct jitter_cell {
    apc_ns period;
    bool loaded;
    double others, stolen; /* what else the machine did, per cent of a core */
    struct jitter_row row[WAYS];
};

struct jitter_drift {
    enum jitter_way way;
    double drift; /* ns; NAN: unknown */
    apc_ns p99;   /* of its lateness in the first tenth; 0 for a row without a grid */
};
#define JITTER_DRIFTS 5

struct jitter {
    struct jitter_tools tools;
    bool quick;
    size_t rounds, n_cells;
    struct jitter_cell cell[6];
    apc_ns drift_time;
    struct jitter_drift drift[JITTER_DRIFTS];
    double tick_cost, record_cost; /* ns; NAN: unknown */
};

/* By nearest rank; @p ns rises, n > 0. */
apc_ns jitter_at(const apc_ns *ns, size_t n, enum jitter_quantile q);
void jitter_sort(apc_ns *ns, size_t n);
/* Take one round's run into the row; @p run is used up. */
void jitter_row_add(struct jitter_row *row, size_t round, struct jitter_run *run);
void jitter_drift_of(struct jitter_drift *drift, struct jitter_run *run);
bool jitter_has(const struct jitter_cell *cell, enum jitter_way way); /* measured; @p cell may be NULL */
/* Median over the rounds; the reference WAY_CYCLIC is the mean of the round's two runs of it. NAN: unknown. */
double jitter_ratio(const struct jitter *j, const struct jitter_cell *cell, enum jitter_way way,
                    enum jitter_way to, enum jitter_quantile q);
/* How far the reference was from itself: least and greatest ratio in a round. False: unknown. */
bool jitter_noise(const struct jitter *j, const struct jitter_cell *cell, enum jitter_quantile q,
                  double *least, double *most);
const struct jitter_cell *jitter_cell_find(const struct jitter *j, apc_ns period, bool loaded);
/* Per cent of a core. */
double jitter_cpu(const struct jitter_row *row);

/* One line of "How good". */
struct jitter_goal {
    char what[64];
    double value, limit; /* NAN: not measured */
    bool at_least;       /* else at most */
    const char *unit;
};
#define JITTER_GOALS 32
size_t jitter_goals(const struct jitter *j, struct jitter_goal goals[JITTER_GOALS]);
bool jitter_goal_met(const struct jitter_goal *goal);

/* ---- Output: jitter_report.c, jitter_plot.c ------------------------------------------------ */

void jitter_describe(const struct jitter *j);
void jitter_print_cell(const struct jitter *j, const struct jitter_cell *cell);
void jitter_print_end(const struct jitter *j);
void jitter_write_json(const struct jitter *j, FILE *json);
/* @p path with its ending, if any, replaced: .svg and .png. False: not drawn. */
bool jitter_plot(const struct jitter *j, const char *path);

#endif
