/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Trends that people save, for themselves, for those of their role or for all: a file in the folder of displays that only grows, a
 * line for each save, with author and time. Of the lines of one name and the same people the newest counts; one without signals
 * takes it away.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "apc-ui/api/api.h"
#include "files/files.h"

#define TRENDS_FILE     "trends.jsonl"
#define TRENDS_MAX      (4 << 20)
#define SIGNALS_MAX     12
#define TREND_NAME_MAX  160 /* bytes: 40 characters of any language */
#define SIGNAL_NAME_MAX 127 /* bytes: no name is longer */

static const char *const shared[] = {"user", "role", "plant"};

/* Whose it is: with name and "for" what a line is known by. */
static const char *whose(const struct request *r, const char *with)
{
    return strcmp(with, "user") == 0   ? r->session.user
           : strcmp(with, "role") == 0 ? session_role(&r->session)
                                       : "";
}

static bool fault_trends(const struct ui *ui, struct request *r, const char *what)
{
    return fault_set(&r->fault, 503, "files", NULL, "%s, %s/" TRENDS_FILE ": %s", what, ui->displays,
                     strerror(errno));
}

/* NULL: the fault is set, or there is none to read. */
static FILE *trends_open(const struct ui *ui, struct request *r, bool writes)
{
    char path[sizeof ui->displays + 16];
    snprintf(path, sizeof path, "%s/" TRENDS_FILE, ui->displays);
    if (writes && mkdir(ui->displays, 0777) < 0 && errno != EEXIST) {
        fault_trends(ui, r, "nothing was written");
        return NULL;
    }
    const int fd = open(path,
                        O_CLOEXEC | O_NONBLOCK | /* of a pipe nobody waits for the other end */
                            (writes ? O_RDWR | O_APPEND | O_CREAT | O_NOFOLLOW : O_RDONLY),
                        0644);
    FILE *file = fd >= 0 && (!writes || flock(fd, LOCK_EX) == 0) ? fdopen(fd, writes ? "a+" : "r") : NULL;
    if (!file && (writes || errno != ENOENT))
        fault_trends(ui, r, writes ? "nothing was written" : "the trends cannot be read");
    if (!file && fd >= 0)
        close(fd);
    return file;
}

static bool is_shared(const char *with)
{
    bool known = false;
    for (size_t i = 0; i < sizeof shared / sizeof *shared; i++)
        known = known || strcmp(with, shared[i]) == 0;
    return known;
}

static bool is_trend(const json_t *line)
{
    const json_t *signals = json_object_get(line, "signals");
    const char *with = json_string_value(json_object_get(line, "for"));
    bool known = json_is_string(json_object_get(line, "name")) && with && is_shared(with) &&
                 json_is_string(json_object_get(line, "whose")) &&
                 json_is_string(json_object_get(line, "author")) &&
                 json_is_number(json_object_get(line, "time")) && json_is_array(signals) &&
                 json_array_size(signals) <= SIGNALS_MAX;
    for (size_t i = 0; known && i < json_array_size(signals); i++)
        known = json_is_string(json_array_get(signals, i));
    return known;
}

/* "FOR NAME", by which a session knows a trend. NULL: no memory. */
static char *trend_key(const char *with, const char *name)
{
    char *key;
    return asprintf(&key, "%s %s", with, name) < 0 ? NULL : key;
}

/* Takes its place, as the newest. False: no memory. */
static bool trend_put(json_t *all, json_t *line)
{
    char *key = trend_key(json_string_value(json_object_get(line, "for")),
                          json_string_value(json_object_get(line, "name")));
    if (key)
        json_object_del(all, key);
    const bool ok = key && (json_array_size(json_object_get(line, "signals")) == 0 ||
                            json_object_set(all, key, line) == 0);
    free(key);
    return ok;
}

/* The newest of each name that this session sees, by trend_key(); what is no line of ours, as one half written, is none.
 * NULL: the fault is set. */
static json_t *trends_read(const struct ui *ui, struct request *r, FILE *in)
{
    json_t *all = json_object();
    char *line = NULL;
    size_t room = 0;
    bool ok = all != NULL;
    while (ok && in && getline(&line, &room, in) > 0) {
        json_t *one = json_loads(line, 0, NULL);
        if (is_trend(one) && strcmp(json_string_value(json_object_get(one, "whose")),
                                    whose(r, json_string_value(json_object_get(one, "for")))) == 0)
            ok = trend_put(all, one);
        json_decref(one);
    }
    free(line);
    if (!ok)
        fault_set(&r->fault, 503, "busy", NULL, "out of memory");
    else if (in && ferror(in))
        ok = fault_trends(ui, r, "the trends cannot be read");
    if (ok)
        return all;
    json_decref(all);
    return NULL;
}

static void trend_json(const json_t *one, struct text *t)
{
    const json_t *signals = json_object_get(one, "signals");
    json_add(t, "{name:%s, for:%s, signals:[", json_string_value(json_object_get(one, "name")),
             json_string_value(json_object_get(one, "for")));
    for (size_t i = 0; i < json_array_size(signals); i++)
        json_add(t, "%s", json_string_value(json_array_get(signals, i)));
    json_add(t, "], author:%s, time:%.3f}", json_string_value(json_object_get(one, "author")),
             json_number_value(json_object_get(one, "time")));
}

void get_trends(struct ui *ui, struct request *r, struct apc_store *store)
{
    (void)store;
    FILE *in = ui->displays[0] ? trends_open(ui, r, false) : NULL;
    json_t *all = r->fault.http ? NULL : trends_read(ui, r, in), *one;
    const char *key;
    if (in)
        fclose(in);
    if (all) {
        json_add(&r->reply, "{writable:%i, trends:[", ui->displays[0] != '\0');
        json_object_foreach(all, key, one)
        {
            trend_json(one, &r->reply);
        }
        json_add(&r->reply, "]}");
    }
    json_decref(all);
}

/* ---- Writing ------------------------------------------------------------------------------ */

struct trend_order {
    const char *name, *with;
    json_t *signals; /* the body's */
    double seen;     /* time of the one that it replaces; 0: there is none */
};

static bool read_signals(struct request *r, json_t *signals)
{
    bool ok = json_is_array(signals) && json_array_size(signals) <= SIGNALS_MAX;
    for (size_t i = 0; ok && i < json_array_size(signals); i++) {
        const char *name = json_string_value(json_array_get(signals, i));
        ok = name && *name && strlen(name) <= SIGNAL_NAME_MAX;
    }
    return ok || fault_set(&r->fault, 400, "json", "signals",
                           "\"signals\" must be names of signals, at most %d; none takes the trend away",
                           SIGNALS_MAX);
}

static bool read_trend_order(struct request *r, const json_t *body, struct trend_order *o)
{
    if (!member_text(body, "name", &o->name, &r->fault) || !member_text(body, "for", &o->with, &r->fault) ||
        !member_number(body, "seen", &o->seen, &r->fault))
        return false;
    if (!is_shared(o->with))
        return fault_set(&r->fault, 400, "json", "for", "\"for\" must be \"user\", \"role\" or \"plant\"");
    if (!*o->name || strlen(o->name) > TREND_NAME_MAX)
        return fault_set(&r->fault, 422, "value", "name", "\"name\" must have 1 to %d bytes", TREND_NAME_MAX);
    o->signals = json_object_get(body, "signals");
    return read_signals(r, o->signals);
}

/* A line, whole and on the disk, or none. */
static bool append_trend(const struct ui *ui, struct request *r, int fd, const json_t *line)
{
    struct stat st = {0};
    char last = '\n';
    char *text = json_dumps(line, JSON_COMPACT), *whole = NULL;
    bool ok = fstat(fd, &st) == 0 && (st.st_size == 0 || pread(fd, &last, 1, st.st_size - 1) == 1);
    const int n = !text ? -1 : asprintf(&whole, "%s%s\n", last == '\n' ? "" : "\n", text);
    free(text);
    if (n < 0)
        return fault_set(&r->fault, 503, "busy", NULL, "out of memory");
    if (ok && st.st_size + n > TRENDS_MAX)
        fault_set(&r->fault, 409, "trend", NULL,
                  "%s/" TRENDS_FILE " has %d MiB: move it away, nothing was written", ui->displays,
                  TRENDS_MAX >> 20);
    else if (!ok || write(fd, whole, (size_t)n) != n || fsync(fd) < 0) {
        fault_trends(ui, r, "nothing was written");
        if (ok)
            (void)!ftruncate(fd, st.st_size); /* or else a line that is cut, which is none */
    }
    free(whole);
    return !r->fault.http;
}

static void save_trend(struct ui *ui, struct request *r, const struct trend_order *o)
{
    FILE *file = trends_open(ui, r, true);
    json_t *all = file ? trends_read(ui, r, file) : NULL;
    char *key = trend_key(o->with, o->name);
    const json_t *there = key ? json_object_get(all, key) : NULL;
    const apc_ns ms = apc_clock_utc(NULL) / APC_NS_PER_MS;
    const double time = there ? json_number_value(json_object_get(there, "time")) : 0, now = (double)ms / 1e3;
    json_t *line = json_pack("{s:s, s:s, s:s, s:O, s:s, s:f}", "name", o->name, "for", o->with, "whose",
                             whose(r, o->with), "signals", o->signals, "author", r->session.user, "time",
                             time < now ? now : time + 1e-3);
    if (all && there && (time < o->seen - 5e-4 || time > o->seen + 5e-4))
        fault_set(&r->fault, 409, "trend", NULL,
                  "%s has saved the trend \"%s\" meanwhile: nothing was written",
                  json_string_value(json_object_get(there, "author")), o->name);
    else if (all && !there && json_array_size(o->signals) == 0)
        fault_set(&r->fault, 404, "trend", "name", "there is no trend \"%s\"", o->name);
    else if (!key || !line)
        fault_set(&r->fault, 503, "busy", NULL, "out of memory");
    else if (all && append_trend(ui, r, fileno(file), line))
        trend_json(line, &r->reply);
    free(key);
    json_decref(line);
    json_decref(all);
    if (file)
        fclose(file);
}

void post_trend(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"name", "for", "signals", "seen", NULL};
    struct trend_order o = {0};
    (void)store;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    if (body && read_trend_order(r, body, &o) && request_may_write(ui, r)) {
        if (ui->displays[0])
            save_trend(ui, r, &o);
        else
            fault_set(&r->fault, 409, "trend", NULL,
                      "there is no folder for trends: start apc-ui with --config or --displays");
    }
    json_decref(body);
}
