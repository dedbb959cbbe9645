/* SPDX-License-Identifier: BSD-3-Clause */
/* Where the server listens, and where it refuses to. */
#include "http.h"

#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>

static bool is_loopback(const struct sockaddr *address)
{
    if (address->sa_family == AF_INET)
        return ntohl(((const struct sockaddr_in *)(const void *)address)->sin_addr.s_addr) >> 24 == 127;
    return address->sa_family == AF_INET6 &&
           IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)(const void *)address)->sin6_addr);
}

static int check_binding(const struct ui *ui, const struct sockaddr *address, struct apc_error *why)
{
    const struct ui_options *o = &ui->options;
    if (is_loopback(address))
        return 0;
    if (ui->open)
        return apc_fail(
            why, APC_EPERM,
            "--listen %s: everybody could operate the plant: first make users with `apc user add`",
            o->listen);
    if (!ui->tls && !o->allow_plaintext)
        return apc_fail(why, APC_EPERM,
                        "--listen %s: passwords would cross the network in the clear: give --tls-cert and "
                        "--tls-key, or --allow-plaintext if something in front does TLS",
                        o->listen);
    return 0;
}

/* getaddrinfo() takes the lower 16 bits of whatever it is given. */
static bool is_port(const char *text)
{
    size_t n = strlen(text);
    return n > 0 && n <= 5 && strspn(text, "0123456789") == n && strtol(text, NULL, 10) <= 65535;
}

/* Does the kernel say whose connections are? Where it does not, nobody gets in. */
static void check_peers(const struct ui *ui, int listener, const struct sockaddr_in6 *bound, socklen_t size)
{
    int far = socket(bound->sin6_family, SOCK_STREAM | SOCK_CLOEXEC, 0), near = -1;
    if (far >= 0 && connect(far, (const struct sockaddr *)bound, size) == 0)
        near = accept4(listener, NULL, NULL, SOCK_CLOEXEC);
    if (near >= 0 && !peer_is_own(near))
        apc_log_write(
            ui->log, APC_LOG_WARN,
            "this system does not tell whose connections are (sock_diag), so nobody can use the page "
            "without a login: make users with `apc user add`");
    if (near >= 0)
        close(near);
    if (far >= 0)
        close(far);
}

/* listen_on_addresses() reads the port of either as that of the first. */
_Static_assert(offsetof(struct sockaddr_in6, sin6_port) == offsetof(struct sockaddr_in, sin_port), "port");

int listen_on_addresses(struct ui *ui, struct apc_error *why)
{
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM,
                                   .ai_flags = AI_NUMERICHOST | AI_NUMERICSERV | AI_PASSIVE};
    const char *text = ui->options.listen, *colon = strrchr(text, ':');
    struct addrinfo *found = NULL;
    struct sockaddr_in6 bound = {0};
    socklen_t size = sizeof bound;
    char host[64] = "";
    const int on = 1;

    if (colon && colon - text < (ptrdiff_t)sizeof host)
        snprintf(host, sizeof host, "%.*s", (int)(colon - text), text);
    size_t n = strlen(host);
    if (n > 1 && host[0] == '[' && host[n - 1] == ']') {
        host[n - 1] = '\0';
        memmove(host, host + 1, n - 1);
    } else if (strchr(host, ':')) { /* where does its port begin? */
        host[0] = '\0';
    }
    if (!host[0] || !is_port(colon + 1) || getaddrinfo(host, colon + 1, &hints, &found) != 0)
        return apc_fail(why, APC_EINVAL,
                        "--listen \"%s\": must be ADDRESS:PORT, such as 127.0.0.1:8080 or [::1]:8080", text);
    int rc = check_binding(ui, found->ai_addr, why), fd = -1;
    if (rc == 0 && sd_listen_fds(1) == 1) {
        fd = SD_LISTEN_FDS_START; /* from systemd, or `apc run` */
        if (fcntl(fd, F_SETFL, O_NONBLOCK) < 0 || getsockname(fd, (struct sockaddr *)&bound, &size) < 0)
            rc = apc_fail(why, APC_ESYS, "--listen %s: the socket handed over: %s", text, strerror(errno));
        else
            rc = check_binding(ui, (const struct sockaddr *)&bound, why);
    } else if (rc == 0) {
        fd = socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
        if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) < 0 ||
            bind(fd, found->ai_addr, found->ai_addrlen) < 0 || listen(fd, 128) < 0 ||
            getsockname(fd, (struct sockaddr *)&bound, &size) < 0)
            rc = apc_fail(why, APC_ESYS, "--listen %s: %s%s", text, strerror(errno),
                          errno == EADDRINUSE ? "; stop the program that has this port, or choose another"
                                              : "");
    }
    freeaddrinfo(found);
    if (rc < 0) {
        if (fd >= 0)
            close(fd);
        return rc;
    }
    ui->port = ntohs(bound.sin6_port);
    if (ui->open)
        check_peers(ui, fd, &bound, size);
    return fd;
}
