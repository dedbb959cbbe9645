/* SPDX-License-Identifier: BSD-3-Clause */
/* Two persons write: one asks, and another approves or refuses it (operate.h). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "operate.h"

/* ---- What waits ---------------------------------------------------------------------------- */

static struct waiting new_waiting(const struct change_target *to)
{
    return (struct waiting){.to = *to,
                            .row = {.table = to->table, .id = LOOPS_ASKED(to->id)},
                            .over = {.table = to->table, .id = LOOPS_ASKED_OVER(to->id)}};
}

static bool is_asked_at_once(const struct waiting *a, const struct waiting *b)
{
    return a->row.time == b->row.time && a->row.author == b->row.author;
}

/* What was asked for at once is over as soon as any of it is. */
static void find_untils(struct waiting *asked, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double shortest = 0;
        for (size_t k = 0; k < n; k++)
            if (is_asked_at_once(&asked[i], &asked[k]) && asked[k].to.second > 0 &&
                !(shortest > 0 && shortest <= asked[k].to.second))
                shortest = asked[k].to.second;
        asked[i].until = asked[i].row.time + (apc_ns)(shortest * (double)APC_NS_PER_S);
    }
}

static int read_waiting(struct waiting *asked, size_t n, struct apc_store *store)
{
    struct apc_sample *rows = calloc(2 * n + 1, sizeof *rows);
    if (!rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        rows[2 * i] = asked[i].row;
        rows[2 * i + 1] = asked[i].over;
    }
    const int rc = apc_store_read(store, rows, 2 * n);
    for (size_t i = 0; i < n && rc >= 0; i++) {
        asked[i].row = rows[2 * i];
        asked[i].over = rows[2 * i + 1];
    }
    free(rows);
    return rc;
}

int waiting_load(struct waiting **asked, struct apc_store *store, const struct plant_view *plant)
{
    struct waiting *a = *asked = calloc(plant->n + 1, sizeof *a);
    struct change_target to;
    struct change_fault why;
    size_t all = 0, n = 0;
    if (!a)
        return APC_ENOMEM;
    for (size_t i = 0; i < plant->n; i++)
        if (change_is_of(&plant->tag[i]) &&
            change_at(plant, plant->tag[i].table, plant->tag[i].id, &to, &why) == 0)
            a[all++] = new_waiting(&to);
    const int rc = read_waiting(a, all, store);
    for (size_t i = 0; i < all && rc >= 0; i++)
        if (a[i].row.seq > 0 && a[i].row.status == APC_GOOD)
            a[n++] = a[i];
    for (size_t i = 0; i < n; i++)
        if (a[i].row.author == 0 || apc_store_author_name(store, a[i].row.author, a[i].asker) < 0)
            a[i].asker[0] = '\0';
    find_untils(a, n);
    return rc < 0 ? rc : (int)n;
}

/* ---- Asking -------------------------------------------------------------------------------- */

static const struct change *needs_second(const struct operation *o)
{
    for (size_t i = 0; i < o->n; i++)
        if (o->change[i].to.second > 0 && !o->change[i].stop)
            return &o->change[i];
    return NULL;
}

static int fail_asked(const struct waiting *a, apc_ns utc, struct change_fault *why)
{
    char value[CHANGE_TEXT], age[CHANGE_TEXT];
    struct apc_sample to = a->row;
    to.id = a->to.id;
    return change_fail(why, APC_EPERM, "second",
                       "%.60s waits for a second person: %s requested %s, %.20s ago", a->to.name, a->asker,
                       change_text(&to, value), change_age(utc - a->row.time, age));
}

/* Does anything of it wait already? */
static int check_asked(const struct operation *o, struct apc_store *store, struct change_fault *why)
{
    struct waiting *asked;
    const int n = waiting_load(&asked, store, o->plant);
    int rc = n < 0 ? change_fail(why, n, "store", "%s", apc_store_error(store)) : 0;
    for (size_t i = 0; n > 0 && i < (size_t)n && rc == 0; i++)
        for (size_t k = 0; k < o->n && rc == 0; k++)
            if (asked[i].to.table == o->change[k].to.table && asked[i].to.id == o->change[k].to.id &&
                o->time <= asked[i].until)
                rc = fail_asked(&asked[i], o->time, why);
    free(asked);
    return rc;
}

static int put_asked(const struct operation *o, struct apc_store *store, uint32_t author)
{
    struct apc_sample *rows = calloc(2 * o->n, sizeof *rows);
    if (!rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < o->n; i++) {
        const struct waiting a = new_waiting(&o->change[i].to);
        rows[2 * i] = a.row;
        rows[2 * i + 1] = a.over;
    }
    int rc = apc_store_read(store, rows, 2 * o->n);
    for (size_t i = 0; i < 2 * o->n; i++) {
        const struct change *c = &o->change[i / 2];
        rows[i].time = o->time;
        rows[i].author = author;
        rows[i].status = APC_GOOD;
        rows[i].value = i % 2 ? c->over : c->after.value;
        rows[i].origin = i % 2 || c->after.seq == APC_SEQ_ANY ? 0 : c->after.seq;
    }
    if (rc >= 0)
        rc = apc_store_swap(store, rows, 2 * o->n);
    free(rows);
    return rc;
}

int operation_ask(struct operation *o, struct apc_store *store, uint32_t author, struct change_fault *why)
{
    const struct change *first = needs_second(o);
    char words[192], waits[64];
    if (!first)
        return 0;
    int rc = check_asked(o, store, why);
    if (rc < 0)
        return rc;
    if (author == 0)
        return change_fail(why, APC_EPERM, "second",
                           "%.60s needs two persons, and the first one is not known: log in first",
                           first->to.name);
    snprintf(waits, sizeof waits, " waits %g s for a second person", first->to.second);
    rc = operation_fits(o, waits, why);
    if (rc < 0)
        return rc;
    rc = put_asked(o, store, author);
    if (rc == APC_ECONFLICT)
        return change_fail(why, APC_EPERM, "second",
                           "%.60s waits for a second person: another user has requested it just now",
                           first->to.name);
    if (rc < 0)
        return change_fail(why, rc, "store", "%s",
                           rc == APC_ENOMEM ? "out of memory" : apc_store_error(store));
    rc = operation_record(o, store, waits);
    if (rc < 0)
        return change_fail(why, rc, "record", "it was asked for, but that was not recorded as an event: %s",
                           apc_store_error(store));
    return change_fail(why, APC_EPERM, "second", "%.150s%s", change_words(first, NULL, words, sizeof words),
                       waits);
}

/* ---- Approving and refusing ---------------------------------------------------------------- */

static bool is_asked_of(const struct waiting *a, apc_ns only, const char *name)
{
    char place[APC_TAG_LEN];
    snprintf(place, sizeof place, "%s.%d", apc_table_name(a->to.table), a->to.id);
    return only > 0 ? a->row.time / APC_NS_PER_US == only / APC_NS_PER_US
                    : !strcmp(name, a->to.name) || !strcmp(name, place);
}

/* One more change, as it was asked for. */
static int approve_one(struct operation *o, const struct waiting *a, bool refuses, struct approval *approval,
                       struct change_fault *why)
{
    struct change *c = &o->change[o->n];
    const int rc = refuses ? 0 : change_check(&a->to, a->row.value, why);
    if (rc < 0)
        return rc;
    change_make(o->plant, &a->to, a->row.value, c);
    c->after.seq = a->row.origin > 0 ? a->row.origin : APC_SEQ_ANY;
    c->over = a->over.value;
    approval->row[approval->n++] = a->row;
    o->n++;
    return 0;
}

static int take_asked(struct operation *o, struct apc_store *store, const struct waiting *asked, size_t n,
                      const struct waiting *first, bool refuses, struct approval *approval,
                      struct change_fault *why)
{
    int rc = 0;
    o->change = calloc(n + 1, sizeof *o->change);
    approval->row = calloc(n + 1, sizeof *approval->row);
    memcpy(approval->asker, first->asker, sizeof approval->asker);
    if (!o->change || !approval->row)
        return change_fail(why, APC_ENOMEM, "store", "out of memory");
    for (size_t i = 0; i < n && rc == 0; i++)
        if (is_asked_at_once(&asked[i], first))
            rc = approve_one(o, &asked[i], refuses, approval, why);
    if (rc == 0 && (operation_look(o, store) < 0 || operation_read(o, store) < 0))
        rc = change_fail(why, APC_ESTORE, "store", "%s", apc_store_error(store));
    return rc == 0 && !refuses ? operation_check(o, store, why) : rc;
}

/* What is over is found where nothing else is. @p other: of that name as well, but not asked for at once; NULL. */
static struct waiting *find_asked(struct waiting *asked, size_t n, apc_ns only, const char *name,
                                  struct waiting **other)
{
    const apc_ns now = apc_clock_utc(NULL);
    struct waiting *first = asked + n;
    *other = NULL;
    for (struct waiting *a = asked; a < asked + n; a++) {
        if (!is_asked_of(a, only, name))
            continue;
        if (first == asked + n || now > first->until)
            first = a;
        else if (now <= a->until && !is_asked_at_once(a, first))
            *other = a;
    }
    return first;
}

int operation_approve(struct operation *o, struct apc_store *store, apc_ns only, const char *name,
                      bool refuses, struct approval *approval, struct change_fault *why)
{
    struct waiting *asked, *first, *other;
    const int found = waiting_load(&asked, store, o->plant);
    const size_t n = found > 0 ? (size_t)found : 0;
    int rc;
    o->approval = approval;
    o->confirmed = true; /* two have looked at it */
    first = find_asked(asked, n, only, name, &other);
    if (found < 0)
        rc = change_fail(why, found, "store", "%s",
                         found == APC_ENOMEM ? "out of memory" : apc_store_error(store));
    else if (first == asked + n && only == 0)
        rc = change_fail(why, APC_EPERM, "second", "nothing of \"%.60s\" waits for a second person", name);
    else if (first == asked + n)
        rc = change_fail(why, APC_EPERM, "second",
                         "it does not wait for a second person: it was approved or refused");
    else if (other)
        rc = change_fail(why, APC_EPERM, "second", "two of \"%.60s\" wait: say which, %s.%d or %s.%d", name,
                         apc_table_name(first->to.table), first->to.id, apc_table_name(other->to.table),
                         other->to.id);
    else if (apc_clock_utc(NULL) > first->until)
        rc = change_fail(why, APC_EPERM, "second",
                         "the request of %s had to be approved within %g s: request %.60s again",
                         first->asker, apc_ns_to_s(first->until - first->row.time), first->to.name);
    else if (!refuses && !first->asker[0])
        rc = change_fail(
            why, APC_EPERM, "second",
            "the person who requested %.60s is not known, so it cannot be approved: request it again",
            first->to.name);
    else if (!refuses && !strcmp(first->asker, o->author))
        rc = change_fail(why, APC_EPERM, "second",
                         "%s requested it, so another person must approve it: %.60s waits", o->author,
                         first->to.name);
    else
        rc = take_asked(o, store, asked, n, first, refuses, approval, why);
    free(asked);
    return rc;
}

int operation_refuse(struct operation *o, struct apc_store *store, struct change_fault *why)
{
    char also[APC_AUTHOR_LEN + 32];
    snprintf(also, sizeof also, " refused (requested by %s)", o->approval->asker);
    int rc = operation_fits(o, also, why);
    if (rc < 0)
        return rc;
    const int author = rc = o->author[0] ? apc_store_author(store, o->author) : 0;
    o->time = o->time > 0 ? o->time : apc_clock_utc(NULL);
    for (size_t i = 0; i < o->approval->n; i++) {
        struct apc_sample *row = &o->approval->row[i];
        row->time = o->time;
        row->author = (uint32_t)author;
        row->status = APC_BAD_NO_DATA;
    }
    if (rc >= 0)
        rc = apc_store_swap(store, o->approval->row, o->approval->n);
    if (rc == APC_ECONFLICT)
        return change_approved(why);
    if (rc < 0)
        return change_fail(why, rc, "store", "%s", apc_store_error(store));
    rc = operation_record(o, store, also);
    return rc < 0 ? change_fail(why, rc, "record", "it was refused, but not recorded as an event: %s",
                                apc_store_error(store))
                  : 0;
}
