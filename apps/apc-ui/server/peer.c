/* SPDX-License-Identifier: BSD-3-Clause */
/* Whose process is at the other end: asked of the kernel, which keeps the owner of each socket. */
#include "connection_limits.h"

#include <arpa/inet.h>
#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

struct question {
    struct nlmsghdr head;
    struct inet_diag_req_v2 of;
};

static void put_address(const struct sockaddr_storage *address, __be16 *port, __be32 to[4])
{
    if (address->ss_family == AF_INET6) {
        struct sockaddr_in6 in6;
        memcpy(&in6, address, sizeof in6);
        *port = in6.sin6_port;
        memcpy(to, &in6.sin6_addr, 16);
    } else {
        struct sockaddr_in in;
        memcpy(&in, address, sizeof in);
        *port = in.sin_port;
        memcpy(to, &in.sin_addr, 4);
    }
}

/* The other end's socket is the one that has our addresses the other way round. */
static bool ask_kernel(int diag, const struct question *question, uid_t *uid)
{
    struct {
        struct nlmsghdr head;
        struct inet_diag_msg of;
        char more[1024];
    } answer;
    if (send(diag, question, sizeof *question, 0) != (ssize_t)sizeof *question)
        return false;
    ssize_t n = recv(diag, &answer, sizeof answer, 0);
    if (n < (ssize_t)(sizeof answer.head + sizeof answer.of) || answer.head.nlmsg_type != SOCK_DIAG_BY_FAMILY)
        return false;
    *uid = answer.of.idiag_uid;
    return answer.of.idiag_inode != 0; /* 0: its process has closed it, and the owner is no longer known */
}

bool peer_is_own(int fd)
{
    struct sockaddr_storage own = {0}, other = {0};
    socklen_t size = sizeof own, other_size = sizeof other;
    const struct timeval patience = {1, 0};
    uid_t uid;
    struct question question = {.head = {.nlmsg_len = sizeof question,
                                         .nlmsg_type = SOCK_DIAG_BY_FAMILY,
                                         .nlmsg_flags = NLM_F_REQUEST},
                                .of = {.sdiag_protocol = IPPROTO_TCP,
                                       .idiag_states = UINT32_MAX,
                                       .id.idiag_cookie = {INET_DIAG_NOCOOKIE, INET_DIAG_NOCOOKIE}}};
    if (getsockname(fd, (struct sockaddr *)&own, &size) < 0 ||
        getpeername(fd, (struct sockaddr *)&other, &other_size) < 0)
        return false;
    question.of.sdiag_family = (__u8)other.ss_family;
    put_address(&other, &question.of.id.idiag_sport, question.of.id.idiag_src);
    put_address(&own, &question.of.id.idiag_dport, question.of.id.idiag_dst);
    int diag = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_SOCK_DIAG);
    bool known = diag >= 0 && setsockopt(diag, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience) == 0 &&
                 ask_kernel(diag, &question, &uid);
    if (diag >= 0)
        close(diag);
    return known && uid == geteuid();
}
