/* SPDX-License-Identifier: BSD-3-Clause */
#include "exitcode.h"

#include <apcbase.h>

int exit_code_of(int err)
{
    if (err >= 0)
        return EXIT_OK;
    switch (err) {
    case APC_ECONN:
        return EXIT_CONNECTION;
    case APC_ERANGE:
    case APC_EBUSY:
    case APC_ECONFLICT:
    case APC_EPERM:
        return EXIT_REJECTED;
    case APC_ETIMEDOUT:
    case APC_EOVERRUN:
        return EXIT_TIMEOUT;
    default:
        return EXIT_ERROR;
    }
}
