/* SPDX-License-Identifier: BSD-3-Clause */
/* Parameters of a request that are numbers and times. */
#include "http.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

#define TIME_MAX 9e9 /* Unix seconds, and seconds before now, that apc_ns holds */

bool query_whole(struct request *r, const char *name, int64_t low, int64_t high, int64_t *value)
{
    const char *text = request_query(r, name);
    char *end;
    if (!text)
        return true;
    errno = 0;
    long long number = strtoll(text, &end, 10);
    if (end == text || *end || errno || number < low || number > high)
        return fault_set(&r->fault, 400, "parameter", name,
                         "\"%s\" must be a whole number from %" PRId64 " to %" PRId64, name, low, high);
    *value = number;
    return true;
}

bool time_parse(const char *text, apc_ns now, apc_ns *value)
{
    double seconds;
    if (apc_number_parse(text, &seconds) < 0)
        return apc_time_parse(text, value) == 0;
    if (fabs(seconds) > TIME_MAX || apc_ns_from_s(seconds, value) < 0)
        return false;
    if (seconds < 0)
        return !__builtin_add_overflow(now, *value, value);
    /* the microsecond that was meant: a double beside it is up to 0.2 us off */
    *value = (*value + APC_NS_PER_US / 2) / APC_NS_PER_US * APC_NS_PER_US;
    return true;
}

bool query_time(struct request *r, const char *name, apc_ns now, apc_ns *value)
{
    const char *text = request_query(r, name);
    if (!text || time_parse(text, now, value))
        return true;
    return fault_set(
        &r->fault, 400, "parameter", name,
        "\"%s\" must be Unix seconds, a time such as 2026-01-31T12:00:00Z, or negative seconds before now",
        name);
}
