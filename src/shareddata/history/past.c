/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A store as it stood at an instant, for reading: who reads what is newest gets what was newest then.
 *
 * A variable whose newest row is old enough costs no more than that: it comes with all others in one read. Of
 * another one the last row before the instant is looked for, and whether the next one follows it: rows that
 * are missing in between may have been newer. A store that can tells this of many at once. Else both are looked for near the instant first, in steps, so that
 * no store goes through all that it has.
 */
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "shareddata/shareddata_internal.h"

#define MINUTE (60 * APC_NS_PER_S)
#define HOUR   (60 * MINUTE)
#define DAY    (INT64_C(24) * HOUR)

struct past {
    struct apc_store base;
    struct apc_store *of;
    apc_ns until;          /* the first instant behind that which the stores keep apart from it */
    bool compared;         /* the descriptions of then with those of now */
    struct apc_error note; /* what the record cannot tell of it; "": nothing */
};

static struct past *past_of(struct apc_store *store)
{
    return (struct past *)store;
}

/* What a public function of the store said. */
static int answered(struct past *s, int rc)
{
    s->base.why = rc < 0 || s->of->why.text[0] ? s->of->why : s->note;
    return rc != APC_EPERM
               ? rc
               : apc_fail(&s->base.why, rc, "what was then is history, which this role may not read: %s",
                          s->of->why.text);
}

/* The first of its kind is said. */
static void doubt(struct past *s, const char *what, enum apc_table table, int id, apc_ns since, apc_ns until)
{
    char from[APC_TIME_LEN] = "the beginning", to[APC_TIME_LEN] = "now";
    if (since != 0) {
        apc_time_format(since, from);
    }
    if (until != 0) {
        apc_time_format(until, to);
    }
    if (!s->note.text[0]) {
        apc_fail(&s->note, 0, "%s %d: %s from %s to %s", apc_table_name(table), id, what, from, to);
    }
}

/* ---- One variable ---------------------------------------------------------------------------- */

/* A row that is looked for, the first that comes. */
struct look {
    struct past *s;
    enum apc_table table;
    int id;
    struct apc_sample *sample; /* to be filled in, as well as the vector; may be NULL */
    struct apc_vector *vector;
    int64_t seq; /* of the row; 0: none has come */
    apc_ns time;
};

static int take_looked_sample(void *ctx, const struct apc_sample *row)
{
    struct look *l = (struct look *)ctx;
    l->seq = row->seq;
    l->time = row->time;
    if (l->sample) {
        *l->sample = *row;
    }
    return 1;
}

static int take_looked_vector(void *ctx, const struct apc_vector *row)
{
    struct look *l = (struct look *)ctx;
    l->seq = row->seq;
    l->time = row->time;
    if (l->vector) {
        struct apc_vector *v = l->vector;
        v->seq = row->seq;
        v->time = row->time;
        v->status = row->status;
        v->n = row->n;
        const uint32_t n = v->n < v->room ? v->n : v->room;
        if (n > 0) {
            memcpy(v->value, row->value, n * sizeof *v->value);
        }
    }
    return 1;
}

/* Returns 1 with the row, 0 or an error. */
static int look_in(struct look *l, const struct apc_range *range)
{
    const int rc = apc_table_vectors(l->table)
                       ? apc_store_vectors(l->s->of, l->table, l->id, range, take_looked_vector, l)
                       : apc_store_history(l->s->of, l->table, l->id, range, take_looked_sample, l);
    return rc < 0 ? rc : l->seq > 0;
}

static const apc_ns steps[] = {MINUTE, HOUR, DAY, INT64_C(8) * DAY};
#define STEPS (sizeof steps / sizeof *steps)

/* The last row up to the instant. What people write is old: it is the highest seq whatever its time. Of what
 * comes with every tick, that of the last minute goes first. */
static int find_before(struct look *l)
{
    struct apc_range range = {.until = l->s->until, .last = 1};
    int found = 0;
    for (size_t i = 0; i < STEPS && found == 0 && !apc_table_shared(l->table); i++) {
        range.since = l->s->until - steps[i];
        found = look_in(l, &range);
        range.until = range.since;
    }
    range.since = 0;
    return found != 0 ? found : look_in(l, &range);
}

/* The first row above a seq that is not older than @p since; 0: whose time is any. */
static int find_behind(struct look *l, int64_t after, apc_ns since)
{
    struct apc_range range = {.since = since, .after = after};
    int found = 0;
    for (size_t i = 0; i < STEPS && found == 0; i++) {
        range.until = l->s->until + steps[i];
        found = look_in(l, &range);
    }
    range.until = 0;
    return found != 0 ? found : look_in(l, &range);
}

/* The newest row of a variable is too new: the one that was newest instead, and its status. */
static int find_then(struct look *was, apc_status *status)
{
    struct past *s = was->s;
    struct look next = {.s = s, .table = was->table, .id = was->id};
    int rc = find_before(was);
    if (rc < 0 || apc_table_leaves_out(was->table)) {
        return rc < 0 ? rc : 0;
    }
    rc = find_behind(&next, was->seq, s->until);
    if (rc >= 0 && was->seq > 0 && next.seq != was->seq + 1) { /* unless a clock was set back */
        rc = find_behind(&next, was->seq, 0);
    }
    if (rc >= 0 && was->seq > 0 && next.seq != was->seq + 1) {
        *status = apc_status_severity(*status) == APC_SEVERITY_GOOD ? APC_UNCERTAIN_LAST_USABLE : *status;
        doubt(s, "rows are missing in the record", was->table, was->id, was->time, next.time);
    } else if (rc >= 0 && was->seq == 0 && next.seq > 1) {
        doubt(s, "rows are missing in the record", was->table, was->id, 0, next.time);
    }
    return rc < 0 ? rc : 0;
}

static int find_sample_then(struct past *s, struct apc_sample *sample)
{
    struct look was = {.s = s, .table = sample->table, .id = sample->id, .sample = sample};
    *sample = (struct apc_sample){.table = was.table, .id = was.id, .status = APC_BAD_NO_DATA};
    return find_then(&was, &sample->status);
}

static int find_vector_then(struct past *s, struct apc_vector *vector)
{
    struct look was = {.s = s, .table = vector->table, .id = vector->id, .vector = vector};
    vector->seq = vector->time = 0;
    vector->n = 0;
    vector->status = APC_BAD_NO_DATA;
    return find_then(&was, &vector->status);
}

/* ---- All ------------------------------------------------------------------------------------- */

static bool is_later(const struct past *s, int64_t seq, apc_ns time)
{
    return seq > 0 && time >= s->until;
}

/* The next of a table that is to be looked for, from @p i on; n: there is none. */
static size_t next_later(const struct past *s, enum apc_table table, const struct apc_sample *samples,
                         size_t n, size_t i)
{
    while (i < n && (samples[i].table != table || !is_later(s, samples[i].seq, samples[i].time))) {
        i++;
    }
    return i;
}

/* Those of a table whose row of the minute before is followed by the next one, at once. */
static int find_at_once(struct past *s, enum apc_table table, struct apc_sample *samples, size_t n,
                        struct apc_sample *some)
{
    size_t m = 0;
    for (size_t i = next_later(s, table, samples, n, 0); i < n; i = next_later(s, table, samples, n, i + 1)) {
        some[m++] = (struct apc_sample){.table = table, .id = samples[i].id};
    }
    int rc = m > 0 ? apc_store_enter(s->of, some, m) : 0;
    if (rc == 0 && m > 0) {
        rc = s->of->ops->newest_within(s->of, some, m, s->until - MINUTE, s->until);
    }
    m = 0;
    for (size_t i = next_later(s, table, samples, n, 0); i < n && rc >= 0;
         i = next_later(s, table, samples, n, i + 1)) {
        samples[i] = some[m].seq > 0 ? some[m] : samples[i];
        m++;
    }
    return rc;
}

/* Those of the samples that are too new are replaced by what was newest. */
static int find_samples_then(struct past *s, struct apc_sample *samples, size_t n)
{
    const bool at_once = s->of->ops->newest_within && n > 0;
    struct apc_sample *some = at_once ? (struct apc_sample *)calloc(n, sizeof *some) : NULL;
    int rc = at_once && !some ? apc_fail(&s->of->why, APC_ENOMEM, "out of memory") : 0;
    for (enum apc_table t = APC_SENSOR; t < APC_TABLE_END && some && rc >= 0; t++) {
        rc = apc_table_shared(t) ? rc : find_at_once(s, t, samples, n, some);
    }
    for (size_t i = 0; i < n && rc >= 0; i++) {
        rc = is_later(s, samples[i].seq, samples[i].time) ? find_sample_then(s, &samples[i]) : rc;
    }
    free(some);
    return rc;
}

static int past_read(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct past *s = past_of(store);
    int rc = apc_store_read(s->of, samples, n);
    rc = rc < 0 ? rc : find_samples_then(s, samples, n);
    return answered(s, rc);
}

static int past_read_rows(struct apc_store *store, struct apc_rows *rows)
{
    struct past *s = past_of(store);
    int rc = apc_store_read_rows(s->of, rows);
    rc = rc < 0 ? rc : find_samples_then(s, rows->sample, rows->n_samples);
    for (size_t i = 0; i < rows->n_vectors && rc >= 0; i++) {
        struct apc_vector *vector = &rows->vector[i];
        rc = is_later(s, vector->seq, vector->time) ? find_vector_then(s, vector) : rc;
    }
    return answered(s, rc);
}

/* What came up to the instant. */
static struct apc_range up_to(const struct past *s, const struct apc_range *range)
{
    struct apc_range earlier = *range;
    earlier.until = range->until == 0 || range->until > s->until ? s->until : range->until;
    return earlier;
}

static int past_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                        apc_sample_fn fn, void *ctx)
{
    struct past *s = past_of(store);
    const struct apc_range earlier = up_to(s, range);
    return answered(s, apc_store_history(s->of, table, id, &earlier, fn, ctx));
}

static int past_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                        apc_vector_fn fn, void *ctx)
{
    struct past *s = past_of(store);
    const struct apc_range earlier = up_to(s, range);
    return answered(s, apc_store_vectors(s->of, table, id, &earlier, fn, ctx));
}

static int past_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct past *s = past_of(store);
    const struct apc_range earlier = up_to(s, range);
    return answered(s, apc_store_events(s->of, &earlier, fn, ctx));
}

static int past_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct past *s = past_of(store);
    const struct apc_range earlier = up_to(s, range);
    return answered(s, apc_store_timing(s->of, &earlier, fn, ctx));
}

static int past_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity)
{
    struct past *s = past_of(store);
    return answered(s, apc_store_variables(s->of, variables, capacity));
}

/* The text that was in force, to be freed. Of former revisions there are few. */
static int catalogue_of_then(struct past *s, apc_ns time, char **text)
{
    int64_t revision;
    const int length = apc_store_catalogue_at(s->of, time, NULL, 0, &revision);
    *text = length < 0 ? NULL : (char *)calloc((size_t)length + 1, 1);
    return length < 0 ? length
           : !*text   ? apc_fail(&s->of->why, APC_ENOMEM, "out of memory for a catalogue")
                      : apc_store_catalogue_at(s->of, time, *text, (size_t)length + 1, &revision);
}

/* Their descriptions are not kept: where the catalogue is another one since, they may be others as well. */
static int past_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    struct past *s = past_of(store);
    char *now = NULL, *then = NULL;
    int rc = s->compared ? 0 : catalogue_of_then(s, INT64_MAX, &now);
    rc = rc < 0 || s->compared ? rc : catalogue_of_then(s, s->base.instant, &then);
    if (rc >= 0 && now && then && strcmp(now, then) != 0 && !s->note.text[0]) {
        apc_fail(&s->note, 0,
                 "the experiment was described otherwise then: names, units and limits are those of now");
    }
    s->compared = s->compared || rc >= 0;
    free(now);
    free(then);
    return answered(s, rc < 0 ? rc : apc_store_get_tags(s->of, tags, capacity));
}

static int past_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision)
{
    struct past *s = past_of(store);
    return answered(s, apc_store_catalogue_at(s->of, s->base.instant, text, size, revision));
}

static int past_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    struct past *s = past_of(store);
    return answered(s, apc_store_author_name(s->of, number, name));
}

static int past_connect(struct apc_store *store)
{
    struct past *s = past_of(store);
    return answered(s, apc_store_connect(s->of));
}

static bool past_connected(const struct apc_store *store)
{
    return apc_store_connected(((const struct past *)store)->of);
}

static void past_stats(const struct apc_store *store, struct apc_store_stats *all)
{
    all->size = sizeof *all;
    apc_store_stats(((const struct past *)store)->of, all);
}

static int past_version(const struct apc_store *store)
{
    return apc_store_tables_version(((const struct past *)store)->of);
}

/* ---- Opening --------------------------------------------------------------------------------- */

static void close_past(struct apc_store *store)
{
    free(store);
}

static const struct apc_store_ops past_store = {
    .scheme = "the past",
    .close = close_past,
    .connected = past_connected,
    .stats = past_stats,
    .version = past_version,
    .connect = past_connect,
    .read = past_read,
    .variables = past_variables,
    .history = past_history,
    .history_bins = apc_bins_by_history,
    .get_tags = past_get_tags,
    .events = past_events,
    .timing = past_timing,
    .read_rows = past_read_rows,
    .vectors = past_vectors,
    .author_name = past_author_name,
    .catalogue = past_catalogue,
};

int apc_store_past(struct apc_store **past, struct apc_store *store, apc_ns time, struct apc_error *why)
{
    char text[APC_TIME_LEN];
    *past = NULL;
    if (!store) {
        return apc_fail(why, APC_EINVAL, "the past of no store");
    }
    /* that of a simulation has a clock of its own */
    if (time > apc_clock_utc(NULL) && strcmp(store->ops->scheme, "mem:") != 0) {
        return apc_fail(why, APC_EINVAL, "%s is in the future: there is no record of it",
                        apc_time_format(time, text));
    }
    if (time <= INT64_MIN + INT64_C(400) * DAY || time >= INT64_MAX - INT64_C(400) * DAY) {
        return apc_fail(why, APC_EINVAL, "%s is no time that a record can have", apc_time_format(time, text));
    }
    struct past *s = (struct past *)calloc(1, sizeof *s);
    if (!s) {
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    s->base.ops = &past_store;
    s->base.config = store->config;
    s->of = store;
    s->base.instant = time;
    s->until = apc_time_stored(time) + 1000;
    *past = &s->base;
    return 0;
}
