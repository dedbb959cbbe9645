/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Is what stands in TO under a row's number that row? It is, unless somebody wrote there who is not the
 * historian, or TO is of another run whose numbers are the same.
 *
 * Two places are looked at: the newest row of a variable when its place is found, and the rows of a batch of
 * which TO says that some were there already. A row of what people write is counted and told, and the record
 * goes on; one of a variable with one writer is another run's.
 */
#include "shareddata/history/replication.h"

struct comparing {
    const struct apc_sample *sample, *end; /* of one variable in rising seq */
    const struct apc_vector *vector, *vector_end;
    struct apc_sample other; /* the first that is not the same: table, id, seq; seq 0: none */
    uint64_t others;
};

static void row_differs(struct comparing *c, enum apc_table table, int id, int64_t seq)
{
    if (c->others++ == 0) {
        c->other = (struct apc_sample){.table = table, .id = id, .seq = seq};
    }
}

/* An author has a number of its own in each store. */
static int compare_sample(void *ctx, const struct apc_sample *there)
{
    struct comparing *c = (struct comparing *)ctx;
    while (c->sample < c->end && c->sample->seq < there->seq) {
        c->sample++;
    }
    if (c->sample < c->end && c->sample->seq == there->seq &&
        (apc_time_stored(c->sample->time) != apc_time_stored(there->time) ||
         c->sample->status != there->status || c->sample->value != there->value)) {
        row_differs(c, there->table, there->id, there->seq);
    }
    return c->sample >= c->end || there->seq >= c->end[-1].seq;
}

static int compare_vector(void *ctx, const struct apc_vector *there)
{
    struct comparing *c = (struct comparing *)ctx;
    while (c->vector < c->vector_end && c->vector->seq < there->seq) {
        c->vector++;
    }
    if (c->vector < c->vector_end && c->vector->seq == there->seq &&
        (apc_time_stored(c->vector->time) != apc_time_stored(there->time) ||
         c->vector->status != there->status || c->vector->n != there->n)) {
        row_differs(c, there->table, there->id, there->seq);
    }
    return c->vector >= c->vector_end || there->seq >= c->vector_end[-1].seq;
}

static void note_difference(struct apc_replication *f, const struct comparing *c)
{
    if (c->others > 0) {
        f->stats.other.rows += c->others;
        f->stats.other.table = c->other.table;
        f->stats.other.id = c->other.id;
        f->stats.other.seq = c->other.seq;
    }
}

int apc_replication_compare_batch(struct apc_replication *f, size_t samples, size_t vectors)
{
    int rc = 0;
    for (size_t i = 0, end; rc >= 0 && i < samples; i = end) {
        const struct apc_sample *s = &f->sample[i];
        for (end = i + 1; end < samples && f->sample[end].table == s->table && f->sample[end].id == s->id;) {
            end++;
        }
        struct comparing c = {.sample = s, .end = &f->sample[end]};
        const struct apc_range range = {.after = s->seq - 1};
        rc = apc_store_history(f->to, s->table, s->id, &range, compare_sample, &c);
        note_difference(f, &c);
    }
    for (size_t i = 0, end; rc >= 0 && i < vectors; i = end) {
        const struct apc_vector *v = &f->vector[i];
        for (end = i + 1; end < vectors && f->vector[end].table == v->table && f->vector[end].id == v->id;) {
            end++;
        }
        struct comparing c = {.vector = v, .vector_end = &f->vector[end]};
        const struct apc_range range = {.after = v->seq - 1};
        rc = apc_store_vectors(f->to, v->table, v->id, &range, compare_vector, &c);
        note_difference(f, &c);
    }
    return rc < 0 ? apc_replication_fail_to(f, rc) : 0;
}

/* TO's newest of variable i with what FROM still has under its number. */
static int compare_place(struct apc_replication *f, size_t i, int64_t seq, struct comparing *c)
{
    const struct apc_sample *at = &f->variable[i].at;
    const struct apc_range range = {.after = seq - 1};
    int rc;
    if (i < f->n_vectors) {
        *c = (struct comparing){.vector = &f->ask_vector[i], .vector_end = &f->ask_vector[i + 1]};
        rc = apc_store_vectors(f->from, at->table, at->id, &range, compare_vector, c);
    } else {
        const struct apc_sample *there = &f->ask[i - f->n_vectors];
        *c = (struct comparing){.sample = there, .end = there + 1};
        rc = apc_store_history(f->from, at->table, at->id, &range, compare_sample, c);
    }
    return rc < 0 ? apc_replication_fail_from(f, rc) : 0;
}

int apc_replication_compare_places(struct apc_replication *f)
{
    for (size_t i = 0; i < f->n; i++) {
        struct apc_replication_variable *v = &f->variable[i];
        const int64_t seq = i < f->n_vectors ? f->ask_vector[i].seq : f->ask[i - f->n_vectors].seq;
        struct comparing c;
        if (seq == 0 || seq > v->newest || seq == v->compared) {
            continue;
        }
        const int rc = compare_place(f, i, seq, &c);
        if (rc < 0) {
            return rc;
        }
        if (c.others > 0 && !apc_table_shared(v->at.table)) {
            f->stats.away = true;
            return apc_fail(&f->why, APC_ECONFLICT,
                            "it has another row of %s %d under seq %lld than there is here: it is of another "
                            "run, or somebody else wrote there",
                            apc_table_name(v->at.table), v->at.id, (long long)seq);
        }
        note_difference(f, &c);
        v->compared = seq;
    }
    return 0;
}
