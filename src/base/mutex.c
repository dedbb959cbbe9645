/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcbase.h"

int apc_mutex_init(pthread_mutex_t *mutex)
{
    pthread_mutexattr_t attr;
    int e;

    if (!mutex)
        return APC_EINVAL;
    if (pthread_mutexattr_init(&attr))
        return APC_ESYS;
    e = pthread_mutexattr_setprotocol(&attr, PTHREAD_PRIO_INHERIT);
    if (!e)
        e = pthread_mutex_init(mutex, &attr);
    pthread_mutexattr_destroy(&attr);
    return e ? APC_ESYS : 0;
}
