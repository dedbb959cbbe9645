/* SPDX-License-Identifier: BSD-3-Clause */
/* What instance.c is put together from. */
#ifndef APC_CONTROL_PARTS_H
#define APC_CONTROL_PARTS_H

#include "control/control_internal.h"

/** Refuse a setting that the law does not know. Returns 0 or APC_EINVAL. */
int apc_law_check_settings(const struct apc_law *law, const struct apc_law_setup *setup,
                           struct apc_error *why);

/** What belongs to @p output, as the law says or by default; all of it is there. Returns 0 or a negative
 * error. */
int apc_law_find_ports(const struct apc_law *law, const struct apc_law_setup *setup, size_t output,
                       struct apc_law_ports *ports, struct apc_error *why);

/** How many parameters of that scope the law, an output, or a measurement has. [tick] */
size_t apc_law_count(const struct apc_law *law, enum apc_law_scope scope);

/** A controller's setup as an instance for an output sees it. */
struct apc_law_view {
    struct apc_law_setup setup;
    struct apc_signal_view y[APC_LAW_PORTS], z[APC_LAW_PORTS], d[APC_LAW_PORTS];
    struct apc_law_plant plant;
    double *memory; /* of plant: to be freed */
};
/** Fill @p view, which borrows from @p whole. Returns 0 or APC_ENOMEM. */
int apc_law_view_setup(struct apc_law_view *view, const struct apc_law_setup *whole, size_t output,
                       const struct apc_law_ports *ports);

/** See apc_instances_mark(). */
uint32_t apc_law_mark(const struct apc_law *law, const struct apc_law_setup *setup, size_t states);

#endif
