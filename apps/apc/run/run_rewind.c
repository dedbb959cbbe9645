/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A simulated run goes back. What was until then has become a run folder, as at any end; it gets another name. Then the
 * process begins anew, as `apc run THAT --speed 0 --from T` does, in a folder, a store and at a page of the same names:
 * what people did before T is done again, so all of it is exactly what it was, whatever a law or plant keeps to itself.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc/folder/folder.h"
#include "run.h"
#include "simulation/simulation.h"

#define REWOUND "APC_REWOUND" /* from the process to itself: "SOCKET STORE GRAPHIC" */
#define MOST    10000         /* that often a run is rewound */

void run_take_over(struct run *r)
{
    const char *text = getenv(REWOUND);
    int end = 0;
    if (text && sscanf(text, "%d %95s %n", &r->listener, r->segment.uri, &end) == 2 && end > 0)
        snprintf(r->graphic, sizeof r->graphic, "%s", text + end);
    unsetenv(REWOUND);
}

static int hand_over_run(const struct run *r)
{
    char text[sizeof r->graphic + sizeof r->segment.uri + 16];
    const int fd = r->page[0] ? r->listener : 0;
    snprintf(text, sizeof text, "%d %s %s", fd, r->segment.uri, r->graphic);
    unsetenv("APC_STORE"); /* which were for the page */
    unsetenv("APC_SPOOL");
    unsetenv("APC_HISTORY");
    return setenv(REWOUND, text, 1) < 0 || (fd > 0 && fcntl(fd, F_SETFD, 0) < 0) ? -1 : 0;
}

/* DIR.1, DIR.2, ...: the first that is free. */
static int set_aside(const struct run *r, char aside[sizeof r->dir + 16])
{
    size_t n = strlen(r->dir);
    while (n > 1 && r->dir[n - 1] == '/')
        n--;
    int i = 1;
    do
        snprintf(aside, sizeof r->dir + 16, "%.*s.%d", (int)n, r->dir, i);
    while (access(aside, F_OK) == 0 && i++ < MOST);
    if (rename(r->dir, aside) == 0)
        return 0;
    cli_error(&r->cli, APC_ESYS, "%s: cannot be renamed to %s: %s; the run ends here", r->dir, aside,
              strerror(errno));
    return APC_ESYS;
}

int run_rewind(struct run *r)
{
    char aside[sizeof r->dir + 16], from[40], duration[40];
    const apc_ns to = simulation_nearest_tick(&r->e, r->rewind - SIMULATION_BEGIN);
    const char *argv[16] = {"apc", "run", "--speed", "0", "--out", r->dir, "--duration", duration};
    size_t n = 8;
    struct apc_error why;
    const int rc = set_aside(r, aside);
    if (rc < 0)
        return rc;
    if (folder_moved(aside, &why) < 0)
        cli_error(&r->cli, APC_ESYS, "%s", why.text);
    apc_number_format(apc_ns_to_s(to), from, sizeof from);
    apc_number_format(r->e.duration, duration, sizeof duration); /* it ended before */
    if (to > 0) {
        argv[n++] = "--from";
        argv[n++] = from;
    }
    if (r->options.no_ui)
        argv[n++] = "--no-ui";
    argv[n++] = "--";
    argv[n] = aside;
    printf("going back to %s s; what was until now is in %s\n", from, aside);
    fflush(stdout);
    if (hand_over_run(r) == 0) {
        union { /* execv takes char *const *, for history's sake */
            const char **from;
            char **to;
        } args = {argv};
        execv("/proc/self/exe", args.to);
    }
    cli_error(&r->cli, APC_ESYS, "the run cannot go on from %s s: %s; what was is in %s", from,
              strerror(errno), aside);
    return APC_ESYS;
}
