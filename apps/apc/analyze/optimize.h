/* SPDX-License-Identifier: BSD-3-Clause */
/* The search for numbers of an experiment: what is searched, what was tried, what came of it. */
#ifndef APC_OPTIMIZE_H
#define APC_OPTIMIZE_H

#include "apc/common/setting.h"
#include "apc/simulate/campaign.h"

#define OPTIMIZE_NUMBERS 16

/* One number that is searched. In the search it goes from 0 to 1, by its logarithm where it spans a decade. */
struct number {
    char path[EXPERIMENT_SETTING];
    double low, high, now; /* now: in the file */
    bool logarithmic;
};

/* The cost: each share is relative to what the present numbers give, or to another reference. */
struct weights {
    double iae, effort, overshoot, limits;
    double peak; /* that no loop's sensitivity is to exceed; 0: whatever */
};

struct optimize_options {
    struct setting_list set;
    struct number number[OPTIMIZE_NUMBERS];
    size_t n;
    struct weights weights;
    unsigned runs, budget, jobs; /* seeds of each try; simulated runs of all tries */
    uint64_t seed;
    double duration; /* s; 0: the file's */
    bool seeded, json, force;
    const char *net, *csv, *figure, *write;
};

/* What was tried: numbers, then of each loop what they gave over the seeds. */
struct attempt {
    double iae, effort, overshoot, beyond; /* the first three relative, means over the loops */
    double peak;                           /* the largest of the loops' sensitivities, where it is limited */
    double lasted;                         /* of the duration, until the plant diverged */
    bool made, stable;
    double value[OPTIMIZE_NUMBERS];
    double loop[]; /* [3 * loops] IAE, effort, overshoot, as they are */
};

struct optimization {
    struct cli cli;
    struct optimize_options own;
    struct experiment e;
    struct loop *loop;
    size_t loops, stride; /* bytes from one attempt to the next */
    struct worker_pool *pool;
    void *attempts; /* [tries]; the first is of the present numbers */
    unsigned tries;
    size_t size;       /* bytes of the memory behind the pool */
    double *reference; /* [2 * loops] IAE and effort that count as 1 */
    unsigned best;     /* place of the least cost */
    unsigned *front;   /* [n_front] places, from the least effort to the least IAE */
    unsigned n_front;
    char command[1000]; /* that was given */
    FILE *talk;
};

struct attempt *optimization_attempt(const struct optimization *z, unsigned i);
/* The largest peak of the loops' sensitivities, each cut open alone; HUGE_VAL: not stable. Returns 0 or a
 * negative error. */
int optimization_peak(const struct experiment *e, double *peak, struct apc_error *why);
/* The cost of what is in an attempt; HUGE_VAL where it is not stable, or nearer to that than it may be. */
double optimization_cost(const struct attempt *a, const struct weights *w);

/* Load the experiment with these numbers. Returns 0 or a negative error. */
int optimization_load(const struct optimization *z, const double *value, struct experiment *e,
                      struct apc_error *why);
/* Try all that the budget allows, for `best` and `front`. Returns 0, or an error with its text. */
int optimization_search(struct optimization *z, struct apc_error *why);

/* Tables and lines, JSON, CSV, figure: as they were asked for. */
int optimization_show(const struct optimization *z, double took, struct apc_error *why);

#endif
