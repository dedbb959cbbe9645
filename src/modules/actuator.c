/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Where an actuator stands, that is commanded and may be faulty. Stiction is of He, Wang, Pottmann and Qin
 * (Ind. Eng. Chem. Res. 46, 2007), in the parameters S and J of Choudhury, Thornhill and Shah (Control Eng.
 * Practice 13, 2005): static friction (S + J) / 2, kinetic friction (S - J) / 2. Without a jump it is backlash.
 */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <math.h>

static int check_actuator_fault(const struct apc_actuator_fault *fault, size_t i, struct apc_error *why)
{
    if (fault->kind < APC_ACTUATOR_STUCK || fault->kind > APC_ACTUATOR_POWER)
        return apc_fail(why, APC_EINVAL, "actuator %zu: %d is no kind of fault", i + 1, (int)fault->kind);
    if (fault->at < 0 || fault->duration < 0)
        return apc_fail(why, APC_EINVAL, "actuator %zu: a fault's begin and duration must be 0 or above",
                        i + 1);
    if (!(fault->size >= 0.0 && apc_value_ok(fault->size)) ||
        !(fault->jump >= 0.0 && apc_value_ok(fault->jump)))
        return apc_fail(why, APC_EINVAL, "actuator %zu: size %g and jump %g of a fault must be 0 or above",
                        i + 1, fault->size, fault->jump);
    if (!(fault->low <= fault->high && apc_value_ok(fault->low) && apc_value_ok(fault->high)))
        return apc_fail(why, APC_EINVAL,
                        "actuator %zu: low %g and high %g of a fault must be finite, and not fall", i + 1,
                        fault->low, fault->high);
    return 0;
}

int apc_actuators_check(const struct apc_actuator *actuator, size_t n, struct apc_error *why)
{
    int rc = 0;

    for (size_t i = 0; i < n && rc == 0; i++)
        for (size_t k = 0; k < actuator[i].n_faults && rc == 0; k++)
            rc = check_actuator_fault(&actuator[i].fault[k], i, why);
    return rc;
}

static double held_by_friction(double command, double position, double size, double jump)
{
    const double kinetic = (size - jump) / 2;

    if (fabs(command - position) <= (size + jump) / 2)
        return position;
    return command > position ? command - kinetic : command + kinetic;
}

double apc_actuator_move(const struct apc_actuator *actuator, apc_ns before, apc_ns t, double command,
                         double position)
{
    double to = command;

    for (size_t k = 0; k < actuator->n_faults; k++) {
        const struct apc_actuator_fault *fault = &actuator->fault[k];

        if (t < fault->at || (fault->duration > 0 && t - fault->at >= fault->duration))
            continue;
        switch (fault->kind) {
        case APC_ACTUATOR_STUCK:
            to = position;
            break;
        case APC_ACTUATOR_STICTION:
            to = held_by_friction(to, position, fault->size, fault->jump);
            break;
        case APC_ACTUATOR_BACKLASH:
            to = held_by_friction(to, position, fault->size, 0.0);
            break;
        case APC_ACTUATOR_RATE: {
            const double reach = fault->size * apc_ns_to_s(t - before);

            to = fmin(fmax(to, position - reach), position + reach);
            break;
        }
        case APC_ACTUATOR_SATURATION:
            to = fmin(fmax(to, fault->low), fault->high);
            break;
        case APC_ACTUATOR_REVERSE:
            to = fault->low + fault->high - to;
            break;
        case APC_ACTUATOR_POWER:
            to = fault->low;
            break;
        }
    }
    return to;
}
