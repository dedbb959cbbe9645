/* SPDX-License-Identifier: BSD-3-Clause */
/* The faults of a simulated plant, for its instructor. */
#include "apc-ui/api/api.h"
#include "common/storeuri.h"

/* Answers with all of them as they are, of a plant in real time with none; where @p start is not negative, after that
 * was written. */
static void answer_faults(struct request *r, struct apc_store *store, int64_t number, int start)
{
    struct apc_store_clock clock;
    struct faults f = {.n = 0};
    struct apc_error why;
    int rc = store_simulated(store, &clock, &why);
    if (rc == 0 && start >= 0)
        fault_set(&r->fault, 409, "simulation", NULL, "the plant is not simulated: its time is real");
    else if (rc < 0 || (rc > 0 && (rc = faults_open(&f, store, &why)) < 0))
        fault_set(&r->fault, rc == APC_ESTATE ? 409 : 503, rc == APC_ESTATE ? "simulation" : "store", NULL,
                  "%.200s", why.text);
    else if (start >= 0 && number > (int64_t)f.n)
        fault_set(&r->fault, 422, "value", "fault", "there is no such fault");
    else if (start >= 0 && (rc = faults_order(store, (size_t)number - 1, start, r->session.user)) < 0)
        fault_store(r, rc, store);
    if (!r->fault.http && start >= 0) {
        faults_close(&f);
        if ((rc = faults_open(&f, store, &why)) < 0)
            fault_store(r, rc, store);
    }
    if (!r->fault.http)
        faults_json(&f, &r->reply);
    faults_close(&f);
}

void get_faults(struct ui *ui, struct request *r, struct apc_store *store)
{
    (void)ui;
    answer_faults(r, store, 0, -1);
}

void post_fault(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"fault", "start", NULL};
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    int64_t number;
    if (body && member_whole(body, "fault", 1, 1000000, &number, &r->fault)) {
        const json_t *start = json_object_get(body, "start");
        if (!json_is_boolean(start))
            fault_set(&r->fault, 400, "json", "start", "\"start\" must be true or false");
        else if (request_may_write(ui, r))
            answer_faults(r, store, number, json_is_true(start));
    }
    json_decref(body);
}
