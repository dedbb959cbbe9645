/* SPDX-License-Identifier: BSD-3-Clause */
/* Scenarios, shared by their files: judge.c, run.c, scenario.c, trigger.c. */
#ifndef APC_CHECK_INTERNAL_H
#define APC_CHECK_INTERNAL_H

#include "check.h"
#include "simulation/simulation.h"

/* ---- expect.c */

/* As check_parse(), of a condition alone: that it becomes true is expected, and called @p text. */
int check_parse_when(struct expectation *x, const char *text, const char *condition,
                     const struct experiment *e, struct check_sources *sources, struct apc_error *why);

/* ---- judge.c */

bool check_is_true(const struct expectation *x, const struct check_point *p);
void check_say_unknown(struct check_verdict *v, const char *why);

/* ---- run.c */

struct check_point check_point_of(const struct check_source *of, const struct apc_sample *row);

/* ---- trigger.c */

struct run_triggers {
    const struct scenario *of;
    struct simulation *s;
    struct experiment e; /* the scenario's, with its seed, and faults of its own */
    apc_ns first;        /* tick of the plant; -1: there was none */
    apc_ns *met, *done;  /* [of->n_triggers] when; INT64_MAX: not yet */
    void *memory;
    char *text; /* of e, where triggers_write() has made it one of its own */
};

/* Returns 0 or APC_ENOMEM; its memory is the caller's to free. */
int triggers_make(struct run_triggers *t, const struct scenario *of, struct simulation *s);
void triggers_look(void *triggers, apc_ns now); /* at each tick of the plant; @now since t = 0 */
/* After the run: e.text is what makes this run without a condition, each time in its place. Returns 0 or a negative
 * error; t->text is to be freed in either case. */
int triggers_write(struct run_triggers *t, struct apc_error *why);
void triggers_judge(const struct run_triggers *t, struct check_verdict *verdict);

#endif
