/* SPDX-License-Identifier: BSD-3-Clause */
#include "recorder.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define QUEUE   128
#define WINDOWS (RECORDER_QUANTITIES + 1) /* the last: what is measured beside the task */
#define LISTED  6                         /* events of the link that are written as they are, and */
#define MINUTE  (60 * APC_NS_PER_S)       /* after how long as many again */
#define COUNTED (10 * APC_NS_PER_S)       /* the others are one event for so long */

static const struct {
    enum apc_task_histogram which;
    const char *name;
} quantities[RECORDER_QUANTITIES] = {{APC_LATENESS, "lateness"}, {APC_JITTER, "jitter"}, {APC_RUN, "run"}};

struct recorder {
    struct apc_store *store;
    char task[32];
    pthread_mutex_t mutex; /* of the queue */
    struct apc_event queue[QUEUE];
    size_t first, count;
    unsigned long lost, told; /* pushed out of the queue; of those, said so in the records */
    struct {
        apc_ns since; /* of the first that is listed */
        unsigned listed;
        unsigned long count; /* that are not */
        apc_ns first;        /* of these */
        struct apc_event last;
    } chatter;
    /* What live histograms had when last looked at, and what of them is not yet in the store. */
    struct apc_histogram *window, *mark[WINDOWS], *pending[WINDOWS];
    uint64_t missed[WINDOWS];
    /* Of an append that failed, and may have been stored all the same: what it was. */
    struct {
        struct apc_event first;
        size_t n; /* 0: none */
        unsigned long lost;
    } sent;
    struct apc_timing_row row[WINDOWS]; /* time 0: none */
    uint64_t row_missed[WINDOWS];
    _Atomic uint64_t absent; /* ticks missed before the task began */
    const char *beside;      /* NULL: nothing */
    const struct apc_histogram *run;
    const _Atomic uint64_t *failed;
    struct apc_bin *bins;
    int64_t *low, *high, *number;
    size_t capacity;
};

int recorder_create(struct recorder **out, struct apc_store *store, const char *task)
{
    struct recorder *r = calloc(1, sizeof *r);
    *out = NULL;
    if (!r || apc_mutex_init(&r->mutex) < 0) {
        free(r);
        apc_store_close(store);
        return APC_ENOMEM;
    }
    r->store = store;
    snprintf(r->task, sizeof r->task, "%s", task);
    int rc = apc_histogram_create(&r->window);
    for (int i = 0; i < WINDOWS && rc == 0; i++) {
        rc = apc_histogram_create(&r->mark[i]);
        if (rc == 0)
            rc = apc_histogram_create(&r->pending[i]);
    }
    if (rc < 0)
        recorder_destroy(r);
    else
        *out = r;
    return rc;
}

void recorder_destroy(struct recorder *r)
{
    if (!r)
        return;
    for (int i = 0; i < WINDOWS; i++) {
        apc_histogram_destroy(r->mark[i]);
        apc_histogram_destroy(r->pending[i]);
    }
    apc_histogram_destroy(r->window);
    apc_store_close(r->store);
    pthread_mutex_destroy(&r->mutex);
    free(r->bins);
    free(r->low);
    free(r->high);
    free(r->number);
    free(r);
}

void recorder_measure(struct recorder *r, const char *task, const struct apc_histogram *run,
                      const _Atomic uint64_t *failed)
{
    r->beside = task;
    r->run = run;
    r->failed = failed;
}

void recorder_absent(struct recorder *r, uint64_t missed)
{
    atomic_store(&r->absent, missed);
}

static void enqueue(struct recorder *r, const struct apc_event *event)
{
    if (r->count == QUEUE) {
        r->first = (r->first + 1) % QUEUE;
        r->count--;
        r->lost++;
    }
    r->queue[(r->first + r->count++) % QUEUE] = *event;
}

/* What was counted is told of by its last one, which says how it is now. */
static void tell_chatter(struct recorder *r, apc_ns now)
{
    struct apc_event *last = &r->chatter.last;
    const size_t used = strnlen(last->text, sizeof last->text);
    if (r->chatter.count == 0 || (now < r->chatter.first + COUNTED && now > r->chatter.first - MINUTE))
        return; /* beyond that the clock has stepped */
    if (r->chatter.count > 1)
        snprintf(last->text + used, sizeof last->text - used, " (%lu such events in %.0f s, the last one)",
                 r->chatter.count, apc_ns_to_s(last->time - r->chatter.first));
    enqueue(r, last);
    r->chatter.count = 0;
}

/* A link that comes and goes all the time is counted; its first events are listed. */
static bool is_counted(struct recorder *r, const struct apc_event *event)
{
    if (strcmp(event->kind, "stop") == 0)
        tell_chatter(r, INT64_MAX);
    if (strcmp(event->kind, "link") != 0)
        return false;
    tell_chatter(r, event->time);
    if (event->time < r->chatter.since || event->time - r->chatter.since >= MINUTE) {
        r->chatter.since = event->time;
        r->chatter.listed = 0;
    }
    if (r->chatter.count == 0 && r->chatter.listed < LISTED) {
        r->chatter.listed++;
        return false;
    }
    r->chatter.first = r->chatter.count++ == 0 ? event->time : r->chatter.first;
    r->chatter.last = *event;
    return true;
}

void recorder_event(struct recorder *r, const struct apc_event *event)
{
    if (!r || !r->store)
        return;
    pthread_mutex_lock(&r->mutex);
    if (!is_counted(r, event))
        enqueue(r, event);
    pthread_mutex_unlock(&r->mutex);
}

/* The event that stands for those which were pushed out, before the first that was not. */
static struct apc_event loss(const struct apc_event *next, unsigned long lost)
{
    struct apc_event event = {.time = next->time, .severity = APC_EVENT_WARNING, .kind = "store"};
    memcpy(event.source, next->source, sizeof event.source);
    snprintf(event.text, sizeof event.text,
             "%lu events were lost: more came while the store took none than are kept (%d)", lost, QUEUE);
    return event;
}

/* The first @p n of the queue as it was when @p lost had been pushed out: new ones may have come in since. */
static void drop_written(struct recorder *r, size_t n, unsigned long lost)
{
    r->told = lost;
    pthread_mutex_lock(&r->mutex);
    size_t pushed_out = r->lost - lost;               /* by events that came in meanwhile */
    size_t written = pushed_out < n ? pushed_out : n; /* these are not lost */
    r->lost -= written;
    r->first = (r->first + n - written) % QUEUE;
    r->count -= n - written;
    pthread_mutex_unlock(&r->mutex);
}

/* Where a store may round a time to. */
static struct apc_range around(apc_ns time)
{
    return (struct apc_range){.since = time - APC_NS_PER_US, .until = time + APC_NS_PER_US};
}

struct search {
    const struct apc_event *event;
    const struct apc_timing_row *row;
    bool found;
};

static int find_event(void *ctx, const struct apc_event *e)
{
    struct search *s = ctx;
    s->found = strcmp(e->source, s->event->source) == 0 && strcmp(e->kind, s->event->kind) == 0 &&
               strcmp(e->text, s->event->text) == 0;
    return s->found;
}

static int find_row(void *ctx, const struct apc_timing_row *row)
{
    struct search *s = ctx;
    s->found = strcmp(row->task, s->row->task) == 0 && strcmp(row->quantity, s->row->quantity) == 0 &&
               row->missed == s->row->missed && row->count == s->row->count && row->max == s->row->max;
    return s->found;
}

/* An append whose answer did not come is looked up before anything is sent again: it was stored as a whole or
 * not at all. Who may not read believes that it was not. */
static int settle_events(struct recorder *r)
{
    const struct apc_range range = around(r->sent.first.time);
    struct search s = {.event = &r->sent.first};
    const int rc = r->sent.n > 0 ? apc_store_events(r->store, &range, find_event, &s) : 0;
    if (rc < 0 && rc != APC_EPERM)
        return rc;
    if (s.found)
        drop_written(r, r->sent.n, r->sent.lost);
    r->sent.n = 0;
    return 0;
}

/* What stands for an event that the store refuses for what it says. */
static struct apc_event refusal(const struct recorder *r, const struct apc_event *event)
{
    char time[APC_TIME_LEN];
    struct apc_event said = {.time = apc_clock_utc(NULL), .severity = APC_EVENT_WARNING, .kind = "store"};
    memcpy(said.source, event->source, sizeof said.source);
    snprintf(said.text, sizeof said.text, "an event of %s (%.31s) was refused: %.100s",
             apc_time_format(event->time, time), event->kind, apc_store_error(r->store));
    return said;
}

/* One of these is refused: the others go without it. batch[0] is no part of the queue. */
static int send_singly(struct recorder *r, const struct apc_event *batch, size_t begin, size_t n,
                       unsigned long lost)
{
    for (size_t i = begin; i < n; i++) {
        int rc = apc_store_append_events(r->store, &batch[i], 1);
        if (rc == APC_ERANGE) {
            const struct apc_event said = refusal(r, &batch[i]);
            rc = apc_store_append_events(r->store, &said, 1);
            rc = rc == APC_ERANGE ? 0 : rc; /* this clock is ahead still */
        }
        if (rc < 0) {
            r->sent.first = batch[i];
            r->sent.n = i > 0;
            r->sent.lost = lost;
            return rc;
        }
        if (i > 0)
            drop_written(r, 1, lost);
    }
    return 0;
}

/* The queue is only shortened after the store has acknowledged. */
static int flush_event_queue(struct recorder *r)
{
    struct apc_event batch[1 + QUEUE];
    int rc = settle_events(r);
    if (rc < 0)
        return rc;
    pthread_mutex_lock(&r->mutex);
    tell_chatter(r, apc_clock_utc(NULL));
    size_t n = r->count;
    unsigned long lost = r->lost;
    for (size_t i = 0; i < n; i++)
        batch[1 + i] = r->queue[(r->first + i) % QUEUE];
    pthread_mutex_unlock(&r->mutex);
    if (n == 0)
        return 0;
    batch[0] = loss(&batch[1], lost - r->told);
    bool tell = lost > r->told;
    rc = apc_store_append_events(r->store, tell ? batch : batch + 1, n + tell);
    if (rc == APC_ERANGE)
        return send_singly(r, batch, tell ? 0 : 1, 1 + n, lost);
    if (rc < 0) {
        r->sent.first = batch[1];
        r->sent.n = n;
        r->sent.lost = lost;
        return rc;
    }
    drop_written(r, n, lost);
    return 0;
}

static int reserve_bins(struct recorder *r, size_t n)
{
    if (n <= r->capacity)
        return 0;
    free(r->bins);
    free(r->low);
    free(r->high);
    free(r->number);
    r->bins = calloc(n, sizeof *r->bins);
    r->low = calloc(n, sizeof *r->low);
    r->high = calloc(n, sizeof *r->high);
    r->number = calloc(n, sizeof *r->number);
    r->capacity = r->bins && r->low && r->high && r->number ? n : 0;
    return r->capacity ? 0 : APC_ENOMEM;
}

static int fill_row(struct recorder *r, const struct apc_histogram *histogram, struct apc_timing_row *row)
{
    struct apc_summary summary;
    size_t n = apc_histogram_bins(histogram, NULL, 0);
    int rc = reserve_bins(r, n);
    if (rc < 0)
        return rc;
    apc_histogram_bins(histogram, r->bins, n);
    for (size_t i = 0; i < n; i++) {
        r->low[i] = r->bins[i].low;
        r->high[i] = r->bins[i].high;
        r->number[i] = (int64_t)r->bins[i].count;
    }
    apc_histogram_summary(histogram, &summary);
    row->count = summary.count;
    row->mean = summary.mean;
    row->sd = summary.sd;
    row->p50 = summary.p50;
    row->p99 = summary.p99;
    row->max = summary.max;
    row->bin_low = r->low;
    row->bin_high = r->high;
    row->bin_count = r->number;
    row->n_bins = n;
    return 0;
}

static void window_written(struct recorder *r, int i, uint64_t missed)
{
    apc_histogram_clear(r->pending[i]);
    r->missed[i] = missed;
}

static int settle_window(struct recorder *r, int i)
{
    const struct apc_range range = around(r->row[i].time);
    struct search s = {.row = &r->row[i]};
    const int rc = r->row[i].time != 0 ? apc_store_timing(r->store, &range, find_row, &s) : 0;
    if (rc < 0 && rc != APC_EPERM)
        return rc;
    if (s.found)
        window_written(r, i, r->row_missed[i]);
    r->row[i].time = 0;
    return 0;
}

static int flush_window(struct recorder *r, int i, const char *task, const char *quantity,
                        const struct apc_histogram *live, uint64_t missed, apc_ns period)
{
    int rc = settle_window(r, i);
    if (rc < 0)
        return rc;
    missed = missed > r->missed[i] ? missed : r->missed[i];
    struct apc_timing_row row = {
        .time = apc_clock_utc(NULL), .period = period, .missed = missed - r->missed[i]};
    snprintf(row.task, sizeof row.task, "%s", task);
    snprintf(row.quantity, sizeof row.quantity, "%s", quantity);
    apc_histogram_window(r->window, r->mark[i], live);
    apc_histogram_merge(r->pending[i], r->window);
    rc = fill_row(r, r->pending[i], &row);
    if (rc < 0 || (row.count == 0 && row.missed == 0))
        return rc;
    rc = apc_store_append_timing(r->store, &row, 1);
    if (rc == APC_ERANGE)
        return 0; /* it goes along with the next one, when the clock is right */
    if (rc < 0) {
        r->row[i] = row;
        r->row_missed[i] = missed;
        return rc;
    }
    window_written(r, i, missed);
    return 0;
}

static int flush_timing_queue(struct recorder *r, const struct apc_task *task, apc_ns period)
{
    const uint64_t missed = atomic_load(&r->absent) + apc_task_missed(task);
    int rc = 0;
    for (int i = 0; i < RECORDER_QUANTITIES && rc == 0; i++)
        rc = flush_window(r, i, r->task, quantities[i].name, apc_task_histogram(task, quantities[i].which),
                          missed, period);
    if (rc == 0 && r->beside)
        rc = flush_window(r, RECORDER_QUANTITIES, r->beside, "run", r->run, atomic_load(r->failed), period);
    return rc;
}

int recorder_flush(struct recorder *r, const struct apc_task *task, apc_ns period)
{
    if (!r->store)
        return 0;
    int rc = apc_store_connect(r->store), wrote = flush_event_queue(r);
    rc = rc < 0 ? rc : wrote;
    return rc < 0 || !task ? rc : flush_timing_queue(r, task, period);
}

struct apc_store *recorder_store(const struct recorder *r)
{
    return r->store;
}
