/* SPDX-License-Identifier: BSD-3-Clause */
/* What an operator writes, as `apc set`, `tune` and `mode` do it: who waits for what is Python's. */
#include <apcstore.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "columns.h"
#include "experiment/experiment.h"
#include "operate/operate.h"

struct apc_operation {
    struct known_plant plant;
    struct change change;
    struct operation operation;
    struct change *retaken; /* of the operation instead of that one */
    char note[APC_TIME_LEN + 16];
};

static int failed(struct apc_store *store, int rc, struct apc_error *why)
{
    return rc == APC_ENOMEM ? apc_fail(why, rc, "out of memory")
                            : apc_fail(why, rc, "%s", apc_store_error(store));
}

static int said(const struct change_fault *fault, struct apc_error *why)
{
    return apc_fail(why, fault->err, "%s", fault->text);
}

struct apc_operation *apc_operation_new(void)
{
    return calloc(1, sizeof(struct apc_operation));
}

void apc_operation_free(struct apc_operation *operation)
{
    if (!operation)
        return;
    operation_end(&operation->operation);
    free(operation->retaken);
    known_free(&operation->plant);
    free(operation);
}

_Static_assert((int)APC_OPERATION_SETPOINT == (int)CHANGE_SETPOINT &&
                   (int)APC_OPERATION_OUTPUT == (int)CHANGE_OUTPUT &&
                   (int)APC_OPERATION_TUNING == (int)CHANGE_TUNING &&
                   (int)APC_OPERATION_MODE == (int)CHANGE_MODE,
               "kinds have the same numbers");

int apc_operation_find(struct apc_operation *w, struct apc_store *store, const char *name, int kinds,
                       double value, bool stop, struct apc_error *why)
{
    const struct plant_view *const plant = &w->plant.view;
    struct change_target to;
    struct change_fault fault;
    int rc = known_load(&w->plant, store);

    if (rc < 0)
        return failed(store, rc, why);
    rc = change_find(plant, name, (unsigned)kinds, &to, &fault);
    if (rc == 0 && !stop)
        rc = change_check(&to, value, &fault);
    if (rc < 0)
        return said(&fault, why);
    change_make(plant, &to, value, &w->change);
    w->change.stop = stop;
    w->operation = (struct operation){.plant = plant, .change = &w->change, .n = 1};
    if ((rc = operation_look(&w->operation, store)) < 0)
        return failed(store, rc, why);
    rc = change_now(plant, &to, &w->change.mode, &fault);
    if (rc == 0 && !w->change.by)
        rc = change_nobody(&w->change, 0, &fault);
    return rc < 0 ? said(&fault, why) : 0;
}

int apc_operation_over(struct apc_operation *w, double over, struct apc_error *why)
{
    struct change_fault fault;

    w->change.over = over;
    return change_over(over, &fault) < 0 ? said(&fault, why) : 0;
}

int apc_operation_ready(struct apc_operation *w, struct apc_store *store, struct apc_error *why)
{
    struct change_fault fault;
    const int rc = operation_ready(&w->operation, store, &fault);

    return rc < 0 ? said(&fault, why) : rc;
}

int apc_operation_write(struct apc_operation *w, struct apc_store *store, const char *author, bool confirmed,
                        struct apc_error *why)
{
    struct change_fault fault;
    int rc = operation_read(&w->operation, store);

    if (rc < 0)
        return failed(store, rc, why);
    w->operation.author = author;
    w->operation.confirmed = confirmed;
    rc = operation_begin(&w->operation, store, &fault);
    return rc < 0 ? said(&fault, why) : 0;
}

int apc_operation_poll(struct apc_operation *w, struct apc_store *store, int64_t timeout,
                       struct apc_error *why)
{
    struct change_fault fault;
    char text[192];
    int rc = operation_poll(&w->operation, store);

    if (rc == 0)
        rc = operation_wait(&w->operation, store, timeout);
    for (size_t i = 0; i < w->operation.n && rc > 0; i++)
        if (operation_finish(&w->operation, i, &fault) < 0)
            return apc_fail(why, fault.err, "%s: %s",
                            change_words(&w->operation.change[i], NULL, text, sizeof text), fault.text);
    return rc < 0 ? failed(store, rc, why) : rc;
}

int apc_operation_retake(struct apc_operation *w, struct apc_store *store, int64_t at,
                         const char *const *name, size_t n, struct apc_error *why)
{
    struct retake of = {.name = name, .n_names = n};
    struct change_fault fault;
    struct apc_tag *tag = NULL;
    char time[APC_TIME_LEN];
    int rc = known_load(&w->plant, store);

    if (rc < 0)
        return failed(store, rc, why);
    rc = apc_store_past(&of.past, store, at, why);
    if (rc == 0)
        rc = experiment_tags_then(of.past, store, NULL, &tag, &of.n, why);
    of.tag = tag;
    snprintf(w->note, sizeof w->note, " (as of %s)", apc_time_format(at, time));
    w->operation = (struct operation){.plant = &w->plant.view, .note = w->note};
    if (rc == 0 && operation_retake(&w->operation, store, &of, &fault) < 0)
        rc = said(&fault, why);
    w->retaken = w->operation.change;
    free(tag);
    apc_store_close(of.past);
    return rc < 0 ? rc : (int)w->operation.n;
}

const char *apc_operation_change(const struct apc_operation *w, int i, double *now, double *then)
{
    const struct change *c = &w->operation.change[i];

    *now = c->before.seq > 0 ? c->before.value : (double)NAN;
    *then = c->after.value;
    return c->to.name;
}

double apc_operation_force(const struct apc_operation *w)
{
    return w->change.actual.value;
}

int64_t apc_operation_time(const struct apc_operation *w)
{
    return w->operation.time;
}

int apc_log_enter(struct apc_store *store, const char *author, const char *signal, const char *entry,
                  bool signs, struct apc_error *why)
{
    const struct logbook_entry of = {.author = author, .signal = signal, .text = entry, .signs = signs};
    struct known_plant plant;
    struct apc_event event;
    struct change_fault fault = {0};
    int rc = known_load(&plant, store);

    if (rc < 0)
        rc = failed(store, rc, why);
    else if ((rc = logbook_make(&plant.view, &of, &event, &fault)) < 0 ||
             (rc = logbook_add(store, -1, &event, &fault)) < 0)
        rc = said(&fault, why);
    known_free(&plant);
    return rc;
}

int apc_operation_role(const char *user, const char *role, const char *wanted, struct apc_error *why)
{
    struct change_fault fault;

    (void)change_role(user, role, wanted, &fault);
    return said(&fault, why);
}
