/* SPDX-License-Identifier: BSD-3-Clause */
#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.h"
#include "common/timing.h"
#include "experiment/experiment.h"
#include "files/files.h"
#include "past_folder.h"
#include "record/record.h"
#include "record/samples_columns.h"
#include "simulation/simulation.h"

#define PATH_LEN 600

static int make_parents(const char *dir, struct apc_error *why)
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
    return 0;
}

static int make_folders(const char *dir, struct apc_error *why)
{
    int rc = make_parents(dir, why);
    if (rc == 0 && mkdir(dir, 0700) != 0 && errno != EEXIST)
        rc = apc_fail(why, APC_ESYS, "%s: cannot be made: %s", dir, strerror(errno));
    return rc;
}

/* Whoever makes it has it: one that was there a moment ago may be somebody else's by now. */
int folder_choose(char *dir, size_t size, const char *name, struct apc_error *why)
{
    char stamp[APC_TIME_LEN];
    apc_time_format(apc_clock_utc(NULL), stamp);
    const int n = snprintf(dir, size, "runs/%s-%.4s%.2s%.2s-%.2s%.2s%.2s", name, stamp, stamp + 5, stamp + 8,
                           stamp + 11, stamp + 14, stamp + 17);
    if (n + (int)sizeof "-1000" > (int)size)
        return apc_fail(why, APC_EINVAL, "%s: the path is too long", dir);
    int rc = make_parents(dir, why);
    bool made = rc == 0 && mkdir(dir, 0700) == 0;
    for (int i = 2; rc == 0 && !made && errno == EEXIST && i < 1000; i++) {
        snprintf(dir + n, size - (size_t)n, "-%d", i);
        made = mkdir(dir, 0700) == 0;
    }
    return rc < 0 || made ? rc : apc_fail(why, APC_ESYS, "%s: cannot be made: %s", dir, strerror(errno));
}

/* ---- Files that appear whole -------------------------------------------------------------- */

struct file {
    FILE *stream;
    char path[PATH_LEN], part[PATH_LEN + 8];
};

static int file_open(struct file *f, const char *dir, const char *name, struct apc_error *why)
{
    *f = (struct file){0};
    if (snprintf(f->path, sizeof f->path, "%s/%s", dir, name) >= (int)sizeof f->path)
        return apc_fail(why, APC_EINVAL, "%s: the path is too long", dir);
    snprintf(f->part, sizeof f->part, "%s.part", f->path);
    f->stream = fopen(f->part, "we");
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

/* ---- What the run consists of -------------------------------------------------------------- */

static const char *const kept[] = {"run.conf", "plant.so", "plant.fmu",
                                   "plant.py"}; /* and the laws: kept_file() */
static const char *const exported[] = {"samples.csv",   COLUMNS_FILE,         "plant.csv",   TICKS_FILE,
                                       "operation.csv", "published.csv",      "signals.csv", "events.csv",
                                       "timing.csv",    "timing-summary.csv", "report.svg",  "report.png",
                                       WRITTEN_FILE};
#define COUNT(array) (sizeof(array) / sizeof *(array))
#define NEW          ".new"

static void path_in_folder(const char *dir, const char *name, const char *suffix, char path[PATH_LEN])
{
    snprintf(path, PATH_LEN, "%.500s/%s%s", dir, name, suffix);
}

static bool is_empty(const char *dir)
{
    DIR *folder = opendir(dir);
    const struct dirent *entry = NULL;
    while (folder && (entry = readdir(folder)) &&
           (!strcmp(entry->d_name, ".") || !strcmp(entry->d_name, "..")))
        ;
    if (folder)
        closedir(folder);
    return folder && !entry;
}

/* A built-in law or model has no file. */
static bool is_file(const struct plugin *plugin)
{
    return strchr(plugin->name, '/') != NULL;
}

int folder_copy(const char *dir, const char *name, const char *from, struct apc_error *why)
{
    char block[4096];
    struct file copy;
    size_t n;
    FILE *in = fopen(from, "re");
    if (!in)
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be read: %s", from, strerror(errno));
    int rc = file_open(&copy, dir, name, why);
    if (rc == 0) {
        while ((n = fread(block, 1, sizeof block, in)) > 0)
            fwrite(block, 1, n, copy.stream);
        rc = ferror(in) ? apc_fail(why, APC_ESYS, "%s: cannot be read: %s", from, strerror(errno)) : 0;
        rc = file_close(&copy, rc, why);
    }
    fclose(in);
    return rc;
}

static int copy_plugin(const char *dir, const char *name, const char *from, struct apc_error *why)
{
    char part[64];
    snprintf(part, sizeof part, "%.50s" NEW, name);
    return folder_copy(dir, part, from, why);
}

/* law.so, of one in Python law.py; of several controllers law-NAME.so, or where the name is no file's
 * law-NUMBER.so. */
static const char *law_file(const struct experiment *e, size_t i, char name[RECORD_LAW_LEN])
{
    const char *own = e->controllers[i].name;
    const char *kind = apc_law_in_process(e->controllers[i].law) ? "py" : "so";
    if (e->n_controllers == 1)
        snprintf(name, RECORD_LAW_LEN, "law.%s", kind);
    else if (strlen(own) > 40 || strchr(own, '/'))
        snprintf(name, RECORD_LAW_LEN, "law-%zu.%s", i + 1, kind);
    else
        snprintf(name, RECORD_LAW_LEN, "law-%.40s.%s", own, kind);
    return name;
}

/* Number @p i of all that a folder keeps; NULL: there are no more. */
static const char *kept_file(const struct experiment *e, size_t i, char name[RECORD_LAW_LEN])
{
    if (i < COUNT(kept))
        return kept[i];
    return i - COUNT(kept) < e->n_controllers ? law_file(e, i - COUNT(kept), name) : NULL;
}

static const char *plant_file(const struct experiment *e)
{
    const char *const ending = strrchr(e->plant.plugin.name, '.');

    if (!is_fmu(e->plant.plugin.name))
        return "plant.so";
    return strcmp(ending, ".py") ? "plant.fmu" : "plant.py";
}

static int copy_laws(const char *dir, const struct experiment *e, struct apc_error *why)
{
    char name[RECORD_LAW_LEN];
    int rc = 0;
    for (size_t i = 0; i < e->n_controllers && rc == 0; i++)
        if (is_file(&e->controllers[i].plugin))
            rc = copy_plugin(dir, law_file(e, i, name), e->controllers[i].plugin.name, why);
    return rc;
}

/* The experiment, whole. */
static int put_experiment(const char *dir, const struct experiment *e, struct apc_error *why)
{
    struct file copy;
    char *text;
    int rc = model_files_embed(e, &text, why);

    if (rc == 0)
        rc = file_open(&copy, dir, "run.conf" NEW, why);
    if (rc == 0) {
        fputs(text, copy.stream);
        rc = file_close(&copy, 0, why);
    }
    free(text);
    return rc;
}

int folder_make(const char *dir, bool force, struct apc_error *why)
{
    const int rc = make_folders(dir, why);
    if (rc == 0 && !force && !is_empty(dir))
        return apc_fail(
            why, APC_EPERM,
            "%s is not empty: give a folder of its own to this run, or --force to write over what "
            "is there",
            dir);
    return rc;
}

int folder_create(const char *dir, const struct experiment *e, bool force, struct apc_error *why)
{
    /* Known before the run: its ticks are kept in a file of SQLite. */
    struct apc_store *ticks = NULL;
    int rc = apc_store_open(&ticks, "sqlite:" TICKS_FILE, NULL, why);
    apc_store_close(ticks);
    if (rc == 0)
        rc = folder_make(dir, force, why);
    if (rc < 0)
        return rc;
    rc = put_experiment(dir, e, why);
    if (rc == 0)
        rc = copy_laws(dir, e, why);
    if (rc == 0 && is_file(&e->plant.plugin))
        rc = copy_plugin(dir, plant_file(e), e->plant.plugin.name, why);
    if (rc == 0 && e->past > 0)
        rc = past_folder_put(dir, e->past_dir, why);
    if (rc < 0)
        folder_discard(dir, e);
    return rc;
}

void folder_discard(const char *dir, const struct experiment *e)
{
    char path[PATH_LEN], name[RECORD_LAW_LEN];
    for (size_t i = 0; kept_file(e, i, name); i++) {
        path_in_folder(dir, kept_file(e, i, name), NEW, path);
        remove(path);
    }
    past_folder_discard(dir);
    remove(dir); /* fails, as it should, when there is more in it */
}

/* ---- The record ----------------------------------------------------------------------------- */

static void put_record_text(FILE *out, const char *name, const char *text)
{
    char instead;
    fprintf(out, "%s = \"", name);
    for (size_t n; *text; text += n) {
        n = text_step(text, &instead);
        if (*text == '"' || *text == '\\')
            fputc('\\', out);
        fwrite(instead ? &instead : text, 1, instead ? 1 : n, out);
    }
    fputs("\"; ", out);
}

static void put_record_number(FILE *out, const char *name, double value)
{
    char text[40];
    apc_number_format(value, text, sizeof text);
    fprintf(out, "%s = %s%s;\n", name, text, strpbrk(text, ".e") ? "" : ".0");
}

static int put_plugin(FILE *out, const char *dir, const char *file, const struct plugin *plugin,
                      const char *name, struct apc_error *why)
{
    char path[PATH_LEN], hash[RECORD_HASH_LEN];
    fputs("{ ", out);
    put_record_text(out, "name", name);
    fprintf(out, "chosen = %s; ", plugin->chosen ? "true" : "false");
    if (is_file(plugin)) {
        path_in_folder(dir, file, "", path);
        int rc = record_hash(path, hash, why);
        if (rc < 0)
            return rc;
        put_record_text(out, "file", file);
        put_record_text(out, "from", plugin->name);
        put_record_text(out, "sha256", hash);
    }
    fputs("}", out);
    return 0;
}

static int put_laws(FILE *out, const char *dir, const struct experiment *e, struct apc_error *why)
{
    const bool one = e->n_controllers == 1;
    char name[RECORD_LAW_LEN];
    int rc = 0;
    fputs(one ? "law = " : "laws = ( ", out);
    for (size_t i = 0; i < e->n_controllers && rc == 0; i++) {
        fputs(i ? ",\n         " : "", out);
        rc = put_plugin(out, dir, law_file(e, i, name), &e->controllers[i].plugin,
                        e->controllers[i].law->name, why);
    }
    fputs(one ? ";\n" : " );\n", out);
    return rc;
}

static void put_metadata(FILE *out, const struct experiment *e, const struct folder_metadata *metadata)
{
    char start[APC_TIME_LEN];
    struct record_build build;
    record_build_here(&build);
    fputs("# What was in force in this run, beside what run.conf says.\n", out);
    put_record_text(out, "by", metadata->by);
    put_record_text(out, "\nversion", build.libapc);
    put_record_text(out, "\ncvode", build.cvode);
    put_record_text(out, "\nmachine", build.machine);
    if (metadata->host) {
        put_record_text(out, "\nhost", metadata->host);
        put_record_text(out, "\nstart", apc_time_format(metadata->start, start));
        put_record_text(out, "\ntimer", metadata->timer);
        put_record_text(out, "\nstore", metadata->store);
    }
    if (metadata->live)
        put_record_text(out, "\nlive", metadata->live);
    fputc('\n', out);
    put_record_number(out, "duration", e->duration);
    if (e->past > 0)
        put_record_number(out, "past", e->past);
    fprintf(out, "seed = %" PRId64 "L;\n", (int64_t)e->seed);
    if (e->net[0]) {
        put_record_text(out, "net", e->net);
        fputc('\n', out);
    }
}

static int write_record(const char *dir, const struct experiment *e, const struct folder_metadata *metadata,
                        struct apc_error *why)
{
    char path[PATH_LEN], hash[RECORD_HASH_LEN];
    struct file f;
    path_in_folder(dir, "run.conf", "", path);
    int rc = record_hash(path, hash, why);
    if (rc < 0 || (rc = file_open(&f, dir, RECORD_FILE, why)) < 0)
        return rc;
    put_metadata(f.stream, e, metadata);
    fputs("experiment = { ", f.stream);
    put_record_text(f.stream, "name", e->name);
    put_record_text(f.stream, "sha256", hash);
    fputs("};\n", f.stream);
    rc = put_laws(f.stream, dir, e, why);
    fputs("plant = ", f.stream);
    if (rc == 0)
        rc = put_plugin(f.stream, dir, plant_file(e), &e->plant.plugin,
                        e->plant.model ? e->plant.model->name : "", why);
    fputs(";\n", f.stream);
    return file_close(&f, rc, why);
}

/* Lines that begin with one of @p names, NULL at the end, give way to what @p put writes behind all others. */
static int replace_record_lines(const char *dir, const char *const *names,
                                void (*put)(FILE *out, const void *value), const void *value,
                                struct apc_error *why)
{
    char path[PATH_LEN], *line = NULL;
    size_t size = 0;
    struct file f;
    path_in_folder(dir, RECORD_FILE, "", path);
    FILE *in = fopen(path, "re");
    if (!in)
        return apc_fail(why, APC_ESYS, "%s: cannot be read: %s", path, strerror(errno));
    int rc = file_open(&f, dir, RECORD_FILE, why);
    if (rc == 0) {
        while (getline(&line, &size, in) >= 0) {
            size_t k = 0;
            while (names[k] && strncmp(line, names[k], strlen(names[k])) != 0)
                k++;
            if (!names[k])
                fputs(line, f.stream);
        }
        put(f.stream, value);
        rc = file_close(&f, 0, why);
    }
    free(line);
    fclose(in);
    return rc;
}

static void put_end(FILE *out, const void *ended)
{
    put_record_number(out, "ended", *(const double *)ended);
}

struct moved_stores {
    const char *store, *live;
};

static void put_moved_stores(FILE *out, const void *stores)
{
    const struct moved_stores *moved = stores;
    put_record_text(out, "store", moved->store);
    fputc('\n', out);
    if (moved->live) {
        put_record_text(out, "live", moved->live);
        fputc('\n', out);
    }
}

static void put_start(FILE *out, const void *start)
{
    char text[APC_TIME_LEN];
    put_record_text(out, "start", apc_time_format(*(const apc_ns *)start, text));
    fputc('\n', out);
}

int folder_begins(const char *dir, apc_ns start, struct apc_error *why)
{
    static const char *const names[] = {"start = ", NULL};
    return replace_record_lines(dir, names, put_start, &start, why);
}

static int write_end(const char *dir, double ended, struct apc_error *why)
{
    static const char *const names[] = {"ended = ", NULL};
    return replace_record_lines(dir, names, put_end, &ended, why);
}

int folder_moved(const char *dir, const char *live, struct apc_error *why)
{
    static const char *const names[] = {"live = ", "store = ", NULL};
    char path[PATH_LEN], store[PATH_LEN + sizeof "sqlite:"];
    const struct moved_stores moved = {store, live};
    path_in_folder(dir, "store.db", "", path);
    char *real = realpath(path, NULL);
    if (!real)
        return apc_fail(why, APC_ESYS, "%s: %s", path, strerror(errno));
    snprintf(store, sizeof store, "sqlite:%.*s", PATH_LEN - 1, real);
    free(real);
    return replace_record_lines(dir, names, put_moved_stores, &moved, why);
}

int folder_keep(const char *dir, const struct experiment *e, const struct folder_metadata *metadata,
                struct apc_error *why)
{
    char from[PATH_LEN], to[PATH_LEN], name[RECORD_LAW_LEN];
    for (size_t i = 0; i < COUNT(exported); i++) {
        path_in_folder(dir, exported[i], "", to);
        remove(to);
    }
    for (size_t i = 0; kept_file(e, i, name); i++) {
        path_in_folder(dir, kept_file(e, i, name), NEW, from);
        path_in_folder(dir, kept_file(e, i, name), "", to);
        if (access(from, F_OK) != 0)
            remove(to);
        else if (rename(from, to) != 0)
            return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", to, strerror(errno));
    }
    const int rc = past_folder_keep(dir, why);
    return rc < 0 ? rc : write_record(dir, e, metadata, why);
}

int folder_spare(const char *path, bool force, struct apc_error *why)
{
    struct stat at;
    if (force || stat(path, &at) != 0 || !S_ISREG(at.st_mode) || at.st_size == 0)
        return 0;
    return apc_fail(why, APC_EPERM, "%s: is there already; --force writes over it", path);
}

int folder_replace(const char *part, const char *path, struct apc_error *why)
{
    struct stat at;
    const bool other = lstat(path, &at) == 0 && !S_ISREG(at.st_mode);
    if (!other && rename(part, path) == 0)
        return 0;
    const int rc =
        other ? apc_fail(why, APC_EINVAL, "%s cannot be written: it is there, and no plain file", path)
              : apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    remove(part);
    return rc;
}

/* ---- Samples ------------------------------------------------------------------------------ */

static int put_samples_files(const char *dir, const char *name, const struct samples *samples, apc_ns start,
                             struct apc_error *why)
{
    struct file f;
    int rc = file_open(&f, dir, name, why);
    if (rc < 0)
        return rc;
    samples_write(samples, start, f.stream);
    return file_close(&f, 0, why);
}

static int collected(int rc, const struct apc_store *store, const char *what, struct apc_error *why)
{
    if (rc < 0)
        apc_fail(why, rc, "%s: %s", what, rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
    return rc;
}

/* A setpoint holds until somebody moves it: one of before is in force at the start. */
static int collect_held_setpoints(struct samples *samples, struct apc_store *store,
                                  const struct experiment *e, const struct apc_range *range, apc_ns start)
{
    const struct apc_range until = {.until = start + 1, .last = 1};
    int rc = 0;
    for (size_t k = 1; k <= e->dim.nz && rc == 0; k++) {
        const size_t n = samples->n;
        rc = samples_collect_one(samples, store, APC_SETPOINT, (int)k, &until);
        if (samples->n > n && samples->at[n].time >= range->since)
            samples->n = n; /* is among them */
        else if (samples->n > n)
            samples->at[n].time = start;
    }
    samples_sort(samples);
    return rc;
}

static int export_samples(const char *dir, struct apc_store *store, const struct experiment *e,
                          const struct apc_range *range, apc_ns start, apc_ns *end, struct apc_error *why)
{
    struct samples samples = {0};
    int rc = samples_collect(&samples, store, e, range);
    if (rc == 0)
        rc = collect_held_setpoints(&samples, store, e, range, start);
    rc = collected(rc, store, "samples", why);
    if (rc == 0)
        rc = put_samples_files(dir, "samples.csv", &samples, start, why);
    *end = samples.n > 0 ? samples.at[samples.n - 1].time - start : 0;
    *end =
        (*end / APC_NS_PER_US + 1) * APC_NS_PER_US; /* the last one lies before it, also as it is written */
    samples_free(&samples);
    return rc;
}

typedef int collect_fn(struct samples *, struct apc_store *, const struct experiment *,
                       const struct apc_range *);

/* Nothing where there is nothing. */
static int export_beside(const char *dir, const char *name, collect_fn *collect, struct apc_store *store,
                         const struct experiment *e, apc_ns start, const struct apc_range *range,
                         struct apc_error *why)
{
    struct samples samples = {0};
    int rc = collected(collect(&samples, store, e, range), store, name, why);
    if (rc == 0 && samples.n > 0)
        rc = put_samples_files(dir, name, &samples, start, why);
    samples_free(&samples);
    return rc;
}

static void put_record_limit(FILE *out, double limit)
{
    char text[40] = "";
    if (limit > -APC_VALUE_MAX && limit < APC_VALUE_MAX)
        apc_number_format(limit, text, sizeof text);
    fprintf(out, ",%s", text);
}

/* Which table and id is what. */
static int export_signals(const char *dir, const struct experiment *e, struct apc_error *why)
{
    struct file f;
    size_t n;
    struct apc_tag *tag = provision_tags(e, &n);
    int rc = tag ? file_open(&f, dir, "signals.csv", why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc < 0)
        goto out;
    fputs("table,id,name,unit,description,low,high\n", f.stream);
    for (size_t i = 0; i < n; i++) {
        fprintf(f.stream, "%s,%d,", apc_table_name(tag[i].table), tag[i].id);
        csv_put_quoted(f.stream, tag[i].name);
        fputc(',', f.stream);
        csv_put_quoted(f.stream, tag[i].unit);
        fputc(',', f.stream);
        csv_put_quoted(f.stream, tag[i].description);
        put_record_limit(f.stream, tag[i].low);
        put_record_limit(f.stream, tag[i].high);
        fputc('\n', f.stream);
    }
    rc = file_close(&f, 0, why);
out:
    free(tag);
    return rc;
}

/* ---- Events ------------------------------------------------------------------------------- */

struct events {
    struct apc_event *at;
    size_t n, room;
};

static int keep_event(void *ctx, const struct apc_event *event)
{
    struct events *e = ctx;
    if (e->n == e->room) {
        size_t room = 2 * e->room + 64;
        struct apc_event *at = reallocarray(e->at, room, sizeof *at);
        if (!at)
            return 1;
        e->at = at;
        e->room = room;
    }
    e->at[e->n++] = *event;
    return 0;
}

static void write_event(FILE *out, const struct apc_event *event, apc_ns start)
{
    static const char *const severity[] = {
        [APC_EVENT_INFO] = "info", [APC_EVENT_WARNING] = "warning", [APC_EVENT_ALARM] = "alarm"};
    fprintf(out, "%.6f,%s,", apc_ns_to_s(event->time - start), severity[event->severity]);
    csv_put(out, event->source);
    fputc(',', out);
    csv_put(out, event->kind);
    fputc(',', out);
    csv_put_quoted(out, event->text);
    fputc('\n', out);
}

/* By time; at one time in the order in which they came. An insertion at the end is what there is nearly
 * always. */
static void sort_events(struct events *e)
{
    for (size_t i = 1; i < e->n; i++) {
        const struct apc_event event = e->at[i];
        size_t k = i;
        for (; k > 0 && e->at[k - 1].time > event.time; k--)
            ;
        memmove(&e->at[k + 1], &e->at[k], (i - k) * sizeof event);
        e->at[k] = event;
    }
}

static int export_events(const char *dir, struct apc_store *store, const struct apc_range *range,
                         apc_ns start, struct apc_error *why)
{
    struct events events = {0};
    struct file f;
    int rc = apc_store_events(store, range, keep_event, &events);
    rc = collected(rc > 0 && (size_t)rc > events.n ? APC_ENOMEM : rc < 0 ? rc : 0, store, "events", why);
    if (rc == 0)
        rc = file_open(&f, dir, "events.csv", why);
    if (rc == 0) {
        sort_events(&events);
        fputs("time,severity,source,kind,text\n", f.stream);
        for (size_t i = 0; i < events.n; i++)
            write_event(f.stream, &events.at[i], start);
        rc = file_close(&f, 0, why);
    }
    free(events.at);
    return rc;
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
        for (size_t b = 0; b < s->n_bins; b++) {
            csv_put(bins.stream, s->task);
            fprintf(bins.stream, ",%s,%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRIu64 "\n", s->quantity,
                    s->period, s->bins[b].low, s->bins[b].high, s->bins[b].count);
        }
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

void folder_columns(const char *dir)
{
    char csv[PATH_LEN], columns[PATH_LEN];

    path_in_folder(dir, "samples.csv", "", csv);
    path_in_folder(dir, COLUMNS_FILE, "", columns);
    apc_samples_keep(csv, columns);
}

int folder_export(const char *dir, struct apc_store *store, const struct experiment *e, apc_ns start,
                  double ended, apc_ns since, apc_ns until, struct apc_error *why)
{
    const struct apc_range samples = {.since = since, .until = until};
    const struct apc_range records = {.since = since}; /* the last window is closed when the daemons stop */
    apc_ns end;
    int rc = export_beside(dir, "operation.csv", samples_collect_operation, store, e, start, &samples, why);
    if (rc == 0)
        rc = export_beside(dir, "published.csv", samples_collect_published, store, e, start, &samples, why);
    if (rc == 0)
        rc = export_signals(dir, e, why);
    if (rc == 0)
        rc = export_events(dir, store, &records, start, why);
    if (rc == 0)
        rc = export_timing(dir, store, since, why);
    if (rc == 0)
        rc = ticks_keep(dir, store, e, &samples, why);
    if (rc == 0) /* last: where they are, the rest is */
        rc = export_samples(dir, store, e, &samples, start, &end, why);
    if (rc == 0)
        folder_columns(dir);
    return rc == 0 ? write_end(dir, ended > 0 ? ended : apc_ns_to_s(end), why) : rc;
}

/* ---- What its file does not say ------------------------------------------------------------ */

int folder_put_written(const char *dir, const struct samples *written, apc_ns start, struct apc_error *why)
{
    return put_samples_files(dir, WRITTEN_FILE, written, start, why);
}

int folder_add_written(const char *dir, const struct samples *written, size_t from, apc_ns start,
                       struct apc_error *why)
{
    const struct samples rest = {.at = written->at + from, .n = written->n - from};
    char path[PATH_LEN];
    path_in_folder(dir, WRITTEN_FILE, "", path);
    FILE *file = fopen(path, "ae");
    if (file)
        samples_write_rows(&rest, start, file);
    const bool failed = !file || ferror(file);
    return (!file || fclose(file) == 0) && !failed
               ? 0
               : apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
}

/* Of the file's actions, which it does say. */
static unsigned long long count_actions(const struct experiment *e, bool tuning)
{
    unsigned long long n = 0;
    for (size_t i = 0; i < e->n_actions; i++) {
        const enum apc_table table = e->action[i].to.table;
        const bool counts = tuning ? table == APC_TUNING : table != APC_SETPOINT;
        if (e->action[i].kind == ACTION_WRITE && counts && e->action[i].at <= (apc_ns)(e->duration * 1e9))
            n += e->action[i].n;
    }
    return n;
}

unsigned long long folder_operated(const struct experiment *e, bool tuning)
{
    struct samples operation;
    struct apc_error why;
    char dir[EXPERIMENT_PATH];
    unsigned long long n = 0;
    if (!e->start || !experiment_run_dir(e, dir))
        return 0;
    if (samples_read(&operation, dir, "operation.csv", &why) == 0)
        for (size_t i = 0; i < operation.n; i++) {
            const struct apc_sample *s = &operation.at[i];
            const bool counts =
                tuning ? s->table == APC_TUNING : s->table != APC_ACTUAL && s->table != APC_SETPOINT;
            n += s->time > 0 && counts;
        }
    samples_free(&operation);
    const unsigned long long asked = count_actions(e, tuning);
    return n > asked ? n - asked : 0;
}
