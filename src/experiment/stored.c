/* SPDX-License-Identifier: BSD-3-Clause */
/* The experiment as a store has it. */
#include "experiment.h"

#include <stdlib.h>
#include <string.h>

int experiment_text(struct apc_store *store, char **text, int64_t *revision, struct apc_error *why)
{
    int length = apc_store_catalogue(store, NULL, 0, revision);
    *text = length < 0 ? NULL : calloc((size_t)length + 1, 1);
    if (*text)
        length = apc_store_catalogue(store, *text, (size_t)length + 1, revision);
    return length < 0 ? apc_fail(why, length, "%s", apc_store_error(store))
           : !*text   ? apc_fail(why, APC_ENOMEM, "out of memory")
                      : length;
}

bool is_of_user(const char *plugin)
{
    return strchr(plugin, '/') || is_fmu(plugin);
}

int experiment_stored(struct experiment *e, struct apc_store *store, int64_t *revision, struct apc_error *why)
{
    char *text = NULL;
    *e = (struct experiment){.n_controllers = 0};
    int rc = experiment_text(store, &text, revision, why);
    if (rc > 0) {
        rc =
            experiment_parse(e, &(struct experiment_source){.file = "catalogue", .text = text}, 0, NULL, why);
        rc = rc < 0 ? rc : 1;
    }
    free(text);
    return rc;
}

int experiment_refuse_own(const struct experiment_source *from, const char *instead, struct apc_error *why)
{
    struct experiment e;
    int rc = experiment_parse(&e, from, 0, NULL, why);
    if (rc < 0)
        return rc;
    const char *own = is_of_user(e.plant.name) ? e.plant.name : NULL;
    for (size_t i = 0; i < e.n_controllers; i++)
        if (is_of_user(e.controllers[i].law_name))
            own = e.controllers[i].law_name;
    if (own)
        rc = apc_fail(why, APC_EPERM, "%s is not built in, so %s", own, instead);
    experiment_free(&e);
    return rc;
}

static int tags_of_text(const char *text, const char *refusal, struct apc_tag **tags, size_t *n,
                        struct apc_error *why)
{
    const struct experiment_source from = {.file = "the store's experiment of then", .text = text};
    struct experiment e;
    int rc = refusal ? experiment_refuse_own(&from, refusal, why) : 0;
    if (rc < 0)
        return rc;
    rc = experiment_parse(&e, &from, EXPERIMENT_LAW, NULL, why);
    *tags = rc == 0 ? provision_tags(&e, n) : NULL;
    experiment_free(&e);
    return rc < 0 ? rc : *tags ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
}

/* A store that keeps former descriptions has its first one at the beginning of time. */
static int check_kept(struct apc_store *store, int64_t revision, struct apc_error *why)
{
    struct apc_store *past = NULL;
    char *text = NULL;
    int64_t first = 0;
    int rc = apc_store_past(&past, store, 1, why);
    if (rc >= 0)
        rc = experiment_text(past, &text, &first, why);
    free(text);
    apc_store_close(past);
    return rc < 0 || first < revision
               ? rc
               : apc_fail(
                     why, APC_ENOTFOUND,
                     "how the experiment was described then is not on record, and it was described anew: "
                     "a name may have been another's");
}

int experiment_tags_then(struct apc_store *past, struct apc_store *now, const char *refusal,
                         struct apc_tag **tags, size_t *n, struct apc_error *why)
{
    char *was = NULL, *is = NULL;
    int64_t revision;
    *tags = NULL;
    *n = 0;
    int rc = experiment_text(past, &was, &revision, why);
    if (rc >= 0)
        rc = experiment_text(now, &is, &revision, why);
    if (rc >= 0 && revision > 1 && strcmp(was, is) == 0)
        rc = check_kept(now, revision, why);
    if (rc >= 0 && was[0] && strcmp(was, is) != 0)
        rc = tags_of_text(was, refusal, tags, n, why);
    free(was);
    free(is);
    return rc < 0 ? rc : 0;
}
