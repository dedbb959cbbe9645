/* SPDX-License-Identifier: BSD-3-Clause */
#include "folder.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "common/timing.h"
#include "samples.h"

#define PATH_LEN 600
#define COPY     "run.conf.new"

static int make_folders(const char *dir, struct apc_error *why)
{
    char path[PATH_LEN];
    if (strlen(dir) >= sizeof path)
        return apc_fail(why, APC_EINVAL, "%s: the path is too long", dir);
    snprintf(path, sizeof path, "%s", dir);
    for (char *c = path + 1; *c; c++) {
        if (*c != '/')
            continue;
        *c = '\0';
        mkdir(path, 0777); /* one that is there is fine; any other trouble shows at the last one */
        *c = '/';
    }
    if (mkdir(path, 0777) != 0 && errno != EEXIST)
        return apc_fail(why, APC_ESYS, "%s: cannot be made: %s", dir, strerror(errno));
    return 0;
}

/* ---- Files that appear whole -------------------------------------------------------------- */

struct file {
    FILE *stream;
    char path[PATH_LEN], part[PATH_LEN + 8];
};

static int file_open(struct file *f, const char *dir, const char *name, struct apc_error *why)
{
    if (snprintf(f->path, sizeof f->path, "%s/%s", dir, name) >= (int)sizeof f->path)
        return apc_fail(why, APC_EINVAL, "%s: the path is too long", dir);
    snprintf(f->part, sizeof f->part, "%s.part", f->path);
    f->stream = fopen(f->part, "w");
    return f->stream ? 0 : apc_fail(why, APC_ESYS, "%s: cannot be written: %s", f->part, strerror(errno));
}

static int file_close(struct file *f, int rc, struct apc_error *why)
{
    bool failed = ferror(f->stream) != 0;
    failed |= fclose(f->stream) != 0;
    if (rc >= 0 && (failed || rename(f->part, f->path) != 0))
        rc = apc_fail(why, APC_ESYS, "%s: cannot be written: %s", f->path, strerror(errno));
    if (rc < 0)
        remove(f->part);
    return rc < 0 ? rc : 0;
}

int folder_create(const char *dir, const char *experiment_file, struct apc_error *why)
{
    char block[4096];
    struct file copy;
    size_t n;
    int rc = make_folders(dir, why);
    if (rc < 0)
        return rc;
    FILE *from = fopen(experiment_file, "r");
    if (!from)
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be read: %s", experiment_file, strerror(errno));
    rc = file_open(&copy, dir, COPY, why);
    if (rc == 0) {
        while ((n = fread(block, 1, sizeof block, from)) > 0)
            fwrite(block, 1, n, copy.stream);
        rc = file_close(&copy, 0, why);
    }
    fclose(from);
    return rc;
}

int folder_keep(const char *dir, struct apc_error *why)
{
    char copy[PATH_LEN + 8], path[PATH_LEN + 8];
    snprintf(copy, sizeof copy, "%.580s/" COPY, dir);
    snprintf(path, sizeof path, "%.580s/run.conf", dir);
    return rename(copy, path) == 0
               ? 0
               : apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
}

void folder_discard(const char *dir)
{
    char path[PATH_LEN];
    snprintf(path, sizeof path, "%.580s/" COPY, dir);
    remove(path);
    remove(dir); /* fails, as it should, when there is more in it */
}

/* ---- Samples ------------------------------------------------------------------------------ */

static int export_samples(const char *dir, struct apc_store *store, const struct experiment *e,
                          const struct apc_range *range, apc_ns start, struct apc_error *why)
{
    struct samples samples = {0};
    struct file f;
    int rc = samples_collect(&samples, store, e, range);
    if (rc < 0) {
        apc_fail(why, rc, "samples: %s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
        goto out;
    }
    if ((rc = file_open(&f, dir, "samples.csv", why)) < 0)
        goto out;
    samples_write(&samples, start, f.stream);
    rc = file_close(&f, 0, why);
out:
    samples_free(&samples);
    return rc;
}

/* ---- Events ------------------------------------------------------------------------------- */

struct event_file {
    struct file f;
    apc_ns start;
};

static void quoted(FILE *out, const char *text)
{
    fputc('"', out);
    for (; *text; text++) {
        if (*text == '"')
            fputc('"', out);
        fputc(*text, out);
    }
    fputc('"', out);
}

static int write_event(void *ctx, const struct apc_event *event)
{
    static const char *const severity[] = {
        [APC_EVENT_INFO] = "info", [APC_EVENT_WARNING] = "warning", [APC_EVENT_ALARM] = "alarm"};
    struct event_file *e = ctx;
    fprintf(e->f.stream, "%.6f,%s,%s,%s,", apc_ns_to_s(event->time - e->start), severity[event->severity],
            event->source, event->kind);
    quoted(e->f.stream, event->text);
    fputc('\n', e->f.stream);
    return 0;
}

static int export_events(const char *dir, struct apc_store *store, const struct apc_range *range,
                         apc_ns start, struct apc_error *why)
{
    struct event_file e = {.start = start};
    int rc = file_open(&e.f, dir, "events.csv", why);
    if (rc < 0)
        return rc;
    fputs("time,severity,source,kind,text\n", e.f.stream);
    rc = apc_store_events(store, range, write_event, &e);
    if (rc < 0)
        apc_fail(why, rc, "events: %s", apc_store_error(store));
    return file_close(&e.f, rc, why);
}

/* ---- Timing ------------------------------------------------------------------------------- */

static int write_timing(const char *dir, const struct timing *t, struct apc_error *why)
{
    struct file bins, summary;
    int rc = file_open(&bins, dir, "timing.csv", why);
    if (rc < 0)
        return rc;
    fputs("task,quantity,period_ns,low_ns,high_ns,count\n", bins.stream);
    for (size_t i = 0; i < t->n; i++) {
        const struct timing_series *s = &t->series[i];
        for (size_t b = 0; b < s->n_bins; b++)
            fprintf(bins.stream, "%s,%s,%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRIu64 "\n", s->task,
                    s->quantity, s->period, s->bins[b].low, s->bins[b].high, s->bins[b].count);
    }
    rc = file_close(&bins, 0, why);
    if (rc < 0 || (rc = file_open(&summary, dir, "timing-summary.csv", why)) < 0)
        return rc;
    fputs(TIMING_HEADER "\n", summary.stream);
    for (size_t i = 0; i < t->n; i++)
        timing_csv(summary.stream, &t->series[i]);
    return file_close(&summary, 0, why);
}

static int export_timing(const char *dir, struct apc_store *store, apc_ns since, struct apc_error *why)
{
    struct timing t;
    int rc = timing_load(&t, store, &(struct apc_range){.since = since}, NULL);
    if (rc < 0)
        apc_fail(why, rc, "timing: %s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
    else
        rc = write_timing(dir, &t, why);
    timing_free(&t);
    return rc;
}

int folder_export(const char *dir, struct apc_store *store, const struct experiment *e, apc_ns start,
                  apc_ns since, apc_ns until, struct apc_error *why)
{
    const struct apc_range samples = {.since = since, .until = until};
    const struct apc_range records = {.since = since}; /* the last window is closed when the daemons stop */
    int rc = export_samples(dir, store, e, &samples, start, why);
    if (rc == 0)
        rc = export_events(dir, store, &records, start, why);
    return rc == 0 ? export_timing(dir, store, since, why) : rc;
}
