/* SPDX-License-Identifier: BSD-3-Clause */
/* A new live store goes on from its history, or from numbers of its own. */
#include <stdio.h>
#include <stdlib.h>

#include "base/base_internal.h"
#include "shareddata/shareddata_internal.h"

#define EPOCH    (INT64_C(1577923200) * APC_NS_PER_S) /* 2020-01-02: databases count from the day before */
#define A_SECOND (INT64_C(1) << 20)                   /* more rows than any variable has in one */

struct newest {
    struct apc_sample sample;
    struct apc_vector vector;
    double value[APC_ELEMENTS_MAX];
    bool there;
};

static int take_newest_sample(void *ctx, const struct apc_sample *s)
{
    struct newest *n = (struct newest *)ctx;
    n->sample = *s;
    n->there = true;
    return 1;
}

static int take_newest_vector(void *ctx, const struct apc_vector *v)
{
    struct newest *n = (struct newest *)ctx;
    n->vector = *v;
    n->vector.value = n->value;
    for (uint32_t i = 0; i < v->n; i++) {
        n->value[i] = v->value[i];
    }
    n->there = true;
    return 1;
}

/* The list goes to free(). Returns how many or an error. */
static int list_store_variables(struct apc_store *store, struct apc_sample **variables)
{
    const int n = apc_store_variables(store, NULL, 0);
    *variables = n > 0 ? (struct apc_sample *)calloc((size_t)n, sizeof **variables) : NULL;
    if (n > 0 && !*variables) {
        return apc_fail(&store->why, APC_ENOMEM, "out of memory for %d variables", n);
    }
    const int there = n > 0 ? apc_store_variables(store, *variables, (size_t)n) : n;
    return there < n ? there : n;
}

static bool is_in(const struct apc_sample *variables, int n, const struct apc_sample *like)
{
    int i = 0;
    while (i < n && (variables[i].table != like->table || variables[i].id != like->id)) {
        i++;
    }
    return i < n;
}

/* A number of an author is a name's in its own store only. */
static int translate(struct apc_store *live, struct apc_store *history, struct apc_sample *s)
{
    char name[APC_AUTHOR_LEN];
    const int known = s->author > 0 ? apc_store_author_name(history, s->author, name) : APC_ENOTFOUND;
    const int author = known == 0 ? apc_store_author(live, name) : 0;
    s->author = author > 0 ? (uint32_t)author : 0;
    return author < 0 ? author : 0;
}

/* Returns 1, 0: there is none; an error, in @p failed whose. */
static int take_newest(struct apc_store *live, struct apc_store *history, const struct apc_sample *variable,
                       struct newest *n, struct apc_store **failed)
{
    const struct apc_range newest = {.last = 1};
    const bool vector = apc_table_vectors(variable->table);
    n->there = false;
    *failed = history;
    int rc = vector
                 ? apc_store_vectors(history, variable->table, variable->id, &newest, take_newest_vector, n)
                 : apc_store_history(history, variable->table, variable->id, &newest, take_newest_sample, n);
    if (rc < 0 || !n->there) {
        return rc < 0 ? rc : 0;
    }
    *failed = live;
    if (vector) {
        const struct apc_rows rows = {.size = sizeof rows, .vector = &n->vector, .n_vectors = 1};
        return apc_store_append_rows(live, &rows);
    }
    rc = translate(live, history, &n->sample);
    return rc < 0 ? rc : apc_store_append(live, &n->sample, 1);
}

static int no_more(void *ctx, const struct apc_event *event)
{
    (void)ctx;
    (void)event;
    return 1;
}

/* Of what the loop measured and put out last, or INT64_MIN: it never ran. Returns 0 or an error. */
static int last_known(struct apc_store *history, struct apc_sample *variables, int n, apc_ns *time)
{
    int rc = 0;
    *time = INT64_MIN;
    for (int i = 0; i < n && rc >= 0; i++) {
        if (variables[i].table == APC_SENSOR || variables[i].table == APC_ACTUATOR) {
            rc = apc_store_read(history, &variables[i], 1);
            *time = rc >= 0 && variables[i].seq > 0 && variables[i].time > *time ? variables[i].time : *time;
        }
    }
    return rc;
}

/* Into a live store that has seen nothing yet, before the rows: seqs go on, so nothing else shows that rows
 * are missing. */
static int mark_gap(struct apc_store *live, struct apc_store *history, struct apc_sample *had, int n,
                    struct apc_store **failed)
{
    char since[APC_TIME_LEN], until[APC_TIME_LEN];
    struct apc_event event = {
        .time = apc_clock_utc(NULL), .severity = APC_EVENT_WARNING, .source = "apc", .kind = "history"};
    apc_ns newest;
    *failed = live;
    int rc = apc_store_events(live, &(struct apc_range){.last = 1}, no_more, NULL);
    if (rc != 0) {
        return rc;
    }
    *failed = history;
    rc = last_known(history, had, n, &newest);
    if (rc < 0 || newest == INT64_MIN) {
        return rc;
    }
    *failed = live;
    snprintf(
        event.text, sizeof event.text,
        newest < event.time
            ? "the record has a gap: the live store is new, and nothing is known between %s and %s"
            : "the record has a gap: the live store is new, and nothing is known from %s on, which is later "
              "than the clock says (%s)",
        apc_time_format(newest, since), apc_time_format(event.time, until));
    return apc_store_append_events(live, &event, 1);
}

static int count_anew(struct apc_store *live, int had)
{
    const apc_ns since = apc_clock_utc(NULL) - EPOCH;
    return had == 0 && since > 0 && live->ops->count_from
               ? live->ops->count_from(live, since / APC_NS_PER_S * A_SECOND)
               : 0;
}

int apc_store_take_over(struct apc_store *live, struct apc_store *history, struct apc_error *why)
{
    if (!live || !history || live == history) {
        return apc_fail(why, APC_EINVAL, "which store takes over from which other one?");
    }
    struct newest *newest = (struct newest *)malloc(sizeof *newest);
    struct apc_sample *has = NULL, *had = NULL;
    struct apc_store *failed = live;
    int taken = 0, rc = newest ? list_store_variables(live, &has) : APC_ENOMEM;
    const int n_has = rc;
    if (rc >= 0) {
        failed = history;
        rc = list_store_variables(history, &had);
    }
    const int n_had = rc;
    if (rc > 0) {
        rc = mark_gap(live, history, had, n_had, &failed);
    }
    for (int i = 0; i < n_had && rc >= 0; i++) {
        if (had[i].table != APC_STATE && !is_in(has, n_has, &had[i])) {
            rc = take_newest(live, history, &had[i], newest, &failed);
            taken += rc > 0;
        }
    }
    const int counted = rc < 0 && failed == history ? count_anew(live, n_has + taken) : 0;
    failed = counted < 0 ? live : failed;
    rc = counted < 0 ? counted : rc;
    free(newest);
    free(has);
    free(had);
    return rc < 0
               ? apc_fail(why, rc, "%s%s", failed == history ? "the history: " : "", apc_store_error(failed))
               : taken;
}

int64_t apc_store_first(struct apc_store *store)
{
    return store->ops->first ? store->ops->first(store) : 0;
}

uint64_t apc_rows_between(int64_t first, int64_t stored, int64_t newest)
{
    const int64_t from = stored < first && newest >= first ? first : stored;
    return newest > from ? (uint64_t)(newest - from) : 0;
}
