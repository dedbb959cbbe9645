/* SPDX-License-Identifier: BSD-3-Clause */
#include "http.h"

#include <apcbase.h>

#include <arpa/inet.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <setjmp.h>

#include <cmocka.h>

static const char *source;

void http_from(const char *address)
{
    source = address;
}

static void bind_source(int fd)
{
    struct sockaddr_in own = {.sin_family = AF_INET};
    if (!source)
        return;
    assert_int_equal(inet_pton(AF_INET, source, &own.sin_addr), 1);
    assert_int_equal(bind(fd, (const struct sockaddr *)&own, sizeof own), 0);
}

int http_connect(int port)
{
    const struct timeval patience = {20, 0};
    const struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons((uint16_t)port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_true(fd >= 0);
    assert_int_equal(setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience), 0);
    bind_source(fd);
    if (connect(fd, (const struct sockaddr *)&address, sizeof address) < 0)
        fail_msg("nobody listens on port %d", port);
    return fd;
}

bool http_send(int fd, const char *bytes, size_t n)
{
    while (n > 0) {
        ssize_t sent = send(fd, bytes, n, MSG_NOSIGNAL);
        if (sent <= 0)
            return false;
        bytes += sent;
        n -= (size_t)sent;
    }
    return true;
}

/* Everything up to the end. */
static char *read_all(int fd, size_t *n)
{
    size_t room = 65536, got = 0;
    char *all = malloc(room + 1);
    ssize_t part;
    assert_non_null(all);
    while ((part = recv(fd, all + got, room - got, 0)) > 0) {
        got += (size_t)part;
        if (got == room) {
            all = realloc(all, 2 * room + 1);
            assert_non_null(all);
            room *= 2;
        }
    }
    all[got] = '\0';
    *n = got;
    return all;
}

static void unchunk(struct http_reply *reply)
{
    char *from = reply->body, *to = reply->body, *end = reply->body + reply->n;
    while (from < end) {
        char *data = strstr(from, "\r\n");
        unsigned long size = strtoul(from, NULL, 16);
        if (!data || size == 0 || size > (unsigned long)(end - data))
            break;
        memmove(to, data + 2, size);
        to += size;
        from = data + 2 + size + 2;
    }
    *to = '\0';
    reply->n = (size_t)(to - reply->body);
}

void http_raw(struct http_reply *reply, int port, const char *bytes, size_t n)
{
    size_t got;
    char text[64];
    int fd = http_connect(port);
    *reply = (struct http_reply){0};
    (void)http_send(fd, bytes, n); /* a server that has had enough answers, and closes */
    char *all = read_all(fd, &got), *end = strstr(all, "\r\n\r\n");
    close(fd);
    if (!end || sscanf(all, "HTTP/1.1 %d", &reply->status) != 1) {
        free(all);
        return;
    }
    end[2] = '\0';
    reply->n = got - (size_t)(end + 4 - all);
    reply->header = all;
    reply->body = malloc(reply->n + 1);
    assert_non_null(reply->body);
    memcpy(reply->body, end + 4, reply->n + 1);
    if (!strcasecmp(http_header(reply, "Transfer-Encoding", text, sizeof text), "chunked"))
        unchunk(reply);
}

APC_PRINTF(1, 2) static char *format(const char *fmt, ...)
{
    va_list args;
    char *text = NULL;
    va_start(args, fmt);
    assert_true(vasprintf(&text, fmt, args) >= 0);
    va_end(args);
    return text;
}

void http_request(struct http_reply *reply, int port, const char *method, const char *path,
                  const char *header, const char *body)
{
    char host[64] = "", length[64] = "";
    if (!header || !strcasestr(header, "Host:"))
        snprintf(host, sizeof host, "Host: 127.0.0.1:%d\r\n", port);
    if (body)
        snprintf(length, sizeof length, "Content-Length: %zu\r\n", strlen(body));
    char *text = format("%s %s HTTP/1.1\r\n%s%s%sConnection: close\r\n\r\n%s", method, path, host,
                        header ? header : "", length, body ? body : "");
    http_raw(reply, port, text, strlen(text));
    free(text);
}

void http_free(struct http_reply *reply)
{
    free(reply->header);
    free(reply->body);
    *reply = (struct http_reply){0};
}

char *http_header(const struct http_reply *reply, const char *name, char *to, size_t size)
{
    size_t n = strlen(name);
    *to = '\0';
    for (const char *at = reply->header; at; at = strstr(at, "\r\n")) {
        at += strncmp(at, "\r\n", 2) == 0 ? 2 : 0;
        if (!strncasecmp(at, name, n) && at[n] == ':') {
            at += n + 1 + strspn(at + n + 1, " ");
            snprintf(to, size, "%.*s", (int)strcspn(at, "\r"), at);
            break;
        }
    }
    return to;
}

/* ---- Streams ------------------------------------------------------------------------------ */

struct http_stream {
    FILE *in;
    size_t left; /* of the chunk */
    char *line, *data;
    size_t room;
};

/* One line of the chunked body; false: its end. */
static bool next_line(struct http_stream *s)
{
    size_t n = 0;
    for (;;) {
        char size[32];
        if (s->left == 0) {
            do
                if (!fgets(size, sizeof size, s->in))
                    return false;
            while (size[0] == '\r');
            s->left = strtoul(size, NULL, 16);
            if (s->left == 0)
                return false;
        }
        int c = fgetc(s->in);
        if (c == EOF)
            return false;
        s->left--;
        if (n + 1 >= s->room) {
            s->room = 2 * s->room + 256;
            s->line = realloc(s->line, s->room);
            assert_non_null(s->line);
        }
        if (c == '\n')
            break;
        s->line[n++] = (char)c;
    }
    s->line[n] = '\0';
    return true;
}

struct http_stream *http_stream_open(int port, const char *path, const char *header)
{
    struct http_stream *s = calloc(1, sizeof *s);
    char line[512];
    int status = 0, fd = http_connect(port);
    char *text = format("GET %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n%s\r\n", path, port, header ? header : "");
    assert_non_null(s);
    assert_true(http_send(fd, text, strlen(text)));
    free(text);
    s->in = fdopen(fd, "r");
    assert_non_null(s->in);
    bool at_once = false; /* else a proxy on the way keeps what is said until it has enough of it */
    while (fgets(line, sizeof line, s->in) && strcmp(line, "\r\n") != 0) {
        if (status == 0)
            (void)sscanf(line, "HTTP/1.1 %d", &status);
        at_once |= !strcmp(line, "X-Accel-Buffering: no\r\n");
    }
    assert_int_equal(status, 200);
    assert_true(at_once);
    return s;
}

bool http_stream_next(struct http_stream *s, struct http_message *m)
{
    free(s->data);
    s->data = NULL;
    *m = (struct http_message){0};
    while (next_line(s)) {
        if (s->line[0] == '\0' && s->data) {
            m->data = s->data;
            return true;
        }
        if (!strncmp(s->line, "id: ", 4))
            snprintf(m->id, sizeof m->id, "%s", s->line + 4);
        else if (!strncmp(s->line, "event: ", 7))
            snprintf(m->event, sizeof m->event, "%s", s->line + 7);
        else if (!strncmp(s->line, "data: ", 6))
            s->data = strdup(s->line + 6);
    }
    return false;
}

void http_stream_close(struct http_stream *s)
{
    if (!s)
        return;
    fclose(s->in);
    free(s->line);
    free(s->data);
    free(s);
}
