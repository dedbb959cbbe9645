/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The plant as a Temperature Control Lab: a pseudo-terminal, under the name that it was given, in a thread of
 * its own. We keep the far end open too, so that the port outlives whoever opens and closes it.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include "plant.h"

#define LINE 128

/* The lines among the bytes: each is answered, and what is left of them stays. Returns how many bytes are
 * left. */
static size_t answer_lines(struct shell *s, char *bytes, size_t have)
{
    char reply[LINE], *end;
    while ((end = memchr(bytes, '\n', have))) {
        const size_t n = (size_t)(end + 1 - bytes);
        const int length = apc_tclab_answer(s->board.board, bytes, n, reply, sizeof reply);
        if (length > 0 && write(s->board.port, reply, (size_t)length) < 0 && errno != EAGAIN)
            apc_log_write(s->d->log, APC_LOG_WARN, "%s: %s", s->board.path, strerrordesc_np(errno));
        have -= n;
        memmove(bytes, bytes + n, have);
    }
    return have < LINE ? have : 0; /* no line is as long */
}

static void *run_tclab_port(void *arg)
{
    struct shell *s = arg;
    struct pollfd p[2] = {{.fd = s->board.wake, .events = POLLIN}, {.fd = s->board.port, .events = POLLIN}};
    char bytes[2 * LINE];
    size_t have = 0;

    while (poll(p, 2, -1) < 0 || !p[0].revents) {
        const ssize_t n = p[1].revents ? read(s->board.port, bytes + have, sizeof bytes - have) : 0;
        if (n > 0)
            have = answer_lines(s, bytes, have + (size_t)n);
    }
    return NULL;
}

static int fail_tclab_port(struct shell *s, struct apc_error *why, const char *what)
{
    snprintf(why->text, sizeof why->text, "serial port %s: %s: %s", s->board.path, what,
             strerrordesc_np(errno));
    s->board.path[0] = '\0'; /* not ours to remove */
    return APC_ESYS;
}

/* A link of ours from an earlier run that was killed leads nowhere, and is replaced. Anything else under this
 * name is somebody's: a plant's that runs, too. */
static bool is_left_over(const char *path)
{
    char to[64];
    const ssize_t n = readlink(path, to, sizeof to);
    return n > 9 && !memcmp(to, "/dev/pts/", 9) && access(path, F_OK) < 0;
}

static int make_port(struct shell *s, const char *path, struct apc_error *why)
{
    struct termios how;
    char name[64];

    if (snprintf(s->board.path, sizeof s->board.path, "%s", path) >= (int)sizeof s->board.path) {
        errno = ENAMETOOLONG;
        return fail_tclab_port(s, why, "this name cannot be given to it");
    }
    if (is_left_over(path)) /* before there is a new one, which may have the old one's number */
        unlink(path);
    s->board.port = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
    if (s->board.port < 0 || grantpt(s->board.port) < 0 || unlockpt(s->board.port) < 0 ||
        ptsname_r(s->board.port, name, sizeof name) != 0)
        return fail_tclab_port(s, why, "no pseudo-terminal can be had");
    s->board.kept = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (s->board.kept < 0 || tcgetattr(s->board.kept, &how) < 0)
        return fail_tclab_port(s, why, name);
    cfmakeraw(&how);
    if (tcsetattr(s->board.kept, TCSANOW, &how) < 0)
        return fail_tclab_port(s, why, name);
    if (symlink(name, path) < 0)
        return fail_tclab_port(s, why, "this name cannot be given to it");
    return 0;
}

int board_open(struct shell *s, const char *path, struct apc_error *why)
{
    const struct apc_tclab_options options = {.size = sizeof options,
                                              .nu = s->d->experiment.dim.nu,
                                              .ny = s->d->experiment.dim.ny,
                                              .command = gateway_command,
                                              .measure = gateway_measure,
                                              .ctx = s};
    sigset_t all, old;
    int rc = apc_tclab_create(&s->board.board, &options, why);

    if (rc == 0)
        rc = gateway_open(s, why);
    if (rc == 0)
        rc = make_port(s, path, why);
    if (rc < 0)
        return rc;
    s->gateway.connection = 1;
    s->board.wake = eventfd(0, EFD_CLOEXEC);
    sigfillset(&all); /* signals are the daemon's business */
    pthread_sigmask(SIG_SETMASK, &all, &old);
    errno = s->board.wake < 0 ? errno : pthread_create(&s->board.thread, NULL, run_tclab_port, s);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    if (errno) {
        unlink(path);
        return fail_tclab_port(s, why, "no thread can be had");
    }
    apc_log_write(s->d->log, APC_LOG_INFO, "a temperature control lab at serial port %s", path);
    return 0;
}

void board_close(struct shell *s)
{
    if (s->board.path[0]) {
        const uint64_t one = 1;
        while (write(s->board.wake, &one, sizeof one) < 0 && errno == EINTR)
            continue;
        pthread_join(s->board.thread, NULL);
        unlink(s->board.path);
    }
    for (const int *fd = (const int[]){s->board.port, s->board.kept, s->board.wake, 0}; *fd > 0; fd++)
        close(*fd);
    apc_tclab_destroy(s->board.board);
}
