/* SPDX-License-Identifier: BSD-3-Clause */
/* A store that goes on otherwise: until then its record is a run folder like others. */
#include "whatif.h"

#include <errno.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc/folder/folder.h"
#include "common/storeuri.h"

#define TIMEOUT (60 * APC_NS_PER_S)
#define LOOK    1000    /* tick rows; the least late of them says when t = 0 was */
#define INDEX   2       /* of a tick row, behind its mark: number of the tick on the controller's grid */
#define GRAIN   1000000 /* ns: t = 0 is a whole ms */

struct beginning {
    const struct controller *c;
    apc_ns zero;
};

static int take_whatif_tick(void *ctx, const struct apc_vector *tick)
{
    struct beginning *b = ctx;
    if (tick->n <= INDEX)
        return 0;
    const apc_ns zero = tick->time - b->c->rhythm.phase - (apc_ns)tick->value[INDEX] * b->c->rhythm.period;
    b->zero = zero < b->zero ? zero : b->zero;
    return 0;
}

static int take_first(void *ctx, const struct apc_sample *sample)
{
    apc_ns *first = ctx;
    *first = sample->time < *first ? sample->time : *first;
    return 1;
}

/* t = 0 of the daemons whose rows those are; where the record begins later, as many rounds of the scheduler
 * later. */
static int find_start(struct apc_store *store, const struct experiment *e, apc_ns at, apc_ns *start,
                      struct apc_error *why)
{
    const struct apc_range ticks = {.until = at, .last = LOOK};
    const struct controller *c = &e->controllers[0];
    struct beginning b = {.c = c, .zero = INT64_MAX};
    apc_ns first = INT64_MAX, round = e->scheduler.rhythm.period * (apc_ns)e->scheduler.steps;
    int rc = apc_store_vectors(store, APC_TICK, c->number, &ticks, take_whatif_tick, &b);
    if (rc >= 0 && b.zero == INT64_MAX)
        return apc_fail(why, APC_ENOTFOUND, "controller %s has no tick on record before that time", c->name);
    b.zero -= (b.zero % GRAIN + GRAIN) % GRAIN;
    const struct apc_range since = {.since = b.zero};
    for (size_t i = 0; i < e->dim.nu && rc >= 0; i++)
        rc = apc_store_history(store, APC_ACTUATOR, (int)i + 1, &since, take_first, &first);
    if (rc < 0)
        return apc_fail(why, rc, "%s", apc_store_error(store));
    round = round > 0 ? round : c->rhythm.period;
    *start = b.zero + (first < INT64_MAX && first > b.zero ? (first - b.zero) / round * round : 0);
    return 0;
}

static int make_whatif_folder(struct whatif *w, struct apc_store *store, const struct experiment *e,
                              struct apc_error *why)
{
    struct folder_metadata metadata = {
        .by = "apc simulate --from", .timer = "", .store = w->store, .host = ""};
    const char *tmp = getenv("TMPDIR");
    char name[sizeof w->store];
    char differs[PROVISION_TEXT];
    int rc = provision_check(store, e, differs);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_EPERM ? differs : apc_store_error(store));
    if ((rc = find_start(store, e, w->utc, &metadata.start, why)) < 0)
        return rc;
    snprintf(w->dir, sizeof w->dir, "%.380s/apc-XXXXXX", tmp && *tmp ? tmp : "/tmp");
    if (!mkdtemp(w->dir)) {
        rc = apc_fail(why, APC_ESYS, "%s: %s", w->dir, strerror(errno));
        w->dir[0] = '\0';
        return rc;
    }
    store_name(w->store, name, sizeof name);
    metadata.store = name;
    w->at = apc_ns_to_s(w->utc - metadata.start);
    rc = folder_create(w->dir, e, false, why);
    if (rc == 0)
        rc = folder_keep(w->dir, e, &metadata, why);
    return rc == 0 ? folder_export(w->dir, store, e, metadata.start, 0, metadata.start, 0, why) : rc;
}

int whatif_store_take(struct whatif *w, const char *file, struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = TIMEOUT};
    struct apc_store *store = NULL;
    struct experiment e = {.file = ""};
    struct apc_error reason;
    int rc = experiment_load(&e, file, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    w->dir[0] = '\0';
    if (rc == 0)
        rc = store_open(&store, w->store, &options, why);
    if (rc == 0 && (rc = make_whatif_folder(w, store, &e, &reason)) < 0)
        apc_fail(why, rc, "%s: %s", w->spec, reason.text);
    apc_store_close(store);
    experiment_free(&e);
    return rc;
}

static int drop_folder_entry(const char *path, const struct stat *what, int kind, struct FTW *at)
{
    (void)what;
    (void)kind;
    (void)at;
    return remove(path);
}

void whatif_store_drop(struct whatif *w)
{
    if (w->store[0] && w->dir[0])
        (void)nftw(w->dir, drop_folder_entry, 16, FTW_DEPTH | FTW_PHYS);
}
