/* SPDX-License-Identifier: BSD-3-Clause */
#include "run_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Names of what belongs to an output: "Kp" when there is one output, "u1.Kp" when there are more. */
static void output_name(const struct experiment *e, size_t output, const char *what, char *name, size_t size)
{
    if (e->dim.nu == 1)
        snprintf(name, size, "%.63s", what);
    else
        snprintf(name, size, "%.31s.%.31s", e->u[output].tag.name, what);
}

static struct apc_tag plain_tag(enum apc_table table, int id, const char *name, const char *description,
                                double low, double high)
{
    struct apc_tag tag = {.table = table, .id = id, .low = low, .high = high};
    snprintf(tag.name, sizeof tag.name, "%s", name);
    snprintf(tag.description, sizeof tag.description, "%s", description);
    return tag;
}

/* The parameters of that scope, of which the law, an output or a measurement has them. */
static size_t tuning_tags(const struct experiment *e, enum apc_law_scope scope, size_t of,
                          struct apc_tag *tag)
{
    const struct apc_law *law = e->controllers->law;
    const size_t all = apc_law_parameters(law, &e->dim);
    size_t n = 0;
    char name[APC_TAG_LEN];

    for (size_t k = 0; k < all; k++) {
        const struct apc_law_parameter at = apc_law_parameter_at(law, &e->dim, k);
        const struct apc_param *p = &e->controllers->param[at.number];
        if (at.scope != scope || at.of != of)
            continue;
        if (scope == APC_OF_OUTPUT)
            output_name(e, of, p->name, name, sizeof name);
        else if (scope == APC_OF_LAW)
            snprintf(name, sizeof name, "%.63s", p->name);
        else
            snprintf(name, sizeof name, "%.31s.%.31s", e->y[of].tag.name, p->name);
        tag[n] =
            plain_tag(APC_TUNING, (int)k + 1, name, p->description ? p->description : "", p->low, p->high);
        snprintf(tag[n++].unit, sizeof tag->unit, "%s", p->unit ? p->unit : "");
    }
    return n;
}

static size_t output_tags(const struct experiment *e, size_t i, struct apc_tag *tag)
{
    size_t n = 0;
    char name[APC_TAG_LEN];

    output_name(e, i, "manual", name, sizeof name);
    tag[n] = plain_tag(APC_MANUAL, (int)i + 1, name, "operator's output in mode Man", e->u[i].tag.low,
                       e->u[i].tag.high);
    memcpy(tag[n++].unit, e->u[i].tag.unit, APC_TAG_LEN);
    return n + tuning_tags(e, APC_OF_OUTPUT, i, tag + n);
}

struct apc_tag *provision_tags(const struct experiment *e, size_t *count)
{
    const struct apc_dim *dim = &e->dim;
    size_t n = 0, most = dim->ny + dim->nz + 4 * dim->nu + apc_law_parameters(e->controllers->law, dim) + 6;
    char name[APC_TAG_LEN];
    struct apc_tag *tag = calloc(most, sizeof *tag);
    if (!tag)
        return NULL;
    for (size_t i = 0; i < dim->ny; i++) {
        tag[n++] = e->y[i].tag;
        n += tuning_tags(e, APC_OF_MEASUREMENT, i, tag + n);
    }
    n += tuning_tags(e, APC_OF_LAW, 0, tag + n);
    for (size_t i = 0; i < dim->nz; i++)
        tag[n++] = e->z[i].tag;
    for (size_t i = 0; i < dim->nu; i++) {
        tag[n++] = e->u[i].tag;
        n += output_tags(e, i, tag + n);
    }
    for (size_t i = 0; i < dim->nu; i++) {
        snprintf(name, sizeof name, "dim.u%zu.y", i + 1);
        tag[n++] = plain_tag(APC_DIM, (int)(4 + 2 * i), name, "measurement that the output controls", 1, 1e6);
        snprintf(name, sizeof name, "dim.u%zu.z", i + 1);
        tag[n++] =
            plain_tag(APC_DIM, (int)(5 + 2 * i), name, "setpoint that it controls it to; 0: none", 0, 1e6);
    }
    tag[n++] = plain_tag(APC_DIM, 1, "dim.y", "number of measurements", 1, 1e6);
    tag[n++] = plain_tag(APC_DIM, 2, "dim.z", "number of setpoints", 1, 1e6);
    tag[n++] = plain_tag(APC_DIM, 3, "dim.u", "number of manipulated variables", 1, 1e6);
    tag[n++] = plain_tag(APC_OPMODE, 0, "mode", "target mode: 0 Man, 1 Auto", 0, 1);
    tag[n++] = plain_tag(APC_OPMODE, 1, "mode.actual", "actual mode: 0 Man, 1 Auto, 2 out of service", 0, 2);
    tag[n++] = plain_tag(APC_STATE, 0, "experiment", e->name, 0, 0);
    *count = n;
    return tag;
}

static int put_tags(struct apc_store *store, const struct experiment *e)
{
    size_t n;
    struct apc_tag *tag = provision_tags(e, &n);
    int rc = tag ? apc_store_put_tags(store, tag, n) : APC_ENOMEM;
    free(tag);
    return rc;
}

/* ---- Whose store it is -------------------------------------------------------------------- */

static const struct apc_tag *signal_of(const struct experiment *e, enum apc_table table, size_t i)
{
    if (table == APC_SENSOR)
        return i < e->dim.ny ? &e->y[i].tag : NULL;
    if (table == APC_SETPOINT)
        return i < e->dim.nz ? &e->z[i].tag : NULL;
    return i < e->dim.nu ? &e->u[i].tag : NULL;
}

static bool is_signal(const struct apc_tag *tag)
{
    return tag->table == APC_SENSOR || tag->table == APC_SETPOINT || tag->table == APC_ACTUATOR;
}

int provision_compare(const struct experiment *e, const struct apc_tag *tag, size_t n,
                      char why[PROVISION_TEXT])
{
    size_t signals = 0;
    for (size_t i = 0; i < n; i++) {
        if (!is_signal(&tag[i]))
            continue;
        signals++;
        const struct apc_tag *own = signal_of(e, tag[i].table, (size_t)tag[i].id - 1);
        if (own && !strcmp(own->name, tag[i].name) && !strcmp(own->unit, tag[i].unit))
            continue;
        snprintf(why, PROVISION_TEXT,
                 "it belongs to another experiment: its %s.%d is \"%s\" [%s], that of %s is \"%s\" [%s]",
                 apc_table_name(tag[i].table), tag[i].id, tag[i].name, tag[i].unit, e->name,
                 own ? own->name : "none", own ? own->unit : "");
        return APC_EPERM;
    }
    if (signals == 0 || signals == e->dim.ny + e->dim.nz + e->dim.nu)
        return 0;
    snprintf(why, PROVISION_TEXT, "it belongs to another experiment: it has %zu signals, %s has %zu", signals,
             e->name, e->dim.ny + e->dim.nz + e->dim.nu);
    return APC_EPERM;
}

/* The one that was described last says its name. */
static int compare_names(const struct experiment *e, const struct apc_tag *tag, size_t n,
                         char why[PROVISION_TEXT])
{
    for (size_t i = 0; i < n; i++)
        if (tag[i].table == APC_STATE && tag[i].id == 0 && strcmp(tag[i].description, e->name) != 0) {
            snprintf(why, PROVISION_TEXT, "it belongs to experiment %s, this is %s", tag[i].description,
                     e->name);
            return APC_EPERM;
        }
    return 0;
}

int provision_check(struct apc_store *store, const struct experiment *e, char why[PROVISION_TEXT])
{
    int n = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *tag = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *tag);
    if (!tag)
        return n < 0 ? n : APC_ENOMEM;
    int rc = apc_store_get_tags(store, tag, (size_t)n);
    if (rc >= 0) {
        size_t there = (size_t)(rc < n ? rc : n);
        if ((rc = compare_names(e, tag, there, why)) == 0)
            rc = provision_compare(e, tag, there, why);
    }
    free(tag);
    return rc;
}

/* ---- Writing ------------------------------------------------------------------------------ */

/* Write those of n samples that are not there yet (KEEP) or have another value (RESET). */
static int put_values(struct apc_store *store, struct apc_sample *wanted, size_t n, enum provision how)
{
    struct apc_sample *there = calloc(n + 1, sizeof *there);
    size_t changed = 0;
    if (!there)
        return APC_ENOMEM;
    memcpy(there, wanted, n * sizeof *there);
    int rc = apc_store_read(store, there, n);
    for (size_t i = 0; i < n && rc >= 0; i++)
        if (there[i].seq == 0 || (how == PROVISION_RESET && there[i].value != wanted[i].value))
            wanted[changed++] = wanted[i];
    if (rc >= 0 && changed > 0)
        rc = apc_store_put(store, wanted, changed);
    free(there);
    return rc < 0 ? rc : 0;
}

/*
 * Where the store says that a number of table tuning is another parameter, of another law or of another
 * version of it, what an operator wrote there is not meant for this one: it becomes the file's. @wanted is
 * [n] from id 1 on.
 */
static int put_renamed(struct apc_store *store, const struct experiment *e, const struct apc_sample *wanted,
                       size_t n)
{
    const int most = apc_store_get_tags(store, NULL, 0);
    size_t n_new, renamed = 0;
    struct apc_tag *new = provision_tags(e, &n_new);
    struct apc_tag *was = calloc(most > 0 ? (size_t)most : 1, sizeof *was);
    struct apc_sample *moved = calloc(n + 1, sizeof *moved);
    int rc = most < 0 ? most : new &&was &&moved ? apc_store_get_tags(store, was, (size_t)most) : APC_ENOMEM;

    for (int i = 0; i < rc && i < most; i++)
        for (size_t k = 0; was[i].table == APC_TUNING && k < n_new; k++)
            if (new[k].table == APC_TUNING &&new[k].id == was[i].id && strcmp(new[k].name, was[i].name) != 0)
                moved[renamed++] = wanted[new[k].id - 1];
    if (rc >= 0)
        rc = put_values(store, moved, renamed, PROVISION_RESET);
    free(moved);
    free(was);
    free(new);
    return rc;
}

/* Of table dim: how many there are of each, and what the law says that each output controls. */
static int put_dimensions(struct apc_store *store, const struct experiment *e, apc_ns now)
{
    const size_t nu = e->dim.nu, n = 3 + 2 * nu;
    const struct apc_law_setup setup = cores_law_setup(e->controllers);
    struct apc_sample *wanted = calloc(n, sizeof *wanted);
    struct apc_pair *pair = calloc(nu, sizeof *pair);
    int rc = wanted && pair ? apc_law_pairing(e->controllers->law, &setup, pair, NULL) : APC_ENOMEM;

    for (size_t i = 0; rc == 0 && i < n; i++)
        wanted[i] = (struct apc_sample){.table = APC_DIM, .id = (int)i + 1, .time = now};
    if (rc == 0) {
        wanted[0].value = (double)e->dim.ny;
        wanted[1].value = (double)e->dim.nz;
        wanted[2].value = (double)nu;
        for (size_t i = 0; i < nu; i++) {
            wanted[3 + 2 * i].value = (double)pair[i].measurement;
            wanted[4 + 2 * i].value = (double)pair[i].setpoint;
        }
        rc = put_values(store, wanted, n, PROVISION_RESET);
    }
    free(pair);
    free(wanted);
    return rc;
}

/* What operators set in a former run is no output of this one, whatever the clock said then: nothing is
 * deleted, but the newest rows are no good any more. */
static int forget_manual(struct apc_store *store, size_t nu, apc_ns now)
{
    struct apc_sample *rows = calloc(nu, sizeof *rows);
    size_t n = 0;
    if (!rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < nu; i++)
        rows[i] = (struct apc_sample){.table = APC_MANUAL, .id = (int)i + 1};
    int rc = apc_store_read(store, rows, nu);
    for (size_t i = 0; i < nu && rc >= 0; i++)
        if (rows[i].seq > 0 && apc_status_severity(rows[i].status) != APC_SEVERITY_BAD)
            rows[n++] = (struct apc_sample){
                .table = APC_MANUAL, .id = rows[i].id, .time = now, .status = APC_BAD_NO_DATA};
    if (rc >= 0 && n > 0)
        rc = apc_store_put(store, rows, n);
    free(rows);
    return rc < 0 ? rc : 0;
}

int provision(struct apc_store *store, const struct experiment *e, enum provision how)
{
    size_t tunings = apc_law_parameters(e->controllers->law, &e->dim);
    apc_ns now = apc_clock_utc(NULL);
    struct apc_sample *wanted = calloc(tunings + 1, sizeof *wanted);
    int rc = wanted ? put_dimensions(store, e, now) : APC_ENOMEM;
    if (rc < 0) {
        free(wanted);
        return rc;
    }
    for (size_t i = 0; i < tunings; i++)
        wanted[i] = (struct apc_sample){
            .table = APC_TUNING, .id = (int)i + 1, .time = now, .value = e->controllers->tuning[i]};
    wanted[tunings] =
        (struct apc_sample){.table = APC_OPMODE, .id = 0, .time = now, .value = e->controllers->mode};
    if (rc >= 0 && how == PROVISION_KEEP)
        rc = put_renamed(store, e, wanted, tunings);
    if (rc >= 0)
        rc = put_values(store, wanted, tunings + 1, how);
    if (rc >= 0 && how == PROVISION_RESET)
        rc = forget_manual(store, e->dim.nu, now);
    free(wanted);
    return rc < 0 ? rc : put_tags(store, e);
}
