/* SPDX-License-Identifier: BSD-3-Clause */
/* A run folder's files as a store in memory: for what reads stores, of a run whose own is none or gone. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "files/files.h"
#include "folder.h"
#include "record/record.h"

struct filling {
    struct apc_store *store;
    const char *dir;
    apc_ns zero; /* UTC of t = 0 */
    int failed;  /* of the store */
};

static int fail_filling(const struct filling *f, const char *name, int rc, struct apc_error *why)
{
    return apc_fail(why, rc, "%s/%s: %s", f->dir, name,
                    rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(f->store));
}

static int fill_samples(const struct filling *f, const char *name, struct apc_error *why)
{
    struct samples s;
    int rc = samples_read(&s, f->dir, name, why);
    for (size_t i = 0; i < s.n && rc == 0; i++)
        if (__builtin_add_overflow(s.at[i].time, f->zero, &s.at[i].time))
            rc = apc_fail(why, APC_EINVAL, "%s/%s: a time beyond the year 2262", f->dir, name);
    if (rc == 0 && (rc = apc_store_append(f->store, s.at, s.n)) < 0)
        fail_filling(f, name, rc, why);
    samples_free(&s);
    return rc < 0 ? rc : 0;
}

static int fill_event(const struct filling *f, struct csv *csv, struct apc_error *why)
{
    const char *severity = csv_text(csv, 1);
    struct apc_event event = {.severity = !strcmp(severity, "alarm")     ? APC_EVENT_ALARM
                                          : !strcmp(severity, "warning") ? APC_EVENT_WARNING
                                                                         : APC_EVENT_INFO};
    double t;
    if (csv_number(csv, 0, &t, why) < 0)
        return APC_EINVAL;
    if (apc_ns_from_s(t, &event.time) < 0 || __builtin_add_overflow(event.time, f->zero, &event.time))
        return csv_refuse_field(csv, 0, why, "expected s since the start of the run");
    snprintf(event.source, sizeof event.source, "%s", csv_text(csv, 2));
    snprintf(event.kind, sizeof event.kind, "%s", csv_text(csv, 3));
    snprintf(event.text, sizeof event.text, "%s", csv_text(csv, 4));
    const int rc = apc_store_append_events(f->store, &event, 1);
    return rc < 0 ? fail_filling(f, "events.csv", rc, why) : 0;
}

static int fill_events(const struct filling *f, struct apc_error *why)
{
    char path[600];
    struct csv *csv;
    snprintf(path, sizeof path, "%.580s/events.csv", f->dir);
    int rc = csv_open(&csv, path, why);
    if (rc == 0)
        rc = csv_expect(csv, "time,severity,source,kind,text", why);
    while (rc == 0 && (rc = csv_next(csv, why)) > 0)
        rc = fill_event(f, csv, why);
    csv_close(csv);
    return rc;
}

static int take_row(void *ctx, const struct apc_vector *row)
{
    struct filling *f = ctx;
    struct apc_vector copy = *row;
    const struct apc_rows rows = {.size = sizeof rows, .vector = &copy, .n_vectors = 1};
    const int rc = apc_store_append_rows(f->store, &rows);
    return f->failed = rc < 0 ? rc : 0;
}

/* What laws expected; their numbers are in published.csv. */
static int fill_predictions(struct filling *f, const struct experiment *e, struct apc_error *why)
{
    char path[600];
    size_t n;
    struct apc_store *ticks = NULL;
    struct apc_tag *tag = provision_tags(e, &n);
    int rc = tag ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
    snprintf(path, sizeof path, "%.580s/" TICKS_FILE, f->dir);
    if (rc == 0 && access(path, F_OK) == 0)
        rc = ticks_open(&ticks, path, why);
    for (size_t i = 0; ticks && i < n && rc >= 0 && f->failed == 0; i++)
        if (tag[i].table == APC_PREDICTION &&
            (rc = apc_store_vectors(ticks, tag[i].table, tag[i].id, &(struct apc_range){0}, take_row, f)) < 0)
            apc_fail(why, rc, "%s: %s", path, apc_store_error(ticks));
    if (rc >= 0 && f->failed < 0)
        rc = fail_filling(f, TICKS_FILE, f->failed, why);
    apc_store_close(ticks);
    free(tag);
    return rc < 0 ? rc : 0;
}

int folder_store(struct apc_store **store, const char *dir, const struct experiment *e, apc_ns zero,
                 struct apc_error *why)
{
    static const char *const more[] = {"operation.csv", "published.csv"};
    int rc = apc_store_open(store, "mem:apc-folder", NULL, why);
    struct filling f = {*store, dir, zero, 0};
    if (rc == 0 && (rc = apc_store_init(*store)) < 0)
        fail_filling(&f, "", rc, why);
    if (rc >= 0)
        rc = fill_samples(&f, "samples.csv", why);
    for (size_t i = 0; i < 2 && rc == 0; i++)
        if ((rc = fill_samples(&f, more[i], why)) == APC_ENOTFOUND) /* a former version's */
            rc = 0;
    if (rc == 0 && (rc = fill_events(&f, why)) == APC_ENOTFOUND)
        rc = 0;
    if (rc == 0)
        rc = fill_predictions(&f, e, why);
    if (rc == 0 && (rc = provision(*store, e, PROVISION_KEEP)) < 0)
        fail_filling(&f, "run.conf", rc, why);
    return rc;
}
