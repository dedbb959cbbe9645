/* SPDX-License-Identifier: BSD-3-Clause */
/* What a sensor shows. One draw of noise a look, faults or not: a fault changes no later noise. */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <stdio.h>

static int check_fault(const struct apc_sensor_fault *fault, size_t i, struct apc_error *why)
{
    if (fault->kind < APC_FAULT_STUCK || fault->kind > APC_FAULT_FROZEN)
        return apc_fail(why, APC_EINVAL, "sensor %zu: %d is no kind of fault", i + 1, (int)fault->kind);
    if (fault->at < 0 || fault->duration < 0 || !apc_value_ok(fault->size))
        return apc_fail(why, APC_EINVAL,
                        "sensor %zu: a fault's begin and duration must be 0 or above, its size finite",
                        i + 1);
    if (fault->kind == APC_FAULT_NOISE && fault->size < 0)
        return apc_fail(why, APC_EINVAL, "sensor %zu: noise of a fault is %g: must be 0 or above", i + 1,
                        fault->size);
    return 0;
}

int apc_sensors_check(const struct apc_sensor *sensor, size_t n, struct apc_error *why)
{
    int rc = 0;

    for (size_t i = 0; i < n && rc == 0; i++) {
        const struct apc_sensor *s = &sensor[i];

        if (s->period < 0)
            return apc_fail(why, APC_EINVAL, "sensor %zu: period %g s must be 0 or above", i + 1,
                            apc_ns_to_s(s->period));
        if (!(s->noise >= 0.0 && apc_value_ok(s->noise)) || !(s->quantum >= 0.0 && apc_value_ok(s->quantum)))
            return apc_fail(why, APC_EINVAL, "sensor %zu: noise %g and quantum %g must be 0 or above", i + 1,
                            s->noise, s->quantum);
        for (size_t k = 0; k < s->n_faults && rc == 0; k++)
            rc = check_fault(&s->fault[k], i, why);
    }
    return rc;
}

void apc_reading_init(struct apc_reading *reading, const struct apc_sensor *sensor, uint64_t seed, size_t i)
{
    char name[40];

    (void)snprintf(name, sizeof(name), "sensor.noise.%zu", i + 1);
    *reading = (struct apc_reading){.sensor = sensor, .before = -1};
    apc_random_init(&reading->noise, seed, name);
    (void)snprintf(name, sizeof(name), "sensor.fault.%zu", i + 1);
    apc_random_init(&reading->faulty, seed, name);
}

static bool active(const struct apc_sensor_fault *fault, apc_ns before, apc_ns t)
{
    if (t < fault->at)
        return false;
    if (fault->kind == APC_FAULT_SPIKE && before < fault->at)
        return true;
    return fault->duration == 0 ? fault->kind != APC_FAULT_SPIKE : t - fault->at < fault->duration;
}

bool apc_reading_due(const struct apc_reading *reading, apc_ns t)
{
    const apc_ns period = reading->sensor->period, before = reading->before;

    return period == 0 || before < 0 || t / period > before / period;
}

double apc_reading_take(struct apc_reading *reading, apc_ns t, double value, apc_status *status)
{
    const struct apc_sensor *s = reading->sensor;
    bool stuck = false;

    *status = APC_GOOD;
    reading->frozen = false;
    if (s->noise > 0.0)
        value += s->noise * apc_random_normal(&reading->noise);
    for (size_t k = 0; k < s->n_faults; k++) {
        const struct apc_sensor_fault *fault = &s->fault[k];

        if (!active(fault, reading->before, t))
            continue;
        switch (fault->kind) {
        case APC_FAULT_DRIFT:
            value += fault->size * apc_ns_to_s(t - fault->at);
            break;
        case APC_FAULT_SPIKE:
        case APC_FAULT_BIAS:
            value += fault->size;
            break;
        case APC_FAULT_NOISE:
            value += fault->size * apc_random_normal(&reading->faulty);
            break;
        case APC_FAULT_FROZEN:
            reading->frozen = reading->before >= 0;
            break;
        case APC_FAULT_DROPOUT:
            *status = APC_BAD_SENSOR_FAILURE;
            stuck = true;
            break;
        case APC_FAULT_STUCK:
            stuck = true;
            break;
        }
    }
    if (s->quantum > 0.0)
        value = s->quantum * round(value / s->quantum);
    if (!apc_value_ok(value))
        *status = APC_BAD_SENSOR_FAILURE;
    else if (!stuck || reading->before < 0)
        reading->shown = value;
    reading->before = t;
    return reading->shown;
}
