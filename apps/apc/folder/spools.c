/* SPDX-License-Identifier: BSD-3-Clause */
#include "spools.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/storeuri.h"

static int is_spool(const struct dirent *entry)
{
    size_t n = strlen(entry->d_name);
    return n > 6 && !strcmp(entry->d_name + n - 6, ".spool");
}

int spools_look(struct spools *spools, const char *dir, struct apc_error *why)
{
    struct dirent **names;
    struct apc_error this;
    int rc = 0, n = scandir(dir, &names, is_spool, alphasort);
    spools->n = 0;
    if (n < 0)
        return apc_fail(why, APC_ENOTFOUND, "%s: %s: expected the folder of a run, or one of spools", dir,
                        strerror(errno));
    for (int i = 0; i < n; i++) {
        if (spools->n < SPOOLS_MAX) {
            char *path = spools->path[spools->n];
            snprintf(path, sizeof spools->path[0], "%s/%s", dir, names[i]->d_name);
            spools->info[spools->n].size = sizeof spools->info[0];
            int err = apc_spool_look(path, &spools->info[spools->n], &this);
            if (err == 0)
                spools->n++;
            else if (err != APC_ENOTFOUND && rc == 0) /* else its writer has just removed it */
                rc = apc_fail(why, err, "%s", this.text);
        } else if (rc == 0) {
            rc = apc_fail(why, APC_EFULL, "%s: there are more than %d spools: move some away", dir,
                          SPOOLS_MAX);
        }
        free(names[i]);
    }
    free(names);
    return rc;
}

static int drain_one(const char *path, const char *writer, const char *uri, apc_ns timeout,
                     struct apc_error *why)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = writer, .timeout = timeout, .spool = path};
    struct apc_store_stats stats = {.size = sizeof stats};
    struct apc_store *store;
    int rc = store_open(&store, uri, &options, why);
    if (rc < 0)
        return rc;
    do {
        rc = apc_store_connect(store);
        apc_store_stats(store, &stats);
    } while (rc >= 0 && stats.spool.samples + stats.spool.events > 0);
    if (rc < 0)
        apc_fail(why, rc, "%llu samples and %llu events wait in %.200s: %.250s",
                 (unsigned long long)stats.spool.samples, (unsigned long long)stats.spool.events, path,
                 apc_store_error(store));
    else if (stats.spool.damaged)
        rc = apc_fail(why, APC_EPROTO,
                      "%.200s was damaged: what could be read of it is stored (%llu samples and events), the "
                      "rest is lost unless it is mended in %.200s, which is the file as it was",
                      path, (unsigned long long)stats.spool.drained, stats.spool.aside);
    apc_store_close(store);
    return rc;
}

int spools_drain(const char *dir, const char *uri, apc_ns timeout, struct apc_error *why)
{
    struct spools *spools = malloc(sizeof *spools);
    struct apc_error this;
    int rc = spools ? spools_look(spools, dir, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; spools && i < spools->n; i++) {
        int err = drain_one(spools->path[i], spools->info[i].writer, uri, timeout, &this);
        const bool away = err == APC_ECONN || err == APC_ETIMEDOUT;
        if (err < 0 && (rc == 0 || away))
            rc = apc_fail(why, err, "%s", this.text);
        if (away) /* the others would wait for the same */
            break;
    }
    free(spools);
    return rc;
}
