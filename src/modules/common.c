/* SPDX-License-Identifier: BSD-3-Clause */
/* What more than one core needs. */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <stdio.h>

static int gravity(enum apc_notice_kind kind)
{
    switch (kind) {
    case APC_NOTICE_TRIP:
    case APC_NOTICE_FAULT:
    case APC_NOTICE_FAILED:
    case APC_NOTICE_RIVALS:
    case APC_NOTICE_FENCED:
        return 4;
    case APC_NOTICE_REJECTED:
    case APC_NOTICE_HOLD:
    case APC_NOTICE_CLOCK:
        return 3;
    case APC_NOTICE_RESUMED:
    case APC_NOTICE_RECOVERED:
        return 2;
    case APC_NOTICE_MODE:
    case APC_NOTICE_POOR:
    case APC_NOTICE_SAID:
        return 1;
    case APC_NOTICE_NONE:
        break;
    }
    return 0;
}

bool apc_note(struct apc_notice *notice, enum apc_notice_kind kind, const char *fmt, ...)
{
    va_list args;

    if (!notice)
        return true;
    if (gravity(notice->kind) >= gravity(kind))
        return false;
    notice->kind = kind;
    va_start(args, fmt);
    vsnprintf(notice->text, sizeof(notice->text), fmt, args);
    va_end(args);
    return true;
}

int apc_limits_copy(double *low, double *high, const double *from_low, const double *from_high, size_t n,
                    struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        low[i] = from_low ? from_low[i] : -HUGE_VAL;
        high[i] = from_high ? from_high[i] : HUGE_VAL;
        if (!(low[i] <= high[i]))
            return apc_fail(why, APC_EINVAL, "limits %zu: low %.15g must not be above high %.15g", i + 1,
                            low[i], high[i]);
    }
    return 0;
}

int apc_fallback_copy(double *to, const double *from, const double *low, const double *high, size_t n,
                      const char *what, struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        to[i] = from ? from[i] : 0.0;
        if (!apc_value_ok(to[i]) || to[i] < low[i] || to[i] > high[i])
            return apc_fail(why, APC_EINVAL,
                            "%s value %zu is %.15g; it must lie within the limits, %.15g to %.15g", what,
                            i + 1, to[i], low[i], high[i]);
    }
    return 0;
}
