/* SPDX-License-Identifier: BSD-3-Clause */
/* What a store has on record, as the folder of a run that goes on otherwise. */
#include "store_folder.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apc/folder/folder.h"
#include "common/storeuri.h"
#include "past_folder.h"

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

static int make_store_folder(struct store_folder *f, struct apc_store *store, const char *uri, apc_ns at,
                             const struct experiment *e, struct apc_error *why)
{
    const char *tmp = getenv("TMPDIR");
    char name[400];
    char differs[PROVISION_TEXT];
    struct folder_metadata metadata = {.by = "apc simulate --from", .timer = "", .store = name, .host = ""};
    int rc = provision_check(store, e, differs);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_EPERM ? differs : apc_store_error(store));
    if ((rc = find_start(store, e, at, &metadata.start, why)) < 0)
        return rc;
    snprintf(f->dir, sizeof f->dir, "%.380s/apc-XXXXXX", tmp && *tmp ? tmp : "/tmp");
    if (!mkdtemp(f->dir)) {
        rc = apc_fail(why, APC_ESYS, "%s: %s", f->dir, strerror(errno));
        f->dir[0] = '\0';
        return rc;
    }
    f->made = true;
    store_name(uri, name, sizeof name);
    f->at = apc_ns_to_s(at - metadata.start);
    rc = folder_create(f->dir, e, false, why);
    if (rc == 0)
        rc = folder_keep(f->dir, e, &metadata, why);
    return rc == 0 ? folder_export(f->dir, store, e, metadata.start, 0, metadata.start, 0, why) : rc;
}

int store_folder_make(struct store_folder *f, const char *uri, apc_ns at, const char *file,
                      struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = TIMEOUT};
    struct apc_store *store = NULL;
    struct experiment e = {.file = ""};
    struct apc_error reason;
    int rc = experiment_load(&e, file, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    *f = (struct store_folder){.made = false};
    if (rc == 0)
        rc = store_open(&store, uri, &options, why);
    if (rc == 0 && (rc = make_store_folder(f, store, uri, at, &e, &reason)) < 0) {
        char name[400];
        store_name(uri, name, sizeof name);
        apc_fail(why, rc, "--from %s: %s", name, reason.text);
    }
    apc_store_close(store);
    experiment_free(&e);
    return rc;
}

void store_folder_drop(const struct store_folder *f)
{
    if (f->made)
        past_folder_remove(f->dir);
}
