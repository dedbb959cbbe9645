/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-historian: moves what the live store gets on into a history, a file or a database, in order and once.
 * The loop never waits for it: while the history is away the live store keeps what is to come, as far as its
 * room goes.
 *
 * A worker moves, and may wait for a history as long as it takes; the task only wakes it each cycle, and
 * tells what became of it.
 *
 * A second one, with connections of its own, brings what people ask of the history to the live store
 * (operate/requests.h), as long as what the first one moves is taken: then the history is this experiment's.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/storeuri.h"
#include "daemon/daemon.h"
#include "daemon/gaps.h"
#include "daemon/process_watchdog.h"
#include "daemon/self_monitor.h"
#include "daemon/worker.h"
#include "operate/operate.h"

#define CYCLE   (100 * APC_NS_PER_MS)
#define TIMEOUT (10 * APC_NS_PER_S)   /* of one operation of the history */
#define BATCHES (2 * APC_NS_PER_S)    /* of one step, when there is much to move */
#define HUNG    (60 * APC_NS_PER_S)   /* a step that takes longer has no deadline any more */
#define LAST    APC_NS_PER_S          /* for what came at the very end */
#define WAIT    (12 * APC_NS_PER_S)   /* for a dead predecessor's claim */
#define LOOK    (5 * APC_NS_PER_S)    /* between two looks at what the live store still holds */
#define ASK     (200 * APC_NS_PER_MS) /* between two looks at what people ask for */
#define SETTLE  (50 * APC_NS_PER_MS)  /* the same while something is under way */
#define ANSWER  (2 * APC_NS_PER_S)    /* of one operation of that */
#define WITHIN  10.0                  /* s: what was asked for longer ago is refused */
#define RARELY  9.0 /* s between two steps at most: after 10 a page calls the history late */

struct report {
    int rc;        /* of the last step */
    char why[400]; /* that failed */
    apc_ns whole;  /* monotonic: when the history had all for the last time */
    double left;   /* as of apc_replication_left() */
    struct apc_replication_stats stats;
};

struct shell {
    struct daemon d;
    const char *history;
    double within, every; /* s */
    bool pack;
    struct apc_store *live, *record;
    struct apc_replication *replication;
    struct gap_teller gaps;
    bool reached;   /* the history, once */
    uint64_t older; /* when that was said: stats.older */
    apc_ns looked;  /* monotonic: at what the live store still holds */
    struct worker mover;
    struct report report; /* of the mover, under its mutex */
    struct {
        struct apc_store *live, *history;
        struct requests *requests;
        struct worker worker;
        int rc; /* of the last look, with `why` under the worker's mutex */
        char why[400];
    } asked;
    struct { /* the task's own */
        struct lag_watch lag;
        bool scarce;
        int refused;
        uint64_t rows, older, other, refused_records;
    } told;
    apc_ns woken; /* monotonic: the mover, by the task */
};

#define AT(member) .to = offsetof(struct shell, member)
static const struct option_spec own_options[] = {
    {"history", 0, "URI",
     "Where the record goes: postgresql://host/db#schema, sqlite:FILE [APC_HISTORY, or what follows the '+' "
     "in --store]",
     OPTION_TEXT, AT(history)},
    {"writes-within", 0, "SECONDS",
     "Largest age of a request in the history (table request) that still goes to the loop; default 10; 0: "
     "none goes",
     OPTION_NUMBER, AT(within), .high = 3600, .must = "be seconds, from 0 to 3600"},
    {"every", 0, "SECONDS",
     "Time between two moves of rows, 0.1 to 9; default 0.1. Several rows of a signal at once cost a "
     "database less, but if the host fails, the rows that were not yet moved are lost",
     OPTION_NUMBER, AT(every), .low = 0.1, .high = RARELY, .must = "be seconds, from 0.1 to 9"},
    {"pack", 0, NULL,
     "Write four or more samples of a signal that are moved at once into one row of PostgreSQL: with --every "
     "some seconds, a third of the cost. SQL reads them by function trend(), not from table sensor",
     OPTION_FLAG, AT(pack)},
    {0},
};

static const struct program program = {
    .ordinary = true,
    .name = "apc-historian",
    .doc =
        "Move the new rows of the live store --store to the history --history: samples, ticks, events, "
        "timing and descriptions, in order and once. While the history is offline the loop goes on. Writes "
        "that people request in the history are passed to the live store, and the outcome is returned.",
    .task = "historian",
    .extra = own_options,
};

/* ---- The mover ----------------------------------------------------------------------------- */

/* Where there are no tables yet they are made; a file that has gone is not: it may come back. */
static int move(struct shell *s, apc_ns timeout)
{
    int rc = apc_replication_step(s->replication, timeout);
    if ((rc == APC_ESCHEMA || (rc == APC_ECONN && !s->reached)) && apc_store_init(s->record) >= 0)
        rc = apc_replication_step(s->replication, timeout);
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(s->replication, &stats);
    s->reached = s->reached && stats.older == s->older;
    if (rc >= 0 && !s->reached && apc_store_connected(s->record)) { /* only its owner may say what it is */
        const int said = apc_store_keep_history(s->record);
        s->reached = said >= 0 || said == APC_EPERM;
        s->older = stats.older;
    }
    return rc;
}

static void note(struct shell *s, int rc, const struct apc_replication_stats *stats, double left)
{
    pthread_mutex_lock(&s->mover.mutex);
    s->report.rc = rc;
    s->report.left = left;
    s->report.stats = *stats;
    if (rc < 0)
        snprintf(s->report.why, sizeof s->report.why, "%s", apc_replication_error(s->replication));
    if (rc >= 0 && stats->behind == 0)
        s->report.whole = apc_clock_mono(NULL);
    pthread_mutex_unlock(&s->mover.mutex);
}

/* What the live store holds takes a while to look through, and is asked for only when it matters. */
static double left_of(struct shell *s, int rc, uint64_t behind)
{
    const apc_ns now = apc_clock_mono(NULL);
    if (rc >= 0 && (behind == 0 || now - s->report.whole <= LAG_LIMIT))
        return 1;
    if (now - s->looked < LOOK)
        return s->report.left;
    s->looked = now;
    return apc_replication_left(s->replication);
}

static apc_ns replicate_step(void *ctx, bool last)
{
    struct shell *s = ctx;
    const int rc = move(s, last ? LAST : BATCHES);
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(s->replication, &stats);
    note(s, rc, &stats, left_of(s, rc, stats.behind));
    return WORKER_IDLE;
}

/* ---- Who brings what is asked for ------------------------------------------------------------- */

static apc_ns bring(void *ctx, bool last)
{
    struct shell *s = ctx;
    pthread_mutex_lock(&s->mover.mutex);
    const bool taken = s->report.rc >= 0;
    pthread_mutex_unlock(&s->mover.mutex);
    if (last)
        return WORKER_IDLE;
    const int rc = taken ? requests_step(s->asked.requests) : 0;
    pthread_mutex_lock(&s->asked.worker.mutex);
    s->asked.rc = rc;
    if (rc < 0)
        snprintf(s->asked.why, sizeof s->asked.why, "%s", requests_error(s->asked.requests));
    pthread_mutex_unlock(&s->asked.worker.mutex);
    return rc > 0 ? SETTLE : ASK;
}

/* ---- The task ------------------------------------------------------------------------------ */

/* That the history is away is told by who moves. */
static void tell_asked(struct shell *s, int rc, const char *why)
{
    const bool away = rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_EFULL;
    if (rc < 0 && !away && s->told.refused >= 0)
        daemon_event(&s->d, APC_EVENT_WARNING, "history",
                     "requests in the history do not reach the loop: %.100s", why);
    if (rc >= 0 && s->told.refused < 0)
        daemon_event(&s->d, APC_EVENT_INFO, "history", "requests in the history reach the loop again");
    s->told.refused = away ? s->told.refused : rc;
}

static void tell_lag(struct shell *s, const struct report *r, apc_ns now)
{
    const uint64_t rows = r->stats.samples + r->stats.vectors;
    const bool trouble = s->told.lag.away || s->told.lag.slow;
    const enum lag_change change = lag_watch_look(&s->told.lag, r->rc < 0, r->stats.behind, now - r->whole);
    if (change == LAG_AWAY)
        daemon_event(&s->d, APC_EVENT_WARNING, "history", "the history accepts no rows, trying again: %.130s",
                     r->why);
    if (change == LAG_SLOW)
        daemon_event(&s->d, APC_EVENT_WARNING, "history",
                     "the history is slow: it has not had all for %.0f s, %llu rows are missing",
                     apc_ns_to_s(now - r->whole), (unsigned long long)r->stats.behind);
    if (change == LAG_ENDED)
        daemon_event(&s->d, APC_EVENT_INFO, "history",
                     "the history has all again: %llu rows, up to %.1f s late",
                     (unsigned long long)(rows - s->told.rows), apc_ns_to_s(s->told.lag.late));
    s->told.rows = trouble ? s->told.rows : rows;
}

static void tell_room(struct shell *s, const struct report *r, apc_ns now)
{
    if (r->left < 0.5 && !s->told.scarce)
        daemon_event(
            &s->d, APC_EVENT_WARNING, "history",
            "the history is %.0f s behind: in some %.0f s more the live store begins to overwrite what "
            "it has not got",
            apc_ns_to_s(now - r->whole), r->left / (1 - r->left) * apc_ns_to_s(now - r->whole));
    s->told.scarce = r->left < 0.5 || (s->told.scarce && r->left < 1);
}

static void tell_older(struct shell *s, const struct report *r)
{
    if (r->stats.older > s->told.older)
        daemon_event(&s->d, APC_EVENT_WARNING, "history",
                     "the history came back older than it was: what the live store still has is sent again");
    s->told.older = r->stats.older;
}

static void tell_other(struct shell *s, const struct apc_replication_stats *stats)
{
    if (stats->other.rows > s->told.other)
        daemon_event(&s->d, APC_EVENT_ALARM, "history",
                     "another writer has written to the history: %llu rows are not the loop's, the last %s "
                     "%d seq %lld; they are left as they are",
                     (unsigned long long)(stats->other.rows - s->told.other),
                     apc_table_name(stats->other.table), stats->other.id, (long long)stats->other.seq);
    s->told.other = stats->other.rows;
}

static void tell_refused(struct shell *s, const struct apc_replication_stats *stats)
{
    if (stats->refused > s->told.refused_records)
        daemon_event(&s->d, APC_EVENT_WARNING, "history",
                     "the history refuses %llu events or rows of timing, whose time is more than a day ahead "
                     "of its clock",
                     (unsigned long long)(stats->refused - s->told.refused_records));
    s->told.refused_records = stats->refused;
}

/* What failed, or had no time for all, goes on at the next cycle. */
static void wake_mover(struct shell *s, const struct report *r, apc_ns now)
{
    if (r->rc < 0 || r->stats.behind > 0 ||
        now + CYCLE / 2 - s->woken >= (apc_ns)(s->every * (double)APC_NS_PER_S)) {
        worker_wake(&s->mover);
        s->woken = now;
    }
}

static int on_historian_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    const apc_ns now = apc_clock_mono(NULL);
    (void)tick;
    pthread_mutex_lock(&s->asked.worker.mutex);
    char why[sizeof s->asked.why];
    const int asked = s->asked.rc;
    memcpy(why, s->asked.why, sizeof why);
    pthread_mutex_unlock(&s->asked.worker.mutex);
    pthread_mutex_lock(&s->mover.mutex);
    const struct report r = s->report;
    pthread_mutex_unlock(&s->mover.mutex);
    wake_mover(s, &r, now);
    if (worker_busy(&s->mover) > HUNG) {
        daemon_event(&s->d, APC_EVENT_ALARM, "history",
                     "stopping: the history does not answer, in spite of its deadline");
        return APC_ETIMEDOUT;
    }
    tell_asked(s, asked, why);
    tell_older(s, &r);
    tell_other(s, &r.stats);
    tell_refused(s, &r.stats);
    tell_lag(s, &r, now);
    tell_room(s, &r, now);
    return 0;
}

/* ---- Start and end ------------------------------------------------------------------------- */

static int refuse_history(struct shell *s, const char *uri, int rc)
{
    char name[400];
    store_name(uri, name, sizeof name);
    return daemon_error(&s->d, rc, "the history %s cannot be taken: %s", name,
                        apc_replication_error(s->replication));
}

/* What is away may come; what is another's, or newer, stays so. */
static int replicate_first(struct shell *s, const char *uri)
{
    const apc_ns give_up = apc_clock_mono(NULL) + WAIT;
    int rc = move(s, BATCHES);
    while (rc == APC_EBUSY && apc_clock_mono(NULL) < give_up)
        if (process_watchdog_wait(s->d.process_watchdog, 100 * APC_NS_PER_MS) > 0)
            return 1;
        else
            rc = move(s, BATCHES);
    s->report.whole = apc_clock_mono(NULL);
    struct apc_replication_stats stats = {.size = sizeof stats};
    apc_replication_stats(s->replication, &stats);
    note(s, rc, &stats, 1);
    return rc >= 0 || (stats.away && (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_EFULL))
               ? 0
               : refuse_history(s, uri, rc);
}

static int open_asked(struct shell *s, const char *uri)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = s->d.name, .timeout = ANSWER, .backoff_max = APC_NS_PER_S};
    struct apc_error why;
    int rc = daemon_store(&s->d, &s->asked.live, NULL, 0);
    if (rc == 0 && (rc = store_open(&s->asked.history, uri, &options, &why)) < 0)
        return daemon_error(&s->d, rc, "--history: %s", why.text);
    if (rc == 0 && (rc = requests_create(&s->asked.requests, s->asked.live, s->asked.history,
                                         (apc_ns)(s->within * (double)APC_NS_PER_S), &why)) < 0)
        return daemon_error(&s->d, rc, "%s", why.text);
    return rc;
}

static int open_historian(struct shell *s)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = s->d.name, .timeout = TIMEOUT, .chunks = s->pack};
    const char *uri = s->history ? s->history : getenv("APC_HISTORY"), *store = getenv("APC_STORE");
    struct apc_error why;
    store = s->d.options.store ? s->d.options.store : store;
    if (!uri && store && store[apc_store_live(store)])
        uri = store + apc_store_live(store) + 1;
    if (!uri)
        return daemon_error(&s->d, APC_EINVAL, "no history: give --history URI or set APC_HISTORY");
    int rc = daemon_store(&s->d, &s->live, NULL, 0);
    if (rc == 0 && (rc = apc_store_connect(s->live)) < 0)
        return daemon_error(&s->d, rc, "--store: %s", apc_store_error(s->live));
    if (rc == 0 && (rc = store_open(&s->record, uri, &options, &why)) < 0)
        return daemon_error(&s->d, rc, "--history: %s", why.text);
    if (rc == 0 && (rc = apc_replication_create(&s->replication, s->live, s->record, &why)) < 0)
        return daemon_error(&s->d, rc, "%s", why.text);
    if (rc == 0) {
        s->gaps = (struct gap_teller){.live = s->live, .source = s->d.name, .log = s->d.log};
        apc_replication_tell(s->replication, gap_tell, &s->gaps);
        rc = replicate_first(s, uri);
    }
    return rc == 0 && s->within > 0 ? open_asked(s, uri) : rc;
}

static int start_replication(struct shell *s)
{
    struct apc_error why;
    s->looked = apc_clock_mono(NULL);
    int rc = worker_start(&s->mover, &why);
    if (rc == 0 && s->asked.requests)
        rc = worker_start(&s->asked.worker, &why);
    return rc < 0 ? daemon_error(&s->d, rc, "%s", why.text) : 0;
}

/* True: they have ended. One that waits for a history is left alone, and the process ends around it. */
static bool end_replication(struct shell *s)
{
    const apc_ns until = apc_clock_mono(NULL) + LAST;
    worker_stop(&s->asked.worker);
    const bool moved = worker_join(&s->mover, until);
    return worker_join(&s->asked.worker, until) && moved;
}

int main(int argc, char **argv)
{
    static struct shell s = {.within = WITHIN, .every = 0.1}; /* it outlives main(), should a worker */
    const struct rhythm rhythm = {.period = CYCLE, .overrun = APC_OVERRUN_SKIP};
    struct apc_error why;
    int rc = worker_init(&s.mover, replicate_step, &s, &why);
    if (rc == 0)
        rc = worker_init(&s.asked.worker, bring, &s, &why);
    if (rc == 0)
        rc = daemon_open(&s.d, &program, &s, argc, argv);
    if (rc == 0)
        rc = open_historian(&s);
    if (rc == 0)
        rc = start_replication(&s);
    if (rc == 0)
        rc = daemon_run(&s.d, rhythm, on_historian_tick, &s);
    if (end_replication(&s)) {
        requests_destroy(s.asked.requests);
        apc_store_close(s.asked.history);
        apc_store_close(s.asked.live);
        apc_replication_destroy(s.replication);
        apc_store_close(s.record);
        apc_store_close(s.live);
    }
    return daemon_close(&s.d, rc > 0 ? 0 : rc);
}
