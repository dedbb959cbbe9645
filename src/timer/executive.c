/* SPDX-License-Identifier: BSD-3-Clause */
/* Executives by name. */
#include "base/base_internal.h"
#include "timer/timer_internal.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const struct apc_executive_ops *const executives[] = {&apc_executive_deadline, &apc_executive_posix,
                                                             &apc_executive_virtual, NULL};

static const struct apc_executive_ops *find_executive(const char *name)
{
    const struct apc_executive_ops *const *ops = executives;
    while (*ops && !(name && !strcmp((*ops)->name, name)))
        ops++;
    return *ops;
}

int apc_executive_create(struct apc_executive **executive, const char *name,
                         const struct apc_executive_options *options, struct apc_error *why)
{
    struct apc_executive_options o = {.size = sizeof o};
    int err;

    if (!executive)
        return apc_fail(why, APC_EINVAL, "no place for the executive");
    *executive = NULL;
    if ((err = apc_options_copy(&o, sizeof o, options, "apc_executive_options", why)) < 0)
        return err;
    const struct apc_executive_ops *ops = find_executive(name);
    if (!ops)
        return apc_fail(why, APC_EINVAL,
                        "no executive is called '%s': expected 'deadline', 'posix' or 'virtual'",
                        name ? name : "(null)");
    if (o.clock && ops->own_clock)
        return apc_fail(why, APC_EINVAL, "the executive '%s' is its own clock and takes no other", name);

    struct apc_executive *e = calloc(1, sizeof *e);
    if (!e)
        return apc_fail(why, APC_ENOMEM, "no memory for the executive '%s'", name);
    e->ops = ops;
    e->mono = apc_clock_system();
    e->utc = o.clock ? o.clock : apc_clock_system();
    e->log = o.log;
    e->begin = o.begin;
    if (ops->open && (err = ops->open(e)) < 0) {
        free(e);
        return apc_fail(why, err, "no memory for the executive '%s'", name);
    }
    e->latency = o.hold_latency ? apc_hold_latency(o.log) : -1;
    if (o.lock_memory)
        apc_lock_memory(o.log);
    *executive = e;
    return 0;
}

int apc_executive_destroy(struct apc_executive *executive)
{
    if (!executive)
        return 0;
    if (atomic_load(&executive->tasks) > 0)
        return APC_ESTATE;
    if (executive->ops->close)
        executive->ops->close(executive);
    if (executive->latency >= 0)
        close(executive->latency);
    free(executive);
    return 0;
}

const struct apc_clock *apc_executive_clock(const struct apc_executive *executive)
{
    return executive ? executive->utc : NULL;
}
