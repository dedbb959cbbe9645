/* SPDX-License-Identifier: BSD-3-Clause */
/* What all schemes have in common: which there are, one exchange at a time, and what a failed one gives. */
#include "base/base_internal.h"
#include "exchange/exchange_internal.h"

#include <stdlib.h>
#include <string.h>

static const struct apc_exchange_ops *const schemes[] = {&apc_exchange_tcp,    &apc_exchange_tls,
                                                         &apc_exchange_modbus, &apc_exchange_serial,
                                                         &apc_exchange_inproc, NULL};

static const struct apc_exchange_ops *find_scheme(const char *uri)
{
    for (size_t i = 0; schemes[i]; i++)
        if (!strncmp(uri, schemes[i]->scheme, strlen(schemes[i]->scheme)))
            return schemes[i];
    return NULL;
}

int apc_exchange_open(struct apc_exchange **exchange, const char *uri,
                      const struct apc_exchange_options *options, struct apc_error *why)
{
    struct apc_exchange_options o = {0};
    const struct apc_exchange_ops *ops;
    int rc;

    if (!exchange)
        return apc_fail(why, APC_EINVAL, "apc_exchange_open: exchange must not be NULL");
    *exchange = NULL;
    rc = apc_options_copy(&o, sizeof(o), options, "apc_exchange_options", why);
    if (rc < 0)
        return rc;
    ops = uri ? find_scheme(uri) : NULL;
    if (!ops)
        return apc_fail(
            why, APC_EINVAL,
            "plant \"%s\": unknown scheme; expected tcp:HOST:PORT, tls:HOST:PORT, modbus:HOST:PORT "
            "or serial:PATH",
            uri ? uri : "");
    if (!o.nu || o.nu > APC_EXCHANGE_VALUES || !o.ny || o.ny > APC_EXCHANGE_VALUES)
        return apc_fail(why, APC_EINVAL, "plant \"%s\": nu is %zu, ny is %zu; each must be 1 to %d", uri,
                        o.nu, o.ny, APC_EXCHANGE_VALUES);
    bool *commanded = calloc(2 * o.nu, sizeof(*commanded));
    if (!commanded)
        return apc_fail(why, APC_ENOMEM, "plant \"%s\": no memory", uri);
    rc = ops->open(exchange, uri, &o, why);
    if (rc < 0) {
        free(commanded);
        return rc;
    }
    (*exchange)->commanded = commanded;
    (*exchange)->ops = ops;
    (*exchange)->nu = o.nu;
    (*exchange)->ny = o.ny;
    return 0;
}

void apc_exchange_close(struct apc_exchange *x)
{
    if (!x)
        return;
    bool *commanded = x->commanded;
    x->ops->close(x);
    free(commanded);
}

bool apc_exchange_writes(const struct apc_value *u)
{
    return apc_status_severity(u->status) != APC_SEVERITY_BAD && apc_value_ok(u->value);
}

int apc_exchange_begin(struct apc_exchange *x, const struct apc_value *u, apc_ns deadline)
{
    int rc;

    if (x->begun)
        return apc_fail(&x->error, APC_EBUSY, "the previous exchange has not ended");
    x->refused = x->partly = false;
    rc = x->ops->begin(x, u, deadline);
    x->begun = rc == 0;
    return rc;
}

int apc_exchange_finish(struct apc_exchange *x, struct apc_value *y)
{
    int rc;

    if (!x->begun)
        return apc_fail(&x->error, APC_EINVAL, "no exchange was begun");
    rc = x->ops->finish(x, y);
    if (rc == APC_EBUSY)
        return rc;
    x->begun = false;
    if (rc == 0 && !x->partly)
        x->error.text[0] = '\0';
    for (size_t i = 0; rc < 0 && i < x->ny; i++)
        y[i] = (struct apc_value){.status = APC_BAD_NO_COMMUNICATION};
    return rc;
}

int apc_exchange_safe(struct apc_exchange *x, const bool *spared, apc_ns deadline)
{
    bool *which = x->commanded + x->nu, any = false;

    for (size_t i = 0; i < x->nu; i++) {
        which[i] = x->commanded[i] && !(spared && spared[i]);
        any = any || which[i];
    }
    return any && x->ops->safe ? x->ops->safe(x, which, deadline) : 0;
}

void apc_exchange_claim(struct apc_exchange *x, uint64_t number)
{
    if (x->ops->claim)
        x->ops->claim(x, number);
}

apc_status apc_exchange_read_back(const struct apc_exchange *x, size_t i, double *value)
{
    return x->ops->read_back && i < x->nu ? x->ops->read_back(x, i, value) : APC_GOOD;
}

bool apc_exchange_taken(const struct apc_exchange *x)
{
    return !x->refused;
}

const char *apc_exchange_error(const struct apc_exchange *x)
{
    return x->error.text;
}
