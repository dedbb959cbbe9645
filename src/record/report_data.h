/* SPDX-License-Identifier: BSD-3-Clause */
/* What the report is drawn from: the CSV files of a run folder, read into memory. */
#ifndef APC_REPORT_DATA_H
#define APC_REPORT_DATA_H

#include <stdbool.h>

#include <apcstore.h> /* APC_TAG_LEN */
#include <apctimer.h> /* struct apc_bin */

#include "outlook.h"

struct report_point {
    double t, value; /* t in s since the start of the run */
    enum apc_severity severity;
    bool limited; /* a limit held it back */
    size_t line;  /* of the file: keeps the order of points of the same time */
};

/* The samples of one variable in order of time. */
struct report_series {
    struct report_point *points;
    size_t n, capacity;
};

/* The variables of one kind: id i is series[i - 1]. */
struct report_group {
    struct report_series *series;
    size_t n; /* highest id in the file */
};

/* What was out of the ordinary. */
struct report_event {
    double t;
    bool alarm; /* or a warning */
    char kind[32];
};

/* (t_{k+1} - t_k) - period of one task, in ns. */
struct report_jitter {
    char task[APC_TAG_LEN];
    struct apc_bin *bins;
    size_t n_bins, capacity;
    uint64_t count, missed;
    double period, mean, sd;
};

struct report_data {
    struct report_group y, z, u;
    struct report_group published; /* by id of the estimate */
    struct report_group mode;      /* of loop i: actual ones; not Good where it differs from the target */
    struct report_jitter *jitter;  /* [n_jitter] in the order of the file */
    size_t n_jitter;
    struct report_event *event; /* [n_events] by time; none where there is no events.csv */
    size_t n_events, events_room;
    double begin, end; /* s: 0 and the time of the last sample of all, or what is left of these */
    const struct outlook *expected; /* to be laid over it; NULL: nothing */
};

/* Fill *data, which report_free() takes back also after a failure. Returns as report_write() does. */
int report_read(struct report_data *data, const char *dir, struct apc_error *why);
void report_free(struct report_data *data);

/* Leave what happened from @p begin to @p end, and what was in force before it. */
void report_clip(struct report_data *data, double begin, double end);

/* Of one task; NULL: nothing is known of it. */
struct report_jitter *report_jitter_of(const struct report_data *data, const char *task);

#endif
