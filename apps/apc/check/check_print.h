/* SPDX-License-Identifier: BSD-3-Clause */
/* What came of scenarios, and how it is said. */
#ifndef APC_CHECK_PRINT_H
#define APC_CHECK_PRINT_H

#include <stdio.h>

#include "apc/common/cli.h"
#include "check/check.h"

/* One run of a scenario, in memory that processes share. */
struct check_trial {
    bool made;
    int rc; /* it could not begin, or came to no end */
    struct check_end end;
    struct check_verdict verdict[]; /* [n_expect] */
};

struct checked {
    struct scenario scenario;
    char *trials;
    size_t stride;                 /* bytes: from one to the next */
    struct check_session *session; /* check_session.h; NULL: people did not operate it */
    char **why; /* [n_expect] where one failed, why the output moved that answers for it; NULL: not known */
};

/* Of one expectation over all runs. */
struct check_outcome {
    bool held;
    unsigned runs, n_held;
    char text[400];                      /* where it held or failed */
    const struct check_trial *trial;     /* that is told of */
    const struct check_verdict *verdict; /* of it; NULL: it came to none */
    uint64_t seed;                       /* of it */
};

enum check_format {
    CHECK_FORMAT_TEXT,
    CHECK_FORMAT_TAP,
    CHECK_FORMAT_JUNIT,
    CHECK_FORMAT_JSON,
    CHECK_FORMAT_HTML
};

const struct check_trial *checked_trial(const struct checked *c, unsigned run);
struct check_outcome checked_outcome(const struct checked *c, size_t expectation);
/* What was around a failure, in one line; "": nothing is known. */
void checked_near(const struct checked *c, const struct check_outcome *o, size_t expectation, char *text,
                  size_t size);
/* What is to be left of runs that failed. */
struct check_report {
    const struct cli *cli;
    const char *dir; /* there a run folder of each; NULL: nothing */
    bool force;      /* over what is in it */
};
/* Into @p c->why, to be freed by checked_why_free(): each run that is told of is made once more. Returns 0 or a
 * negative error: what cannot be explained is none. */
int checked_why(struct checked *c, const struct check_report *report, struct apc_error *why);
void checked_why_free(struct checked *c);
/* All of them, to stdout. Returns how many did not hold. */
size_t checked_print(const struct checked *c, size_t n, enum check_format format);

#endif
