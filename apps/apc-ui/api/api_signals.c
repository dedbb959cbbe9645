/* SPDX-License-Identifier: BSD-3-Clause */
/* Figures of signals in a window of the record. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "grid/grid.h"

#define HOUR    (3600 * APC_NS_PER_S)
#define SIGNALS 4
#define MOST    200000 /* samples: some s of computing */

/* The measurement that comes most often makes the grid; all others are held. False: the fault is set. */
static bool choose_signals_grid(struct ui *ui, struct request *r, struct identify_selection *s,
                                char *const *name, size_t n)
{
    size_t first = n;

    if (n > SIGNALS)
        return fault_set(&r->fault, 422, "parameter", "names", "at most %d signals at once", SIGNALS);
    pthread_mutex_lock(&ui->model.mutex);
    for (size_t i = 0; i < ui->model.plant.n; i++) {
        const struct apc_tag *tag = &ui->model.plant.tag[i];
        const double period =
            tag->table == APC_SENSOR ? apc_ns_to_s(plant_period(&ui->model.plant, tag->table, tag->id)) : 0.0;

        for (size_t k = 0; k < n && tag->table == APC_SENSOR; k++)
            if (!strcmp(tag->name, name[k]) && (first == n || (period > 0.0 && period < s->period))) {
                first = k;
                s->period = period;
            }
    }
    pthread_mutex_unlock(&ui->model.mutex);
    if (first == n)
        return fault_set(&r->fault, 422, "parameter", "names", "one of \"names\" must be a measurement");
    s->output[s->outputs++] = name[first];
    for (size_t k = 0; k < n; k++)
        if (k != first)
            s->input[s->inputs++] = name[k];
    if (s->period > 0.0 && apc_ns_to_s(s->until - s->since) / s->period > MOST)
        return fault_set(&r->fault, 422, "parameter", "since", "more than %d rows: ask for less time at once",
                         MOST);
    return true;
}

void get_signals(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct identify_selection selection = {.from = -HUGE_VAL, .only = true};
    struct identify_data data = {.memory = NULL};
    const struct grid_source from = {.file = "the record", .store = store, .read = stored_read};
    struct apc_error why = {0};
    char *copy = NULL, *name[IDENTIFY_SIGNALS];
    size_t n = 0;
    int rc = 0;

    if (query_range(r, HOUR, 0, &selection.since, &selection.until) &&
        split_signals(r, "names", &copy, name, &n) && choose_signals_grid(ui, r, &selection, name, n)) {
        rc = grid_read(&data, &from, &selection, &why);
        if (rc == 0) {
            json_add(&r->reply, "{");
            range_json(&r->reply, selection.since, selection.until);
            rc = grid_signals(&data, &r->reply, NULL);
            json_add(&r->reply, "}");
        }
    }
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_ESTORE || rc == APC_ENOMEM)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_set(&r->fault, 422, "record", NULL, "%s", why.text);
    identify_data_free(&data);
    free(copy);
}
