/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Which loops need somebody, as `apc monitor` tells it. A window is judged loop after loop, for a while in each
 * request, so that nobody who asks for something else waits long: a window that is asked for again goes on
 * where it stopped. The windows are the one computing thread's.
 */
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "common/health_json.h"

#define DAY     (86400 * APC_NS_PER_S)
#define MOST    (31 * DAY)
#define AT_ONCE (2 * APC_NS_PER_S)
#define NEWEST  300000 /* rows of each variable: 8 h of ten a second */
#define KEPT    8

struct judged {
    int64_t catalogue;
    struct kpis kpis; /* from, until: of the question; until 0: nothing is kept here */
    size_t left;
    uint64_t used; /* a number that rises with each use */
};

int verdicts_init(struct verdicts *verdicts)
{
    verdicts->kept = calloc(KEPT, sizeof *verdicts->kept);
    return !verdicts->kept ? APC_ENOMEM : pthread_mutex_init(&verdicts->mutex, NULL) ? APC_ESYS : 0;
}

void verdicts_free(struct verdicts *verdicts)
{
    for (size_t i = 0; verdicts->kept && i < KEPT; i++)
        kpis_free(&verdicts->kept[i].kpis);
    free(verdicts->kept);
    free(verdicts->loop);
    pthread_mutex_destroy(&verdicts->mutex);
}

/* What is kept of the window, or in place of the one that nobody has asked for longest. */
static struct judged *find_window(struct verdicts *verdicts, apc_ns since, apc_ns until, int64_t catalogue)
{
    struct judged *oldest = verdicts->kept, *found = NULL;
    uint64_t used = 0;
    for (struct judged *j = verdicts->kept; j < verdicts->kept + KEPT; j++) {
        if (j->kpis.from == since && j->kpis.until == until && j->catalogue == catalogue)
            found = j;
        if (j->used < oldest->used)
            oldest = j;
        used = j->used > used ? j->used : used;
    }
    if (!found) {
        found = oldest;
        kpis_free(&found->kpis);
        *found = (struct judged){.catalogue = catalogue, .kpis = {.from = since, .until = until}};
    }
    found->used = used + 1;
    return found;
}

/* Into the metrics, unless those are of a newer window. */
static void publish_verdicts(struct verdicts *verdicts, const struct kpis *m)
{
    struct loop_verdict *loop = calloc(m->n_loops + 1, sizeof *loop);
    for (size_t i = 0; i < m->n_loops && loop; i++) {
        memcpy(loop[i].name, m->loop[i].name, sizeof loop[i].name);
        loop[i].health = health_name(m->loop[i].health.verdict);
    }
    pthread_mutex_lock(&verdicts->mutex);
    if (loop && m->until >= verdicts->until) {
        struct loop_verdict *const former = verdicts->loop;
        verdicts->loop = loop;
        verdicts->n = m->n_loops;
        verdicts->until = m->until;
        loop = former;
    }
    pthread_mutex_unlock(&verdicts->mutex);
    free(loop);
}

static void judged_json(const struct judged *j, struct text *t)
{
    json_add(t, "{");
    range_json(t, j->kpis.from, j->kpis.until);
    json_add(t, "left:%zu, loops:[", j->left);
    for (const struct kpis_loop *l = j->kpis.loop; l < j->kpis.loop + j->kpis.n_loops; l++) {
        json_add(t, "{id:%d, since:%.6jd, until:%.6jd", l->id, l->from, l->until);
        health_members(l, t);
        json_add(t, "}");
    }
    json_add(t, "]}");
}

/* Of the loop that ticks most often. */
static double least_time(struct ui *ui, int64_t *catalogue)
{
    const struct loops *loops = &ui->model.plant.loops;
    apc_ns least = 0;
    pthread_mutex_lock(&ui->model.mutex);
    for (size_t i = 0; i < loops->n; i++) {
        const apc_ns period = loops->controller[loops->at[i].controller].period;
        least = least == 0 || period < least ? period : least;
    }
    *catalogue = ui->model.catalogue;
    pthread_mutex_unlock(&ui->model.mutex);
    return HEALTH_TICKS * apc_ns_to_s(least);
}

static bool fault_record(struct request *r, const struct kpis *m)
{
    char from[APC_TIME_LEN], until[APC_TIME_LEN];
    return fault_set(&r->fault, 422, "record", "since",
                     "no loop is on record from %s to %s: ask for another time",
                     apc_time_format(m->from, from), apc_time_format(m->until, until));
}

/* Goes on with it. False: the fault is set. */
static bool judge_window(struct request *r, struct judged *j, struct apc_store *store)
{
    const struct health_asked asked = {.newest = NEWEST, .give_up = apc_clock_mono(NULL) + AT_ONCE};
    const int rc = health_of_store(&j->kpis, store, &asked);
    if (rc == APC_ENOTFOUND)
        return fault_record(r, &j->kpis);
    if (rc < 0) {
        fault_store(r, rc, store);
        return false;
    }
    j->left = (size_t)rc;
    if (j->left == 0)
        kpis_sort_by_health(&j->kpis);
    return j->left > 0 || kpis_on_record(&j->kpis) || fault_record(r, &j->kpis);
}

void get_health(struct ui *ui, struct request *r, struct apc_store *store)
{
    apc_ns since, until;
    int64_t catalogue;
    const double least = least_time(ui, &catalogue);
    if (!query_range(r, DAY, MOST, &since, &until))
        return;
    if (until > apc_clock_utc(NULL)) /* what is still to come is not kept as judged */
        until = apc_clock_utc(NULL);
    since -= since % APC_NS_PER_US; /* as times are told, so that they can be asked for again */
    until -= until % APC_NS_PER_US;
    if (apc_ns_to_s(until - since) < least) {
        fault_set(&r->fault, 422, "parameter", "since",
                  "a loop is judged by %d ticks or more: ask for at least %.4g s", HEALTH_TICKS, least);
        return;
    }
    struct judged *const j = find_window(&ui->verdicts, since, until, catalogue);
    const bool done = j->kpis.loop && j->left == 0;
    if (!done && !judge_window(r, j, store)) {
        kpis_free(&j->kpis);
        *j = (struct judged){0};
        return;
    }
    if (!done && j->left == 0)
        publish_verdicts(&ui->verdicts, &j->kpis);
    judged_json(j, &r->reply);
}
