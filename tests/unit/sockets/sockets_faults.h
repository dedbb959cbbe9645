/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the tests of links and servers share: system calls that fail to order, and a monotonic clock that
 * stands. These functions stand before libc's. Sends and receptions fail only on the socket under test, which
 * is the one that `UNDER_TEST` names: connected (by a link) or accepted (by a server) last.
 */
#ifndef APC_SOCKETS_FAULTS_H
#define APC_SOCKETS_FAULTS_H

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "apcbase.h"
#include "check.h"

enum call { PPOLL, SEND, RECV, CONNECT, SOCKET, ACCEPT, CALLS };

static struct {
    atomic_int calls;  /* so far */
    atomic_int after;  /* so many of the next succeed, */
    atomic_int times;  /* and so many then fail */
    atomic_int number; /* with this errno; 0: the call returns 0 instead, as a poll whose time is over */
    atomic_int most;   /* bytes that a send or a reception moves; 0: as many as there are */
} kernel[CALLS];

static atomic_int connected = -1, accepted = -1;
static atomic_int asked[64],
    n_asked;                    /* the last bytes of the IPv4 addresses that were connected to, in turn */
static _Atomic apc_ns standing; /* the monotonic clock stands here; 0: it runs */

static inline void order(enum call call, int number, int after, int times)
{
    atomic_store(&kernel[call].number, number);
    atomic_store(&kernel[call].after, after);
    atomic_store(&kernel[call].times, times);
}

static inline bool fails(enum call call)
{
    atomic_fetch_add(&kernel[call].calls, 1);
    if (atomic_load(&kernel[call].times) == 0)
        return false;
    if (atomic_load(&kernel[call].after) > 0) {
        atomic_fetch_sub(&kernel[call].after, 1);
        return false;
    }
    atomic_fetch_sub(&kernel[call].times, 1);
    errno = atomic_load(&kernel[call].number);
    return true;
}

static inline size_t part(enum call call, size_t size)
{
    size_t most = (size_t)atomic_load(&kernel[call].most);
    return most > 0 && most < size ? most : size;
}

int faulty_ppoll(struct pollfd *p, nfds_t n, const struct timespec *timeout,
                 const sigset_t *mask) __asm__("ppoll");
int faulty_ppoll(struct pollfd *p, nfds_t n, const struct timespec *timeout, const sigset_t *mask)
{
    struct timespec left = timeout ? *timeout : (struct timespec){0}; /* the kernel changes it */
    if (p->fd == atomic_load(&connected) && fails(PPOLL))
        return errno ? -1 : 0;
    return (int)syscall(SYS_ppoll, p, n, timeout ? &left : NULL, mask, (size_t)8);
}

ssize_t faulty_send(int fd, const void *data, size_t size, int flags) __asm__("send");
ssize_t faulty_send(int fd, const void *data, size_t size, int flags)
{
    if (fd == atomic_load(&UNDER_TEST)) {
        if (fails(SEND))
            return -1;
        size = part(SEND, size);
    }
    return syscall(SYS_sendto, fd, data, size, flags, NULL, 0);
}

ssize_t faulty_recv(int fd, void *data, size_t size, int flags) __asm__("recv");
ssize_t faulty_recv(int fd, void *data, size_t size, int flags)
{
    if (fd == atomic_load(&UNDER_TEST)) {
        if (fails(RECV))
            return -1;
        size = part(RECV, size);
    }
    return syscall(SYS_recvfrom, fd, data, size, flags, NULL, NULL);
}

/* One that is ordered to fail goes on in the background, as after EINPROGRESS or a signal. */
int faulty_connect(int fd, const struct sockaddr *address, socklen_t length) __asm__("connect");
int faulty_connect(int fd, const struct sockaddr *address, socklen_t length)
{
    int rc, number;
    if (address->sa_family == AF_INET) {
        struct sockaddr_in in;
        memcpy(&in, address, sizeof in);
        atomic_store(&asked[atomic_fetch_add(&n_asked, 1) % 64], (int)(ntohl(in.sin_addr.s_addr) & 255));
    }
    atomic_store(&connected, fd);
    rc = (int)syscall(SYS_connect, fd, address, length);
    number = errno;
    if (fails(CONNECT))
        return -1;
    errno = number;
    return rc;
}

int faulty_socket(int domain, int type, int protocol) __asm__("socket");
int faulty_socket(int domain, int type, int protocol)
{
    return fails(SOCKET) ? -1 : (int)syscall(SYS_socket, domain, type, protocol);
}

int faulty_accept(int fd, struct sockaddr *address, socklen_t *length, int flags) __asm__("accept4");
int faulty_accept(int fd, struct sockaddr *address, socklen_t *length, int flags)
{
    int connection = fails(ACCEPT) ? -1 : (int)syscall(SYS_accept4, fd, address, length, flags);
    if (connection >= 0)
        atomic_store(&accepted, connection);
    return connection;
}

int standing_clock(clockid_t id, struct timespec *t) __asm__("clock_gettime");
int standing_clock(clockid_t id, struct timespec *t)
{
    apc_ns at = id == CLOCK_MONOTONIC ? atomic_load(&standing) : 0;
    if (at == 0)
        return (int)syscall(SYS_clock_gettime, id, t);
    *t = (struct timespec){at / APC_NS_PER_S, at % APC_NS_PER_S};
    return 0;
}

/* As it was before a test: the clock runs, and nothing fails. */
static inline int mend(void **state)
{
    (void)state;
    atomic_store(&standing, 0);
    for (int i = 0; i < CALLS; i++) {
        order((enum call)i, 0, 0, 0);
        atomic_store(&kernel[i].most, 0);
    }
    return 0;
}

static inline int open_descriptors(void)
{
    int n = 0;
    DIR *folder = opendir("/proc/self/fd");
    assert_non_null(folder);
    while (readdir(folder))
        n++;
    closedir(folder);
    return n;
}

static inline int option_of(int fd, int level, int option)
{
    int value = -1;
    socklen_t size = sizeof value;
    assert_int_equal(getsockopt(fd, level, option, &value, &size), 0);
    return value;
}

/* Neither waits for more bytes before it sends, nor keeps a peer that died for longer than 20 s. */
static inline void assert_tuned(int fd)
{
    assert_int_equal(option_of(fd, IPPROTO_TCP, TCP_NODELAY), 1);
    assert_int_equal(option_of(fd, SOL_SOCKET, SO_KEEPALIVE), 1);
    assert_int_equal(option_of(fd, IPPROTO_TCP, TCP_KEEPIDLE), 5);
    assert_int_equal(option_of(fd, IPPROTO_TCP, TCP_KEEPINTVL), 5);
    assert_int_equal(option_of(fd, IPPROTO_TCP, TCP_KEEPCNT), 3);
    assert_int_equal(option_of(fd, IPPROTO_TCP, TCP_USER_TIMEOUT), 15000);
    assert_true(fcntl(fd, F_GETFL) & O_NONBLOCK);
    assert_true(fcntl(fd, F_GETFD) & FD_CLOEXEC);
}

#endif
