/* SPDX-License-Identifier: BSD-3-Clause */
/* The faults of a simulated plant, as an instructor sees them: in its store is which ones somebody started or stopped. */
#include "experiment.h"

#include <stdlib.h>

#include "files/files.h"
#include "operate/operate.h"

int faults_open(struct faults *f, struct apc_store *store, struct apc_error *why)
{
    int64_t revision;
    *f = (struct faults){.n = 0};
    int rc = experiment_stored(&f->e, store, &revision, why);
    while (rc > 0 && experiment_fault(&f->e, f->n).kind)
        f->n++;
    f->row = calloc(f->n + 1, sizeof *f->row);
    if (rc >= 0 && !f->row)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; f->row && i < f->n; i++)
        f->row[i] = (struct apc_sample){.table = APC_OPMODE, .id = LOOPS_FAULT(i)};
    if (rc >= 0 && (rc = apc_store_read(store, f->row, f->n)) < 0)
        apc_fail(why, rc, "%s", apc_store_error(store));
    return rc < 0 ? rc : 0;
}

void faults_close(struct faults *f)
{
    experiment_free(&f->e);
    free(f->row);
}

enum fault_state faults_state(const struct faults *f, size_t i)
{
    if (f->row[i].seq > 0)
        return f->row[i].value == 0 ? FAULT_STOPPED : FAULT_STARTED;
    return *experiment_fault(&f->e, i).at == FAULT_NEVER ? FAULT_WAITS : FAULT_TIMED;
}

const char *fault_state_name(enum fault_state state)
{
    static const char *const names[] = {"waits", "timed", "started", "stopped"};
    return names[state];
}

int faults_order(struct apc_store *store, size_t i, bool start, const char *who)
{
    const int author = apc_store_author(store, who);
    struct apc_sample row = {.table = APC_OPMODE,
                             .id = LOOPS_FAULT(i),
                             .value = start,
                             .seq = APC_SEQ_ANY,
                             .author = author > 0 ? (uint32_t)author : 0,
                             .time = apc_clock_utc(NULL)};
    return author < 0 ? author : apc_store_put(store, &row, 1);
}

void faults_json(const struct faults *f, struct text *t)
{
    json_add(t, "{faults:[");
    for (size_t i = 0; i < f->n; i++) {
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        const apc_ns since = f->row[i].seq > 0 ? f->row[i].time : JSON_NONE;
        json_add(t, "{number:%zu, signal:%s, kind:%s, state:%s, since:%.6jd}", i + 1, fault.signal->name,
                 fault.kind, fault_state_name(faults_state(f, i)), (intmax_t)since);
    }
    json_add(t, "]}");
}
