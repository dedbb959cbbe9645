/* SPDX-License-Identifier: BSD-3-Clause */
/* The three standard streams: each number is taken, if need be by /dev/null. */
#include "common/streams.h"

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

void streams_keep(void)
{
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++)
        if (fcntl(fd, F_GETFD) < 0 && open("/dev/null", fd == STDOUT_FILENO ? O_RDONLY : O_WRONLY) != fd)
            abort(); /* the lowest number that is free is this one, unless there is no /dev/null */
}
