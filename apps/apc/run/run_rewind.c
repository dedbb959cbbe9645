/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A simulated run goes back. What was until then gets another name, folder and memory, and becomes a run folder as at any
 * end, in a process of its own that nobody waits for but the end. Meanwhile this process begins anew, as `apc run THAT
 * --speed 0 --from T` does, in a folder and a store of the same names and with the same page: what people did before T is
 * done again, so all of it is exactly what it was, whatever a law or plant keeps to itself.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apc/folder/folder.h"
#include "run.h"
#include "simulation/simulation.h"

#define REWOUND "APC_REWOUND" /* from the process to itself: "SOCKET PAGE NOTIFY FOLDER STORE GRAPHIC" */
#define MOST    10000         /* that often a run is rewound */

/* To the next life of this process, and not to others that it starts. */
static int keep_open(int fd, bool keep)
{
    return fd > 0 ? fcntl(fd, F_SETFD, keep ? 0 : FD_CLOEXEC) : 0;
}

void run_take_over(struct run *r)
{
    const char *text = getenv(REWOUND);
    struct supervisor *s = &r->daemons;
    int end = 0;
    if (text &&
        sscanf(text, "%d %d %d %31s %95s %n", &r->listener, &r->rewound, &s->notify, s->meeting,
               r->segment.uri, &end) == 5 &&
        end > 0)
        snprintf(r->graphic, sizeof r->graphic, "%s", text + end);
    unsetenv(REWOUND);
    keep_open(r->listener, false);
    keep_open(s->notify, false);
}

void run_look_aside(void)
{
    while (waitpid(0, NULL, WNOHANG) > 0)
        ;
}

void run_await_aside(void)
{
    while (waitpid(0, NULL, 0) > 0 || errno == EINTR)
        ;
}

static int hand_over_run(const struct run *r)
{
    char text[sizeof r->graphic + sizeof r->segment.uri + 80];
    const struct supervisor *s = &r->daemons;
    const bool page = r->page[0] && s->n > 0 && s->child->name;
    snprintf(text, sizeof text, "%d %d %d %s %s %s", page ? r->listener : 0, page ? s->child->pid : 0,
             s->notify, s->meeting, r->segment.uri, r->graphic);
    unsetenv("APC_STORE"); /* which were for the page */
    unsetenv("APC_SPOOL");
    unsetenv("APC_HISTORY");
    return setenv(REWOUND, text, 1) < 0 || keep_open(page ? r->listener : 0, true) < 0 ||
                   keep_open(s->notify, true) < 0
               ? -1
               : 0;
}

/* DIR.1, DIR.2, ...: the first that is free. Returns its number, or an error, having said why. */
static int set_aside(const struct run *r, char *aside, size_t size)
{
    size_t n = strlen(r->dir);
    while (n > 1 && r->dir[n - 1] == '/')
        n--;
    int i = 1, length;
    while ((length = snprintf(aside, size, "%.*s.%d", (int)n, r->dir, i)) < (int)size &&
           access(aside, F_OK) == 0 && i < MOST)
        i++;
    errno = ENAMETOOLONG;
    if (length < (int)size && rename(r->dir, aside) == 0)
        return i;
    cli_error(&r->cli, APC_ESYS, "%s: cannot be renamed to %s: %s; the run ends here", r->dir, aside,
              strerror(errno));
    return APC_ESYS;
}

/* All of @p was under its new names: the folder @p aside, its record, and what is in memory yet. */
static int name_aside(struct run *was, int number, const char *aside)
{
    struct apc_error why;
    int rc = segment_rename(&was->segment, number, aside, &why);
    if (rc == 0)
        rc = folder_moved(aside, was->segment.uri, &why);
    if (rc < 0)
        cli_error(&was->cli, rc, "%s", why.text);
    snprintf(was->dir, sizeof was->dir, "%s", aside);
    snprintf(was->own_history, sizeof was->own_history, "sqlite:%s/store.db", aside);
    was->cli.store = was->segment.uri;
    was->record = was->history = was->own_history;
    return rc;
}

/* From here on it is the run that goes on. Returns only if it cannot. */
static void go_on_rewound(const struct run *r, const char *aside, apc_ns to)
{
    char from[40], duration[40];
    const char *argv[16] = {"apc", "run", "--speed", "0", "--out", r->dir, "--duration", duration};
    union { /* execv takes char *const *, for history's sake */
        const char **from;
        char **to;
    } args = {argv};
    size_t n = 8;
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
    printf("going back to %s s; the run so far is in %s\n", from, aside);
    fflush(stdout);
    if (hand_over_run(r) == 0)
        execv("/proc/self/exe", args.to);
    cli_error(&r->cli, APC_ESYS, "the run cannot continue from %s s: %s; the run so far is in %s", from,
              strerror(errno), aside);
}

int run_rewind(struct run *r)
{
    struct run was = *r;
    char aside[sizeof r->dir];
    const int number = set_aside(r, aside, sizeof aside);
    const int named = number < 0 ? number : name_aside(&was, number, aside);
    if (named < 0) /* it ends as any other */
        was.rewind = 0;
    const int finished = run_finish(&was);
    if (named == 0 && finished == 0)
        go_on_rewound(r, aside, simulation_nearest_tick(&r->e, r->rewind - SIMULATION_BEGIN));
    supervisor_stop(&r->daemons, NULL);
    return named < 0 ? named : finished < 0 ? finished : APC_ESYS;
}
