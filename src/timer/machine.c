/* SPDX-License-Identifier: BSD-3-Clause */
/* What a real-time process asks of its machine. To be refused is no failure; the log says so. */
#include "timer/timer_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#define PAGE 4096

int apc_hold_latency(struct apc_log *log)
{
    static const char device[] = "/dev/cpu_dma_latency";
    const int32_t us = 0;
    int fd = open(device, O_WRONLY | O_CLOEXEC);

    if (fd >= 0 && write(fd, &us, sizeof us) == (ssize_t)sizeof us) {
        apc_log_write(log, APC_LOG_INFO, "%s is held at 0: idle CPUs do not sleep deeply", device);
        return fd;
    }
    apc_log_write(log, APC_LOG_WARN, "%s cannot be held at 0: %s; going on without", device, strerror(errno));
    if (fd >= 0)
        close(fd);
    return -1;
}

/*
 * Whether the process may lock more than its limit. Asked by doing it, with addresses only: a capability seen
 * in /proc may be one of a user namespace, which does not count here.
 */
static bool may_exceed(rlim_t limit)
{
    size_t size = (size_t)limit + PAGE;
    void *addresses = mmap(NULL, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_LOCKED, -1, 0);
    return addresses != MAP_FAILED && munmap(addresses, size) == 0;
}

void apc_lock_memory(struct apc_log *log)
{
    struct rlimit limit;

    if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY &&
        !may_exceed(limit.rlim_cur))
        apc_log_write(
            log, APC_LOG_INFO,
            "memory is not locked: RLIMIT_MEMLOCK is %llu KiB; grant CAP_IPC_LOCK or make it unlimited",
            (unsigned long long)limit.rlim_cur / 1024);
    else if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0)
        apc_log_write(log, APC_LOG_INFO, "memory is not locked: %s", strerror(errno));
    else
        apc_log_write(log, APC_LOG_INFO, "memory is locked");
}
