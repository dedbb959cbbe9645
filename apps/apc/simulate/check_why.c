/* SPDX-License-Identifier: BSD-3-Clause */
/* What `apc why` says of an expectation that failed, out of a run of its own, of which all is kept. */
#include "check_print.h"

#include <stdlib.h>

#include "apc/report/print_why.h"

/* The expectations of one run. */
struct failures {
    struct checked *of;
    uint64_t seed;
    struct apc_error *why;
};

static bool is_failure_of(const struct failures *f, size_t i, struct check_move *move)
{
    const struct check_outcome o = checked_outcome(f->of, i);
    return !o.held && o.verdict && o.seed == f->seed && !f->of->why[i] &&
           check_find_move(move, &f->of->scenario, i, o.verdict) > 0;
}

static int explain_failure(const struct failures *f, const struct check_move *move,
                           const struct simulation *s, char **text)
{
    struct replay replay = {.controller = NULL};
    const struct why_question question = {.replay = &replay,
                                          .store = s->store,
                                          .simulated = s->e,
                                          .loop = move->loop,
                                          .at = SIMULATION_BEGIN + move->at,
                                          .over = move->over};
    struct apc_error why;
    size_t size;
    FILE *out = open_memstream(text, &size);
    if (!out)
        return apc_fail(f->why, APC_ENOMEM, "out of memory");
    const int rc = print_why(&question, out, &why);
    if (rc < 0 && rc != APC_ENOTFOUND) /* it failed before the first tick */
        fprintf(out, "%s: %s\n", move->loop, why.text);
    replay_free(&replay);
    return fclose(out) != 0 || rc == APC_ENOMEM ? apc_fail(f->why, APC_ENOMEM, "out of memory") : 0;
}

static int explain_run(void *ctx, const struct simulation *s)
{
    const struct failures *f = ctx;
    struct check_move move;
    int rc = 0;
    for (size_t i = 0; i < f->of->scenario.n_expect && rc == 0; i++)
        if (is_failure_of(f, i, &move))
            rc = explain_failure(f, &move, s, &f->of->why[i]);
    return rc;
}

int checked_why(struct checked *c, struct apc_error *why)
{
    int rc = 0;
    c->why = calloc(c->scenario.n_expect + 1, sizeof *c->why);
    if (!c->why)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < c->scenario.n_expect && rc == 0; i++) {
        struct failures f = {.of = c, .seed = checked_outcome(c, i).seed, .why = why};
        struct check_move move;
        if (is_failure_of(&f, i, &move))
            rc = scenario_rerun(&c->scenario, f.seed, explain_run, &f, why);
    }
    return rc;
}

void checked_why_free(struct checked *c)
{
    for (size_t i = 0; c->why && i < c->scenario.n_expect; i++)
        free(c->why[i]);
    free(c->why);
}
