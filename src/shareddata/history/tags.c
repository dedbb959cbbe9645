/* SPDX-License-Identifier: BSD-3-Clause */
/* Descriptions of variables, of one store beside another's. */
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "shareddata/shareddata_internal.h"

int apc_tags_load(struct apc_store *store, struct apc_tag **tags, size_t *n)
{
    const int most = apc_store_get_tags(store, NULL, 0);
    *tags = most > 0 ? (struct apc_tag *)calloc((size_t)most, sizeof **tags) : NULL;
    *n = 0;
    if (most <= 0 || !*tags) {
        return most > 0 ? APC_ENOMEM : most;
    }
    const int there = apc_store_get_tags(store, *tags, (size_t)most);
    *n = there > 0 ? (size_t)(there < most ? there : most) : 0;
    return there < 0 ? there : 0;
}

const struct apc_tag *apc_tag_of(const struct apc_tag *tags, size_t n, const struct apc_tag *like)
{
    for (size_t i = 0; i < n; i++) {
        if (tags[i].table == like->table && tags[i].id == like->id) {
            return &tags[i];
        }
    }
    return NULL;
}

bool apc_tags_alike(const struct apc_tag *a, const struct apc_tag *b)
{
    return strcmp(a->name, b->name) == 0 && strcmp(a->unit, b->unit) == 0 &&
           strcmp(a->description, b->description) == 0 && strcmp(a->controller, b->controller) == 0 &&
           strcmp(a->area, b->area) == 0 && a->low == b->low && a->high == b->high &&
           a->display_low == b->display_low && a->display_high == b->display_high && a->period == b->period &&
           a->step == b->step && a->length == b->length;
}

/* Two experiments in one store would be one series of each variable. */
int apc_tags_compare(const struct apc_tag *here, size_t n, const struct apc_tag *other, size_t n_other,
                     struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_tag *a = &here[i], *b = apc_tag_of(other, n_other, a);
        const bool experiment = a->table == APC_STATE, signal = a->table <= APC_SETPOINT;
        if (b && ((experiment && strcmp(a->description, b->description) != 0) ||
                  (signal && (strcmp(a->name, b->name) != 0 || strcmp(a->unit, b->unit) != 0)))) {
            return apc_fail(
                why, APC_EPERM,
                "it belongs to another experiment: its %s.%d is \"%s\" [%s], here it is \"%s\" [%s]",
                apc_table_name(b->table), b->id, experiment ? b->description : b->name, b->unit,
                experiment ? a->description : a->name, a->unit);
        }
    }
    return 0;
}
