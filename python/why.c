/* SPDX-License-Identifier: BSD-3-Clause */
/* Why an output moved, as `apc why` has it in JSON. */
#include <apcstore.h>
#include <stdlib.h>

#include "columns.h"
#include "simulation/simulation.h"

int apc_why_json(struct apc_store *store, const char *output, int64_t at, int64_t over, char **json,
                 struct apc_error *why)
{
    struct replay replay = {.controller = NULL};
    const struct why_question q = {
        .replay = &replay, .store = store, .loop = output, .at = at != 0 ? at : INT64_MAX, .over = over};
    struct text text = {.at = NULL};
    json_add(&text, "{");
    int rc = why_json(&q, &text, why);
    json_add(&text, "}");
    text_put(&text, "", 1);
    replay_free(&replay);
    if (text.failed)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc < 0)
        text_free(&text);
    *json = text.at;
    return rc;
}

void apc_why_free(char *json)
{
    free(json);
}
