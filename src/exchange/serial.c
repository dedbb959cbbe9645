/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The scheme serial: a Temperature Control Lab at a serial port. begin sets its heaters, finish reads its
 * sensors: a line after the other, each with the line that answers it.
 *
 * Lines have no numbers. So whenever one was not answered in time, or not as it must be, nothing is believed
 * before the board has said its name again: it answers in order, so what came before that was for us no more.
 * The port stays open meanwhile: to open it restarts the board.
 */
#include "base/base_internal.h"
#include "exchange/exchange_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#define LINE      128 /* no line of a board is longer */
#define PAUSE     APC_NS_PER_S
#define RESTART   (3 * APC_NS_PER_S) /* of the board, which hears nothing meanwhile */
#define CHANNELS  2
#define COLDEST   (-50.0) /* what a sensor says at 0 V and, well above what it can, at 5 V */
#define HOTTEST   200.0
#define TOLERANCE 0.0051 /* of a heater's echo: hundredths */

struct serial {
    struct apc_exchange x;
    char *path;
    int fd; /* -1: closed */
    bool agreed;
    apc_ns open_at;  /* not before: mono */
    apc_ns asked_at; /* for its name, mono; 0: it was told */
    apc_ns deadline;
    double safe[CHANNELS];
    char bytes[2 * LINE]; /* come, and not yet looked at */
    size_t have;
};

/* ---- The port -------------------------------------------------------------------------------- */

static int lose_serial_line(struct serial *s, int err, const char *what)
{
    close(s->fd);
    s->fd = -1;
    s->agreed = false;
    s->open_at = apc_clock_mono(NULL) + PAUSE;
    return apc_fail(&s->x.error, err, "%s: %s", s->path, what);
}

static int open_port(struct serial *s)
{
    struct termios how;

    if (apc_clock_mono(NULL) < s->open_at)
        return apc_fail(&s->x.error, APC_ECONN, "%s: lost; trying again once a second", s->path);
    s->fd = open(s->path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (s->fd < 0) {
        s->open_at = apc_clock_mono(NULL) + PAUSE;
        return apc_fail(&s->x.error, APC_ECONN, "cannot open %s: %s", s->path, strerrordesc_np(errno));
    }
    if (tcgetattr(s->fd, &how) < 0)
        return lose_serial_line(s, APC_ECONN, "not a serial port");
    if (flock(s->fd, LOCK_EX | LOCK_NB) < 0)
        return lose_serial_line(s, APC_ECONN, "another program has it");
    cfmakeraw(&how);
    how.c_cflag |= CLOCAL | CREAD;
    cfsetspeed(&how, B115200);
    if (tcsetattr(s->fd, TCSANOW, &how) < 0)
        return lose_serial_line(s, APC_ECONN, "cannot be set to 115200 baud");
    s->have = 0;
    s->asked_at = 0;
    return 0;
}

/* 1: ready, or a negative error. */
static int wait_for_serial(struct serial *s, short events)
{
    struct pollfd p = {.fd = s->fd, .events = events};
    const apc_ns left = s->deadline - apc_clock_mono(NULL);
    const struct timespec t = {left / APC_NS_PER_S, left % APC_NS_PER_S};
    const int n = left > 0 ? ppoll(&p, 1, &t, NULL) : 0;

    if (n > 0 && (p.revents & (POLLERR | POLLHUP | POLLNVAL)) && !(p.revents & events))
        return lose_serial_line(s, APC_ECONN, "the board is gone");
    return n == 0 ? apc_fail(&s->x.error, APC_ETIMEDOUT, "%s: the board does not answer in time", s->path)
                  : 1;
}

static int send_serial_line(struct serial *s, const char *line)
{
    size_t n = strlen(line);

    while (n > 0) {
        int rc = wait_for_serial(s, POLLOUT);
        if (rc < 0)
            return rc;
        const ssize_t sent = write(s->fd, line, n);
        if (sent < 0 && errno != EAGAIN && errno != EINTR)
            return lose_serial_line(s, APC_ECONN, strerrordesc_np(errno));
        if (sent > 0) {
            line += sent;
            n -= (size_t)sent;
        }
    }
    return 0;
}

/* The next line, without its end. */
static int read_serial_line(struct serial *s, char line[LINE])
{
    for (;;) {
        const char *end = memchr(s->bytes, '\n', s->have);
        if (end || s->have >= LINE) {
            const size_t n = end ? (size_t)(end - s->bytes) : s->have, whole = end ? n + 1 : n;
            const size_t kept = n >= LINE ? 0 : n > 0 && s->bytes[n - 1] == '\r' ? n - 1 : n;
            memcpy(line, s->bytes, kept); /* one that is too long is as good as none */
            line[kept] = '\0';
            s->have -= whole;
            memmove(s->bytes, s->bytes + whole, s->have);
            return 0;
        }
        int rc = wait_for_serial(s, POLLIN);
        if (rc < 0)
            return rc;
        const ssize_t n = read(s->fd, s->bytes + s->have, sizeof(s->bytes) - s->have);
        if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR))
            return lose_serial_line(s, APC_ECONN, n == 0 ? "the board is gone" : strerrordesc_np(errno));
        s->have += n > 0 ? (size_t)n : 0;
    }
}

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Its name, and nothing of before. It is asked once, and again when that may have been lost: a second answer
 * would stand in the way. */
static int agree(struct serial *s)
{
    const apc_ns now = apc_clock_mono(NULL);
    char line[LINE];
    int rc = 0;

    if (!s->asked_at || now - s->asked_at > RESTART) {
        s->asked_at = now;
        rc = send_serial_line(s, "VER\r\n");
    }
    while (rc == 0 && !s->agreed) {
        rc = read_serial_line(s, line);
        s->agreed = rc == 0 && !strncmp(line, "TCLab", 5);
    }
    if (s->agreed)
        s->asked_at = 0;
    return rc;
}

/* As an Arduino prints it. */
static int read_number(const char *line, double *number)
{
    static const char *const none[] = {"nan", "inf", "-inf", "ovf", "-ovf"};

    for (size_t i = 0; i < sizeof(none) / sizeof(none[0]); i++) {
        if (!strcmp(line, none[i])) {
            *number = (double)NAN;
            return 0;
        }
    }
    return apc_number_parse(line, number);
}

/* A line that is answered by a number, of which it may say that it is none. */
static int request_number(struct serial *s, const char *request, double *number)
{
    char line[LINE];
    int rc = s->have
                 ? apc_fail(&s->x.error, APC_EPROTO, "%s: the board sent more than it was asked for", s->path)
                 : send_serial_line(s, request);

    if (rc == 0)
        rc = read_serial_line(s, line);
    if (rc == 0 && read_number(line, number) < 0)
        rc = apc_fail(&s->x.error, APC_EPROTO, "%s: the board answers %.2s by \"%.40s\", not by a number",
                      s->path, request, line);
    s->agreed = s->agreed && rc == 0;
    return rc;
}

static int set_heater(struct serial *s, size_t i, double percent)
{
    const long hundredths = lround(percent * 100.0);
    char line[LINE];
    double echo;

    (void)snprintf(line, sizeof(line), "Q%zu %ld.%02ld\r\n", i + 1, hundredths / 100, hundredths % 100);
    s->x.commanded[i] = true;
    int rc = request_number(s, line, &echo);
    if (rc == 0 && !(fabs(echo - percent) < TOLERANCE)) {
        s->agreed = false;
        return apc_fail(&s->x.error, APC_EPROTO, "%s: heater %zu was set to %g %%, and the board says %g",
                        s->path, i + 1, percent, echo);
    }
    return rc;
}

static int ready(struct serial *s, apc_ns deadline)
{
    s->deadline = deadline;
    int rc = s->fd < 0 ? open_port(s) : 0;
    int unasked = 0;
    if (rc == 0 && (s->have || (ioctl(s->fd, FIONREAD, &unasked) == 0 && unasked > 0)))
        s->agreed = false; /* the next answer would be taken for another's */
    return rc == 0 && !s->agreed ? agree(s) : rc;
}

/* ---- The scheme ------------------------------------------------------------------------------ */

static bool heats(double percent)
{
    return percent >= 0.0 && percent <= 100.0;
}

static int serial_begin(struct apc_exchange *x, const struct apc_value *u, apc_ns deadline)
{
    struct serial *s = (struct serial *)x;

    for (size_t i = 0; u && i < x->nu; i++)
        if (apc_exchange_writes(&u[i]) && !heats(u[i].value))
            return apc_fail(&x->error, APC_ERANGE, "output %zu is %g: a heater takes 0 to 100 %%", i + 1,
                            u[i].value);
    int rc = ready(s, deadline);
    for (size_t i = 0; u && i < x->nu && rc == 0; i++)
        if (apc_exchange_writes(&u[i]))
            rc = set_heater(s, i, u[i].value);
    return rc;
}

static int serial_finish(struct apc_exchange *x, struct apc_value *y)
{
    struct serial *s = (struct serial *)x;
    int rc = 0;

    for (size_t i = 0; i < x->ny && rc == 0; i++) {
        double celsius = 0.0;
        rc = request_number(s, i ? "T2\r\n" : "T1\r\n", &celsius);
        y[i] = (struct apc_value){.value = celsius, .time = apc_clock_utc(NULL)};
        if (!(celsius > COLDEST && celsius < HOTTEST))
            y[i].status = APC_BAD_SENSOR_FAILURE;
        if (isnan(celsius))
            y[i].value = 0.0;
    }
    return rc;
}

static int serial_safe(struct apc_exchange *x, const bool *which, apc_ns deadline)
{
    struct serial *s = (struct serial *)x;
    int rc = ready(s, deadline);

    for (size_t i = 0; i < x->nu && rc == 0; i++)
        if (which[i])
            rc = set_heater(s, i, s->safe[i]);
    return rc;
}

static void serial_close(struct apc_exchange *x)
{
    struct serial *s = (struct serial *)x;

    if (s->fd >= 0)
        close(s->fd);
    free(s->path);
    free(s);
}

static int serial_open(struct apc_exchange **x, const char *uri, const struct apc_exchange_options *options,
                       struct apc_error *why)
{
    struct serial *s;

    if (options->nu > CHANNELS || options->ny > CHANNELS)
        return apc_fail(why, APC_EINVAL,
                        "plant \"%s\": a temperature control lab has two heaters and two sensors", uri);
    for (size_t i = 0; options->safe && i < options->nu; i++)
        if (!heats(options->safe[i]))
            return apc_fail(why, APC_EINVAL, "plant \"%s\": safe value %zu is %g: a heater takes 0 to 100 %%",
                            uri, i + 1, options->safe[i]);
    s = calloc(1, sizeof(*s));
    if (s)
        s->path = strdup(uri + strlen("serial:"));
    if (!s || !s->path) {
        free(s);
        return apc_fail(why, APC_ENOMEM, "plant \"%s\": no memory", uri);
    }
    s->fd = -1;
    for (size_t i = 0; options->safe && i < options->nu; i++)
        s->safe[i] = options->safe[i];
    *x = &s->x;
    return 0;
}

const struct apc_exchange_ops apc_exchange_serial = {.scheme = "serial:",
                                                     .open = serial_open,
                                                     .close = serial_close,
                                                     .begin = serial_begin,
                                                     .finish = serial_finish,
                                                     .safe = serial_safe};
