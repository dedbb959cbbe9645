/* SPDX-License-Identifier: BSD-3-Clause */
/* Why an output moved: the ticks of its move are computed again. */
#include <math.h>

#include "apc-ui/api/api.h"
#include "simulation/simulation.h"

#define PATIENCE (10 * APC_NS_PER_S)
#define DAY      86400.0

static bool query_over(struct request *r, apc_ns *over)
{
    const char *text = request_query(r, "over");
    double seconds = 0;
    if (!text || (apc_number_parse(text, &seconds) == 0 && seconds >= 0 && seconds <= DAY))
        return apc_ns_from_s(seconds, over) == 0;
    return fault_set(&r->fault, 400, "parameter", "over", "\"over\" must be seconds, from 0 to %.0f", DAY);
}

static void fault_why(struct request *r, int rc, const struct apc_error *why)
{
    switch (rc) {
    case APC_ENOTFOUND:
        fault_set(&r->fault, 404, "variable", "output", "%s", why->text);
        break;
    case APC_ECONN:
    case APC_ESTORE:
    case APC_ESYS:
    case APC_ESCHEMA:
    case APC_ENOMEM:
        fault_set(&r->fault, 503, "store", NULL, "the database is offline: %.150s", why->text);
        break;
    default:
        fault_set(&r->fault, 422, "replay", NULL, "%s", why->text);
    }
}

void get_why(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct replay replay = {.controller = NULL};
    struct why_question q = {.replay = &replay,
                             .store = store,
                             .loop = request_query(r, "output"),
                             .at = INT64_MAX,
                             .built_in = true,
                             .give_up = apc_clock_mono(NULL) + PATIENCE};
    struct apc_error why;
    (void)ui;
    if (!q.loop) {
        fault_set(&r->fault, 400, "parameter", "output", "\"output\" is needed: the name of a loop");
        return;
    }
    if (!query_time(r, "at", apc_clock_utc(NULL), &q.at) || !query_over(r, &q.over))
        return;
    if (!store) {
        fault_store(r, APC_ENOMEM, store);
        return;
    }
    json_add(&r->reply, "{t:%.6jd", apc_clock_utc(NULL));
    const int rc = why_json(&q, &r->reply, &why);
    json_add(&r->reply, "}");
    if (rc < 0)
        fault_why(r, rc, &why);
    replay_free(&replay);
}
