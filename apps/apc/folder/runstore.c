/* SPDX-License-Identifier: BSD-3-Clause */
#include "runstore.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <apcstore.h>

#include "experiment/experiment.h"

bool runstore_gone(const char *uri)
{
    char path[256];
    if (strncmp(uri, "shm:", strlen("shm:")) != 0)
        return false;
    uri += strlen("shm:");
    snprintf(path, sizeof path, "/dev/shm/apc.%.*s", (int)strcspn(uri, "?+"), uri);
    return access(path, F_OK) != 0 && errno == ENOENT;
}

int runstore_find(struct runstore *r, const char *dir, struct apc_error *why)
{
    struct record_stores recorded;
    char here[PATH_MAX] = "", file[PATH_MAX + 16];
    const int rc = record_stores(&recorded, dir, why);
    *r = (struct runstore){0};
    if (rc < 0)
        return rc;
    const char *said = strstr(recorded.history, " ("); /* by the environment */
    said = said ? said : recorded.history + strlen(recorded.history);
    snprintf(file, sizeof file, "%s/store.db", realpath(dir, here) ? here : dir);
    if (access(file, F_OK) == 0)
        snprintf(r->history, sizeof r->history, "sqlite:%.1100s", file);
    else if (!strstr(recorded.history, "***"))
        snprintf(r->history, sizeof r->history, "%.*s", (int)(said - recorded.history), recorded.history);
    if (recorded.live[0] && !runstore_gone(recorded.live))
        snprintf(r->live, sizeof r->live, "%s", recorded.live);
    return 0;
}

/* Is it a store in a file that is not there, as where a run's folder was moved without it? */
static bool is_file_gone(const char *uri)
{
    char path[PATH_MAX];
    if (strncmp(uri, "sqlite:", strlen("sqlite:")) != 0)
        return false;
    uri += strlen("sqlite:");
    snprintf(path, sizeof path, "%.*s", (int)strcspn(uri, "?"), uri);
    return access(path, F_OK) != 0 && errno == ENOENT;
}

/* Why a folder names no store that can be opened. */
static int fail_no_store(const char *dir, struct apc_error *why)
{
    struct record_stores recorded;
    const int rc = record_stores(&recorded, dir, why);
    if (rc < 0)
        return rc;
    if (is_file_gone(recorded.history))
        return apc_fail(why, APC_ENOTFOUND,
                        "the store of %s's run is not there (%s): put it beside the run's other files, as "
                        "store.db; its values are in samples.csv too, if it ended well",
                        dir, recorded.history);
    if (recorded.history[0])
        return apc_fail(why, APC_ENOTFOUND, "the store of %s's run wants a password: give --store URI", dir);
    if (recorded.live[0])
        return apc_fail(why, APC_ENOTFOUND,
                        "the run of %s had no history, and its memory (%s) is gone: its values are in "
                        "samples.csv there, if it ended well",
                        dir, recorded.live);
    return apc_fail(
        why, APC_ENOTFOUND,
        "%s has no store, as the folder of a simulation has none: its values are in samples.csv there; "
        "apc run FILE --speed max --out DIR leaves one",
        dir);
}

int runstore_uri(const char *dir, char uri[RUNSTORE_LEN], struct apc_error *why)
{
    struct runstore r;
    const int rc = runstore_find(&r, dir, why);
    if (rc < 0)
        return rc;
    if (is_file_gone(r.history))
        r.history[0] = '\0';
    snprintf(uri, RUNSTORE_LEN, "%s%s%.1000s", r.live, r.live[0] && r.history[0] ? "+" : "", r.history);
    return uri[0] ? 0 : fail_no_store(dir, why);
}

int runstore_folder(const char *uri, char dir[RUNSTORE_LEN])
{
    static const char begin[] = "sqlite:", end[] = "/store.db";
    const char *at = uri + apc_store_live(uri);
    struct record_stores recorded;

    at += *at == '+';
    at = *at ? at : uri;
    const size_t n = strlen(at);
    if (strncmp(at, begin, sizeof begin - 1) != 0 || n < sizeof begin + sizeof end ||
        strcmp(at + n - (sizeof end - 1), end) != 0 || n >= RUNSTORE_LEN)
        return APC_ENOTFOUND;
    snprintf(dir, RUNSTORE_LEN, "%.*s", (int)(n - (sizeof begin - 1) - (sizeof end - 1)),
             at + sizeof begin - 1);
    return record_stores(&recorded, dir, NULL) < 0 ? APC_ENOTFOUND : 0;
}
