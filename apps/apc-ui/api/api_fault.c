/* SPDX-License-Identifier: BSD-3-Clause */
/* The faults of a simulated plant, for its instructor. */
#include <stdio.h>

#include "apc-ui/api/api.h"
#include "common/storeuri.h"

/* Finds it, and writes it. */
static void give_fault_order(struct request *r, struct apc_store *store, const struct faults *f,
                             const char *fault, bool start)
{
    struct fault_order order;
    struct apc_error why;
    int rc = faults_find(f, fault, start, &order, &why);
    if (rc < 0)
        fault_set(&r->fault, 422, "value", "fault", "%.200s", why.text);
    else if ((rc = faults_order(f, store, &order, start, r->session.user)) < 0)
        fault_store(r, rc, store);
}

/* Answers with all of them as they are, of a plant in real time with none; where @p fault is not NULL, after that was
 * written. */
static void answer_faults(struct ui *ui, struct request *r, struct apc_store *store, const char *fault,
                          bool start)
{
    struct apc_store_clock clock;
    struct faults f = {.n = 0};
    struct apc_error why;
    int rc = fault ? model_simulated(&ui->model, store, &clock, &why) : store_simulated(store, &clock, &why);
    if (rc > 0 && fault && clock.rewind > 0)
        rc = apc_fail(&why, APC_ESTATE, "the plant is being rewound: do this again when that is done");
    if (rc == 0 && fault)
        fault_set(&r->fault, 409, "simulation", NULL, "the plant is not simulated: its time is real");
    else if (rc < 0 || (rc > 0 && (rc = faults_open(&f, store, &why)) < 0))
        fault_set(&r->fault, rc == APC_ESTATE ? 409 : 503, rc == APC_ESTATE ? "simulation" : "store", NULL,
                  "%.200s", why.text);
    else if (fault)
        give_fault_order(r, store, &f, fault, start);
    if (!r->fault.http && fault) {
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
    answer_faults(ui, r, store, NULL, false);
}

void post_fault(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"fault", "start", NULL};
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    const json_t *fault = json_object_get(body, "fault"), *start = json_object_get(body, "start");
    char number[24];
    snprintf(number, sizeof number, "%" JSON_INTEGER_FORMAT, json_integer_value(fault));
    if (body && !json_is_string(fault) && !json_is_integer(fault))
        fault_set(&r->fault, 400, "json", "fault", "\"fault\" must be a number of the list, or a text");
    else if (body && !json_is_boolean(start))
        fault_set(&r->fault, 400, "json", "start", "\"start\" must be true or false");
    else if (body && request_may_write(ui, r))
        answer_faults(ui, r, store, json_is_string(fault) ? json_string_value(fault) : number,
                      json_is_true(start));
    json_decref(body);
}
